"""Training recipes: YAML in the format of rl-baselines3-zoo, one entry per environment.

The recipes and the trained policies that come with rodgym live in ``rodgym/zoo`` (in the repository
``baselines/zoo`` points there).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import rodgym
from rodgym._literal import literal
from rodgym.zoo import ZOO, zoo_policy

__all__ = ["ZOO", "Recipe", "RecipeError", "has_recipe", "load_recipe", "zoo_policy"]

ALGORITHMS = ("PPO", "SAC", "TD3", "DDPG", "A2C")
#: Observations that a policy may see at once.
MAX_FRAMES = 1000
#: Those that learn from a store of old steps.
OFF_POLICY = ("SAC", "TD3", "DDPG")


class RecipeError(rodgym.RodgymError, ValueError):
    """A recipe that is missing or cannot be used."""


@dataclass(frozen=True)
class Recipe:
    """How to train.

    Parameters
    ----------
    algorithm: class of Stable-Baselines3
    n_timesteps: environment steps in all
    n_envs: environments in the batch
    policy: policy class of the algorithm
    frame_stack: observations that the policy sees at once
    own_actions: whether it sees, beside each of them, the action that led to it
    hyperparams: further keywords of the algorithm; ``lin_0.001`` falls linearly to zero
    """

    algorithm: str = "PPO"
    n_timesteps: int = 1_000_000
    n_envs: int = 64
    policy: str = "MlpPolicy"
    frame_stack: int = 1
    own_actions: bool = False
    hyperparams: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.algorithm not in ALGORITHMS:
            raise RecipeError(f"algorithm {self.algorithm!r} is not one of {', '.join(ALGORITHMS)}")
        for name in ("n_timesteps", "n_envs", "frame_stack"):
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool) or value < 1:
                raise RecipeError(f"{name} = {value!r} must be a whole number of at least 1")
        if self.frame_stack > MAX_FRAMES:
            raise RecipeError(f"frame_stack = {self.frame_stack} must be at most {MAX_FRAMES}")
        if not isinstance(self.own_actions, bool):
            raise RecipeError(f"own_actions = {self.own_actions!r} must be true or false")

    def with_changes(self, changes: Mapping[str, Any]) -> Recipe:
        """Returns this recipe with some values changed; unknown names are hyperparameters."""
        own = {key: value for key, value in changes.items() if key in OWN}
        rest = {key: value for key, value in changes.items() if key not in OWN}
        return replace(self, **own, hyperparams={**self.hyperparams, **rest})

    def keywords(self) -> dict[str, Any]:
        """Hyperparameters as Stable-Baselines3 takes them: schedules and classes made from text."""
        result = {key: schedule(key, value) for key, value in self.hyperparams.items()}
        if isinstance(result.get("train_freq"), list):
            result["train_freq"] = tuple(result["train_freq"])
        if isinstance(result.get("policy_kwargs"), dict):
            kwargs = dict(result["policy_kwargs"])
            if isinstance(kwargs.get("activation_fn"), str):
                import torch

                name = kwargs["activation_fn"]
                kwargs["activation_fn"] = getattr(torch.nn, name, None)
                if kwargs["activation_fn"] is None:
                    raise RecipeError(f"activation_fn = {name!r} is no class of torch.nn")
            result["policy_kwargs"] = kwargs
        return result

    def as_dict(self) -> dict[str, Any]:
        """All of it, as in a YAML entry."""
        return {**{name: getattr(self, name) for name in OWN}, **self.hyperparams}


OWN = ("algorithm", "n_timesteps", "n_envs", "policy", "frame_stack", "own_actions")


def schedule(name: str, value: Any) -> Any:
    """Makes ``lin_0.001`` a schedule over the remaining share of training; other values stay.

    (But ``1e-3`` is a number, although YAML takes it for text.)
    """
    if not isinstance(value, str):
        return value
    if not value.startswith("lin_"):
        try:
            return literal(value)
        except ValueError as error:
            raise RecipeError(f"{name}: {error}") from error
    try:
        initial = float(value.removeprefix("lin_"))
    except ValueError:
        raise RecipeError(f"{name} = {value!r} must be lin_ and a number") from None

    def falling(remaining: float) -> float:
        return initial * remaining

    return falling


def load_recipe(env_id: str, algorithm: str = "PPO", file: Path | None = None) -> Recipe:
    """The recipe of an environment, from ``file`` or from the zoo, or else :func:`plain_recipe`.

    Raises
    ------
    RecipeError: no such file, no entry in the file given, or a value that is not allowed
    """
    Recipe(algorithm)
    if file is None and not has_recipe(env_id, algorithm):
        return plain_recipe(algorithm)
    path = file or _zoo_file(algorithm)
    entries = _entries(path)
    entry = entries.get(env_id, entries.get("default"))
    if not isinstance(entry, dict):
        raise RecipeError(f"{path} has no entry for {env_id}; it has {', '.join(entries)}")
    return Recipe(algorithm).with_changes(entry)


def has_recipe(env_id: str, algorithm: str) -> bool:
    """Whether the zoo has one."""
    path = _zoo_file(algorithm)
    return path.is_file() and not {env_id, "default"}.isdisjoint(_entries(path))


def plain_recipe(algorithm: str) -> Recipe:
    """The defaults of Stable-Baselines3, tried on none of our tasks.

    An algorithm that learns from old steps learns as often as environments step, as with one
    environment.
    """
    if algorithm in OFF_POLICY:
        return Recipe(algorithm, 200_000, n_envs=8, hyperparams={"gradient_steps": -1})
    return Recipe(algorithm)


def _zoo_file(algorithm: str) -> Path:
    return ZOO / f"{algorithm.lower()}.yml"


def _entries(path: Path) -> dict[str, Any]:
    """What a file of recipes holds."""
    import yaml

    try:
        entries = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise RecipeError(f"no recipe file {path}: {reason}") from error
    except yaml.YAMLError as error:
        raise RecipeError(f"{path} is not YAML: {error}") from error
    if not isinstance(entries, dict):
        raise RecipeError(f"{path} holds no entries 'ENV_ID: {{...}}'")
    return entries
