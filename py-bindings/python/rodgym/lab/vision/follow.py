"""Which spot is which marker, from frame to frame, through short losses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import linear_sum_assignment

from rodgym.lab.errors import MarkersError
from rodgym.lab.tracks import Array
from rodgym.lab.vision.markers import Spots, alike

#: Neighbours are no farther apart than so many times their usual distance.
STRETCH = 1.35
#: A spot belongs to a marker that is expected within this share of the usual distance.
NEAR = 0.6
#: In how many of the frames all markers must be seen at once, as a share.
WHOLE = 0.1


@dataclass(frozen=True)
class Followed:
    """Places of the markers [pixel], (frames, markers, 2), and how sure they are."""

    places: Array
    confidence: Array


def follow(frames: Sequence[Spots], count: int | None = None) -> Followed:
    """Puts the spots of all frames in an order along the rod.

    Where all markers are seen, their order is the shortest path through them; elsewhere each spot
    goes to the marker that was expected next to it. Marker 1 is the end that moves less.

    Parameters
    ----------
    count: number of markers; None: the number that most frames show

    Raises
    ------
    MarkersError: there are none, or another number
    """
    frames, count = selected(frames, count)
    first = next(i for i, found in enumerate(frames) if len(found.places) == count)
    chain = path(frames[first].places)
    spacing = float(np.median(_links(frames[first].places[chain])))
    # From the first frame with all of them forwards, and from there back to the beginning.
    places = np.full((len(frames), count, 2), np.nan)
    chosen = np.full((len(frames), count), -1)
    for way in (range(first, len(frames)), range(first, -1, -1)):
        past = [frames[first].places[chain]] * 3
        last = past[0]
        for i in way:
            expected = _expected(past, last)
            which = assigned(frames[i].places, expected, spacing)
            chosen[i] = which
            seen = which >= 0
            places[i, seen] = frames[i].places[which[seen]]
            now = np.where(seen[:, np.newaxis], places[i], np.nan)
            last = np.where(np.isfinite(now), now, _carried(last, now))
            past = [past[1], past[2], last]
    sure = confidences(frames, chosen)
    if _moved(places[:, -1]) < _moved(places[:, 0]):
        places, sure = places[:, ::-1], sure[:, ::-1]
    return Followed(places, sure)


def selected(frames: Sequence[Spots], count: int | None) -> tuple[list[Spots], int]:
    """Spots as large and bright as most are, and how many markers there are."""
    areas = np.concatenate([found.areas for found in frames] or [np.zeros(0)])
    heights = np.concatenate([found.heights for found in frames] or [np.zeros(0)])
    if len(areas) == 0:
        raise MarkersError(
            "no markers were found: are they brighter than the rod (--dark if they are darker), "
            "and no wider than --largest pixels?"
        )
    # Faint spots, of which an empty picture may have many, say nothing of the markers.
    strong = heights > 0.5 * np.percentile(heights, 95)
    area, height = float(np.median(areas[strong])), float(np.median(heights[strong]))
    found = [alike(one, area, height) for one in frames]
    numbers = np.array([len(one.places) for one in found])
    usual = int(np.bincount(numbers).argmax())
    if count is None:
        count = usual
    whole = float(np.mean(numbers == count))
    if count < 3 or whole < WHOLE:
        raise MarkersError(
            f"{count} markers are seen at once in {100 * whole:.0f} % of the frames, most show "
            f"{usual}: say how many there are (--count), where (--region), or how wide (--largest)"
        )
    return found, count


def path(places: Array) -> list[int]:
    """The shortest path through all places: nearest neighbours from every start, then uncrossed."""
    gaps = np.linalg.norm(places[:, np.newaxis] - places, axis=2)
    best, least = list(range(len(places))), np.inf
    for start in range(len(places)):
        way, left = [start], set(range(len(places))) - {start}
        while left:
            way.append(min(left, key=lambda i: gaps[way[-1], i]))
            left.remove(way[-1])
        way = _uncrossed(way, gaps)
        length = float(gaps[way[:-1], way[1:]].sum())
        if length < least - 1e-9:
            best, least = way, length
    return best


def _uncrossed(way: list[int], gaps: Array) -> list[int]:
    """Reverses parts of a path as long as that makes it shorter."""
    better = True
    while better:
        better = False
        for i in range(len(way) - 1):
            for j in range(i + 1, len(way)):
                before = gaps[way[i - 1], way[i]] if i > 0 else 0.0
                after = gaps[way[j], way[j + 1]] if j + 1 < len(way) else 0.0
                first = gaps[way[i - 1], way[j]] if i > 0 else 0.0
                last = gaps[way[i], way[j + 1]] if j + 1 < len(way) else 0.0
                if first + last < before + after - 1e-9:
                    way = way[:i] + way[i : j + 1][::-1] + way[j + 1 :]
                    better = True
    return way


def assigned(places: Array, expected: Array, spacing: float) -> Array:
    """Which spot is each marker, -1 where none is, (markers,)."""
    count = len(expected)
    which = np.full(count, -1)
    if len(places) == count:
        chain = np.array(path(places))
        if _links(places[chain]).max() < STRETCH * spacing:
            off = [
                np.linalg.norm(places[way] - expected, axis=1).sum() for way in (chain, chain[::-1])
            ]
            return chain if off[0] <= off[1] else chain[::-1]
    if len(places) == 0:
        return which
    gaps = np.linalg.norm(expected[:, np.newaxis] - places, axis=2)
    # (What is too far away costs as much as nobody.)
    rows, columns = linear_sum_assignment(np.minimum(gaps, NEAR * spacing))
    near = gaps[rows, columns] < NEAR * spacing
    which[rows[near]] = columns[near]
    return _believed(which, places, spacing)


def _believed(which: Array, places: Array, spacing: float) -> Array:
    """Takes back markers that are farther from a seen neighbour than the rod allows."""
    seen = np.flatnonzero(which >= 0)
    for one, other in pairwise(seen.tolist()):
        gap = np.linalg.norm(places[which[one]] - places[which[other]])
        if gap > STRETCH * spacing * (other - one):
            which[other] = -1
            return _believed(which, places, spacing)
    return which


def _expected(past: list[Array], last: Array) -> Array:
    """Where markers are next, if their acceleration stays."""
    before, middle, now = past
    return np.asarray(last + (now - middle) + 0.5 * ((now - middle) - (middle - before)))


def _carried(last: Array, now: Array) -> Array:
    """Places of markers that were lost: moved as their neighbours along the rod were."""
    seen = np.flatnonzero(np.isfinite(now[:, 0]))
    if len(seen) == 0:
        return last
    moved = now[seen] - last[seen]
    index = np.arange(len(last))
    return last + np.column_stack([np.interp(index, seen, moved[:, axis]) for axis in (0, 1)])


def confidences(frames: Sequence[Spots], chosen: Array) -> Array:
    """How much each spot looks like its marker does: its area and height beside their medians."""
    sure = np.full(chosen.shape, np.nan)
    areas, heights = sure.copy(), sure.copy()
    for i, (found, which) in enumerate(zip(frames, chosen, strict=True)):
        seen = which >= 0
        areas[i, seen], heights[i, seen] = found.areas[which[seen]], found.heights[which[seen]]
    for values in (areas, heights):
        ratio = values / np.nanmedian(values, axis=0)
        part = np.minimum(ratio, 1 / ratio)
        sure = part if np.isnan(sure).all() else np.fmin(sure, part)
    return sure


def _links(chain: Array) -> Array:
    return np.asarray(np.linalg.norm(np.diff(chain, axis=0), axis=1))


def _moved(places: Array) -> float:
    """How far a marker goes about."""
    return float(np.nanstd(places, axis=0).sum())
