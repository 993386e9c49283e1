"""What is measured of an episode.

A score sees whole trajectories of n episodes at once, as arrays of shape (T, n), and answers with
one number per episode and column. The columns stand in the machine's description
(`rodgym.machines`). Nothing here simulates anything.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgym import machines
from rodgym.machines import Column
from rodgym.machines.description import Floats

__all__ = ["Column", "Trajectories", "columns_for", "score"]


@dataclass(frozen=True)
class Trajectories:
    """n episodes side by side, padded at the end.

    ``spec`` is what the core says of the environment; ``alive[t, i]`` is set where step t is one of
    episode i; ``metrics`` are the numbers that the environment reports at every step, (T, n) each;
    ``terminated`` (n,) says which episodes the task ended before the time limit; ``parameters`` are
    those of each episode, (n,) each; ``observations`` (T + 1, n, d), where they were kept, begin
    with those of the start.
    """

    spec: Mapping[str, Any]
    alive: NDArray[np.bool_]
    rewards: Floats
    actions: NDArray[np.float32]
    metrics: Mapping[str, Floats]
    terminated: NDArray[np.bool_]
    parameters: Mapping[str, Floats] = field(default_factory=dict)
    observations: NDArray[np.float32] | None = None
    seeds: tuple[int, ...] = ()

    @property
    def control_dt(self) -> float:
        """Duration of a step [s]."""
        return float(self.spec["control_dt"])

    @property
    def steps(self) -> NDArray[np.intp]:
        """Steps of each episode, (n,)."""
        return self.alive.sum(axis=0)

    def total(self, values: Floats, where: NDArray[np.bool_] | None = None) -> Floats:
        """Sum over each episode, (n,), or over the steps that `where` marks.

        Step by step: NumPy's own sum adds one episode in another order than many side by side, so
        that the last bits of a score would depend on who else was played.
        """
        marked = self.alive if where is None else where
        return np.asarray(np.where(marked, values, 0.0).cumsum(axis=0)[-1], np.float64)

    def mean(self, values: Floats) -> Floats:
        """Mean over each episode, (n,)."""
        return self.total(values) / self.steps

    def mean_of_last(self, seconds: float, values: Floats) -> Floats:
        """Mean over the last ``seconds`` of each episode, (n,); over all of a shorter one."""
        count = max(1, round(seconds / self.control_dt))
        index = np.arange(len(values))[:, None]
        window = self.alive & (index >= self.steps - count)
        return self.total(values, window) / window.sum(axis=0)

    def last(self, values: Floats) -> Floats:
        """The value at the end of each episode, (n,)."""
        return values[self.steps - 1, np.arange(values.shape[1])]

    def rms(self, values: Floats) -> Floats:
        """Root of the mean square over each episode, (n,)."""
        return np.sqrt(self.mean(values**2))


def columns_for(spec: Mapping[str, Any]) -> tuple[Column, ...]:
    """The columns of an environment, by its `core_spec` or catalogue's row."""
    return machines.of(spec).columns_of(spec["task"])


def score(run: Trajectories) -> dict[str, Floats]:
    """One (n,) array per column of `columns_for`."""
    return {column.name: column.measure(run) for column in columns_for(run.spec)}
