"""The environments of a training: the native batch, and what a recipe puts around it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import (
    ActionNoise,
    NormalActionNoise,
    OrnsteinUhlenbeckActionNoise,
)
from stable_baselines3.common.vec_env import (
    VecEnv,
    VecEnvWrapper,
    VecFrameStack,
    VecNormalize,
    unwrap_vec_wrapper,
)

import rodgym.sb3
from rodgym.training.expressions import RecipeError, classes
from rodgym.training.recipe import Recipe, schedule

NOISES = {"normal": NormalActionNoise, "ornstein-uhlenbeck": OrnsteinUhlenbeckActionNoise}


def make_training_env(
    env_id: str, recipe: Recipe, seed: int, env_kwargs: Mapping[str, Any]
) -> VecEnv:
    """The batch as Stable-Baselines3 wants it, with the returns of episodes recorded.

    From the inside out, as in rl-baselines3-zoo: Gymnasium's wrappers, wrappers of the batch,
    normalisation, stacked observations.
    """
    env = rodgym.sb3.make_vec_env(
        env_id,
        recipe.n_envs,
        seed,
        wrapper_class=env_wrapper(recipe),
        env_kwargs={**recipe.env_kwargs, **env_kwargs},
        monitor_kwargs=dict(recipe.monitor_kwargs),
    )
    return around(env, recipe)


def around(env: VecEnv, recipe: Recipe, training: bool = True) -> VecEnv:
    """What a recipe puts around a batch; statistics stand still and rewards stay as they are
    where nobody learns.
    """
    for wrapper, given in classes("vec_env_wrapper", recipe.vec_env_wrapper, VecEnvWrapper):
        env = _made("vec_env_wrapper", wrapper, env, given)
    if (keywords := recipe.normalize_keywords()) is not None:
        env = VecNormalize(env, **({} if training else {"training": False}) | keywords)
        env.norm_reward = env.norm_reward and training
    return VecFrameStack(env, recipe.frame_stack) if recipe.frame_stack > 1 else env


def env_wrapper(recipe: Recipe) -> Callable[[gym.Env], gym.Env] | None:
    """A function that puts a recipe's Gymnasium wrappers around an environment, if it has any."""
    wrappers = classes("env_wrapper", recipe.env_wrapper, gym.Wrapper)
    if not wrappers:
        return None

    def wrap(env: gym.Env) -> gym.Env:
        for wrapper, keywords in wrappers:
            env = _made("env_wrapper", wrapper, env, keywords)
        return env

    return wrap


def _made(key: str, wrapper: type, env: Any, keywords: Mapping[str, Any]) -> Any:
    try:
        return wrapper(env, **keywords)
    except (TypeError, ValueError, AssertionError) as error:
        raise RecipeError(f"{key}: {wrapper.__name__} cannot be made so: {error}") from error


def returns_behind_wrappers(
    model: BaseAlgorithm,
    env_id: str,
    recipe: Recipe,
    env_kwargs: Mapping[str, Any],
    seeds: Sequence[int],
) -> NDArray[np.float64]:
    """Return of one episode a seed, played behind a recipe's own wrappers.

    (`rodgym.evaluation` plays bare environments, and cannot know what such wrappers do.)
    """
    env = rodgym.sb3.make_vec_env(
        env_id,
        len(seeds),
        seeds[0],
        wrapper_class=env_wrapper(recipe),
        env_kwargs={**recipe.env_kwargs, **env_kwargs},
    )
    env = around(env, recipe, training=False)
    if (learnt := model.get_vec_normalize_env()) is not None:
        normalize = unwrap_vec_wrapper(env, VecNormalize)
        assert normalize is not None
        normalize.obs_rms = learnt.obs_rms
    observation, state = env.reset(), None
    start = np.ones(len(seeds), bool)
    returns = np.full(len(seeds), np.nan)
    while np.isnan(returns).any():
        action, state = model.predict(observation, state, start, deterministic=True)  # type: ignore[arg-type]
        observation, _, start, infos = env.step(action)
        for i in np.flatnonzero(start & np.isnan(returns)):
            returns[i] = infos[i]["episode"]["r"]
    env.close()
    return returns


def action_noise(recipe: Recipe, space: gym.spaces.Space) -> dict[str, ActionNoise]:
    """The keyword ``action_noise`` of an algorithm, if the recipe names a ``noise_type``.

    Raises
    ------
    RecipeError: an unknown type, or no standard deviation
    """
    kind = recipe.hyperparams.get("noise_type")
    if kind is None:
        return {}
    std = schedule("noise_std", recipe.hyperparams.get("noise_std"))
    if kind not in NOISES:
        raise RecipeError(f"noise_type = {kind!r} is not one of {', '.join(NOISES)}")
    if not isinstance(std, int | float) or isinstance(std, bool) or std < 0:
        raise RecipeError(f"noise_std = {std!r} must be a number of at least 0")
    assert isinstance(space, gym.spaces.Box)
    zeros = np.zeros(space.shape)
    return {"action_noise": NOISES[kind](zeros, zeros + std)}
