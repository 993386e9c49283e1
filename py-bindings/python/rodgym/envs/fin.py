"""The flexible fin."""

from __future__ import annotations

from typing import Any

from rodgym.envs.arguments import documented
from rodgym.envs.rod_env import RodEnv


@documented("rodgym/FinThrust-v0")
class FinEnv(RodEnv):
    r"""A flexible fin that is pitched near its nose and pushed by the water that it moves.

    ## Description

    A fin of silicone sits in a slow flow. It is 140 mm long and 115 mm high, thick at its nose and
    thin at its tail. A servo pitches it near the nose: it turns the edge behind the third node, and
    the rest of the fin follows. This is the fin of T. T. Burch's thesis (2019, chapters 2 and 3).

    The fin is modelled as a discrete elastic rod in a plane whose section varies. The water follows
    an improved Lighthill model. It adds mass to the fin, takes momentum with it where it is shed at
    the tail, and resists by drag and friction. x points downstream; thrust is positive upstream.
    Equations and errata of the thesis are in docs/physics.md.

    | id | task | observation | episode |
    |---|---|---|---|
    | `rodgym/FinThrust-v0` | much thrust for little power, stiffness unknown | 26 | 200 steps |
    | `rodgym/FinEfficiency-v0` | a demanded thrust at the least power | 28 | 200 steps |
    | `rodgym/FinSwim-v0` | swim forward with a hull, water at rest | 27 | 250 steps |

    In `FinThrust` the stiffness of the fin, Young's modulus, is drawn anew for each episode:
    log-uniform in [3e4, 3e6] Pa, which is about the soft fin's 2.5e5 Pa. If `youngs_modulus` or
    `randomize` is given, that holds instead. The reason: for a fin that is known beforehand, the
    best sinusoid comes within a few percent of the best waveform, and there is little to learn. A
    fin that must be felt is worth controlling.

    ## Action Space

    `Box(-1, 1, (1,), float32)`. The action is held for one control step, `control_dt` (40 ms).
    Values beyond the bounds are clipped. NaN and infinity are refused.

    The action is a command for the pitch. Two things stand between it and the fin. A low-pass
    filter smooths the command (Butterworth, order ten, `command_cutoff` 3 Hz). It delays the
    command by a third of a second and overshoots a step by a sixth. A servo then follows the
    smoothed command (second order, 40 rad/s, critically damped, at most 6 rad/s). Of a sine of 2 Hz
    97 % arrive, of one of 3 Hz 63 %, of 4 Hz 5 %, and of 5 Hz and above less than 1 %. Faster
    motion is kept out because the model of the water does not hold there.

    | number | action | unit |
    |---|---|---|
    | 0 | pitch command / `pitch_limit`, counter-clockwise positive | 1 (0.349 rad at 1) |

    ## Observation Space

    `Box(-10, 10, float32)`. Larger values are clipped. With N = 8 nodes:

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

    `observation="camera"` replaces the first 2N+10 numbers: it shows the last command, and y of
    every node over the length of an edge. The full observation hides nothing of the servo and the
    low-pass. It does not show the parameters of the episode, nor a command that `actuator_delay`
    holds back, nor the stretch of the edges, which is tiny.

    ## Rewards

    Terms are in `info["reward_terms"]` and add up to the reward. T is the thrust that the water
    gives for good: the momentum shed at the tail and the resistive forces. The momentum that is
    lent to the moved water does not count, because it comes back. P is the power of the servo,
    which counts only while the servo gives it. w is `power_weight`.

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

    The terms are clipped at these bounds, which lie far from what a fin can do. In between they are
    linear: a power term that saturates would pay for bursts.

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
