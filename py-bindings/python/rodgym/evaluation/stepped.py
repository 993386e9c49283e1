"""Policies that are a function from observation and memory to action and memory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgym import _checks as checks
from rodgym.errors import ShapeError
from rodgym.evaluation.policy import AnyEnv, PolicyError

Rows = NDArray[np.float32]
#: Actions (n, a) and next state (n, s) for observations (n, d) and state (n, s).
Step = Callable[[Rows, Rows], tuple[Rows, Rows]]


class Stepped:
    """`predict` over a function from observation and state to action and state.

    The state is one row of numbers an episode, zero at its beginning.
    """

    def __init__(self, step: Step, observation: int, state: int) -> None:
        self._step = step
        self.observation_size = observation
        self.state_size = state

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Rows, Rows]:
        """Actions for one observation (d,) or a batch (n, d), and the next state (n, s).

        Raises:
            ShapeError: arrays that do not belong together.
        """
        array = checks.numbers("observation", observation, np.float32)
        rows = np.atleast_2d(array)
        if array.ndim not in (1, 2) or rows.shape[1] != self.observation_size:
            size = self.observation_size
            raise ShapeError(
                f"observation has shape {array.shape}, but ({size},) or (n, {size}) is needed"
            )
        memory = np.zeros((len(rows), self.state_size), np.float32)
        if state is not None:
            given = np.asarray(state, np.float32)
            if given.shape != memory.shape:
                raise ShapeError(f"state has shape {given.shape}, but {memory.shape} is needed")
            start = np.zeros(len(rows), bool) if episode_start is None else episode_start
            memory = np.where(np.atleast_1d(np.asarray(start, bool))[:, None], memory, given)
        action, memory = self._step(rows, memory)
        return (action if array.ndim == 2 else action[0]), memory


def check_sizes(
    path: Path, card: Mapping[str, Any], env: AnyEnv, observation: int, action: int
) -> None:
    """Refuses a policy's file for an environment of other observations or actions.

    Raises:
        PolicyError: says what the policy sees and what the environment shows.
    """
    seen: Any = getattr(env, "single_observation_space", env.observation_space)
    done: Any = getattr(env, "single_action_space", env.action_space)
    if seen.shape != (observation,) or done.shape != (action,):
        raise PolicyError(
            f"{path} was trained in {card.get('env')} and sees {observation} numbers; this "
            f"environment shows {seen.shape[0]}"
        )
