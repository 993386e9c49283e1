"""Several trainings of one recipe as one row: all their episodes together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rodgym.evaluation.episodes import Evaluation


def several(name: str, count: int) -> str:
    """What a row of several trainings is called."""
    return f"{name}, {count} training seeds"


def pooled(evaluations: Sequence[Evaluation], name: str) -> Evaluation:
    """The episodes of several policies on the same seeds, so that means are those over all of them.

    Every seed stands there once a policy.
    """
    first = evaluations[0]

    def joined(of: str, key: str) -> NDArray[np.float64]:
        return np.concatenate([getattr(evaluation, of)[key] for evaluation in evaluations])

    return Evaluation(
        policy=name,
        env_id=first.env_id,
        seeds=tuple(seed for evaluation in evaluations for seed in evaluation.seeds),
        described=first.described,
        columns={key: joined("columns", key) for key in first.columns},
        design=first.design,
        parameters={key: joined("parameters", key) for key in first.parameters},
        env_kwargs=first.env_kwargs,
        best_known=first.best_known,
        trajectories=tuple(t for evaluation in evaluations for t in evaluation.trajectories),
    )


def scores(evaluations: Sequence[Evaluation], column: str = "return") -> NDArray[np.float64]:
    """A column as an array (trainings, episodes), as `rodgym.evaluation.statistics` takes it."""
    return np.array([evaluation.columns[column] for evaluation in evaluations])
