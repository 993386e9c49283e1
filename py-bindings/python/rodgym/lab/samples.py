"""Between the samples of a signal."""

from __future__ import annotations

import numpy as np

from rodgym.lab.tracks import Array


def cubic(times: Array, values: Array, at: Array) -> Array:
    """Values between samples, by the cubic whose slopes are those of the neighbours."""
    slopes = np.gradient(values, times)
    low = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    width = times[low + 1] - times[low]
    u = np.clip((at - times[low]) / width, 0.0, 1.0)
    return np.asarray(
        (1 + 2 * u) * (1 - u) ** 2 * values[low]
        + u * (1 - u) ** 2 * width * slopes[low]
        + u**2 * (3 - 2 * u) * values[low + 1]
        + u**2 * (u - 1) * width * slopes[low + 1]
    )
