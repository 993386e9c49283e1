"""The conditions of an evaluation: keywords of the environment, and what an evaluation chooses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym

from rodgym import _checks as checks
from rodgym import machines
from rodgym._layers import layers
from rodgym._own import module_of
from rodgym._registration import REMOTE
from rodgym._rod import with_rod
from rodgym.errors import ParameterError, UnknownEnvError

#: Keywords of `gym.make_vec` that are an evaluation's to choose: one environment a seed, each
#: played to its end once.
CHOSEN = (
    "num_envs", "autoreset_mode", "copy", "vectorization_mode", "vector_kwargs", "wrappers", "id",
)  # fmt: skip


def conditions(env_id: Any, env_kwargs: Any) -> tuple[str, dict[str, Any]]:
    """The environment's id and keywords, checked.

    Raises:
        ParameterError: a keyword that an evaluation chooses itself, another environment than
            `env_id`, or episodes without an end, which would never be scored.
    """
    env_id = checks.env_id(env_id)
    keywords = checks.mapping("env_kwargs", env_kwargs)
    for name in keywords:
        if name in CHOSEN or (name == "env_id" and env_id != REMOTE):
            raise ParameterError(f"keyword {name!r} is not allowed here: an evaluation chooses it")
    if "max_episode_steps" in keywords:
        keywords["max_episode_steps"] = checks.episode_steps(keywords["max_episode_steps"])
    return env_id, with_rod(keywords)


def make_batch(
    env_id: str, num_envs: int, keywords: Mapping[str, Any], num_threads: int | None = None
) -> Any:
    """`gym.make_vec` of an environment; one with wrappers of its own has no native batch.

    Parameters
    ----------
    num_threads: threads of a native batch; None: as many as the process may use
    """
    registered = gym.registry.get(name := registered_name(env_id))
    native = registered is None or registered.vector_entry_point is not None
    given = dict(keywords)
    if registered is not None and (not native or registered.additional_wrappers):
        given["vectorization_mode"] = "sync"
    elif num_threads is not None:
        given["num_threads"] = num_threads
    return gym.make_vec(name, num_envs=num_envs, **given)


def make_single(env_id: str, keywords: Mapping[str, Any]) -> Any:
    """`gym.make` of an environment."""
    return gym.make(registered_name(env_id), **keywords)


def spec_for(env_id: str, keywords: Mapping[str, Any]) -> dict[str, Any]:
    """What the core says of an environment."""
    env = make_batch(env_id, 1, keywords)
    try:
        return machines.spec_of(env)
    finally:
        env.close()


def registered_name(env_id: str) -> str:
    """The id that Gymnasium knows; a module that stands before it (`module:id`) is imported."""
    module, _, name = env_id.rpartition(":")
    if module:
        module_of(module)
    if module and name not in gym.registry:
        raise ParameterError(f"env_id = {env_id!r} is not allowed: {module} registers no {name!r}")
    try:
        gym.spec(name)
    except gym.error.UnregisteredEnv as error:
        raise UnknownEnvError(
            f"there is no environment {name!r}; one of your own is named with the module that "
            f"registers it, module:{name}"
        ) from error
    return name


def has_end(env: Any) -> bool:
    """Whether the episodes of an environment, single or a batch, have a time limit."""
    base = env.unwrapped
    if isinstance(base, gym.vector.VectorEnv):
        members: Any = getattr(base, "envs", ())
        limit = getattr(base, "max_episode_steps", None)
        return limit is not None or any(has_end(member) for member in members)
    return any(isinstance(layer, gym.wrappers.TimeLimit) for layer in layers(env))


def needs_end(env: Any) -> None:
    """Refuses an environment without a time limit (such as one of your own registration).

    Raises:
        ParameterError: it would be played for ever.
    """
    if not has_end(env):
        raise ParameterError(
            "max_episode_steps = None is not allowed for this environment, which is registered "
            "without a time limit: it must be a whole number of at least 1"
        )
