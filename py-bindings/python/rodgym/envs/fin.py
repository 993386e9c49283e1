"""The flexible fin."""

from __future__ import annotations

from typing import Any

from rodgym.envs.arguments import documented
from rodgym.envs.rod_env import RodEnv


@documented("rodgym/FinThrust-v0")
class FinEnv(RodEnv):
    r"""A flexible fin that is pitched near its nose and pushed by the water that it moves.

    ## Description

    The silicone fin of the thesis (chapters 2 and 3): 140 mm long, 115 mm high, thick at its
    nose and thin at its tail, in a slow flow. A servo pitches the edge behind the third node;
    the rest follows as a planar discrete elastic rod of varying section. The water is an
    improved Lighthill model: added mass that is part of the implicit step, momentum shed at the
    tail, drag and friction. Equations and errata are in docs/physics.md. x points downstream;
    thrust is positive upstream.

    | id | task | observation | episode |
    |---|---|---|---|
    | `rodgym/FinThrust-v0` | much thrust for little power, stiffness unknown | 26 | 200 steps |
    | `rodgym/FinEfficiency-v0` | a demanded thrust at the least power | 28 | 200 steps |
    | `rodgym/FinSwim-v0` | swim forward with a hull, water at rest | 27 | 250 steps |

    In `FinThrust` Young's modulus is drawn for each episode, log-uniform in [3e4, 3e6] Pa (about
    the soft fin's 2.5e5 Pa), unless `youngs_modulus` or `randomize` is given: for a
    fin that is known beforehand the best sinusoid comes within a few percent of the best
    waveform; one that must be felt is worth controlling.

    ## Action Space

    `Box(-1, 1, (1,), float32)`, held for `control_dt` (40 ms). Values beyond are clipped, NaN and
    infinity are refused. A low-pass smooths the command (Butterworth, order ten, `command_cutoff`
    3 Hz; it comes a third of a second later and overshoots a step by a sixth), and the servo
    (second order, 40 rad/s, critically damped, at most 6 rad/s) follows what is left: 97 % of a
    sine of 2 Hz, 63 % at 3 Hz, 5 % at 4 Hz, less than 1 % at 5 Hz and above, where the model of the
    water does not hold.

    | number | action | unit |
    |---|---|---|
    | 0 | pitch command / `pitch_limit`, counter-clockwise positive | 1 (0.349 rad at 1) |

    ## Observation Space

    `Box(-10, 10, float32)`; what exceeds is clipped. With N = 8 nodes:

    | numbers | observation | unit |
    |---|---|---|
    | 0 | pitch | 0.5 rad |
    | 1 | pitch rate | 6 rad/s |
    | 2, 4 ... 10 | command after each of the five stages of the low-pass | 0.5 rad |
    | 3, 5 ... 11 | their rates | 6 rad/s |
    | 12 ... N+9 | turning angles at nodes 2 ... N-1 | 0.5 rad |
    | N+10 ... 2N+7 | their rates | 5 rad/s |
    | 2N+8 | mean thrust of the last step, momentum of the moved water included | 0.5 N |
    | 2N+9 | mean torque of the servo in the last step | 0.1 N m |
    | then, Efficiency | demanded thrust; shed thrust smoothed over 0.5 s | 0.5 N |
    | then, Swim | forward speed of the hull | 0.5 m/s |

    `observation="camera"` shows the last command and y of every node / edge length instead of the
    first 2N+10 numbers. The full observation hides nothing of servo and low-pass; it does not show
    the parameters of the episode, a command that `actuator_delay` holds back, and the stretch of
    the edges, which is tiny.

    ## Rewards

    Terms are in `info["reward_terms"]` and add up to the reward. Thrust T is what water gives for
    good: momentum shed at the tail and resistive forces, not the momentum lent to the moved water
    (it comes back). Power P counts only while the servo gives it; w is `power_weight`.

    | task | term | value | range |
    |---|---|---|---|
    | Thrust | `thrust` | T / 0.25 N | -4 ... 4 |
    | | `power` | -w P / 0.075 W | -16 ... 0 |
    | Efficiency | `tracking` | 1 / (1 + (smoothed T / demand - 1)^2 / 0.25^2) | 0 ... 1 |
    | | `power` | -0.5 w P / (0.2 W/N demand) | -16 ... 0 |
    | Swim | `speed` | forward speed / 0.1 m/s | -4 ... 4 |
    | | `power` | -w P / 0.05 W | -16 ... 0 |

    `power_weight` is 1, and 0.5 with `thesis=True`, whose stiff and damped fin would earn
    nothing at the usual price of power, however it is moved.

    The bounds are clips far from what a fin can do, so that the terms are linear in between: a
    saturating power term would pay for bursts.

    What was tried to earn without swimming well. Every step of a periodic command of 2 to 17 steps
    was free, and evolved for a known fin (20 generations of 48); so were the first and the last 15
    steps around a good sinusoid. Returns of 200 steps, sinusoids beginning at phase 0:

    | fin | best sinusoid to 5 Hz | above 5 Hz | best pattern | of it, period < 0.2 s |
    |---|---|---|---|---|
    | Thrust, 8e4 Pa | 29.0 (2.5 Hz) | 0.0 | 30.2 (2.5 Hz) | 0.5 |
    | Thrust, 2.5e5 Pa | 55.0 (3.25 Hz) | 0.1 | 55.5 (3.1 Hz) | 0.8 |
    | Thrust, 8e5 Pa | 60.9 (3.5 Hz) | -0.2 | 65.0 (3.6 Hz) | 0.1 |
    | Thrust, 1.6e6 Pa | 3.0 (3.75 Hz) | -0.2 | 3.2 (3.6 Hz) | -0.6 |
    | Thrust, 8.11e6 Pa | 1.9 (0.75 Hz) | -0.6 | -0.4 (1.5 Hz) | -0.6 |
    | Thrust, `thesis=True` | 13.3 (1.25 Hz) | -0.5 | 13.8 (1.5 Hz) | -0.5 |
    | Efficiency, demand 0.1 N | 87.2 (3.25 Hz) | 11.6 | 98.3 (1.6 Hz) | 11.6 |
    | Swim | 155.2 (3.25 Hz) | 35.4 | 157.7 (1.5 Hz) | 61.7 |
    | Swim, `thesis=True` | 36.5 (1.0 Hz) | 0.2 | 37.0 (1.5 Hz) | 1.3 |

    (11.6 is what FinEfficiency gives for no thrust at all, 61.7 the glide of a hull after a
    single stroke: a pattern that goes on to hold.) So a slow gait with a better waveform can
    earn a few percent more than a sinusoid, and nothing above 5 Hz earns more than a slow gait
    or holding still. That holds for every stiffness from 3e4 to 1e7 Pa, in flows from 0 to 0.3
    m/s, in all three tasks and for the thesis' fin, for sinusoids, patterns of 2 to 4 steps,
    and random commands without slow parts; the closest is still water at 1.6 MPa, 9.6 at 5.25
    Hz against 17.9. Chatter on top of a gait is hardly felt (what leaks through may tune the
    thrust of a gait in FinEfficiency, by 5 at most). Holding still earns nothing, one stroke to
    any other pitch less than 1 in FinThrust. Other first 15 steps earn 0.9 more in FinThrust,
    12 in FinSwim (sooner at speed), 13 in FinEfficiency (the smoothed thrust comes sooner to
    the demand: that is the task); other last 15 steps 0.4, 0.9 and 1.9 (the last stroke is paid
    by the step after; the hull glides). Kicks of power in one step of eight paid in
    FinEfficiency while its power term was clipped at -1.5; it no longer is. Fast commands,
    chatter, holding, the single stroke and the kicks are tests (env-core/tests/fin_env.rs).

    Why a low-pass so steep: the fin's wet bending mode is at 11.8 Hz times the root of E / 8.11
    MPa, and beating at it pays wherever it is, also where the model of the water is not to be
    trusted. A bare command (`command_cutoff=None`) of 2 degrees at 11.5 Hz returns 69 at 8.11
    MPa, where no slow one earns anything. Order four still loses at 2 MPa, whose mode lies at
    5.9 Hz (52 against 39), order eight in still water (23 against 17 at 1.7 MPa), order ten
    nowhere.

    In FinThrust, on the 50 seeds 500 to 549 that chose nothing, the best sinusoid (3.1 Hz, 11
    degrees of command) returns 31.5, the best squared sine 30.8, the best triangle 30.3 (the best
    sinusoid in hindsight, on a fine grid over these very seeds: 32.3), PPO (recipe and policy in
    `rodgym/zoo`, 1.5e6 steps in 14 minutes on two busy cores) 35.9, 14 % more, and SAC (recipe in
    `rodgym/zoo`, 60 000 steps in 3.5 minutes) 37.1, 18 % more. Other seeds give other margins: on
    2000 to 2049 PPO returns 34.0, SAC 32.5, the sinusoid 25.2. PPO feels the stiffness: it beats at
    2.2 Hz with the softest quarter of the fins (24.0 against 16.6) and with 3.1 Hz where the
    sinusoid fits (60.1 against 61.0), and wastes less power on the stiffest fins (23.3 against 13.7
    in the stiffest quarter). Its efficiency is 23.9 % against 26.0 %, over all episodes. `rodgym
    compare --env rodgym/FinThrust-v0 --policy zoo --controller gait-sine --seeds 500:550` shows it.

    Further numbers in `info` at each step: `thrust`, `mount_thrust`, `shed_thrust` [N],
    `torque` [N m], `power` [W] (means over the step), `pitch` [rad], `efficiency` (Froude:
    speed times impulse over work since the episode began, 0 up to 1 mJ of work), `strouhal`
    (frequency and wake width of the last full period), `thrust_coefficient` (thesis 3.2);
    Efficiency: `demand`, `smooth_thrust` [N]; Swim: `hull_speed` [m/s], `cost_of_transport` (P
    / (m g speed)).

    ## Starting State

    Straight and at rest at pitch U(-0.1, 0.1) rad (`start_pitch`), the servo told to stay there.
    Efficiency: demand U(0.02, 0.15) N (`demand`). `info["parameters"]` has the episode's physical
    parameters.

    `reset(options={...})` sets an episode exactly: `"parameters": {"youngs_modulus": 1e6}`, and
    `"state": {"positions": [[x, y], ...], "velocities": ...}` (one a node, m and m/s, the pivot at
    the origin and the driven edge at its rest length).

    ## Episode End

    Truncation after 200 or 250 steps (`gym.make(..., max_episode_steps=)`), or when the solver
    fails even with its smallest steps; then `info["solver_failure"]` is True and the
    observation is still finite. A million random steps of each fin had no failure
    (docs/fin-soak.md).

    ## Arguments

    [arguments]

    ```python
    >>> import gymnasium as gym
    >>> env = gym.make("rodgym:rodgym/FinThrust-v0", youngs_modulus=1e6)
    >>> observation, info = env.reset(seed=0)
    >>> observation.shape, info["parameters"]["youngs_modulus"]
    ((26,), 1000000.0)

    ```

    ## Version History

    * v0: first version.
    """

    def __init__(self, env_id: str = "rodgym/FinThrust-v0", **kwargs: Any) -> None:
        super().__init__(env_id, **kwargs)
