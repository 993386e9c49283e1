"""Averages of a signal over the phase of its period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rodgym._checks import refused
from rodgym.lab.cells import Signals
from rodgym.lab.tracks import Array


@dataclass(frozen=True)
class Phases:
    """A signal averaged over periods.

    Parameters
    ----------
    phase: middle of each bin [rad], 0 to 2 pi
    mean, deviation: of the samples in it
    counts: how many there are
    period: [s]
    """

    phase: Array
    mean: Array
    deviation: Array
    counts: npt.NDArray[np.int_]
    period: float

    @property
    def band(self) -> tuple[Array, Array]:
        """Two deviations below and above the mean, as in the thesis' Figs 3.11 and 3.13."""
        return self.mean - 2 * self.deviation, self.mean + 2 * self.deviation


def period_of(signals: Signals, name: str, low: float = 0.05, high: float | None = None) -> float:
    """The period of a signal's strongest frequency [s]: the sine that fits best.

    Parameters
    ----------
    low, high: between which frequencies it is looked for [Hz]
    """
    times, values = signals.times, signals.values[name] - np.mean(signals.values[name])
    high = 0.4 * signals.rate if high is None else high
    duration = times[-1] - times[0]

    def power(frequency: float) -> float:
        design = np.column_stack(
            [f(2 * np.pi * frequency * times) for f in (np.cos, np.sin)] + [np.ones(len(times))]
        )
        solution, *_ = np.linalg.lstsq(design, values, rcond=None)
        fit = design @ solution
        return float(fit @ fit)

    size = max(8 * len(times), 1024)
    spectrum = np.abs(np.fft.rfft(values, size))
    grid = np.fft.rfftfreq(size, 1 / signals.rate)
    inside = (grid >= max(low, 1 / duration)) & (grid <= high)
    best = float(grid[inside][np.argmax(spectrum[inside])])
    step = 0.25 / duration
    for _ in range(30):
        trials = best + step * np.array([-1.0, 0.0, 1.0])
        best = float(trials[int(np.argmax([power(f) for f in trials]))])
        step /= 1.6
    return 1 / best


def phase_average(
    signals: Signals, name: str, period: float, bins: int = 60, start: float = 0.0
) -> Phases:
    """A signal's mean and deviation over the phase of a period (thesis 3.4.2).

    Parameters
    ----------
    start: when the phase is 0 [s]

    Raises
    ------
    ParameterError: a period that is not above 0, or of which there are less than two
    """
    duration = signals.times[-1] - signals.times[0]
    if not 0 < period <= duration / 2:
        raise refused(
            "period", period, f"above 0 and at most half the recording, {duration / 2:g} s"
        )
    if not 4 <= bins <= 10_000:
        raise refused("bins", bins, "a whole number from 4 to 10000")
    share = np.mod((signals.times - start) / period, 1.0)
    place = np.minimum((share * bins).astype(int), bins - 1)
    counts = np.bincount(place, minlength=bins)
    if (counts == 0).any():
        raise refused("bins", bins, f"so few that each has samples: at most {len(share) // 4}")
    values = signals.values[name]
    mean = np.bincount(place, values, bins) / counts
    square = np.bincount(place, (values - mean[place]) ** 2, bins)
    deviation = np.sqrt(square / np.maximum(counts - 1, 1))
    return Phases(2 * np.pi * (np.arange(bins) + 0.5) / bins, mean, deviation, counts, period)
