"""What is measured of an episode, machine by machine.

A score sees whole trajectories of n episodes at once, as arrays of shape (T, n), and answers with
one number per episode and column. Nothing here simulates anything.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Upright at the end: the mean height of the tip over the last second exceeds this share of L.
UPRIGHT_MEAN_HEIGHT = 0.95
#: The time to upright is that from which on the tip stays above this share of L.
UPRIGHT_HEIGHT = 0.9


@dataclass(frozen=True)
class Column:
    """A measured quantity.

    ``scale`` and ``unit`` are for people: the CSV holds SI units, a table shows ``scale * value``
    in ``unit``. ``better`` is ``high``, ``low``, or empty where neither is.
    """

    name: str
    title: str
    doc: str
    unit: str = ""
    scale: float = 1.0
    digits: int = 2
    better: str = ""

    @property
    def heading(self) -> str:
        """Title and unit."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title


@dataclass(frozen=True)
class Trajectories:
    """n episodes side by side, padded at the end.

    ``alive[t, i]`` is set where step t belongs to episode i; ``metrics`` are the numbers that the
    environment reports at every step, (T, n) each; ``terminated`` (n,) says which episodes the task
    ended before the time limit; ``parameters`` are those of each episode, (n,) each.
    """

    control_dt: float
    alive: NDArray[np.bool_]
    rewards: Floats
    actions: NDArray[np.float32]
    metrics: Mapping[str, Floats]
    terminated: NDArray[np.bool_]
    parameters: Mapping[str, Floats] = field(default_factory=dict)

    @property
    def steps(self) -> NDArray[np.intp]:
        """Steps of each episode, (n,)."""
        return self.alive.sum(axis=0)

    def mean(self, values: Floats) -> Floats:
        """Mean over each episode, (n,)."""
        return np.where(self.alive, values, 0.0).sum(axis=0) / self.steps

    def mean_of_last(self, seconds: float, values: Floats) -> Floats:
        """Mean over the last ``seconds`` of each episode, (n,); over all of a shorter one."""
        count = max(1, round(seconds / self.control_dt))
        index = np.arange(len(values))[:, None]
        window = self.alive & (index >= self.steps - count)
        return np.where(window, values, 0.0).sum(axis=0) / window.sum(axis=0)

    def last(self, values: Floats) -> Floats:
        """The value at the end of each episode, (n,)."""
        return values[self.steps - 1, np.arange(values.shape[1])]

    def rms(self, values: Floats) -> Floats:
        """Root of the mean square over each episode, (n,)."""
        return np.sqrt(self.mean(values**2))


RETURN = Column("return", "return", "sum of the rewards of the episode", digits=1, better="high")
LENGTH = Column("length", "length", "duration of the episode", "s")

PENDULUM = (
    RETURN,
    Column(
        "upright",
        "upright at the end",
        f"share of episodes that lasted to the time limit and whose tip stood, on average over the "
        f"last second, above {UPRIGHT_MEAN_HEIGHT:g} L",
        "%",
        100.0,
        0,
        "high",
    ),
    Column(
        "time_to_upright",
        "time to upright",
        f"time from which on the tip stays above {UPRIGHT_HEIGHT:g} L; "
        "only episodes upright at the end",
        "s",
        better="low",
    ),
    Column(
        "effort",
        "torque effort",
        "root mean square of the base torque over the episode",
        "mN m",
        1e3,
        better="low",
    ),
    Column(
        "sway",
        "sway",
        "root mean square, over the edges and the last second, of the angle to the vertical; only "
        "episodes upright at the end",
        "deg",
        180 / np.pi,
        better="low",
    ),
    LENGTH,
)


def pendulum(run: Trajectories) -> dict[str, Floats]:
    """Scores of a pendulum: heights are shares of the rod's length.

    Metrics used: ``tip_height`` (share of L), ``torque`` [N m], ``upright_error`` (rms distance
    of the edges' directions from up: radians where small).
    """
    height = run.metrics["tip_height"]
    upright = (run.mean_of_last(1.0, height) > UPRIGHT_MEAN_HEIGHT) & ~run.terminated
    index = np.arange(1, len(height) + 1)[:, None]
    last_low = np.where(run.alive & (height <= UPRIGHT_HEIGHT), index, 0).max(axis=0)
    # Up from its last step only is not up.
    upright &= last_low < run.steps
    sway = np.sqrt(run.mean_of_last(1.0, run.metrics["upright_error"] ** 2))
    return {
        "upright": upright.astype(np.float64),
        "time_to_upright": np.where(upright, last_low * run.control_dt, np.nan),
        "effort": run.rms(run.metrics["torque"]),
        "sway": np.where(upright, sway, np.nan),
    }


