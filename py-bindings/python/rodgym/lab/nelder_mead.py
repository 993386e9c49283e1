"""Nelder and Mead's simplex, which the thesis fitted with (its fminsearch)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rodgym.lab.tracks import Array


def minimise(cost: Callable[[Array], float], start: Array, size: float, rounds: int) -> Array:
    """Where the cost is least, after a fixed number of rounds.

    Parameters
    ----------
    size: how far the first simplex reaches from the start, along every unknown
    """
    n = len(start)
    points = [start, *(start + size * np.eye(n)[i] for i in range(n))]
    values = [cost(p) for p in points]
    for _ in range(rounds):
        order = np.argsort(values)
        points, values = [points[i] for i in order], [values[i] for i in order]
        centre = np.mean(points[:-1], axis=0)
        reflected = 2 * centre - points[-1]
        at_reflected = cost(reflected)
        if at_reflected < values[0]:
            expanded = 3 * centre - 2 * points[-1]
            at_expanded = cost(expanded)
            better = at_expanded < at_reflected
            points[-1] = expanded if better else reflected
            values[-1] = at_expanded if better else at_reflected
        elif at_reflected < values[-2]:
            points[-1], values[-1] = reflected, at_reflected
        else:
            inner = 0.5 * (centre + points[-1])
            at_inner = cost(inner)
            if at_inner < values[-1]:
                points[-1], values[-1] = inner, at_inner
            else:
                points = [points[0], *(0.5 * (points[0] + p) for p in points[1:])]
                values = [values[0], *(cost(p) for p in points[1:])]
    return points[int(np.argmin(values))]
