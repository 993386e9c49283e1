"""Clocks of two recorders, aligned by a signal that both have seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import signal

from rodgym.lab.errors import ClockError
from rodgym.lab.tracks import Array

if TYPE_CHECKING:
    from rodgym.lab.cells import Signals

#: Clocks are not aligned by signals that are no more alike than this, or at two places nearly so.
ALIKE, TWICE = 0.5, 0.98
#: The top of a correlation is where it is above this share of its largest value.
NEARLY = 0.98


@dataclass(frozen=True)
class Clock:
    """Times of one recorder from those of another: `offset + rate * time`.

    Parameters
    ----------
    alike: correlation of the two signals at that offset
    """

    offset: float
    rate: float
    alike: float


def align(reference: Signals, name: str, other: Signals, same: str, most: float) -> Clock:
    """Where in another recorder's time the same is seen.

    Both signals show one thing, such as the angle of the servo by camera and by potentiometer. They
    are compared at the slower one's rate, each half of the recording by itself, so that a clock
    that runs fast is seen.

    Parameters
    ----------
    name, same: of the two signals
    most: largest offset that is looked for [s]

    Raises
    ------
    ClockError: they are not alike anywhere, or alike at two places, as periodic signals are
    """
    rate = 4 * min(reference.rate, other.rate)
    middle = 0.5 * (other.times[0] + other.times[-1])
    halves = [(other.times[0], middle), (middle, other.times[-1])]
    whole = _offset(reference, name, other, same, (other.times[0], other.times[-1]), most, rate)
    near = min(most, 0.25 * (other.times[-1] - other.times[0]))
    found = [
        _offset(reference, name, other, same, part, near, rate, start=whole[0]) for part in halves
    ]
    centres = [0.5 * (first + last) for first, last in halves]
    drift = (found[1][0] - found[0][0]) / (centres[1] - centres[0])
    return Clock(
        float(np.mean([f[0] for f in found]) - drift * np.mean(centres)), float(1 + drift), whole[1]
    )


def _offset(
    reference: Signals,
    name: str,
    other: Signals,
    same: str,
    part: tuple[float, float],
    most: float,
    rate: float,
    start: float = 0.0,
) -> tuple[float, float]:
    """Offset and correlation of a part of a recording; `start`: about where."""
    times = np.arange(part[0], part[1], 1 / rate)
    mine = np.interp(times, other.times, other.values[same])
    shifts = np.arange(-round(most * rate), round(most * rate) + 1) / rate + start
    alike = np.full(len(shifts), -1.0)
    for i, shift in enumerate(shifts):
        inside = (times + shift >= reference.times[0]) & (times + shift <= reference.times[-1])
        if inside.mean() < 0.5:
            continue
        theirs = np.interp(times[inside] + shift, reference.times, reference.values[name])
        alike[i] = _correlation(mine[inside], theirs)
    best = int(np.argmax(alike))
    if alike[best] < ALIKE:
        raise ClockError(
            f"{name} and {same} are alike nowhere within {most:g} s (correlation {alike[best]:.2f})"
        )
    peaks, _ = signal.find_peaks(alike)
    rivals = [i for i in peaks if i != best and alike[i] > TWICE * alike[best]]
    if start == 0.0 and rivals:
        other_place = shifts[rivals[0]]
        raise ClockError(
            f"{name} and {same} are alike at {shifts[best]:.3f} s and at {other_place:.3f} s: "
            "align by something that happens once, or look less far"
        )
    return _top(shifts, alike, best), float(alike[best])


def _correlation(one: Array, other: Array) -> float:
    one, other = one - one.mean(), other - other.mean()
    size = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / size if size > 0 else -1.0


def _top(x: Array, y: Array, best: int) -> float:
    """Where the parabola through the values about the largest one is highest."""
    high = y > NEARLY * y[best]
    low = best - int(np.argmin(np.append(high[best::-1], False))) + 1
    end = best + int(np.argmin(np.append(high[best:], False)))
    if end - low < 3:
        low, end = max(best - 1, 0), min(best + 2, len(x))
    if end - low < 3:
        return float(x[best])
    bend, slope, _ = np.polyfit(x[low:end] - x[best], y[low:end], 2)
    return float(x[best] - 0.5 * slope / bend) if bend < 0 else float(x[best])
