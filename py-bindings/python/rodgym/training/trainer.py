"""Trains an agent on the native batch, watching it on validation seeds as it learns."""

from __future__ import annotations

import inspect
import json
import threading
import time
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import stable_baselines3
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecFrameStack

import rodgym.sb3
from rodgym import _checks as checks
from rodgym.evaluation import evaluate
from rodgym.evaluation.conditions import conditions
from rodgym.evaluation.policies import CARD, Policy, Stacked
from rodgym.progress import Bar, interrupt_flag
from rodgym.runs import Run, versions, write_csv
from rodgym.training.own_actions import OwnActions
from rodgym.training.recipe import Recipe, RecipeError, load_recipe

#: Seeds that choose among the agent's stages. Tables are made on other ones (0 to 99 by default).
VALIDATION_SEEDS = range(10_000, 10_032)
#: How often the agent is validated during a training.
VALIDATIONS = 25
#: Arguments of an algorithm that are the trainer's to choose.
NOT_HYPERPARAMS = ("policy", "env", "seed", "device", "_init_setup_model")
#: Hyperparameters that count something.
COUNTS = ("batch_size", "buffer_size", "n_epochs", "n_steps", "policy_delay", "stats_window_size")
#: Numbers that may be left out.
OPTIONAL_NUMBERS = ("clip_range_vf", "target_kl")
#: Columns of ``learning_curve.csv``, before the share of episodes that did their task, where the
#: machine has a column for it.
CURVE = ("steps", "seconds", "training_return", "return", "return_low", "return_high")


@dataclass(frozen=True)
class Training:
    """What came out: the best validated stage of the agent, saved, and its curve.

    ``curve`` has the columns named ``columns``: :data:`CURVE` and successes; ``seconds`` is the
    wall time, validation included; ``interrupted`` says that Ctrl-C ended it early.
    """

    policy: Path
    recipe: Recipe
    seed: int
    columns: Sequence[str]
    curve: Sequence[Sequence[float]]
    best_steps: int
    seconds: float
    steps: int
    interrupted: bool


def make_training_env(
    env_id: str, recipe: Recipe, seed: int, env_kwargs: Mapping[str, Any]
) -> VecEnv:
    """The native batch as Stable-Baselines3 wants it, with the returns of episodes recorded."""
    env = rodgym.sb3.make_vec_env(env_id, recipe.n_envs, seed, env_kwargs=dict(env_kwargs))
    env = OwnActions(env) if recipe.own_actions else env
    return VecFrameStack(env, recipe.frame_stack) if recipe.frame_stack > 1 else env


def train(
    env_id: str,
    run: Run,
    *,
    recipe: Recipe | None = None,
    seed: int = 0,
    env_kwargs: Mapping[str, Any] | None = None,
    quiet: bool = False,
) -> Training:
    """Trains, and saves ``policy.zip`` and ``learning_curve.csv`` in the run's folder.

    Ctrl-C ends the training after the current step; what was learnt until then is kept.

    Raises
    ------
    RecipeError: a hyperparameter that the algorithm does not take
    ParameterError: a keyword that a training chooses itself, or episodes without an end
    """
    recipe = recipe or load_recipe(env_id)
    seed = checks.whole("seed", seed, 0, 2**32 - 1, "a whole number from 0 to 2^32 - 1")
    env_id, kwargs = conditions(env_id, env_kwargs)
    # The networks are small: a second thread costs more in waiting than it gains.
    torch.set_num_threads(1)
    env = make_training_env(env_id, recipe, seed, kwargs)
    algorithm = getattr(stable_baselines3, recipe.algorithm)
    check_hyperparams(recipe, algorithm)
    try:
        model: BaseAlgorithm = algorithm(
            recipe.policy, env, seed=seed, device="cpu", **recipe.keywords()
        )
    except (AssertionError, TypeError, ValueError) as error:
        raise RecipeError(f"{recipe.algorithm} cannot be made so: {error}") from error
    # Made now, so that a folder that cannot be written is known before anything is learnt.
    path = run.file("policy.zip")
    title = f"training {recipe.algorithm}"
    with interrupt_flag() as flag, Bar(title, recipe.n_timesteps, quiet) as bar:
        if recipe.n_timesteps != (whole := in_rollouts(recipe.n_timesteps, model)):
            bar.say(
                f"{recipe.n_timesteps:,} steps become {whole:,}: {recipe.algorithm} learns "
                f"every {in_rollouts(1, model):,} steps of {recipe.n_envs} environments"
            )
        watch = Watch(env_id, kwargs, recipe, bar, flag)
        model.learn(recipe.n_timesteps, callback=watch)
        watch.validate()
    model.policy.load_state_dict(watch.best_parameters)
    card = {
        "env": env_id,
        "env_kwargs": kwargs,
        "algorithm": recipe.algorithm,
        "frame_stack": recipe.frame_stack,
        "own_actions": recipe.own_actions,
        "recipe": recipe.as_dict(),
        "seed": seed,
        "steps": model.num_timesteps,
        "best_steps": watch.best_steps,
        "versions": versions(),
    }
    save(model, path, card)
    env.close()
    write_csv(run.file("learning_curve.csv"), watch.columns, watch.curve)
    return Training(
        policy=path,
        recipe=recipe,
        seed=seed,
        columns=watch.columns,
        curve=watch.curve,
        best_steps=watch.best_steps,
        seconds=watch.seconds,
        steps=model.num_timesteps,
        interrupted=flag.is_set(),
    )


