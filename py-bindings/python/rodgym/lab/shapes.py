"""Shapes of a rod in few numbers, and where markers sit on its nodes.

The angle along a rod that is free to turn at both ends has no slope there: it is a sum of cosines.
"""

from __future__ import annotations

import numpy as np

from rodgym.lab.tracks import Array, Tracks

#: Cosines of a shape: the rod as a whole, and the bends that outlive a few hundredths of a second.
SHAPES = 6
#: What is expected of their coefficients: angles [rad] and rates [rad/s].
ANGLES = 1.0 / np.maximum(np.arange(SHAPES), 0.2) ** 2
RATES = 30.0 / np.maximum(np.arange(SHAPES), 0.5)


def basis(places: Array) -> Array:
    """The cosines at these shares of the length, (places, SHAPES)."""
    return np.cos(np.pi * np.outer(places, np.arange(SHAPES)))


def edges(nodes: int) -> Array:
    """The cosines at the middles of edges, (nodes - 1, SHAPES)."""
    return basis((np.arange(nodes - 1) + 0.5) / (nodes - 1))


def marks(places: Array, nodes: int, smooth: bool) -> Array:
    """Positions of markers from those of nodes, (markers, nodes).

    `places` are shares of the length. A smooth rod is a cubic through the four nearest nodes, a
    rod of so many straight edges is straight between two.
    """
    count = min(4 if smooth else 2, nodes)
    weights = np.zeros((len(places), nodes))
    for row, at in zip(weights, places * (nodes - 1), strict=True):
        first = int(np.clip(np.floor(at) - (count // 2 - 1), 0, nodes - count))
        chosen = np.arange(first, first + count)
        for i in chosen:
            others = chosen[chosen != i]
            row[i] = np.prod((at - others) / (i - others))
    return weights


def guess(tracks: Tracks, places: Array, tilt: float = 0.0) -> tuple[Array, Array]:
    """Coefficients of angles and rates in every frame, from markers alone, (frames, SHAPES) each.

    They are rough: what a fit starts from.
    """
    angles = np.full((len(tracks.times), SHAPES), np.nan)
    for frame, row in zip(tracks.points, angles, strict=True):
        seen = np.flatnonzero(np.isfinite(frame).all(axis=1))
        if len(seen) < 3:
            continue
        ways = np.diff(frame[seen], axis=0)
        turned = np.unwrap(np.arctan2(ways[:, 0], -ways[:, 1])) - tilt
        middles = (places[seen][1:] + places[seen][:-1]) / 2
        # Ridge regression: the few markers do not hold all coefficients.
        wide = basis(middles / places[-1]) * ANGLES
        row[:] = ANGLES * np.linalg.solve(wide.T @ wide + 1e-3 * np.eye(SHAPES), wide.T @ turned)
    known = np.isfinite(angles[:, 0])
    angles[known, 0] = np.unwrap(angles[known, 0])
    angles = np.column_stack(
        [np.interp(tracks.times, tracks.times[known], column[known]) for column in angles.T]
    )
    return angles, np.gradient(angles, tracks.times, axis=0)
