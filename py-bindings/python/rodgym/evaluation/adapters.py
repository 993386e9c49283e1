"""What stands between an environment and a trained policy: what it saw in its training.

Adapters have ``predict`` themselves and hold the policy inside, so they stack as wrappers do.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgym.evaluation.policy import Policy, PolicyError


class Stacked:
    """A policy that sees the last ``depth`` observations, oldest first, as it did in training.

    With ``own_actions`` (n numbers) each observation is followed by the action that led to it.
    Before an episode's first observation there are zeros (``VecFrameStack`` of Stable-Baselines3).
    """

    def __init__(self, policy: Policy, depth: int, own_actions: int = 0) -> None:
        self.policy = policy
        self.depth = depth
        self.own_actions = own_actions

    def predict(
        self,
        observation: NDArray[np.float32],
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[Any, tuple[Any, ...]]:
        batch = np.atleast_2d(observation)
        size = batch.shape[1] + self.own_actions
        if state is None:
            past = np.zeros((len(batch), (self.depth - 1) * size), batch.dtype)
            last = np.zeros((len(batch), self.own_actions), batch.dtype)
            inner = None
        else:
            past, last, inner = state
            if episode_start is not None:
                past, last = past.copy(), last.copy()
                past[np.atleast_1d(episode_start)] = 0
                last[np.atleast_1d(episode_start)] = 0
        seen = np.concatenate([past, batch, last], axis=1)
        action, inner = self.policy.predict(
            seen if observation.ndim == 2 else seen[0], inner, episode_start, deterministic
        )
        last = np.atleast_2d(action)[:, : self.own_actions]
        return action, (seen[:, size:], last, inner)


class Normalized:
    """A policy that sees observations normalised by the statistics of its training.

    Parameters
    ----------
    statistics: a ``VecNormalize`` of Stable-Baselines3, with or without its environments; it
        learns nothing here
    """

    def __init__(self, policy: Policy, statistics: Any) -> None:
        self.policy = policy
        self.statistics = statistics

    def predict(
        self,
        observation: NDArray[np.float32],
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        seen = self.statistics.normalize_obs(observation)
        return self.policy.predict(seen, state, episode_start, deterministic)  # type: ignore[no-any-return]


def behind(model: Any, frames: int, own_actions: int, statistics: Any) -> Policy:
    """A model of Stable-Baselines3 behind what its training put before it.

    Parameters
    ----------
    frames: observations that it sees at once
    own_actions: numbers of its own last action after each of them
    statistics: a ``VecNormalize``, or None; the count of its numbers tells where it stood: over the
        stacked frames, over an observation with the last action, or over the observation alone

    Raises
    ------
    PolicyError: statistics of another count
    """
    policy: Policy = model
    each = model.observation_space.shape[0] // frames
    counted = None
    if statistics is not None and statistics.norm_obs:
        counted = int(statistics.obs_rms.mean.size)
        if counted not in (frames * each, each, each - own_actions):
            raise PolicyError(
                f"the statistics are of {counted} numbers, but {each - own_actions} are normalised"
            )
    if frames > 1:
        stood = Normalized(policy, statistics) if counted == frames * each else policy
        policy = Stacked(stood, frames)
    if counted == each:
        policy = Normalized(policy, statistics)
    if own_actions:
        policy = Stacked(policy, 1, own_actions)
        policy = Normalized(policy, statistics) if counted == each - own_actions else policy
    return policy
