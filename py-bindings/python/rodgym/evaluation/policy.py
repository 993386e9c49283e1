"""What a policy is, anything with ``predict``, and the question that it is asked."""

from __future__ import annotations

from typing import Any, Protocol, TypeAlias

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import rodgym
from rodgym import _checks as checks

AnyEnv: TypeAlias = "gym.Env[Any, Any] | gym.vector.VectorEnv[Any, Any, Any]"


class PolicyError(rodgym.RodgymError, ValueError):
    """A policy that cannot be found, read or used in this environment."""


class Policy(Protocol):
    """The signature of a Stable-Baselines3 policy, which every controller of rodgym has too."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Actions (n, a) for observations (n, d), and the policy's own state for the next call."""


def check_policy(policy: object) -> None:
    """Refuses what is neither a name nor has `predict`."""
    if not isinstance(policy, str) and not callable(getattr(policy, "predict", None)):
        raise PolicyError(f"policy = {policy!r} is not allowed: it must be a name or have predict")


def label_of(policy: str | Policy, name: str | None) -> str:
    """What tables call a policy."""
    return name or (policy if isinstance(policy, str) else type(policy).__name__)


def ask(
    policy: Policy, observation: NDArray[np.float32], state: Any, start: NDArray[np.bool_]
) -> tuple[NDArray[Any], Any]:
    """Actions (n, a), deterministic, for observations (n, d), and the policy's next state.

    Raises
    ------
    PolicyError: the policy does not answer with a pair of one action a row and a state
    ShapeError: the actions are no numbers
    """
    answer = policy.predict(observation, state, start, deterministic=True)
    if not isinstance(answer, tuple) or len(answer) != 2:
        raise PolicyError(
            f"{type(policy).__name__}.predict returned {answer!r}, but (actions, state) is needed"
        )
    action = checks.actions(answer[0])
    if action.ndim != 2 or len(action) != len(observation):
        raise PolicyError(
            f"{type(policy).__name__}.predict returned actions of shape {action.shape} for "
            f"observations of shape {observation.shape}: one row of actions a row is needed"
        )
    return action, answer[1]


def rows_of(observation: NDArray[Any]) -> tuple[int, ...]:
    """(n,) of a batch, () of one observation (d,)."""
    return observation.shape[:1] if observation.ndim > 1 else ()


class Random:
    """Uniform actions from a stream of its own, the same at every evaluation."""

    def __init__(self, space: gym.spaces.Box, seed: int = 0) -> None:
        self.space = space
        self.rng = np.random.default_rng(seed)

    def predict(
        self,
        observation: NDArray[np.float32],
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[np.float32], None]:
        shape = (*rows_of(observation), *self.space.shape)
        return self.rng.uniform(self.space.low, self.space.high, shape).astype(np.float32), None


class Zero:
    """No torque, no pitch: what the machine does alone."""

    def __init__(self, space: gym.spaces.Box) -> None:
        self.space = space

    def predict(
        self,
        observation: NDArray[np.float32],
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[np.float32], None]:
        return np.zeros((*rows_of(observation), *self.space.shape), np.float32), None
