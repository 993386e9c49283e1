"""Refuses hyperparameters that an algorithm does not have, and values of the wrong kind."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rodgym.training.expressions import RecipeError
from rodgym.training.recipe import Recipe

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

#: Arguments of an algorithm that are the trainer's to choose.
CHOSEN = ("policy", "env", "seed", "device", "tensorboard_log", "_init_setup_model")
#: Hyperparameters that count something.
COUNTS = ("batch_size", "buffer_size", "n_epochs", "n_steps", "policy_delay", "stats_window_size")
#: Numbers that may be left out.
OPTIONAL_NUMBERS = ("clip_range_vf", "target_kl")


def check_hyperparams(recipe: Recipe, algorithm: type[BaseAlgorithm]) -> None:
    """Checks every hyperparameter of a recipe.

    Raises
    ------
    RecipeError: the first that is not allowed
    """
    parameters = inspect.signature(algorithm).parameters
    known = [name for name in parameters if name not in CHOSEN]
    for name, value in recipe.keywords().items():
        if name not in known:
            raise RecipeError(
                f"{name!r} is no hyperparameter of {recipe.algorithm}: it has {', '.join(known)}"
            )
        fits, allowed = kind_of(name, parameters[name].default)
        if not fits(value):
            raise RecipeError(
                f"{name} = {value!r} is not allowed for {recipe.algorithm}: it must be {allowed}"
            )


def kind_of(name: str, default: Any) -> tuple[Callable[[Any], bool], str]:
    """What a hyperparameter may be, by its default, and the same in words."""

    def number(value: Any) -> bool:
        return isinstance(value, int | float) and not isinstance(value, bool)

    def whole(value: Any) -> bool:
        return isinstance(value, int) and not isinstance(value, bool)

    if name in COUNTS:
        return (lambda value: whole(value) and value >= 1), "a whole number of at least 1"
    if name in OPTIONAL_NUMBERS:
        return (lambda value: value is None or number(value) or callable(value)), "a number or null"
    if name == "policy_kwargs":
        return (lambda value: isinstance(value, dict)), "a mapping"
    if name == "train_freq":
        pair = "a whole number or a pair such as [1, episode]"
        return (lambda value: whole(value) or isinstance(value, list | tuple)), pair
    if isinstance(default, bool):
        return (lambda value: isinstance(value, bool)), "true or false"
    if isinstance(default, int):
        return whole, "a whole number"
    if isinstance(default, float):
        # A schedule is a function of the remaining share of the training.
        return (lambda value: number(value) or callable(value)), "a number"
    return (lambda value: True), ""
