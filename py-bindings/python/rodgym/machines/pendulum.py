"""The elastic pendulum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgym.machines.description import (
    GAIN,
    NOISE,
    Band,
    Column,
    Description,
    Floats,
    Quantity,
    Trace,
    factor,
    lag,
)

if TYPE_CHECKING:
    from rodgym.evaluation import Evaluation
    from rodgym.evaluation.score import Trajectories

#: Upright at the end: the mean height of the tip over the last second exceeds this share of L.
UPRIGHT_MEAN_HEIGHT = 0.95
#: The time to upright is that from which on the tip stays above this share of L.
UPRIGHT_HEIGHT = 0.9


def last_low(run: Trajectories) -> np.ndarray:
    """The last step of each episode with the tip low, counted from 1; 0: never."""
    height = run.metrics["tip_height"]
    index = np.arange(1, len(height) + 1)[:, None]
    return np.where(run.alive & (height <= UPRIGHT_HEIGHT), index, 0).max(axis=0)


def stands(run: Trajectories) -> np.ndarray:
    """Which episodes ended upright. Up from its last step only is not up."""
    high = run.mean_of_last(1.0, run.metrics["tip_height"]) > UPRIGHT_MEAN_HEIGHT
    return high & ~run.terminated & (last_low(run) < run.steps)


def upright(run: Trajectories) -> Floats:
    """1 where the episode ended upright, else 0."""
    return stands(run).astype(np.float64)


def time_to_upright(run: Trajectories) -> Floats:
    """Time from which on the tip stays up [s]."""
    return np.where(stands(run), last_low(run) * run.control_dt, np.nan)


def effort(run: Trajectories) -> Floats:
    """Root mean square of the torque [N m]."""
    return run.rms(run.metrics["torque"])


def sway(run: Trajectories) -> Floats:
    """Root mean square, over the last second, of the edges' distance from up: radians where
    small.
    """
    error = np.sqrt(run.mean_of_last(1.0, run.metrics["upright_error"] ** 2))
    return np.where(stands(run), error, np.nan)


COLUMNS = (
    Column(
        "upright",
        "upright at the end",
        f"share of episodes that lasted to the time limit and whose tip stood, on average over the "
        f"last second, above {UPRIGHT_MEAN_HEIGHT:g} L",
        upright,
        "%",
        100.0,
        0,
        "high",
        success=True,
    ),
    Column(
        "time_to_upright",
        "time to upright",
        f"time from which on the tip stays above {UPRIGHT_HEIGHT:g} L; "
        "only episodes upright at the end",
        time_to_upright,
        "s",
        better="low",
    ),
    Column(
        "effort",
        "torque effort",
        "root mean square of the base torque over the episode",
        effort,
        "mN m",
        1e3,
        better="low",
    ),
    Column(
        "sway",
        "sway",
        "root mean square, over the edges and the last second, of the angle to the vertical; only "
        "episodes upright at the end",
        sway,
        "deg",
        180 / np.pi,
        better="low",
    ),
)


def verdict(evaluations: Sequence[Evaluation]) -> str:
    """Who stands, and how soon."""
    parts = []
    for e in evaluations:
        when = e.mean("time_to_upright")
        took = "" if np.isnan(when) else f", up after {when:.1f} s on average"
        up = int(e.columns["upright"].sum())
        parts.append(f"{e.policy} stands at the end of {up} of {len(e.seeds)} episodes{took}")
    return "; ".join(parts) + "."


def controllers(spec: Mapping[str, Any]) -> tuple[str, ...]:
    """State feedback where every edge is seen, output feedback where the base is."""
    return {"full": ("lqr",), "base": ("lqg",)}.get(spec["config"]["observation"], ())


def any_start(spec: Mapping[str, Any]) -> dict[str, Any]:
    """Straight rods at any angle, turning."""
    return {"start_angle": (-np.pi, np.pi), "start_rate": (-5.0, 5.0)}


def other_rods(spec: Mapping[str, Any]) -> dict[str, Any]:
    """Rods about the nominal one."""
    config = spec["config"]
    modulus, width = config["youngs_modulus"], config["width"]
    return {
        "randomize": {
            "youngs_modulus": (0.7 * modulus, 1.3 * modulus),
            "width": (0.85 * width, 1.15 * width),
        }
    }


BANDS = (
    Band("starts", "from any angle, turning at up to 5 rad/s either way", any_start),
    Band("rods", "Young's modulus +-30 % and width +-15 %, drawn each episode", other_rods),
)

#: A push comes after this time [s], when a policy has had the time to swing up, and lasts so long;
#: the episode goes on to its end so that a rod may be brought up again.
PUSH_AT, PUSH_FOR, PUSHED_EPISODE = 4.0, 0.05, 8.0


def torque_noise(spec: Mapping[str, Any], value: float) -> dict[str, Any]:
    """A random torque, drawn each step, of this share of the motor's limit."""
    return {"torque_disturbance": value * spec["config"]["torque_limit"]}


def push(spec: Mapping[str, Any], value: float) -> dict[str, Any]:
    """A push while the rod stands, of so many times the motor's limit."""
    config = spec["config"]
    torque = value * config["torque_limit"]
    return {
        "push": {"torque": torque, "start": PUSH_AT, "duration": PUSH_FOR},
        "max_episode_steps": round(PUSHED_EPISODE / config["control_dt"]),
    }


QUANTITIES = (
    factor("width", "width / nominal", 0.75, 1.25),
    factor("length", "length / nominal", 0.75, 1.25),
    factor("youngs_modulus", "Young's modulus / nominal", 0.5, 2.0, logarithmic=True),
    factor("density", "density / nominal", 0.75, 1.25),
    factor("bending_damping", "bending damping / nominal", 0.25, 4.0, logarithmic=True),
    NOISE,
    Quantity("torque_noise", "torque noise / torque limit", 0.0, 0.2, 0.0, torque_noise),
    GAIN,
    Quantity("actuator_delay", "delay of the motor [ms]", 0.0, 40.0, 0.0, lag),
    Quantity("push", "push for 50 ms / torque limit", 0.0, 2.0, 0.0, push),
)


def quantities(spec: Mapping[str, Any]) -> tuple[Quantity, ...]:
    """All of them, whatever the task."""
    return QUANTITIES


def straight(spec: Mapping[str, Any], given: Mapping[str, float]) -> dict[str, Any]:
    """A straight rod: the same angle and rate of every edge."""
    edges = int(spec["config"]["nodes"]) - 1
    return {"angles": [given.get("angle", 0.0)] * edges, "rates": [given.get("rate", 0.0)] * edges}


PENDULUM = Description(
    "pendulum",
    word="rod",
    environment="rodgym.envs:PendulumEnv",
    simulation="rodgym.sim:Pendulum",
    columns=COLUMNS,
    traces=(Trace("torque", "torque [mN m]", 1e3), Trace("tip_height", "tip height / L")),
    verdict=verdict,
    controllers=controllers,
    bands=BANDS,
    quantities=quantities,
    starts=("angle", "rate"),
    start=straight,
    ends=("base", "tip"),
    named_angles={180.0: "up", -180.0: "up"},
)
