"""Gauss and Newton's method with Levenberg's damping, a robust loss and a prior."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rodgym.lab.errors import MisfitError
from rodgym.lab.tracks import Array

#: Residuals beyond this many deviations count linearly (Huber).
HUBER = 3.0
#: In the end, residuals beyond this many deviations are outliers and count nothing.
OUTLIER = 4.5
#: A step of less than this share of the estimate's own deviation changes nothing; on the way to
#: the next fit a longer one is small enough.
SMALL, ROUGHLY = 0.03, 0.3
#: Damping at the start, and where no step makes the fit better any more.
DAMPING, STUCK = 1e-3, 1e8


@dataclass(frozen=True)
class Prior:
    """What is known before, as a Gaussian of each unknown; infinite deviation: nothing."""

    mean: Array
    deviation: Array

    @property
    def weight(self) -> Array:
        """1 / variance."""
        return self.deviation**-2.0


@dataclass(frozen=True)
class Estimate:
    """Where a fit has ended."""

    x: Array
    covariance: Array
    residuals: Array
    #: Which residuals are no outliers.
    kept: npt.NDArray[np.bool_]
    #: Deviation of the residuals that were kept, of each kind.
    sigmas: tuple[float, ...]
    iterations: int
    converged: bool

    @property
    def sigma(self) -> float:
        """Deviation of the residuals of the first kind."""
        return self.sigmas[0]


#: Residuals (m,) and their derivatives (m, n); NaN where there is no model.
Model = Callable[[Array], tuple[Array, Array]]


class Kinds:
    """Residuals of several kinds, each with a deviation of its own that nobody knows before.

    Parameters
    ----------
    of: the kind of each residual, counted from 0
    floors: the least deviation of each kind that is believed
    """

    def __init__(self, of: npt.NDArray[np.int_], floors: Sequence[float]) -> None:
        self.floors = floors
        self._all = [np.flatnonzero(of == kind) for kind in range(len(floors))]
        self._of = of

    def spread(self, residuals: Array) -> list[float]:
        """The deviation of each kind, as its median tells it."""
        return [
            max(1.4826 * float(np.median(np.abs(residuals[own]))), floor) if len(own) else floor
            for own, floor in zip(self._all, self.floors, strict=True)
        ]

    def deviations(self, residuals: Array, kept: npt.NDArray[np.bool_], free: int) -> list[float]:
        """The deviation of what was kept of each kind; the unknowns have taken some of it."""
        share = 1 - free / max(int(kept.sum()), free + 1)
        found = []
        for own, floor in zip(self._all, self.floors, strict=True):
            inner = residuals[own][kept[own]]
            mean = float(np.sum(inner**2)) / max(len(inner) * share, 1.0)
            found.append(max(float(np.sqrt(mean)), floor))
        return found

    def at(self, deviations: Sequence[float]) -> Array:
        """The deviation at each residual from that of each kind."""
        return np.array(deviations)[self._of]


def solve(
    model: Model,
    x: Array,
    prior: Prior,
    bounds: tuple[Array, Array],
    stride: Array,
    floor: float,
    rounds: int = 30,
    final: bool = True,
    kinds: Kinds | None = None,
) -> Estimate:
    """The most probable unknowns.

    Parameters
    ----------
    bounds: lowest and highest value of each unknown
    stride: the longest step of each unknown
    floor: the least deviation of the residuals that is believed
    final: throws outliers out in the end; else they only count less
    kinds: of the residuals; left out: one kind with this floor
    """
    residuals, slopes = model(x)
    if not np.isfinite(residuals).all():
        raise MisfitError("the rod that the fit starts from cannot be simulated (--start)")
    kinds = kinds or Kinds(np.zeros(len(residuals), int), (floor,))
    damping, iterations, converged = DAMPING, 0, False
    for outliers in (False, True) if final else (False,):
        damping, converged = DAMPING, False
        limit = SMALL if outliers else ROUGHLY
        while iterations < rounds and not converged:
            iterations += 1
            sigma = kinds.at(kinds.spread(residuals))
            normal, slope = _normal(residuals, slopes, x, prior, sigma, outliers)
            before = _cost(residuals, x, prior, sigma, outliers)
            while True:
                way = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), -slope)
                way *= min(1.0, float(1 / np.max(np.abs(way) / stride)))
                there = np.clip(x + way, *bounds)
                way = there - x
                small = float(np.sqrt(way @ normal @ way)) < limit
                trial, trial_slopes = model(there)
                after = _cost(trial, there, prior, sigma, outliers)
                if after <= before:
                    x, residuals, slopes = there, trial, trial_slopes
                    damping = max(damping / 10, 1e-9)
                    converged = small
                    break
                if small or damping > STUCK:
                    converged = True
                    break
                damping = max(damping * 10, 1e-3)
    sigmas = kinds.spread(residuals)
    kept = np.abs(residuals) <= (OUTLIER * kinds.at(sigmas) if final else np.inf)
    if final:
        sigmas = kinds.deviations(residuals, kept, len(x))
    sigma = kinds.at(sigmas)
    normal, _ = _normal(residuals, slopes, x, prior, sigma, final)
    covariance = np.asarray(np.linalg.inv(normal), np.float64)
    return Estimate(x, covariance, residuals, kept, tuple(sigmas), iterations, converged)


def _weights(scaled: Array, outliers: bool) -> Array:
    """Weights of residuals in deviations."""
    size = np.abs(scaled)
    if outliers:
        return (size <= OUTLIER).astype(np.float64)
    return np.minimum(1.0, HUBER / np.maximum(size, 1e-300))


def _normal(
    residuals: Array, slopes: Array, x: Array, prior: Prior, sigma: Array, outliers: bool
) -> tuple[Array, Array]:
    """The normal equations: matrix and gradient."""
    weighted = slopes * (_weights(residuals / sigma, outliers) / sigma**2)[:, np.newaxis]
    matrix = weighted.T @ slopes + np.diag(prior.weight)
    return matrix, weighted.T @ residuals + prior.weight * (x - prior.mean)


def _cost(residuals: Array, x: Array, prior: Prior, sigma: Array, outliers: bool) -> float:
    """Half the squared deviations, of outliers less; infinite where there is no model."""
    if not np.isfinite(residuals).all():
        return float("inf")
    size = np.abs(residuals) / sigma
    far = OUTLIER**2 if outliers else HUBER * (2 * size - HUBER)
    loss = np.where(size <= (OUTLIER if outliers else HUBER), size**2, far)
    return 0.5 * float(loss.sum() + np.sum(prior.weight * (x - prior.mean) ** 2))