def check_hyperparams(recipe: Recipe, algorithm: type[BaseAlgorithm]) -> None:
    """Refuses names that the algorithm does not have and values of the wrong kind.

    Raises
    ------
    RecipeError: the first of them
    """
    parameters = inspect.signature(algorithm).parameters
    known = [name for name in parameters if name not in NOT_HYPERPARAMS]
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


def in_rollouts(steps: int, model: BaseAlgorithm) -> int:
    """What Stable-Baselines3 makes of a number of steps: whole rollouts of all environments."""
    length = getattr(model, "n_steps", 1) if isinstance(model, OnPolicyAlgorithm) else 1
    rollout = length * model.n_envs
    return -(-steps // rollout) * rollout


def save(model: BaseAlgorithm, path: Path, card: Mapping[str, Any]) -> None:
    """Saves a Stable-Baselines3 model with a card inside that says how it was made."""
    model.save(path)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(CARD, json.dumps(card, indent=2) + "\n")


class Watch(BaseCallback):
    """Validates at regular steps, keeps the best stage, shows progress, ends on Ctrl-C."""

    def __init__(
        self,
        env_id: str,
        env_kwargs: Mapping[str, Any],
        recipe: Recipe,
        bar: Bar,
        interrupted: threading.Event,
    ) -> None:
        super().__init__()
        self.env_id = env_id
        self.env_kwargs = env_kwargs
        self.recipe = recipe
        self.every = max(1, recipe.n_timesteps // VALIDATIONS)
        self.bar = bar
        self.interrupted = interrupted
        self.columns: tuple[str, ...] = CURVE
        self.curve: list[tuple[float, ...]] = []
        self.best_return = -np.inf
        self.best_steps = 0
        self.best_parameters: dict[str, torch.Tensor] = {}
        self.began = time.perf_counter()
        self.next = 0

    @property
    def seconds(self) -> float:
        """Wall time since the start."""
        return time.perf_counter() - self.began

    def _on_rollout_start(self) -> None:
        # Between rollouts, where the agent has just changed.
        if self.num_timesteps >= self.next:
            self.next = self.num_timesteps + self.every
            self.validate()

    def _on_step(self) -> bool:
        self.bar.at(self.num_timesteps)
        return not self.interrupted.is_set()

    def validate(self) -> None:
        """Plays the validation seeds with the present stage of the agent."""
        model: Policy = self.model  # type: ignore[assignment]
        depth, own = self.recipe.frame_stack, self.recipe.own_actions
        actions = int(self.model.action_space.shape[0]) if own else 0  # type: ignore[index]
        actor = Stacked(model, depth, actions) if depth > 1 or own else model
        result = evaluate(actor, self.env_id, VALIDATION_SEEDS, env_kwargs=self.env_kwargs)
        returns = result.columns["return"]
        successes = {c.name: result.mean(c.name) for c in result.described if c.success}
        self.columns = (*CURVE, *successes)
        recent = [episode["r"] for episode in self.model.ep_info_buffer or []]
        self.curve.append(
            (
                self.num_timesteps,
                round(self.seconds, 2),
                float(np.mean(recent)) if recent else float("nan"),
                float(returns.mean()),
                float(returns.min()),
                float(returns.max()),
                *successes.values(),
            )
        )
        if returns.mean() > self.best_return:
            self.best_return = float(returns.mean())
            self.best_steps = self.num_timesteps
            state = self.model.policy.state_dict()
            self.best_parameters = {key: value.clone() for key, value in state.items()}
        speed = self.num_timesteps / max(self.seconds, 1e-9)
        done = "".join(f", {name} {share:4.0%}" for name, share in successes.items())
        self.bar.say(f"return {returns.mean():.0f}{done}, {speed:,.0f} steps/s")
