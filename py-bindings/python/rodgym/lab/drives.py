"""What moved the rod: a bench's file of pitch and loads, or of torque, beside a film."""

from __future__ import annotations

import numpy as np
from scipy import signal

from rodgym.lab.cells import Signals
from rodgym.lab.errors import HeaderError, UnitsError
from rodgym.lab.film import Torque
from rodgym.lab.fin_model import LOADS, Recording
from rodgym.lab.tracks import Tracks

#: Above this frequency a pitch is noise of its sensor [Hz].
CUTOFF = 20.0
#: Units of what a bench measures.
UNITS = {"pitch": "rad", "command": "rad", "thrust": "n", "torque": "nm"}


def recording(tracks: Tracks, bench: Signals, cutoff: float | None = CUTOFF) -> Recording:
    """Film and bench of a fin.

    Parameters
    ----------
    bench: with `pitch` [rad], and `thrust` [N], `torque` [N m] and the servo's `command` [rad]
        where they were recorded
    cutoff: of a low-pass of the pitch, forwards and backwards [Hz]; None: the pitch is smooth

    Raises
    ------
    HeaderError, UnitsError: no pitch, or signals in other units
    """
    pitch = taken(bench, "pitch")
    if cutoff is not None:
        times = bench.times
        if np.ptp(np.diff(times)) > 0.01 * np.median(np.diff(times)):
            bench = bench.resampled(1 / float(np.median(np.diff(times))))
            pitch = taken(bench, "pitch")
        if cutoff < 0.4 * bench.rate:
            sections = signal.butter(4, cutoff, fs=bench.rate, output="sos")
            pitch = signal.sosfiltfilt(sections, pitch)
    loads = {name: taken(bench, name) for name in LOADS if name in bench.values}
    command = taken(bench, "command") if "command" in bench.values else None
    return Recording(tracks, bench.times, np.asarray(pitch), loads, command=command)


def torque(bench: Signals) -> Torque:
    """The torque on a pendulum's base.

    Raises
    ------
    HeaderError, UnitsError: there is none, or it is in other units
    """
    return Torque(bench.times, taken(bench, "torque"))


def taken(bench: Signals, name: str) -> np.ndarray:
    """A signal by name, in its unit.

    Raises
    ------
    HeaderError, UnitsError: there is none, or it is in another unit
    """
    if name not in bench.values:
        there = ", ".join(bench.values)
        raise HeaderError(f"the bench has no {name!r} beside the time; there are {there}")
    unit = bench.units.get(name, "")
    if unit not in ("", UNITS[name]):
        raise UnitsError(
            f"{name} is in {unit!r}, not in {UNITS[name]!r}: calibrate it first "
            "(rodgym.lab.cells.calibrate_cell)"
        )
    return np.asarray(bench.values[name], np.float64)
