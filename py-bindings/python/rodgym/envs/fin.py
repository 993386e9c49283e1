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

    What was tried to earn without swimming well, why the low-pass is so steep, and what learned
    policies return beside sinusoids is in docs/records/fin-rewards.md.

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
