"""Anything with ``predict``: where policies come from by name or by file."""

from __future__ import annotations

import json
import pickle
import zipfile
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import rodgym
from rodgym import _checks as checks
from rodgym import _native
from rodgym.zoo import zoo_policy

AnyEnv: TypeAlias = "gym.Env[Any, Any] | gym.vector.VectorEnv[Any, Any, Any]"

#: Member of a saved policy's zip file that says how it was trained.
CARD = "rodgym.json"
#: The member with the statistics of its `VecNormalize`.
STATISTICS = "vecnormalize.pkl"


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
        shape = (*observation.shape[:-1], *self.space.shape)
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
        return np.zeros((*observation.shape[:-1], *self.space.shape), np.float32), None


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
    """A policy that sees observations normalised by the statistics of its training."""

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


def controller_names() -> list[str]:
    """Names that :func:`load_policy` takes beside files."""
    return [*(name for name, _ in _native.controllers()), "random", "zero"]


def load_policy(source: str, env: AnyEnv) -> Policy:
    """The policy called ``source``, ready for ``env`` (single or vector).

    Parameters
    ----------
    source: a controller's name (:func:`controller_names`), ``zoo`` for the trained policy that
        comes with rodgym, or the path of a saved policy (``runs/demo/policy.zip``)
    env: environment that it will play in; controllers design themselves for its parameters

    Raises
    ------
    PolicyError: unknown name, unreadable file, or a policy for other observations or actions
    """
    single: Any = getattr(env, "single_action_space", env.action_space)
    if source == "random":
        return Random(single)
    if source == "zero":
        return Zero(single)
    if source in controller_names():
        from rodgym import baselines

        controller: Policy = baselines.make(source, env)
        return controller
    path = find(source, env)
    return _load_trained(path, env)


def find(source: str, env: AnyEnv | None = None) -> Path:
    """The file of a trained policy: ``zoo`` (of `env`), a path, or a run's folder."""
    if source == "zoo":
        assert env is not None and env.spec is not None
        found = zoo_policy(env.spec.id)
        if found is None:
            raise PolicyError(f"no trained policy for {env.spec.id} comes with rodgym")
        return found
    path = Path(source)
    if path.is_dir():
        path = path / "policy.zip"
    if not path.is_file():
        names = ", ".join(["zoo", *controller_names()])
        raise PolicyError(f"policy {source!r} is neither a file nor one of {names}")
    return path


def read_card(path: Path) -> dict[str, Any]:
    """What a saved policy says of its training: ``env``, ``env_kwargs``, ``algorithm``, ..."""
    try:
        with zipfile.ZipFile(path) as archive:
            card = json.loads(archive.read(CARD))
    except (zipfile.BadZipFile, KeyError, json.JSONDecodeError) as error:
        raise PolicyError(f"{path} is not a policy saved by rodgym ({error})") from error
    assert isinstance(card, dict)
    return card


def _load_trained(path: Path, env: AnyEnv) -> Policy:
    import torch

    from rodgym.zoo.algorithms import AlgorithmError, algorithm_class

    torch.set_num_threads(1)
    card = read_card(path)
    try:
        algorithm = algorithm_class(str(card.get("algorithm")))
    except AlgorithmError as error:
        raise PolicyError(f"{path}: {error}") from error
    if card.get("wrappers"):
        raise PolicyError(
            f"{path} was trained behind {', '.join(card['wrappers'])}, which an evaluation does "
            "not know"
        )
    model: Any = algorithm.load(path, device="cpu")
    with zipfile.ZipFile(path) as archive:
        member = STATISTICS in archive.namelist()
        statistics = pickle.loads(archive.read(STATISTICS)) if member else None
    depth = int(card.get("frame_stack", 1))
    space: Any = getattr(env, "single_observation_space", env.observation_space)
    action_space: Any = getattr(env, "single_action_space", env.action_space)
    own_actions = model.action_space.shape[0] if card.get("own_actions") else 0
    seen = model.observation_space.shape[0] // depth - own_actions
    if seen != space.shape[0] or model.action_space.shape != action_space.shape:
        raise PolicyError(
            f"{path} was trained in {card['env']} and sees {seen} numbers; "
            f"this environment shows {space.shape[0]}"
        )
    return behind(model, depth, own_actions, statistics)


def behind(model: Any, depth: int, own_actions: int, statistics: Any) -> Policy:
    """A model behind what its training put before it."""
    policy: Policy = model
    if depth > 1:
        policy = Stacked(policy, depth)
    if statistics is not None and statistics.norm_obs:
        policy = Normalized(policy, statistics)
    return Stacked(policy, 1, own_actions) if own_actions else policy
