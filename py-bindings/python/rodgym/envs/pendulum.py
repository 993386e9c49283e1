"""The elastic pendulum."""

from __future__ import annotations

from typing import Any

from rodgym.envs.arguments import documented
from rodgym.envs.rod_env import RodEnv


@documented("rodgym/PendulumSwingUp-v0")
class PendulumEnv(RodEnv):
    r"""A flexible rod, hinged at its base, driven by a torque there.

    ## Description

    A rod of length L, soft as silicone, hangs from a hinge. A motor turns its first edge. The agent
    must swing the rod up, or keep it upright. The rod bends while it swings. When it stands, it
    would buckle under its own weight, so feedback has to keep it straight. This is the elastic
    pendulum of T. T. Burch's thesis (2019).

    The rod is modelled by `nodes` nodes in a plane, which are joined by straight edges that can
    stretch. It has a signed curvature, gravity, and Kelvin-Voigt damping of its bending. Equations
    and errata of the thesis are in docs/physics.md.

    | id | task | observation | episode |
    |---|---|---|---|
    | `rodgym/PendulumSwingUp-v0` | from hanging to upright, and stay | every edge | 500 steps |
    | `rodgym/PendulumBalance-v0` | stay upright | every edge | until it falls, or 1000 steps |
    | `rodgym/PendulumSwingUpBase-v0` | as SwingUp | base edge only | 500 steps |

    ## Action Space

    `Box(-1, 1, (1,), float32)`. The action is held for one control step, `control_dt` (10 ms).
    Values beyond the bounds are clipped. NaN and infinity are refused.

    | number | action | unit |
    |---|---|---|
    | 0 | base torque / `torque_limit`, counter-clockwise positive | 1 (0.05 N m at 1) |

    ## Observation Space

    `Box(float32)` with finite bounds. theta_k is the angle of edge k from hanging, counted
    counter-clockwise. A hanging edge has cos = 1, an upright one cos = -1. With n = `nodes` - 1
    edges (6):

    | numbers | observation | bound | unit |
    |---|---|---|---|
    | 0 ... n-1 | cos(theta_k) | 1 | 1 |
    | n ... 2n-1 | sin(theta_k) | 1 | 1 |
    | 2n ... 3n-1 | rate of theta_k | 20, clipped | 10 rad/s |

    `observation="base"` shows cos, sin and rate of the first edge only: what an encoder on the
    motor measures. `observation="tip"` shows the position of the tip, x and y over L (bound 2), and
    its velocity over 10 rad/s L (bound 20).

    ## Rewards

    Terms are in `info["reward_terms"]` and add up to the reward. y is the height of the tip above
    the hinge, a the action.

    | task | term | value | range |
    |---|---|---|---|
    | SwingUp | `height` | (1 + y / L) / 2 | 0 ... 1 |
    | | `rate` | -0.05 min(1, mean (rate / 20 rad/s)^2) | -0.05 ... 0 |
    | | `effort` | -0.02 a^2 | -0.02 ... 0 |
    | Balance | `upright` | 1 while y > L / 2 | 0 or 1 |
    | | `effort` | -0.02 a^2 | -0.02 ... 0 |

    The LQR returns 471 in SwingUp (437 with the thesis' swing-up) and 1000 in Balance; registered
    as solved are 400 and 950.

    Further numbers in `info` at each step: `tip_height` y / L, `upright_error` (root mean square
    over the edges of the distance between tangent and up: for small angles the angle in rad, 2 when
    hanging) and `torque` [N m].

    ## Starting State

    SwingUp: straight rod at rest (`start_rate`: turning), angle U(-0.1, 0.1) rad from hanging
    (`start_angle`). Balance: at
    rest, base angle pi + U(-0.05, 0.05) rad, bent so that the angle grows by U(-0.2, 0.2) rad from
    first to last edge (`start_bend`). `info["parameters"]` has the episode's physical parameters.

    `reset(options={...})` sets an episode exactly: `"parameters": {"width": 0.0081}`, and `"state":
    {"angles": [...], "rates": [...]}` (one an edge, rad and rad/s) or `{"positions": [[x, y], ...],
    "velocities": ...}` (one a node, m and m/s).

    ## Episode End

    Termination: Balance only, when the tip falls below L / 2. Truncation: after 500 or 1000 steps
    (`gym.make(..., max_episode_steps=)`), or when the solver fails even with its smallest steps;
    then `info["solver_failure"]` is True and the observation is still finite.

    ## Arguments

    [arguments]

    ```python
    >>> import gymnasium as gym
    >>> env = gym.make("rodgym:rodgym/PendulumSwingUp-v0", width=0.0081)
    >>> observation, info = env.reset(seed=0)
    >>> observation.shape, info["parameters"]["width"]
    ((18,), 0.0081)

    ```

    ## Version History

    * v0: first version.
    """

    def __init__(self, env_id: str = "rodgym/PendulumSwingUp-v0", **kwargs: Any) -> None:
        super().__init__(env_id, **kwargs)
