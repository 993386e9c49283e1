"""Does a recording look like the fin that it is said to be? Units, axes, order, drive, cells."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rodgym._checks import refused
from rodgym.lab.errors import AxisError, FramesError, OrderError, RecordingError, UnitsError
from rodgym.lab.fin_model import LOADS, Recording
from rodgym.lab.samples import cubic
from rodgym.lab.sanity import losses, spans
from rodgym.lab.tracks import MIN_FRAMES, Array
from rodgym.sim import Fin

#: The largest pitch that a drive may have [rad]: beyond it, it is in degrees.
STEEP = 1.0
#: Samples of the bench in the period of a beat of 3 Hz; fewer do not tell the drive's acceleration.
RATE = 60.0


def markers(recordings: Sequence[Recording]) -> int:
    """Number of markers.

    Raises
    ------
    ParameterError: no recording
    RecordingError: not the same number in all
    """
    if not recordings:
        raise refused("recordings", [], "at least one")
    counts = {one.tracks.markers for one in recordings}
    if len(counts) > 1:
        raise RecordingError(f"recordings have {sorted(counts)} markers; they must have the same")
    return counts.pop()


def checked(
    recordings: Sequence[Recording], places: Array, known: Mapping[str, Any], settle: float
) -> tuple[list[Recording], list[str]]:
    """The recordings, and what is worth saying about them.

    Raises
    ------
    RecordingError: by name what is wrong: units, axes, order, times
    """
    count = recordings[0].tracks.markers
    if len(places) != count or (np.diff(places) <= 0).any() or places[0] < 0 or places[-1] > 1:
        raise refused("places", places.tolist(), f"{count} rising shares from 0 (nose) to 1 (tail)")
    fin, notes, found = Fin(**known), [], []
    length = float(np.ptp(fin.positions[:, 0]))
    for i, one in enumerate(recordings, 1):
        name = f"recording {i}" if len(recordings) > 1 else "the recording"
        one = replace(one, times=np.asarray(one.times, np.float64))
        bench(one, name, settle)
        film(one, name, places, length)
        # (Of a film that shows y only, x is not lost.)
        sideways = one.tracks.points[..., 1:]
        told = [*one.tracks.notes, *losses(one.tracks.times, sideways)]
        notes += [f"{name}: {note}" for note in told] if len(recordings) > 1 else told
        found.append(one)
    return found, notes


def bench(one: Recording, name: str, settle: float) -> None:
    """Times, pitch and loads.

    Raises
    ------
    FramesError, UnitsError, RecordingError: what is wrong
    """
    if one.times.ndim != 1 or len(one.times) < MIN_FRAMES or (np.diff(one.times) <= 0).any():
        raise FramesError(f"{name}: the bench's times must rise, at least {MIN_FRAMES} of them")
    for what, values in (("pitch", one.pitch), *one.loads.items()):
        if what not in ("pitch", *LOADS):
            raise RecordingError(f"{name}: cells measure {' or '.join(LOADS)}, not {what!r}")
        if np.shape(values) != one.times.shape or not np.isfinite(values).all():
            raise FramesError(
                f"{name}: {len(values)} values of {what} for {len(one.times)} times of the bench; "
                "there must be as many, all finite"
            )
    steep = float(np.abs(one.pitch).max())
    if steep > STEEP:
        raise UnitsError(f"{name}: a pitch of {steep:.3g} rad; it seems to be in degrees")
    rate = float(1 / np.median(np.diff(one.times)))
    if rate < RATE:
        raise FramesError(
            f"{name}: {rate:.3g} samples of the pitch a second do not tell how it is moved; at "
            f"least {RATE:g} are needed"
        )
    if not 0 <= settle < 0.5 * (one.times[-1] - one.times[0]):
        raise refused("settle", settle, "from 0 s to half of the shortest recording")


def film(one: Recording, name: str, places: Array, length: float) -> None:
    """Scale, order and sense of the markers' motion.

    Raises
    ------
    FramesError, UnitsError, OrderError, AxisError: what is wrong
    """
    tracks = one.tracks
    inside = (tracks.times >= one.times[0]) & (tracks.times <= one.times[-1])
    seen = np.isfinite(tracks.points[..., 1])
    if (seen.any(axis=1) & inside).sum() < MIN_FRAMES:
        raise FramesError(
            f"{name}: fewer than {MIN_FRAMES} frames show the fin while the bench recorded "
            f"({one.times[0]:g} to {one.times[-1]:g} s): clocks are corrected by some hundredths "
            "of a second only"
        )
    if np.isfinite(tracks.points).all(axis=2).any():
        spans(tracks.points, length * places)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # A marker that was never seen.
        sideways = tracks.points[..., 1] - np.nanmedian(tracks.points[..., 1], axis=0)
        moves = np.nanmedian(np.abs(sideways), axis=0)
    if moves[-1] < 0.7 * moves[0]:
        raise OrderError(
            f"{name}: the last marker moves less ({1e3 * moves[-1]:.1f} mm) than the first "
            f"({1e3 * moves[0]:.1f} mm): markers must go from the nose to the tail"
        )
    # Near the pivot nothing bends: a marker behind it goes the way of the pitch.
    turned = cubic(one.times, one.pitch, tracks.times)
    turned = turned - turned.mean()
    behind = int(np.argmin(np.abs(places - 0.5)))
    way = np.nansum(turned * sideways[:, behind])
    size = np.sqrt(np.nansum(turned**2) * np.nansum(sideways[:, behind] ** 2))
    if size > 0 and way < -0.5 * size:
        raise AxisError(
            f"{name}: the fin is seen to turn against its pitch: y points downwards (--y down "
            "turns it), or the pitch is counted clockwise"
        )


def pivot(recordings: Sequence[Recording], places: Array, known: Mapping[str, Any]) -> Array:
    """Where the film has the pivot, about [m]: its median place."""
    fin = Fin(**known)
    share = fin.config["geometry"]["pivot"] / (len(fin.positions) - 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # Markers that were never seen.
        middles = np.nanmedian(np.concatenate([one.tracks.points for one in recordings]), axis=0)
    found = np.zeros(2)
    for axis in (0, 1):
        there = np.isfinite(middles[:, axis])
        if there.sum() > 1:
            found[axis] = np.interp(share, places[there], middles[there, axis])
    return found
