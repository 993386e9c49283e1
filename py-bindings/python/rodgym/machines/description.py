"""What a machine's description holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from rodgym.evaluation import Evaluation, Record
    from rodgym.evaluation.score import Trajectories

Floats: TypeAlias = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Column:
    """A measured quantity: one number per episode.

    ``measure`` gets whole trajectories and answers with an array (n,), NaN where the quantity is
    not defined. ``scale`` and ``unit`` are for people: the CSV holds SI units, a table shows
    ``scale * value`` in ``unit``. ``better`` is ``high``, ``low``, or empty where neither is.
    ``success`` marks the column that says, by 1 or 0, whether the episode did its task.
    """

    name: str
    title: str
    doc: str
    measure: Callable[[Trajectories], Floats]
    unit: str = ""
    scale: float = 1.0
    digits: int = 2
    better: str = ""
    success: bool = False

    @property
    def heading(self) -> str:
        """Title and unit."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title


@dataclass(frozen=True)
class Trace:
    """A number of every step that reports draw over time: metric, axis label, factor to its
    unit.
    """

    metric: str
    label: str
    factor: float = 1.0


@dataclass(frozen=True)
class Picture:
    """A picture that only this machine's reports have: its file, the title and text above it.

    ``text`` may name the ``{seed}`` of the episode that is shown. ``draw`` writes the file; what
    it needs to draw it imports when it is called.
    """

    file: str
    title: str
    text: str
    draw: Callable[[Path, Sequence[Record], Sequence[Evaluation]], None]


@dataclass(frozen=True)
class Task:
    """What a task adds to its machine: scores that stand beside the return, and traces."""

    columns: tuple[Column, ...] = ()
    traces: tuple[Trace, ...] = ()


def total_reward(run: Trajectories) -> Floats:
    """Sum of the rewards of each episode."""
    return run.total(run.rewards)


def duration(run: Trajectories) -> Floats:
    """Duration of each episode [s]."""
    return np.asarray(run.steps * run.control_dt, np.float64)


RETURN = Column(
    "return", "return", "sum of the rewards of the episode", total_reward, digits=1, better="high"
)
LENGTH = Column("length", "length", "duration of the episode", duration, "s")


def mean_returns(evaluations: Sequence[Evaluation]) -> str:
    """A comparison in one sentence: the returns."""
    parts = [f"{e.policy} earns {e.mean('return'):.2f}" for e in evaluations]
    count = len(set(evaluations[0].seeds))
    return f"Mean return over {count} episodes: " + ", ".join(parts) + "."


@dataclass(frozen=True)
class Band:
    """Conditions of a standard evaluation: ``keywords`` of an environment, made from its spec."""

    name: str
    text: str
    keywords: Callable[[Mapping[str, Any]], dict[str, Any]]


@dataclass(frozen=True)
class Quantity:
    """Something that may be other than a policy was made for, from ``low`` to ``high``.

    ``keywords`` makes the keywords of an environment from its spec and a value. At ``nominal`` the
    environment is as it was asked for.
    """

    name: str
    label: str
    low: float
    high: float
    nominal: float
    keywords: Callable[[Mapping[str, Any], float], dict[str, Any]]
    logarithmic: bool = False

    def values(self, points: int) -> list[float]:
        """An odd number of values, evenly spaced or evenly in the logarithm, `nominal` among
        them.
        """
        spaced = np.geomspace if self.logarithmic else np.linspace
        return [float(f"{value:.12g}") for value in spaced(self.low, self.high, points)]


def factor(name: str, label: str, low: float, high: float, logarithmic: bool = False) -> Quantity:
    """A parameter of the machine, times a value."""

    def keywords(spec: Mapping[str, Any], value: float) -> dict[str, Any]:
        return {name: value * spec["config"][name]}

    return Quantity(name, label, low, high, 1.0, keywords, logarithmic)


def noise(spec: Mapping[str, Any], value: float) -> dict[str, Any]:
    """Sensors with a noise of so many times 1 mrad and 10 mrad/s."""
    return {"sensor_noise": {"angle": 1e-3 * value, "rate": 1e-2 * value}}


def gain(spec: Mapping[str, Any], value: float) -> dict[str, Any]:
    """An actuator that does more or less than it is told."""
    return {"actuator_gain": value}


def lag(spec: Mapping[str, Any], value: float) -> dict[str, Any]:
    """An actuator that lags by so many milliseconds, to the next whole number of physics steps."""
    step = spec["config"]["physics_dt"]
    return {"actuator_delay": step * round(1e-3 * value / step)}


NOISE = Quantity("sensor_noise", "sensor noise / (1 mrad, 10 mrad/s)", 0.0, 20.0, 0.0, noise)
GAIN = Quantity("actuator_gain", "actuator gain", 0.7, 1.3, 1.0, gain)


def no_quantity(spec: Mapping[str, Any]) -> tuple[Quantity, ...]:
    """Nothing is known that may differ."""
    return ()


def no_controller(spec: Mapping[str, Any]) -> tuple[str, ...]:
    """None fits."""
    return ()


@dataclass(frozen=True)
class Description:
    """A machine as Python shows it; what is left out suits any machine."""

    #: The word that the core knows the machine by: `spec["machine"]`.
    machine: str
    #: What people call it, and how an environment names its copy: `env.unwrapped.rod`.
    word: str = "machine"
    #: Class of a single environment, `module:name`.
    environment: str = "rodgym.envs:RodEnv"
    #: Class of the bare machine, `module:name`.
    simulation: str = "rodgym.sim:Simulation"

    #: Scores beside return and length.
    columns: tuple[Column, ...] = ()
    #: Numbers of every step that are drawn over time.
    traces: tuple[Trace, ...] = ()
    #: What single tasks add, by `spec["task"]`.
    tasks: Mapping[str, Task] = field(default_factory=dict)
    #: A comparison in a sentence or two.
    verdict: Callable[[Sequence[Evaluation]], str] = mean_returns

    #: Names of the controllers that play under an environment's own conditions.
    controllers: Callable[[Mapping[str, Any]], tuple[str, ...]] = no_controller
    #: Conditions of a standard evaluation beside the nominal ones.
    bands: tuple[Band, ...] = ()
    #: What a measurement of robustness varies.
    quantities: Callable[[Mapping[str, Any]], tuple[Quantity, ...]] = no_quantity

    #: Keys of a straight start that a study may sweep, and the `state` option that they make.
    starts: tuple[str, ...] = ()
    start: Callable[[Mapping[str, Any], Mapping[str, float]], dict[str, Any]] | None = None

    #: Angle of an edge at rest, from hanging down [rad], and that direction in words.
    rest_angle: float = 0.0
    rest: str = "hanging down"
    #: What the first and the last edge are called.
    ends: tuple[str, str] = ("first", "last")
    #: Edge angles that have a name [deg].
    named_angles: Mapping[float, str] = field(default_factory=dict)
    #: Seconds of an episode that are drawn; None: all.
    seconds: float | None = None
    #: Pictures of its own in a report.
    pictures: tuple[Picture, ...] = ()

    def columns_of(self, task: str) -> tuple[Column, ...]:
        """Every score of a task, in the order of tables."""
        return (RETURN, *self.tasks.get(task, Task()).columns, *self.columns, LENGTH)

    def traces_of(self, task: str) -> tuple[Trace, ...]:
        """Every trace of a task, in the order of plots."""
        return (*self.traces, *self.tasks.get(task, Task()).traces)
