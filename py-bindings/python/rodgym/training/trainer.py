"""Trains an agent on the native batch, from the start or from a checkpoint."""

from __future__ import annotations

import inspect
import json
import pickle
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from rodgym import _checks as checks
from rodgym.evaluation.conditions import conditions
from rodgym.evaluation.policies import CARD
from rodgym.progress import Bar, interrupt_flag
from rodgym.runs import Run, RunError, versions, write_csv
from rodgym.training import checkpoint
from rodgym.training.environments import action_noise, make_training_env
from rodgym.training.expressions import classes
from rodgym.training.hyperparams import check_hyperparams
from rodgym.training.recipe import Recipe, RecipeError, load_recipe
from rodgym.training.training import POLICY, STATISTICS, Training, load_training
from rodgym.training.watch import CURVE, VALIDATION_SEEDS, Watch

__all__ = ["CURVE", "VALIDATION_SEEDS", "Job", "keep_unfinished", "resume", "train", "unfinished"]
from rodgym.zoo.algorithms import algorithm_class

#: The state of a training that has not ended.
CHECKPOINT = "checkpoint.pkl"
#: Where TensorBoard's events go, and kept stages of an agent.
TENSORBOARD, STAGES = "tensorboard", "stages"
#: How an entry of ``run.json`` says where a training stands.
RUNNING, INTERRUPTED, FINISHED = "running", "interrupted", "finished"


@dataclass(frozen=True)
class Job:
    """What is to be learnt, where and how."""

    env_id: str
    env_kwargs: Mapping[str, Any]
    recipe: Recipe
    seed: int
    tensorboard: bool = False
    stages: bool = False
    resumable: bool = True


def train(
    env_id: str,
    run: Run,
    *,
    recipe: Recipe | None = None,
    seed: int = 0,
    env_kwargs: Mapping[str, Any] | None = None,
    tensorboard: bool = False,
    stages: bool = False,
    callbacks: Sequence[BaseCallback] = (),
    on_validation: Callable[[int, float], None] | None = None,
    resumable: bool = True,
    quiet: bool = False,
) -> Training:
    """Trains, and saves ``policy.zip`` and ``learning_curve.csv`` in the run's folder.

    Ctrl-C ends the training after the current step; what was learnt until then is kept, and
    `resume` goes on.

    Parameters
    ----------
    env_id, env_kwargs: the environment
    run: folder of the results
    recipe: how to train; the zoo's, if there is none
    seed: of the agent and, one after the other, of the environments
    tensorboard: whether events are written into the run's folder ``tensorboard``
    stages: whether the agent of every validation is kept in the folder ``stages``
    callbacks: callbacks of Stable-Baselines3, beside those that the recipe names
    on_validation: called with steps and mean return at every validation
    resumable: whether checkpoints are written, from which `resume` goes on
    quiet: whether nothing is shown

    Raises
    ------
    RecipeError: a hyperparameter that the algorithm does not take
    ParameterError: a keyword that a training chooses itself, or episodes without an end
    """
    recipe = recipe or load_recipe(env_id)
    seed = checks.whole("seed", seed, 0, 2**32 - 1, "a whole number from 0 to 2^32 - 1")
    env_id, kwargs = conditions(env_id, {**recipe.env_kwargs, **(env_kwargs or {})})
    job = Job(env_id, kwargs, recipe, seed, tensorboard, stages, resumable)
    named = classes("callback", recipe.callback, BaseCallback)
    made = [_callback(kind, keywords) for kind, keywords in named]
    return _learn(job, run, make_model(job), [*made, *callbacks], None, quiet, on_validation)


def resume(run: Run, *, quiet: bool = False) -> Training:
    """Goes on with a training that was interrupted or killed, to the bits of an uninterrupted one.

    It goes on from its last checkpoint; what it did after that it does again. A training that has
    ended is returned as it is.

    Raises
    ------
    RunError: the folder has no training, or its checkpoint cannot be read
    """
    path = run.path / CHECKPOINT
    if not path.is_file():
        if (run.path / POLICY).is_file():
            return load_training(run.path)
        raise RunError(f"nothing to resume in {run.path}: it has no {CHECKPOINT}")
    # The networks are small: a second thread costs more in waiting than it gains.
    torch.set_num_threads(1)
    try:
        state = checkpoint.read(path)
    except ValueError as error:
        raise RunError(str(error)) from error
    return _learn(state["job"], run, state["model"], state["callbacks"], state["watch"], quiet)


