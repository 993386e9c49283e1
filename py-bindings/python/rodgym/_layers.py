"""The wrappers between a policy and an environment: which of them change what is seen or done.

A policy acts rightly only where its observations and actions mean what they meant to whoever made
it. A wrapper of your own that changes neither (it logs, it scores otherwise) says so by a class
attribute ``transparent = True``.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium as gym

#: Wrappers of Gymnasium and Stable-Baselines3 that change neither observations nor actions, or,
#: like `ClipAction`, do what the environment does itself. Names, since their modules differ.
TRANSPARENT = frozenset({
    "AddWhiteNoise", "Autoreset", "ClipAction", "ClipReward", "DictInfoToList", "HumanRendering",
    "Monitor", "NormalizeReward", "ObstructView", "OrderEnforcing", "PassiveEnvChecker",
    "RecordEpisodeStatistics", "RecordVideo", "RenderCollection", "TimeLimit", "TransformReward",
    "VecCheckNan", "VecMonitor", "VecVideoRecorder",
})  # fmt: skip
#: Wrappers whose running statistics depend on whatever was played before: no episode that is seen
#: through them is that of its seed alone.
RUNNING = ("NormalizeObservation", "NormalizeReward")


def layers(env: Any) -> Iterator[Any]:
    """Every wrapper, outermost first: those of a batch, then those of its first environment.

    Environments in other processes cannot be looked at; their wrappers are not among these.
    """
    while env is not None:
        if isinstance(env, gym.Wrapper | gym.vector.VectorWrapper):
            yield env
            env = env.env
        elif "venv" in getattr(env, "__dict__", {}):
            yield env
            env = env.venv
        else:
            env = next(iter(getattr(env, "__dict__", {}).get("envs", ())), None)


def name_of(layer: Any) -> str:
    """A wrapper's class."""
    return type(layer).__name__


def is_transparent(layer: Any) -> bool:
    """Whether a wrapper leaves observations and actions as they are."""
    if getattr(type(layer), "transparent", False):
        return True
    if isinstance(layer, gym.RewardWrapper | gym.vector.VectorRewardWrapper):
        return True
    if name_of(layer) == "VecNormalize":
        return not layer.norm_obs
    return name_of(layer) in TRANSPARENT


def opaque(env: Any) -> list[str]:
    """Names of the wrappers that may change observations or actions, outermost first."""
    return [name_of(layer) for layer in layers(env) if not is_transparent(layer)]


def is_unknown(layer: Any) -> bool:
    """Whether nothing tells what a wrapper does: one of somebody's own that may only score."""
    telling = (
        gym.ObservationWrapper,
        gym.ActionWrapper,
        gym.vector.VectorObservationWrapper,
        gym.vector.VectorActionWrapper,
    )
    library = type(layer).__module__.partition(".")[0] in ("gymnasium", "stable_baselines3")
    return not (library or isinstance(layer, telling) or is_transparent(layer))


def changing(env: Any) -> list[str]:
    """Names of the wrappers that change observations or actions by their kind."""
    return [
        name_of(layer)
        for layer in layers(env)
        if not is_transparent(layer) and not is_unknown(layer)
    ]


def running(env: Any) -> list[str]:
    """Names of the wrappers that keep running statistics of what they have seen."""
    return [
        name_of(layer)
        for layer in layers(env)
        if name_of(layer) in RUNNING and getattr(layer, "update_running_mean", True)
    ]
