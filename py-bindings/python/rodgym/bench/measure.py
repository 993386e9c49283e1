"""Paired timing: all cases take turns, so that what else the machine does hits them alike."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Case:
    """Something that takes environment steps.

    ``run(count)`` takes ``count * steps`` of them. ``alone`` says that one thread works at a time:
    then the CPU time of the process is the cost, whatever else the machine does. (Long steps are
    computed in a thread that the caller waits for.)
    """

    name: str
    steps: int
    run: Callable[[int], None]
    alone: bool = True


@dataclass(frozen=True)
class Timing:
    """Seconds an environment step, one number a round: wall clock, and CPU of all threads."""

    name: str
    wall: npt.NDArray[np.float64]
    cpu: npt.NDArray[np.float64]
    alone: bool

    @property
    def rate(self) -> float:
        """Environment steps a second of wall clock, median of the rounds."""
        return float(1.0 / np.median(self.wall))

    @property
    def cpu_rate(self) -> float:
        """Environment steps a second of CPU time, median of the rounds."""
        return float(1.0 / np.median(self.cpu))

    @property
    def cost(self) -> float:
        """Seconds a step that compare best: CPU time where one thread did all, else wall clock."""
        return float(np.median(self.cpu if self.alone else self.wall))


@dataclass(frozen=True)
class Ratio:
    """Median and quartiles of a ratio taken round by round."""

    median: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.median:.3g} ({self.low:.3g} to {self.high:.3g})"


def clock() -> float:
    """CPU time of all threads of this process [s]."""
    return time.process_time()


def measure(cases: Sequence[Case], rounds: int, seconds: float) -> list[Timing]:
    """Runs every case once a round for about ``seconds`` of its own CPU time.

    The order turns round by round, so that no case always follows the same other one.
    """
    counts = [calibrate(case, seconds) for case in cases]
    wall = np.zeros((rounds, len(cases)))
    cpu = np.zeros((rounds, len(cases)))
    for r in range(rounds):
        for at in np.roll(np.arange(len(cases)), r).tolist():
            case, count = cases[at], counts[at]
            began, work = time.perf_counter(), clock()
            case.run(count)
            cpu[r, at] = (clock() - work) / (count * case.steps)
            wall[r, at] = (time.perf_counter() - began) / (count * case.steps)
    return [Timing(c.name, wall[:, i], cpu[:, i], c.alone) for i, c in enumerate(cases)]


def calibrate(case: Case, seconds: float) -> int:
    """How often ``run`` must repeat its step to take about ``seconds``; warms the case up, too."""
    case.run(1)
    count = 1
    while True:
        began = clock()
        case.run(count)
        took = clock() - began
        if took >= 0.2 * seconds or count >= 1 << 20:
            return max(1, round(count * seconds / max(took, 1e-9)))
        count *= 4


def ratio(slow: Timing, fast: Timing) -> Ratio:
    """How many times cheaper ``fast`` is, paired round by round.

    CPU time where both work in one thread, wall clock otherwise.
    """
    alone = slow.alone and fast.alone
    pairs = slow.cpu / fast.cpu if alone else slow.wall / fast.wall
    low, median, high = np.percentile(pairs, [25, 50, 75])
    return Ratio(float(median), float(low), float(high))
