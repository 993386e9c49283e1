"""Does a recording look like the rod that it is said to be? Units, axes, order, swapped markers."""

from __future__ import annotations

import warnings
from itertools import combinations

import numpy as np

from rodgym.lab.errors import AxisError, FramesError, OrderError, RecordingError, UnitsError
from rodgym.lab.tracks import MIN_FRAMES, MIN_MARKERS, Array, Tracks

#: A frame time beyond these [s] is no camera's.
FRAME_TIME = (2e-5, 0.25)
#: What markers may span, over what the rod's length says.
SPAN = (0.7, 1.4)
#: Distances longer than along the rod by this share of the markers' spacing are no noise.
SLACK = 0.2


def checked(tracks: Tracks, places: Array) -> Tracks:
    """The tracks with swapped markers put back; `places` are the markers' along the rod [m].

    Raises
    ------
    UnitsError, AxisError, OrderError, FramesError: the recording is none of such a rod in metres
        and seconds, y upwards, base first.
    """
    if tracks.markers != len(places):
        raise RecordingError(f"{tracks.markers} markers, but {len(places)} places along the rod")
    seen = np.isfinite(tracks.points).all(axis=2)
    if (seen.sum(axis=1) >= MIN_MARKERS).sum() < MIN_FRAMES:
        raise FramesError(f"fewer than {MIN_FRAMES} frames show {MIN_MARKERS} markers or more")
    low, high = FRAME_TIME
    if not low <= tracks.frame_time <= high:
        raise UnitsError(
            f"frames are {tracks.frame_time:g} apart: times must be in seconds "
            f"({low:g} to {high:g} s from frame to frame), not in frames or milliseconds"
        )
    scale = spans(tracks.points, places)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # A marker that was never seen.
        middle = np.nanmedian(tracks.points, axis=0)
        spread = np.nanmedian(np.abs(tracks.points - middle), axis=0).sum(axis=1)
        height = np.nanmean(tracks.points[:, -1, 1] - middle[0, 1])
    if spread[-1] < 0.5 * spread[0]:
        raise OrderError(
            f"the last marker moves less ({1e3 * spread[-1]:.1f} mm) than the first "
            f"({1e3 * spread[0]:.1f} mm): markers must go from the base to the tip"
        )
    if height > 0.05 * places[-1]:
        raise AxisError(
            f"the tip is {1e3 * height:.0f} mm above the base on average: y seems to point "
            "downwards, as in pixels (--y down turns it)"
        )
    notes = (*tracks.notes, *losses(tracks.times, tracks.points))
    return untangled(Tracks(tracks.times, tracks.points, notes), places, scale)


def spans(points: Array, places: Array) -> float:
    """Distances of markers over those along the rod: the median of all pairs and frames.

    Raises
    ------
    UnitsError: they are not in metres
    """
    ratios = [
        np.linalg.norm(points[:, i] - points[:, j], axis=1) / (places[j] - places[i])
        for i, j in combinations(range(len(places)), 2)
    ]
    scale = float(np.nanmedian(np.array(ratios)))
    if not SPAN[0] <= scale <= SPAN[1]:
        raise UnitsError(_units(scale))
    return scale


def _units(scale: float) -> str:
    """What the lengths may be instead."""
    spans = f"markers are {scale:.3g} times as far apart as along a rod of that length in metres"
    for unit, size in (("mm", 1e3), ("cm", 1e2)):
        if SPAN[0] <= scale / size <= SPAN[1]:
            return f"{spans}: positions seem to be in {unit} (--unit {unit} reads them)"
    return f"{spans}: give the metres of one unit of the table with --scale, or the right length"


def untangled(tracks: Tracks, places: Array, scale: float = 1.0) -> Tracks:
    """Swaps two markers back wherever that alone makes a frame possible.

    No two markers are farther apart than along the rod.
    """
    pairs = list(combinations(range(len(places)), 2))
    first, second = (np.array(side) for side in zip(*pairs, strict=True))
    longest = scale * (places[second] - places[first])
    slack = SLACK * scale * float(np.min(np.diff(places)))

    def excess(frame: Array) -> float:
        gaps = np.linalg.norm(frame[first] - frame[second], axis=1) - longest - slack
        return float(np.nansum(gaps.clip(0)))

    points, swapped = tracks.points.copy(), dict[tuple[int, int], int]()
    for frame in points:
        now = excess(frame)
        if now == 0.0:
            continue
        trials = []
        for i, j in pairs:
            trial = frame.copy()
            trial[[i, j]] = trial[[j, i]]
            trials.append((excess(trial), i, j, trial))
        best, i, j, trial = min(trials, key=lambda entry: entry[0])
        if best < 0.1 * now:
            frame[:] = trial
            swapped[i + 1, j + 1] = swapped.get((i + 1, j + 1), 0) + 1
    notes = [f"markers {i} and {j} swapped back in {n} frames" for (i, j), n in swapped.items()]
    return Tracks(tracks.times, points, (*tracks.notes, *notes))


def losses(times: Array, points: Array) -> list[str]:
    """Frames that are missing and markers that were lost, in words."""
    steps = np.rint(np.diff(times) / np.median(np.diff(times)))
    notes = []
    if missing := int((steps - 1).clip(0).sum()):
        notes.append(f"{missing} frames are missing in {int((steps > 1).sum())} gaps")
    if lost := int(np.isnan(points).any(axis=2).sum()):
        notes.append(f"{lost} of {points.shape[0] * points.shape[1]} marker positions were lost")
    return notes