def unfinished(run: Run) -> bool:
    """Whether a run's folder has a training that `resume` would go on with."""
    return (run.path / CHECKPOINT).is_file()


def keep_unfinished(run: Run) -> None:
    """Refuses to begin where a training that was not finished would be lost.

    Raises
    ------
    RunError: the folder has one
    """
    if unfinished(run):
        raise RunError(
            f"{run.path} has a training that was not finished: --resume goes on with it, "
            "another --name or --force begin anew"
        )


def make_model(job: Job) -> BaseAlgorithm:
    """A fresh agent in its environments.

    Raises
    ------
    RecipeError: a hyperparameter that the algorithm does not take
    """
    torch.set_num_threads(1)
    recipe = job.recipe
    algorithm = algorithm_class(recipe.algorithm)
    check_hyperparams(recipe, algorithm)
    env = make_training_env(job.env_id, recipe, job.seed, job.env_kwargs)
    keywords = {**recipe.keywords(), **action_noise(recipe, env.action_space)}
    try:
        return algorithm(recipe.policy, env, seed=job.seed, device="cpu", **keywords)
    except (AssertionError, TypeError, ValueError) as error:
        raise RecipeError(f"{recipe.algorithm} cannot be made so: {error}") from error


def _callback(kind: type, keywords: Mapping[str, Any]) -> BaseCallback:
    try:
        return kind(**keywords)  # type: ignore[no-any-return]
    except (TypeError, ValueError) as error:
        raise RecipeError(f"callback: {kind.__name__} cannot be made so: {error}") from error


def _learn(
    job: Job,
    run: Run,
    model: BaseAlgorithm,
    callbacks: Sequence[BaseCallback],
    state: Mapping[str, Any] | None,
    quiet: bool,
    on_validation: Callable[[int, float], None] | None = None,
) -> Training:
    """Learns to the end, from the start or, with the state of a watch, from there."""
    recipe = job.recipe
    # Made now, so that a folder that cannot be written is known before anything is learnt.
    recipe.write(run.file("recipe.yml"), job.env_id)
    model.tensorboard_log = str(run.path / TENSORBOARD) if job.tensorboard else None
    whole = in_rollouts(recipe.n_timesteps, model)
    title = f"training {recipe.algorithm}"
    with interrupt_flag() as flag, Bar(title, recipe.n_timesteps, quiet) as bar:
        if state is None and recipe.n_timesteps != whole:
            bar.say(
                f"{recipe.n_timesteps:,} steps become {whole:,}: {recipe.algorithm} learns "
                f"every {in_rollouts(1, model):,} steps of {recipe.n_envs} environments"
            )
        keeper = Keeper(job, run, callbacks, bar, whole)
        told = [keeper.stage] if job.stages else []
        if on_validation is not None:
            told.append(lambda watch: on_validation(watch.num_timesteps, watch.last_return))
        watch = Watch(job.env_id, job.env_kwargs, recipe, bar, flag, keeper.checkpoint, told)
        if state is not None:
            watch.resume(state)
        try:
            model.learn(
                recipe.n_timesteps - model.num_timesteps,
                callback=[watch, *callbacks],
                tb_log_name=recipe.algorithm,
                reset_num_timesteps=state is None,
            )
            watch.validate()
        except BaseException:
            keeper.say(watch, INTERRUPTED)
            raise
    training = keeper.finish(watch, flag.is_set())
    assert model.env is not None
    model.env.close()
    return training


