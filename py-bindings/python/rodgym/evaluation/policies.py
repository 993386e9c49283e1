"""Anything with ``predict``: where policies come from by name or by file."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import rodgym
from rodgym import _checks as checks
from rodgym import _native, machines
from rodgym.zoo import zoo_policy

AnyEnv: TypeAlias = "gym.Env[Any, Any] | gym.vector.VectorEnv[Any, Any, Any]"

#: Member of a saved policy's zip file that says how it was trained.
CARD = "rodgym.json"
#: Who reads a policy's file, `module:function` of path, card and environment, by the `kind` that
#: its card says. A card that says none is of Stable-Baselines3.
KINDS = {
    "student": "rodgym.distil.policy:load",
    "onnx": "rodgym.export.policy:load",
}


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
        else:
            past, last = (part.copy() for part in state)
            if episode_start is not None:
                past[np.atleast_1d(episode_start)] = 0
                last[np.atleast_1d(episode_start)] = 0
        seen = np.concatenate([past, batch, last], axis=1)
        action, _ = self.policy.predict(
            seen if observation.ndim == 2 else seen[0], deterministic=deterministic
        )
        last = np.atleast_2d(action)[:, : self.own_actions]
        return action, (seen[:, size:], last)


def controller_names() -> list[str]:
    """Names that :func:`load_policy` takes beside files."""
    return [*(name for name, _ in _native.controllers()), "random", "zero"]


def load_policy(source: str, env: AnyEnv) -> Policy:
    """The policy called ``source``, ready for ``env`` (single or vector).

    Parameters
    ----------
    source: a controller's name (:func:`controller_names`), ``zoo`` or ``zoo:NAME`` for a trained
        policy that comes with rodgym, or the path of a saved policy (``runs/demo/policy.zip``)
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
    card = read_card(path)
    if "kind" not in card:
        return _load_trained(path, card, env)
    if card["kind"] not in KINDS:
        known = ", ".join(KINDS)
        raise PolicyError(f"{path}: kind {card['kind']!r} is not one of {known}")
    policy: Policy = machines.load(KINDS[card["kind"]])(path, card, env)
    return policy


def find(source: str, env: AnyEnv | None = None) -> Path:
    """The file of a trained policy: ``zoo`` or ``zoo:NAME`` (of `env`), a path, a run's folder."""
    if is_zoo(source):
        spec = env.spec if env is not None else None
        if spec is None:
            raise PolicyError(f"policy {source!r} is that of an environment: say which")
        return of_zoo(source, spec.id)
    path = Path(source)
    if path.is_dir():
        path = path / "policy.zip"
    if not path.is_file():
        names = ", ".join(["zoo", *controller_names()])
        raise PolicyError(f"policy {source!r} is neither a file nor one of {names}")
    return path


def of_zoo(source: str, env_id: str) -> Path:
    """The file of a policy that comes with rodgym."""
    name = source.partition(":")[2]
    found = zoo_policy(env_id, name)
    if found is None:
        called = f" called {name!r}" if name else ""
        raise PolicyError(f"no trained policy{called} for {env_id} comes with rodgym")
    return found


def is_zoo(source: str) -> bool:
    """Whether a name means a policy that comes with rodgym."""
    return source.partition(":")[0] == "zoo"


def read_card(path: Path) -> dict[str, Any]:
    """What a saved policy says of its training: ``env``, ``env_kwargs``, ``algorithm``, ...

    The card of an ONNX file lies beside it: ``policy.json`` of ``policy.onnx``.
    """
    try:
        if path.suffix == ".onnx":
            card = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        else:
            with zipfile.ZipFile(path) as archive:
                card = json.loads(archive.read(CARD))
    except (zipfile.BadZipFile, KeyError, ValueError, FileNotFoundError) as error:
        raise PolicyError(f"{path} is not a policy saved by rodgym ({error})") from error
    assert isinstance(card, dict)
    return card


def _load_trained(path: Path, card: Mapping[str, Any], env: AnyEnv) -> Policy:
    import stable_baselines3
    import torch

    torch.set_num_threads(1)
    algorithm = getattr(stable_baselines3, str(card.get("algorithm")), None)
    if algorithm is None:
        raise PolicyError(f"{path}: unknown algorithm {card.get('algorithm')!r}")
    model = algorithm.load(path, device="cpu")
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
    stacked = depth > 1 or own_actions
    return Stacked(model, depth, own_actions) if stacked else model  # type: ignore[no-any-return]
