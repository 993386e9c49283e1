"""Residuals that are alike: of neighbouring frames, markers and samples.

Noise of one frame tells nothing of the next. A lens that is not quite known, or a model that does
not quite follow, is off by nearly the same in both, so that a film tells less than its number of
frames says, and intervals are wider.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rodgym.lab.gauss_newton import OUTLIER
from rodgym.lab.tracks import Array

#: Correlations are no chance beyond so many of their deviations; a sum of them goes on to where
#: they are no more than the second.
CERTAIN, CHANCE = 4.0, 2.0
#: The longest way that correlations are summed up, as a share of all there is.
LONGEST = 0.25


def likeness(gaps: Sequence[Array], axis: int = 0, lag: int = 1) -> float:
    """Correlation of residuals with those so much farther along an axis; outliers count little."""
    found, _ = _correlation([_bounded(gap, _rough(gaps)) for gap in gaps], axis, lag)
    return found


def widening(gaps: Sequence[Array]) -> float:
    """The variance of what a fit finds, over that of residuals that are not alike: at least 1.

    Parameters
    ----------
    gaps: of each recording, of a film (frames, markers, 2), of a load (samples,); NaN where
        nothing was seen
    """
    bounded = [_bounded(gap, _rough(gaps)) for gap in gaps]
    factor = 1.0
    for axis in range(min(2, bounded[0].ndim)):
        factor *= 1 + 2 * sum(_correlations(bounded, axis))
    return factor


def _correlations(bounded: Sequence[Array], axis: int) -> list[float]:
    """Correlations with the next, the one after, and so on, to where they are none."""
    found = list[float]()
    longest = max(gap.shape[axis] for gap in bounded)
    for lag in range(1, max(2, int(LONGEST * longest) + 1)):
        one, pairs = _correlation(bounded, axis, lag)
        least = CHANCE if found else CERTAIN
        if pairs == 0 or one < least / np.sqrt(pairs):
            break
        found.append(one)
    return found


def _correlation(bounded: Sequence[Array], axis: int, lag: int) -> tuple[float, int]:
    """Correlation of what is so far apart, and how many pairs there are."""
    products, squares = list[Array](), list[Array]()
    for gap in bounded:
        moved = np.moveaxis(gap, axis, 0)
        products.append((moved[lag:] * moved[:-lag]).ravel())
        squares.append(moved.ravel() ** 2)
    together = np.concatenate(products)
    pairs = int(np.isfinite(together).sum())
    square = float(np.nanmean(np.concatenate(squares)))
    if pairs == 0 or square == 0.0:
        return 0.0, 0
    return float(np.nanmean(together)) / square, pairs


def _rough(gaps: Sequence[Array]) -> float:
    """Their deviation, as the median tells it."""
    return 1.4826 * float(np.nanmedian(np.abs(np.concatenate([gap.ravel() for gap in gaps]))))


def _bounded(gap: Array, rough: float) -> Array:
    """Residuals, of which outliers are no larger than the least outlier."""
    return np.clip(gap, -OUTLIER * rough, OUTLIER * rough)