class Keeper:
    """Writes a training into its run's folder: checkpoints, stages, and the agent in the end."""

    def __init__(
        self, job: Job, run: Run, callbacks: Sequence[BaseCallback], bar: Bar, steps: int
    ) -> None:
        self.job = job
        self.run = run
        self.callbacks = list(callbacks)
        self.bar = bar
        self.steps = steps
        self.possible = job.resumable

    def checkpoint(self, watch: Watch) -> None:
        """Writes the whole state of the training, and how far it is."""
        self.say(watch, RUNNING)
        if not self.possible:
            return
        state = {
            "job": self.job,
            "model": watch.model,
            "callbacks": self.callbacks,
            "watch": watch.state(),
        }
        try:
            checkpoint.write(self.run.file(CHECKPOINT), state)
        except OSError:
            raise
        except Exception as error:  # Whatever a wrapper, a callback or a server's batch raises.
            self.possible = False
            self.bar.say(f"it cannot be resumed, since its state cannot be written: {error}")

    def stage(self, watch: Watch) -> None:
        """Saves the present agent as a policy of its own."""
        path = self.run.folder() / STAGES
        path.mkdir(exist_ok=True)
        normalize = watch.model.get_vec_normalize_env()
        content = None if normalize is None else pickle.dumps(normalize)
        card = {**self._card(watch), "best_steps": watch.num_timesteps}
        save(watch.model, path / f"policy-{watch.num_timesteps}.zip", card, content)

    def finish(self, watch: Watch, interrupted: bool) -> Training:
        """Saves the best stage, the curve and how far the training came."""
        model, path = watch.model, self.run.file(POLICY)
        model.policy.load_state_dict(watch.best_parameters)
        seconds = round(watch.seconds, 2)
        card = {**self._card(watch), "seconds": seconds, "interrupted": interrupted}
        save(model, path, card, watch.best_statistics)
        write_csv(self.run.file("learning_curve.csv"), watch.columns, watch.curve)
        if not interrupted:
            (self.run.path / CHECKPOINT).unlink(missing_ok=True)
        self.say(watch, INTERRUPTED if interrupted else FINISHED)
        return Training(
            policy=path,
            recipe=self.job.recipe,
            seed=self.job.seed,
            columns=watch.columns,
            curve=watch.curve,
            best_steps=watch.best_steps,
            seconds=seconds,
            steps=model.num_timesteps,
            interrupted=interrupted,
        )

    def _card(self, watch: Watch) -> dict[str, Any]:
        recipe = self.job.recipe
        return {
            "env": self.job.env_id,
            "env_kwargs": self.job.env_kwargs,
            "algorithm": recipe.algorithm,
            "frame_stack": recipe.frame_stack,
            "own_actions": recipe.own_actions,
            "wrappers": recipe.wrappers(),
            "recipe": recipe.as_dict(),
            "hyperparameters": every_hyperparameter(watch.model),
            "seed": self.job.seed,
            "steps": watch.model.num_timesteps,
            "best_steps": watch.best_steps,
            "versions": versions(),
        }

    def say(self, watch: Watch, state: str) -> None:
        """Says in ``run.json`` how far the training is, so that a killed one says it too."""
        self.run.facts |= {
            "env": self.job.env_id,
            "env_kwargs": dict(self.job.env_kwargs),
            "seed": self.job.seed,
            "recipe": self.job.recipe.as_dict(),
            "training": {"state": state, "steps": watch.model.num_timesteps, "of": self.steps},
        }
        self.run.write_facts()


def every_hyperparameter(model: BaseAlgorithm) -> dict[str, Any]:
    """All arguments of the algorithm, the library's defaults among them, as JSON can say them."""
    values = {
        name: getattr(model, name)
        for name in inspect.signature(type(model)).parameters
        if hasattr(model, name) and name not in ("env", "policy", "device", "seed")
    }
    return {name: value if _is_plain(value) else str(value) for name, value in values.items()}


def _is_plain(value: Any) -> bool:
    return value is None or isinstance(value, bool | int | float | str)


def in_rollouts(steps: int, model: BaseAlgorithm) -> int:
    """What Stable-Baselines3 makes of a number of steps: whole rollouts of all environments."""
    length = getattr(model, "n_steps", 1) if isinstance(model, OnPolicyAlgorithm) else 1
    rollout = length * model.n_envs
    return -(-steps // rollout) * rollout


def save(
    model: BaseAlgorithm, path: Path, card: Mapping[str, Any], statistics: bytes | None
) -> None:
    """Saves a Stable-Baselines3 model with a card inside that says how it was made."""
    model.save(path)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(CARD, json.dumps(card, indent=2, default=str) + "\n")
        if statistics is not None:
            archive.writestr(STATISTICS, statistics)
