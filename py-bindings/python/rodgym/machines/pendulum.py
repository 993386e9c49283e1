"""The elastic pendulum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgym.machines.description import Column, Description, Floats, Trace

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
    count = len(evaluations[0].seeds)
    parts = []
    for e in evaluations:
        when = e.mean("time_to_upright")
        took = "" if np.isnan(when) else f", up after {when:.1f} s on average"
        up = int(e.columns["upright"].sum())
        parts.append(f"{e.policy} stands at the end of {up} of {count} episodes{took}")
    return "; ".join(parts) + "."


def controllers(spec: Mapping[str, Any]) -> tuple[str, ...]:
    """State feedback where every edge is seen, output feedback where the base is."""
    return {"full": ("lqr",), "base": ("lqg",)}.get(spec["config"]["observation"], ())


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
    starts=("angle", "rate"),
    start=straight,
    ends=("base", "tip"),
    named_angles={180.0: "up", -180.0: "up"},
)
