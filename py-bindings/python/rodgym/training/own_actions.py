"""Shows an agent what it did itself: each observation is followed by the action that led to it.

An observer such as the Kalman filter knows the torque that it commanded; an agent that sees outputs
only can infer the rod's state from a few of them, but not without their cause.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper


class OwnActions(VecEnvWrapper):
    """Observations (n, d) become (n, d + a); the action part is zero when an episode begins."""

    def __init__(self, venv: VecEnv) -> None:
        seen, done = venv.observation_space, venv.action_space
        assert isinstance(seen, Box) and isinstance(done, Box)
        space = Box(
            np.concatenate([seen.low, done.low]).astype(np.float32),
            np.concatenate([seen.high, done.high]).astype(np.float32),
        )
        super().__init__(venv, observation_space=space)
        self._last = np.zeros((venv.num_envs, *done.shape), np.float32)

    def reset(self) -> NDArray[np.float32]:  # type: ignore[override]
        """As the environment's."""
        self._last[:] = 0
        return np.concatenate([self.venv.reset(), self._last], axis=1)  # type: ignore[list-item]

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """As the environment's."""
        self._last = np.array(actions, np.float32)
        self.venv.step_async(actions)

    def step_wait(self) -> Any:
        """As the environment's."""
        observations, rewards, dones, infos = self.venv.step_wait()
        for i in np.flatnonzero(dones):
            final = infos[i]["terminal_observation"]
            infos[i]["terminal_observation"] = np.concatenate([final, self._last[i]])
        self._last[dones] = 0
        return np.concatenate([observations, self._last], axis=1), rewards, dones, infos  # type: ignore[list-item]
