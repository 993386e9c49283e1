"""From what a file says to tracks: seconds, metres, y upwards, base first."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rodgym._checks import refused
from rodgym.lab.errors import FramesError, OrderError, UnitsError
from rodgym.lab.readers.source import Source
from rodgym.lab.tracks import MIN_FRAMES, UNITS, Array, Tracks


def placed(
    source: Source,
    unit: str | None = None,
    scale: float | None = None,
    y: str | None = None,
    rate: float | None = None,
    markers: Sequence[str] | None = None,
    origin: tuple[float, float] | None = None,
    axis: float = 0.0,
    confidence: float = 0.6,
) -> Tracks:
    """The tracks of a file; for the parameters see `read_tracks`."""
    notes = [f"{source.name} was read as {source.kind}", *source.notes]
    if len(source.points) < MIN_FRAMES:
        raise FramesError(
            f"{source.name} has {len(source.points)} frames; at least {MIN_FRAMES} are needed"
        )
    times = clock(source, rate)
    points = np.array(source.points)
    # A point with one coordinate is none.
    points[np.isnan(points).any(axis=2)] = np.nan
    if source.confidence is not None:
        if not 0 <= confidence <= 1:
            raise refused("confidence", confidence, "a number from 0 to 1")
        unsure = (source.confidence < confidence) & np.isfinite(points[..., 0])
        points[unsure] = np.nan
        if unsure.any():
            notes.append(
                f"{int(unsure.sum())} positions are less sure than {confidence:g} and count as lost"
            )
    chosen = order(source, markers)
    points = points[:, chosen]
    sure = None if source.confidence is None else source.confidence[:, chosen]
    if markers is None and source.kind not in ("a plain table", "a tidy table"):
        notes.append(f"taken from base to tip: {', '.join(source.markers)} (--markers)")
    points = points - (np.zeros(2) if origin is None else np.array(origin, np.float64))
    if y not in (None, "up", "down"):
        raise refused("y", y, "'up' or 'down'")
    if (y or source.y) == "down":
        points = points * [1.0, -1.0]
        if y is None:
            notes.append(f"y points downwards in files of {source.kind}: it was turned (--y up)")
    turn = np.radians(axis)
    c, s = np.cos(turn), np.sin(turn)
    points = metres(source, unit, scale) * points @ np.array([[c, -s], [s, c]])
    return Tracks(times, points, tuple(notes), sure)


def clock(source: Source, rate: float | None) -> Array:
    """Times of the frames [s].

    Raises
    ------
    FramesError: they are not known, or do not rise
    """
    if rate is not None and not (np.isfinite(rate) and rate > 0):
        raise refused("rate", rate, "frames a second, above 0")
    if rate is not None:
        times = source.frames / rate if source.times is None else None
        if times is None:
            raise FramesError(f"{source.name} has times of its own: leave --rate out")
    elif source.times is None:
        raise FramesError(
            f"{source.name} counts frames and has no times: give the frames a second with --rate"
        )
    else:
        times = source.times
    if not np.isfinite(times).all():
        raise FramesError(
            f"{source.where(int(np.flatnonzero(~np.isfinite(times))[0]))}: a frame has no time"
        )
    if (np.diff(times) <= 0).any():
        late = int(np.flatnonzero(np.diff(times) <= 0)[0]) + 1
        raise FramesError(f"{source.where(late)}: time does not rise from the line before it")
    return times


def order(source: Source, markers: Sequence[str] | None) -> list[int]:
    """Places of the markers from base to tip.

    Raises
    ------
    OrderError: a marker that there is not, or one that is named twice
    """
    if markers is None:
        return list(range(len(source.markers)))
    for name in markers:
        if name not in source.markers:
            there = ", ".join(source.markers)
            raise OrderError(f"{source.name} has no marker {name!r}; there are {there}")
    if len(set(markers)) < len(markers):
        raise OrderError(f"a marker is named twice: {', '.join(markers)}")
    return [source.markers.index(name) for name in markers]


def metres(source: Source, unit: str | None, scale: float | None) -> float:
    """Metres of one unit of the table.

    Raises
    ------
    UnitsError: pixels without a scale, or another unit than the header names
    """
    if unit is not None and unit not in UNITS:
        raise refused("unit", unit, f"one of {', '.join(UNITS)}")
    if scale is not None:
        if not (np.isfinite(scale) and scale > 0):
            raise refused("scale", scale, "metres of one unit of the table, above 0")
        return float(scale)
    if unit is not None and source.unit not in (None, unit):
        raise UnitsError(
            f"{source.name} says that positions are in {source.unit}, not in {unit}: leave --unit "
            "out, or give the metres of one unit with --scale"
        )
    named = unit or source.unit or "m"
    if named not in UNITS:
        raise UnitsError(
            f"{source.name} is in pixels: give the metres of a pixel with --scale (the rod's "
            "length over that in the picture), or film a board and use 'rodgym track'"
        )
    return UNITS[named]
