"""What tests of trainings put into recipes: callbacks and wrappers, by their dotted names."""

from __future__ import annotations

import os
import signal

import gymnasium as gym
import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnvWrapper

#: Set, it lets `Dies` die.
DYING = "RODGYM_TEST_DYING"


class Dies(BaseCallback):
    """Ends the process in its step `calls`, as ``kill -9`` does, or raises; if it may die."""

    def __init__(self, calls: int) -> None:
        super().__init__()
        self.calls = calls

    def _on_step(self) -> bool:
        how = os.environ.get(DYING)
        if how and self.n_calls == self.calls:
            if how == "kill":
                os.kill(os.getpid(), signal.SIGKILL)
            raise RuntimeError("died")
        return True


class Halves(gym.ObservationWrapper):
    """Observations times `factor`."""

    def __init__(self, env: gym.Env, factor: float = 0.5) -> None:
        super().__init__(env)
        self.factor = factor

    def observation(self, observation: np.ndarray) -> np.ndarray:
        return (self.factor * observation).astype(np.float32)


class Doubles(VecEnvWrapper):
    """The same around a batch."""

    def reset(self):
        return 2 * self.venv.reset()

    def step_wait(self):
        observations, *rest = self.venv.step_wait()
        return 2 * observations, *rest