THRUST = Column("thrust", "thrust", "mean thrust over the episode", "mN", 1e3, 3)
POWER = Column("power", "power", "mean input power over the episode", "mW", 1e3, 3, "low")
TRACKING = Column(
    "tracking_error",
    "tracking error",
    "root mean square of demanded minus smoothed thrust over the episode",
    "mN",
    1e3,
    3,
    "low",
)
SPEED = Column("speed", "speed", "mean speed of the hull over the episode", "mm/s", 1e3, 1, "high")
COMMAND = Column(
    "command",
    "command",
    "root mean square of the command, as a share of its limit",
    "%",
    100.0,
    1,
)

EFFICIENCY = Column(
    "efficiency",
    "efficiency",
    "propulsive (Froude) efficiency over the episode: speed times impulse over work",
    "%",
    100.0,
    1,
    "high",
)
BEAT = Column(
    "beat",
    "beat",
    "frequency that is strongest in the pitch over the second half of the episode",
    "Hz",
)
MODULUS = Column(
    "youngs_modulus", "Young's modulus", "of the fin in this episode", "kPa", 1e-3, digits=0
)

FIN_COMMON = (THRUST, POWER, EFFICIENCY, BEAT, COMMAND, MODULUS, LENGTH)
FIN = (RETURN, *FIN_COMMON)
FIN_DEMAND = (RETURN, TRACKING, *FIN_COMMON)
FIN_SWIM = (RETURN, SPEED, *FIN_COMMON)


def fin(run: Trajectories) -> dict[str, Floats]:
    """Scores of a fin.

    Metrics used: ``thrust`` [N], ``power`` [W], ``pitch`` [rad], ``efficiency``; where the task has
    them, ``demand`` and ``smooth_thrust`` [N], ``hull_speed`` [m/s]. Parameter: ``youngs_modulus``.
    """
    scores = {
        "thrust": run.mean(run.metrics["thrust"]),
        "power": run.mean(run.metrics["power"]),
        "efficiency": run.last(run.metrics["efficiency"]),
        "beat": beat(run),
        "command": run.rms(np.clip(run.actions[..., 0].astype(np.float64), -1, 1)),
        "youngs_modulus": run.parameters["youngs_modulus"],
    }
    if "demand" in run.metrics:
        scores["tracking_error"] = run.rms(run.metrics["demand"] - run.metrics["smooth_thrust"])
    if "hull_speed" in run.metrics:
        scores["speed"] = run.mean(run.metrics["hull_speed"])
    return scores


def beat(run: Trajectories) -> Floats:
    """Strongest frequency of the pitch over the second half of each episode [Hz], (n,)."""
    index = np.arange(len(run.alive))[:, None]
    window = run.alive & (index >= run.steps // 2)
    pitch = run.metrics["pitch"]
    mean = np.where(window, pitch, 0.0).sum(axis=0) / window.sum(axis=0)
    # Padded with zeros: the peak of a short record is read between its own frequencies.
    length = 16 * len(pitch)
    spectrum = np.abs(np.fft.rfft(np.where(window, pitch - mean, 0.0), length, axis=0))
    return np.asarray(spectrum.argmax(axis=0) / (length * run.control_dt), np.float64)


#: Names of all columns there are, whatever the machine.
ALL_SCORES = frozenset(c.name for c in (*PENDULUM, *FIN, *FIN_DEMAND, *FIN_SWIM))


def columns_for(metrics: Collection[str]) -> tuple[Column, ...]:
    """The columns of the machine that reports these metrics."""
    if {"tip_height", "torque", "upright_error"} <= set(metrics):
        return PENDULUM
    if {"thrust", "power"} <= set(metrics):
        return FIN_DEMAND if "demand" in metrics else FIN_SWIM if "hull_speed" in metrics else FIN
    return (RETURN, LENGTH)


def score(run: Trajectories) -> dict[str, Floats]:
    """One (n,) array per column of :func:`columns_for`."""
    columns = columns_for(run.metrics)
    special = pendulum(run) if columns is PENDULUM else fin(run) if THRUST in columns else {}
    return {
        "return": np.where(run.alive, run.rewards, 0.0).sum(axis=0),
        **special,
        "length": run.steps * run.control_dt,
    }
