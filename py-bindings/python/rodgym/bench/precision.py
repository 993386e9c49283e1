"""Error against cost of every stepper: a free swing of 1 s from the horizontal, no damping.

The error is the distance of the tip from where the same model ends with very small steps; so it
speaks of steppers, not of differences between models. The cost is that of an environment step of
10 ms: of a batch of 256 through `gym.make_vec` for ours, of the bare `mj_step` for MuJoCo.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rodgym.bench import mujoco_models
from rodgym.bench.measure import Case, measure
from rodgym.bench.ours import SWING_UP, batch
from rodgym.bench.peers import mujoco
from rodgym.extras import installed
from rodgym.sim import Pendulum

DURATION = 1.0
ENVS = 256
#: Ours: family, stepper, physics steps [s].
OURS = (
    ("rodgym Verlet", "verlet", (1e-4, 2e-4, 5e-4)),
    ("rodgym implicit", "implicit", (5e-4, 1e-3, 2e-3, 5e-3)),
    ("rodgym TR-BDF2", "tr_bdf2", (1e-3, 2e-3, 5e-3)),
    ("rodgym ESDIRK3", "esdirk3", (1e-3, 2e-3, 5e-3, 1e-2)),
    ("rodgym backward Euler", "backward_euler", (1e-4, 5e-4, 2e-3)),
)
#: MuJoCo: family, model, integrator, physics steps [s].
THEIRS = (
    ("MuJoCo chain RK4", mujoco_models.chain, "RK4", (1e-3, 2e-3, 5e-3, 1e-2)),
    ("MuJoCo chain implicitfast", mujoco_models.chain, "implicitfast", (5e-4, 2e-3, 5e-3)),
    ("MuJoCo chain Euler", mujoco_models.chain, "Euler", (1e-4, 5e-4, 2e-3)),
    ("MuJoCo flex Euler", mujoco_models.flex, "Euler", (5e-5, 1e-4, 2e-4)),
)


@dataclass(frozen=True)
class Point:
    """One stepper at one step: cost of an environment step [s], error of the tip [m]."""

    family: str
    dt: float
    cost: float
    error: float


def points(rounds: int, seconds: float) -> list[Point]:
    """Measures costs, interleaved, and errors."""
    found: list[tuple[str, float, float, Case]] = []
    truth = rodgym_tip("verlet", 1e-5)
    for family, stepper, steps in OURS:
        for dt in steps:
            try:
                error = distance(rodgym_tip(stepper, dt), truth)
            except ValueError:
                continue  # beyond what is stable: refused at construction
            kwargs: dict[str, Any] = {"stepper": stepper, "physics_dt": dt, "bending_damping": 0.0}
            found.append((family, dt, error, batch(family, SWING_UP, ENVS, **kwargs)))
    if installed("mujoco"):
        references: dict[Callable[[str, float], str], npt.NDArray[np.float64]] = {
            mujoco_models.chain: mujoco_tip(mujoco_models.chain, "RK4", 1e-4),
            mujoco_models.flex: mujoco_tip(mujoco_models.flex, "RK4", 5e-5),
        }
        for family, model, integrator, steps in THEIRS:
            for dt in steps:
                error = distance(mujoco_tip(model, integrator, dt), references[model])
                if np.isfinite(error):
                    found.append((family, dt, error, mujoco(family, model(integrator, dt), 0.0)))
    timings = measure([case for *_, case in found], rounds, seconds)
    return [
        Point(family, dt, timing.cost, error)
        for (family, dt, error, _), timing in zip(found, timings, strict=True)
    ]


def distance(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> float:
    """Distance of two tips [m]."""
    return float(np.hypot(*(a - b)))


def rodgym_tip(stepper: str, dt: float) -> npt.NDArray[np.float64]:
    """Where the tip of ours ends [m]."""
    rod = Pendulum(stepper=stepper, physics_dt=dt, bending_damping=0.0)
    rod.set_angles([np.pi / 2] * 6)
    rod.step(0.0, n=round(DURATION / dt))
    return rod.positions[-1]


def mujoco_tip(
    model: Callable[[str, float], str], integrator: str, dt: float
) -> npt.NDArray[np.float64]:
    """Where MuJoCo's tip ends [m]."""
    import mujoco as mj

    compiled = mj.MjModel.from_xml_string(model(integrator, dt))
    data = mj.MjData(compiled)
    mj.mj_step(compiled, data, round(DURATION / dt))
    mj.mj_kinematics(compiled, data)
    mj.mj_flex(compiled, data)
    tip = data.site("tip").xpos if compiled.nsite else data.flexvert_xpos[-1]
    return np.array([tip[0], tip[2]])
