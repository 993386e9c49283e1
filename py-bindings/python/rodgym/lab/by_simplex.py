"""A pendulum's fit as the thesis fitted its fin (3.4.1), to compare: Nelder and Mead's simplex on
the cost (3.1).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rodgym.lab.nelder_mead import minimise
from rodgym.lab.result import Fit
from rodgym.lab.search import ROUGH
from rodgym.lab.tracks import Array

#: First simplex (logarithms), rounds, and nodes of the model.
SIMPLEX, ROUNDS, NODES = 0.7, 40, 25
#: Cost of what cannot be simulated [m].
NOWHERE = 1e9


def fit_by_simplex(fit: Fit, start: Mapping[str, float]) -> tuple[dict[str, float], float]:
    """Parameters of the same film by the simplex, and the cost [m].

    Camera and start of the rod are those that `fit` has found: the simplex has no way to find so
    many numbers. It gives no intervals, and an answer also where there is none.

    Parameters
    ----------
    start: where the simplex begins, for each parameter that was free
    """
    names = list(fit.parameters)
    film = fit.film
    if fit.twin is not None:
        film = replace(film, rod=replace(film.rod, nodes=NODES, steps=ROUGH))
    rest = fit.estimate.x[len(names) :]

    def cost(logs: Array) -> float:
        gaps = film.gaps(np.concatenate([logs, rest]))
        return float(np.sqrt(np.sum(gaps**2))) if np.isfinite(gaps).all() else NOWHERE

    found = minimise(cost, np.log([start[name] for name in names]), SIMPLEX, ROUNDS)
    return dict(zip(names, (float(v) for v in np.exp(found)), strict=True)), cost(found)
