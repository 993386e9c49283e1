"""The conditions of an evaluation: keywords of the environment, and what an evaluation chooses."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from rodgym import _checks as checks
from rodgym._registration import REMOTE
from rodgym.errors import ParameterError

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
    return env_id, keywords


def has_end(env: Any) -> bool:
    """Whether the episodes of an environment, single or a batch, have a time limit."""
    base = env.unwrapped
    if isinstance(base, gym.vector.VectorEnv):
        return getattr(base, "max_episode_steps", None) is not None
    while isinstance(env, gym.Wrapper):
        if isinstance(env, gym.wrappers.TimeLimit):
            return True
        env = env.env
    return False


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
