"""How far a fit can be trusted: what the film does not tell, and what the model foretells."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from rodgym.lab.film import Film
from rodgym.lab.gauss_newton import OUTLIER, Estimate
from rodgym.lab.result import Holdout, Interval
from rodgym.lab.search import ROUNDS, STIFFNESS
from rodgym.lab.tracks import Array

if TYPE_CHECKING:
    from rodgym.lab.search import Search

#: What twice or half of E must cost, as a difference of chi-square, where a film tells E.
TOLD, TWICE = 30.0, 2.0
#: A parameter is not identified whose logarithm is known no better than this: a factor of 2.
VAGUE = float(np.log(2.0)) / 1.96
#: Share of the film that is fitted to foretell the rest.
SEEN = 2 / 3
#: Two parameters are known by their ratio or product only, beyond this correlation.
TOGETHER_ONLY = 0.98
#: Half of a 95 % interval in deviations.
WIDE = 1.96
#: Parameters that the swing tells even where the rod does not bend.
MOVES = ("damping", "gravity")
#: What to measure where a parameter is not identifiable.
ADVICE = {
    "density": "weigh the rod and give --known density=...",
    "youngs_modulus": "film a rod that is let go bent, or give --known youngs_modulus=...",
    "bending_damping": "film a rod that is let go bent, with more frames a second",
    "damping": "film for longer, or give --known damping=...",
    "width": "measure the rod and give --known width=...",
    "gravity": "give --known gravity=...",
}


def vague(search: Search, covariance: Array, film: Film, rough: Estimate) -> dict[str, str]:
    """Parameters that the film does not tell, with what would."""
    deviations = np.sqrt(np.diag(covariance))
    bent = bends(search, film, rough)
    return {
        name: ADVICE[name]
        for name, deviation in zip(search.free, deviations, strict=True)
        if deviation > VAGUE or not (bent or name in MOVES)
    }


def bends(search: Search, film: Film, found: Estimate) -> bool:
    """Whether the rod is seen to bend: then neither twice nor half of E fits as well.

    (Noise has a best E, too, and near it an interval that is too narrow.)
    """
    if STIFFNESS not in search.free:
        return True
    place = search.free.index(STIFFNESS)
    rest = tuple(name for name in search.free if name != STIFFNESS)
    costs = []
    for factor in (TWICE, 1 / TWICE):
        value = float(np.exp(found.x[place])) * factor
        rod = replace(film.rod, free=rest, known={**film.rod.known, STIFFNESS: value})
        other = search.solved(
            replace(film, rod=rod), np.delete(found.x, place), rounds=ROUNDS, final=False
        )
        costs.append(deviance(other.residuals, found.sigma))
    return min(costs) - deviance(found.residuals, found.sigma) > TOLD


def together(
    free: tuple[str, ...], logs: Array, covariance: Array, vague: Mapping[str, str]
) -> dict[str, Interval]:
    """Ratios and products of vague parameters that the film does tell."""
    found = {}
    for i, j in combinations(range(len(free)), 2):
        one, other = free[i], free[j]
        scale = np.sqrt(covariance[i, i] * covariance[j, j])
        if not {one, other} <= set(vague) or abs(covariance[i, j]) < TOGETHER_ONLY * scale:
            continue
        sign = -1.0 if covariance[i, j] > 0 else 1.0
        variance = covariance[i, i] + covariance[j, j] + 2 * sign * covariance[i, j]
        if variance < VAGUE**2:
            name = f"{one} {'/' if sign < 0 else '*'} {other}"
            found[name] = interval(logs[i] + sign * logs[j], float(np.sqrt(variance)))
    return found


def holdout(search: Search, film: Film, whole: Estimate, wider: float) -> Holdout:
    """Fits the first part of the film and foretells the rest; `wider` is the variance of what is
    found over that of residuals that are not alike.
    """
    frames = len(search.tracks.times)
    seen = int(SEEN * frames)
    first = replace(film, tracks=search.tracks.part(0, seen))
    found = search.solved(first, whole.x, final=False)
    rest = slice(seen, frames)

    def off(model: Array) -> float:
        gaps = model[rest] - search.tracks.points[rest]
        gaps = gaps[np.isfinite(gaps)]
        # (Outliers are no fault of the model.)
        return 1.4826 * float(np.median(np.abs(gaps)))

    guessed = found.x.copy()
    guessed[: len(search.free)] = np.log(search.values)
    model, slopes = film.predict(found.x)
    before, _ = film.predict(guessed)
    expected = foreseen(found, slopes[rest], wider)
    return Holdout(frames - seen, found.sigma, off(model), off(before), expected)


def foreseen(found: Estimate, slopes: Array, wider: float) -> float:
    """Deviation that is to be expected of what was not fitted, from its derivatives (..., n)."""
    variance = wider * np.einsum("...i,ij,...j->...", slopes, found.covariance, slopes)
    return float(np.sqrt(found.sigma**2 + np.median(variance)))


def interval(log: float, deviation: float) -> Interval:
    """A value and its 95 % interval, from its logarithm."""
    ends = log - WIDE * deviation, log + WIDE * deviation
    return Interval(float(np.exp(log)), *(float(np.exp(end)) for end in ends))


def deviance(residuals: Array, sigma: float) -> float:
    """Chi-square, in which an outlier counts no more than the least outlier."""
    return float(np.sum(np.minimum(np.abs(residuals) / sigma, OUTLIER) ** 2))
