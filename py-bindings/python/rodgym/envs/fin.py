"""The flexible fin."""

from __future__ import annotations

from typing import Any

from rodgym.envs.rod_env import RodEnv


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
    | `rodgym/FinThrust-v0` | much thrust for little power, stiffness unknown | 17 | 200 steps |
    | `rodgym/FinEfficiency-v0` | a demanded thrust at the least power | 19 | 200 steps |
    | `rodgym/FinSwim-v0` | swim forward with a hull, water at rest | 18 | 250 steps |

    In `FinThrust` Young's modulus is drawn for each episode, log-uniform in [8e4, 8e5] Pa (its
    median is the soft fin's 2.5e5 Pa), unless `youngs_modulus` or `randomize` is given: for a
    fin that is known beforehand the best sinusoid comes within a few percent of the best
    waveform; one that must be felt is worth controlling.

    ## Action Space

    `Box(-1, 1, (1,), float32)`, held for `control_dt` (40 ms). Values beyond are clipped, NaN and
    infinity are refused. The command follows the action by at most `action_rate_limit` a step, and
    the servo (second order, 40 rad/s, critically damped, at most 6 rad/s) follows the command.

    | number | action | unit |
    |---|---|---|
    | 0 | pitch command / `pitch_limit`, counter-clockwise positive | 1 (0.349 rad at 1) |

    ## Observation Space

    `Box(-10, 10, float32)`; what exceeds is clipped. With N = 8 nodes:

    | numbers | observation | unit |
    |---|---|---|
    | 0 | pitch | 0.5 rad |
    | 1 | pitch rate | 6 rad/s |
    | 2 | last command, after its rate limit | 1 |
    | 3 ... N | turning angles at nodes 2 ... N-1 | 0.5 rad |
    | N+1 ... 2N-2 | their rates | 5 rad/s |
    | 2N-1 | mean thrust of the last step, momentum of the moved water included | 0.5 N |
    | 2N | mean torque of the servo in the last step | 0.1 N m |
    | then, Efficiency | demanded thrust; shed thrust smoothed over 0.5 s | 0.5 N |
    | then, Swim | forward speed of the hull | 0.5 m/s |

    `observation="camera"` shows the last command and y of every node / edge length instead of the
    first 2N+1 numbers.

    ## Rewards

    Terms are in `info["reward_terms"]` and add up to the reward. Thrust T is what water gives for
    good: momentum shed at the tail and resistive forces, not the momentum lent to the moved water
    (it comes back). Power P counts only while the servo gives it.

    | task | term | value | range |
    |---|---|---|---|
    | Thrust | `thrust` | T / 0.25 N | -4 ... 4 |
    | | `power` | -P / 0.075 W | -16 ... 0 |
    | Efficiency | `tracking` | 1 / (1 + (smoothed T / demand - 1)^2 / 0.25^2) | 0 ... 1 |
    | | `power` | -0.5 P / (0.2 W/N demand) | -16 ... 0 |
    | Swim | `speed` | forward speed / 0.1 m/s | -4 ... 4 |
    | | `power` | -P / 0.05 W | -16 ... 0 |

    The bounds are clips far from what a fin can do, so that the terms are linear in between: a
    saturating power term would pay for bursts.

    What was tried to earn without swimming well. Every step of a periodic command of 2 to 17 steps
    was free, and evolved for a known fin (30 generations of 48); so were the first and the last 15
    steps around the best sinusoid. Returns:

    | fin | best sinusoid to 5 Hz | above 5 Hz | best pattern | of it, period < 0.2 s |
    |---|---|---|---|---|
    | Thrust, 8e4 Pa | 29.4 | -0.8 | 33.1 (2.5 Hz) | -0.3 |
    | Thrust, 2.5e5 Pa | 58.1 | 46.7 (5.25 Hz) | 59.0 (3.1 Hz) | 34.6 |
    | Thrust, 8e5 Pa | 90.4 | 85.1 (5.25 Hz) | 93.3 (1.5 Hz) | 28.7 |
    | Efficiency, demand 0.1 N | 100.5 | 71.6 (6 Hz) | 101.6 (4.2 Hz) | 61.9 |
    | Swim | 164.5 | 157.8 (5.25 Hz) | 164.5 (3.1 Hz) | 145.3 |

    So a slow gait with a better waveform can earn a few percent more than a sinusoid; a command
    without a slow gait cannot. Chatter on top of a good gait costs; holding still earns nothing,
    one stroke to any other pitch less than 1 in FinThrust (a hull does glide on it). Other first 15
    steps earn 0.5 more in FinThrust, 4 in FinSwim (sooner at speed), 14 in FinEfficiency (the
    smoothed thrust comes sooner to the demand: that is the task); other last 15 steps 1.1 and 4.5
    (the last stroke is paid by the step after; the hull glides). Kicks of power in one step of
    eight paid in FinEfficiency while its power term was clipped at -1.5; it no longer is. Fast
    sinusoids, chatter, holding, the single stroke and the kicks are tests
    (env-core/tests/fin_env.rs).

    That holds for the stiffness of the defaults. The fin's wet bending mode is at 11.8 Hz times the
    root of E / 8.11 MPa, and beating at it pays wherever it is: above about 1.5 MPa the best
    sinusoid is faster than 5 Hz (7 Hz at 2 MPa, 12 Hz at 8.11 MPa, where slower ones earn nothing
    in FinThrust). There the model of the water is not to be trusted.

    In FinThrust, on the 50 seeds 500 to 549 that chose nothing, the best sinusoid (3.25 Hz, 6.5
    degrees of command) returns 50.4, the best triangle 49.7, the best squared sine 46.3 (the best
    sinusoid in hindsight, on a fine grid over these very seeds: 50.6), and PPO (recipe and policy
    in `rodgym/zoo`, 0.9e6 steps in 13 minutes on two busy cores) 58.7: 16 % more. It feels the
    stiffness and beats at 1.9 Hz with the softest quarter of the range and at 5.0 Hz with the
    stiffest, where one sinusoid has to do for all; its waveform is nearly a sine. Its efficiency is
    25.8 % against 24.4 %. `rodgym compare --env
    rodgym/FinThrust-v0 --policy zoo --controller gait-sine --seeds 500:550` shows it.

    Further numbers in `info` at each step: `thrust`, `mount_thrust`, `shed_thrust` [N],
    `torque` [N m], `power` [W] (means over the step), `pitch` [rad], `efficiency` (Froude:
    speed times impulse over work since the episode began), `strouhal` (frequency and wake width
    of the last full period), `thrust_coefficient` (thesis 3.2); Efficiency: `demand`,
    `smooth_thrust` [N]; Swim: `hull_speed` [m/s], `cost_of_transport` (P / (m g speed)).

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

    | keyword | default | unit | meaning |
    |---|---|---|---|
    | `youngs_modulus` | 2.5e5 | Pa | Young's modulus |
    | `damping` | 0 | kg/s | force -damping v at each node |
    | `bending_damping` | 0 | s | Kelvin-Voigt bending damping |
    | `density` | 1100 | kg/m^3 | density of the fin |
    | `flow_speed` | 0.05 | m/s | speed of the water (Swim: 0, the water is at rest) |
    | `added_mass_coefficient` | 0.5 | | added mass over that of a long plate |
    | `friction_coefficient` | 0.016 | | friction along the fin |
    | `drag_coefficient` | 1.2 | | drag across the fin |
    | `hull_mass` | 1 | kg | mass of the hull (Swim) |
    | `hull_drag_area` | 0.006 | m^2 | drag coefficient times frontal area of the hull (Swim) |
    | `hydrodynamics` | `"lighthill"` | | or `"morison"`, `"resistive"`, `"air"` |
    | `pitch_limit` | 0.349 | rad | pitch at action 1, at most 30 degrees |
    | `action_rate_limit` | 0.5 | 1 | largest change of the command in a step |
    | `geometry` | Table 3.1 | m, m^2 | {"edge_length", "height", "pivot", "widths", "areas"} |
    | `stiffness_profile` | 1 at each node | 1 | multiplies `youngs_modulus`, node by node |
    | `observation` | `"full"` | | `"full"` or `"camera"` |
    | `control_dt` | 0.04 | s | duration of a step, a multiple of `physics_dt` |
    | `physics_dt` | chosen | s | 4e-3 with BDF2, 1e-3 with backward Euler |
    | `stepper` | `"auto"` | | `"bdf2"` (auto) or `"backward_euler"` |
    | `start_pitch` | (-0.1, 0.1) | rad | range of the start pitch |
    | `demand` | (0.02, 0.15) | N | range of the demanded thrust (Efficiency) |
    | `randomize` | see above | | {parameter: (low, high)}, drawn each episode |
    | `sensor_noise` | {} | rad, rad/s | {"angle": std, "rate": std} |
    | `actuator_delay` | 0 | s | by which the command lags behind the action |
    | `thesis` | False | | the thesis' material (8.11 MPa, damping 0.1238 kg/s) and stepper |
    | `render_mode` | None | | `"rgb_array"`, `"human"` |

    ```python
    >>> import gymnasium as gym
    >>> env = gym.make("rodgym:rodgym/FinThrust-v0", youngs_modulus=1e6)
    >>> observation, info = env.reset(seed=0)
    >>> observation.shape, info["parameters"]["youngs_modulus"]
    ((17,), 1000000.0)

    ```

    ## Version History

    * v0: first version.
    """

    def __init__(self, env_id: str = "rodgym/FinThrust-v0", **kwargs: Any) -> None:
        super().__init__(env_id, **kwargs)
