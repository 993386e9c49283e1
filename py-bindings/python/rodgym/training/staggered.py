"""Lets the environments of a batch be at different times of their episodes.

All environments of a batch begin together, and where episodes last equally long, they go on
together: a rollout of 64 steps then shows an agent the swing-up of all of them or of none. An agent
that learns from one phase after the other forgets, and settles for a worse way up.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper


class Staggered(VecEnvWrapper):
    """At a reset, environment i of n begins where it has done nothing for i / n of an episode.

    Its first episode is that much shorter; all later ones are as ever. Needs environments with
    snapshots (`get_state`) and a time limit, as those of rodgym have them.
    """

    #: Neither observations nor actions mean anything else behind it.
    transparent = True

    def __init__(self, venv: VecEnv) -> None:
        super().__init__(venv)
        steps = venv.get_attr("spec", 0)[0].max_episode_steps
        assert steps is not None, "episodes need a time limit"
        #: Step of an episode at which each environment begins.
        self.begins = steps * np.arange(self.num_envs) // self.num_envs

    def reset(self) -> NDArray[np.float32]:  # type: ignore[override]
        """The observations of different times."""
        observation = np.array(self.venv.reset())
        states: list[Any] = self.venv.env_method("get_state")
        shown = observation.copy()
        idle = np.zeros((self.num_envs, *(self.action_space.shape or ())), np.float32)
        for step in range(1, int(self.begins[-1]) + 1):
            observation = np.array(self.venv.step(idle)[0])
            due = np.flatnonzero(self.begins == step).tolist()
            for i, state in zip(due, self.venv.env_method("get_state", indices=due), strict=True):
                states[i], shown[i] = state, observation[i]
        for i, state in enumerate(states):
            self.venv.env_method("set_state", state, indices=i)
        return shown

    def step_wait(self) -> Any:
        """As the batch's."""
        return self.venv.step_wait()
