"""Samples that get lost on their way to a policy: it is shown NaN in their place."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgym.evaluation.policy import Policy

Rows = NDArray[np.float32]


def lose(observation: Rows, share: NDArray[np.float64], rng: np.random.Generator) -> Rows:
    """Observations (n, d), of which row i is lost with probability `share[i]`."""
    lost = rng.random(len(share)) < share
    return np.where(lost[:, None], np.float32("nan"), observation)


class Lossy:
    """A policy behind a bad line: each row loses its own share of samples, drawn from 0 to `most`.

    The first sample of an episode arrives.
    """

    def __init__(self, policy: Policy, most: float, seed: int) -> None:
        self.policy = policy
        self.most = most
        self.rng = np.random.default_rng(seed)
        self.share = np.zeros(0)

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """As the policy's."""
        if state is None:
            self.share = self.rng.uniform(0, self.most, len(observation))
        else:
            observation = lose(observation, self.share, self.rng)
        return self.policy.predict(observation, state, episode_start, deterministic)
