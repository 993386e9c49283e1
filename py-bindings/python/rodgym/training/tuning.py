"""Searches for the hyperparameters of a recipe with Optuna (extra ``tune``).

A search is a folder: ``trials.db`` holds what was tried, so that a search that was ended goes on.
Trials are trained on seeds of their own and judged on validation seeds, so neither the training
seeds of a table nor its episodes choose anything.
"""

from __future__ import annotations

import inspect
import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgym import _checks as checks
from rodgym.runs import Run, RunError, write_csv
from rodgym.training.expressions import RecipeError
from rodgym.training.hyperparams import check_hyperparams
from rodgym.training.recipe import Recipe
from rodgym.training.recipe_file import entries
from rodgym.training.trainer import train
from rodgym.training.watch import VALIDATIONS
from rodgym.zoo.algorithms import OFF_POLICY, algorithm_class

if TYPE_CHECKING:
    import optuna

#: Training seeds of trials: not those of tables, which begin at 0.
SEEDS = range(1_000, 1_003)
#: The table of trials.
STORE = "trials.db"
#: What is searched where no search space is given, by kind of algorithm. A range is
#: ``{low, high}``, with ``log: true`` over orders of magnitude; a list is a choice.
ON_POLICY_SPACE: dict[str, Any] = {
    "learning_rate": {"low": 1e-4, "high": 1e-2, "log": True, "schedule": "lin"},
    "n_steps": [32, 64, 128, 256],
    "batch_size": [512, 1024, 2048],
    "n_epochs": {"low": 3, "high": 12},
    "gamma": [0.95, 0.97, 0.98, 0.99],
    "gae_lambda": [0.8, 0.9, 0.95, 0.98],
}
OFF_POLICY_SPACE: dict[str, Any] = {
    "learning_rate": {"low": 1e-4, "high": 5e-3, "log": True},
    "gamma": [0.95, 0.97, 0.98, 0.99, 0.995],
    "tau": {"low": 1e-3, "high": 5e-2, "log": True},
    "batch_size": [128, 256, 512],
}


def tune(
    env_id: str,
    run: Run,
    recipe: Recipe,
    *,
    trials: int = 30,
    seeds: Sequence[int] = SEEDS,
    space: Mapping[str, Any] | None = None,
    env_kwargs: Mapping[str, Any] | None = None,
    quiet: bool = False,
) -> Recipe:
    """Tries changes of a recipe, and returns and writes the best (``recipe.yml``).

    The recipe itself is the first trial. A trial is worth the mean over its training seeds of the
    best validated return; one that is behind the others' median at the same step is given up.

    Parameters
    ----------
    trials: how many there are in the end, those of an earlier call included
    seeds: training seeds of every trial
    space: what is searched, by hyperparameter: ``{low, high, log}`` or a list of choices

    Raises
    ------
    RecipeError: a space that cannot be read, or that the algorithm does not know
    RunError: the folder has a search of something else
    """
    import optuna

    off_policy = recipe.algorithm in OFF_POLICY
    seeds = checks.seeds(seeds)
    usual = OFF_POLICY_SPACE if off_policy else ON_POLICY_SPACE
    searched = {
        name: with_own(name, choice, recipe) for name, choice in dict(space or usual).items()
    }
    store = run.file(STORE)
    study = optuna.create_study(
        storage=f"sqlite:///{store.resolve()}",
        study_name="tune",
        load_if_exists=True,
        direction="maximize",
        pruner=optuna.pruners.MedianPruner(n_startup_trials=5, n_warmup_steps=5),
    )
    asked = {
        "env": env_id, "env_kwargs": dict(env_kwargs or {}), "recipe": recipe.as_dict(),
        "space": searched, "seeds": list(seeds),
    }  # fmt: skip
    text = json.dumps(asked, sort_keys=True)
    if study.user_attrs.setdefault("asked", text) != text:
        raise RunError(f"{run.path} has a search of something else: choose another name")
    study.set_user_attr("asked", text)
    if not study.get_trials(deepcopy=False):
        own = {name: own_value(name, choice, recipe) for name, choice in searched.items()}
        study.enqueue_trial(own)
    while len(judged(study)) < trials:
        # A stream for every trial: a search that goes on proposes what it would have proposed.
        tried = len(judged(study))
        study.sampler = optuna.samplers.TPESampler(seed=tried, n_startup_trials=8)
        study.optimize(
            lambda trial: _worth(trial, env_id, recipe, searched, seeds, env_kwargs), n_trials=1
        )
        if not quiet:
            print(described(study), flush=True)
    done = judged(study)
    best = recipe.with_changes(changes(study.best_trial.params, searched))
    best.write(run.file("recipe.yml"), env_id)
    rows = [[t.number, t.state.name, t.value, *map(t.params.get, searched)] for t in done]
    write_csv(run.file("trials.csv"), ["trial", "state", "return", *searched], rows)
    run.facts |= {**asked, "trials": len(done), "best": best.as_dict()}
    run.write_facts()
    return best


def load_space(path: Path) -> dict[str, Any]:
    """A search space from YAML: ``{low, high, log}`` or a list of choices by hyperparameter.

    Raises
    ------
    RecipeError: no such file, or no YAML
    """
    return entries(path)


def judged(study: optuna.Study) -> list[optuna.trial.FrozenTrial]:
    """Trials that have a verdict: those that ended, and those that were given up as hopeless."""
    from optuna.trial import TrialState

    return study.get_trials(deepcopy=False, states=(TrialState.COMPLETE, TrialState.PRUNED))


def described(study: optuna.Study) -> str:
    """The last trial and the best, in a line."""
    last = judged(study)[-1]
    shown = ", ".join(
        f"{name}={value:.3g}" if isinstance(value, float) else f"{name}={value}"
        for name, value in last.params.items()
    )
    found = "given up" if last.state.name == "PRUNED" else f"return {last.value:.2f}"
    if not study.get_trials(deepcopy=False, states=(type(last.state).COMPLETE,)):
        return f"trial {last.number}: {found} ({shown})"
    best = study.best_trial
    return f"trial {last.number}: {found} ({shown}); best {best.value:.2f} (trial {best.number})"


def _worth(
    trial: optuna.Trial,
    env_id: str,
    recipe: Recipe,
    space: Mapping[str, Any],
    seeds: Sequence[int],
    env_kwargs: Mapping[str, Any] | None,
) -> float:
    """Trains a trial on all seeds; the mean of the best validated returns."""
    import optuna

    chosen = {name: suggested(trial, name, choice) for name, choice in space.items()}
    changed = recipe.with_changes(changes(chosen, space))
    found: list[float] = []
    for number, seed in enumerate(seeds):
        validated: list[float] = []

        def on_validation(
            steps: int, value: float, found: list[float] = validated, number: int = number
        ) -> None:
            found.append(value)
            trial.report(max(found), number * 2 * VALIDATIONS + len(found))
            if trial.should_prune():
                raise optuna.TrialPruned

        with tempfile.TemporaryDirectory() as folder:
            try:
                training = train(
                    env_id, Run("trial", Path(folder)), recipe=changed, seed=seed,
                    env_kwargs=env_kwargs, on_validation=on_validation, resumable=False, quiet=True,
                )  # fmt: skip
            except (ValueError, AssertionError) as error:
                # Values that do not go together, or a network that has come to NaN.
                raise optuna.TrialPruned(str(error)) from error
        if training.interrupted:
            raise KeyboardInterrupt
        found.append(max(validated))
    return float(np.mean(found))


def suggested(trial: optuna.Trial, name: str, choice: Any) -> Any:
    """What Optuna proposes for a hyperparameter."""
    if isinstance(choice, list):
        return trial.suggest_categorical(name, choice)
    low, high, log = choice["low"], choice["high"], bool(choice.get("log", False))
    if isinstance(low, int) and isinstance(high, int):
        return trial.suggest_int(name, low, high, log=log)
    return trial.suggest_float(name, low, high, log=log)


def changes(chosen: Mapping[str, Any], space: Mapping[str, Any]) -> dict[str, Any]:
    """What a recipe gets of a trial: numbers, or schedules such as ``lin_0.001``."""
    return {
        name: f"lin_{value:.3g}"
        if isinstance(space[name], Mapping) and space[name].get("schedule") == "lin"
        else float(f"{value:.3g}")
        if isinstance(value, float)
        else value
        for name, value in chosen.items()
    }


def own_value(name: str, choice: Any, recipe: Recipe) -> Any:
    """The value that a recipe has, its schedule's beginning, or else the algorithm's default.

    Raises
    ------
    RecipeError: no hyperparameter of the algorithm, or a value that no range holds
    """
    check_hyperparams(recipe, algorithm_class(recipe.algorithm))
    parameters = inspect.signature(algorithm_class(recipe.algorithm)).parameters
    if name in recipe.hyperparams:
        value = recipe.hyperparams[name]
    elif name in ("n_envs", "frame_stack", "n_timesteps"):
        value = getattr(recipe, name)
    elif name in parameters:
        value = parameters[name].default
    else:
        raise RecipeError(f"{name!r} is no hyperparameter of {recipe.algorithm}")
    if isinstance(choice, list):
        return value
    number = str(value).removeprefix("lin_")
    try:
        found = float(number)
    except ValueError:
        raise RecipeError(f"{name} = {value!r} of the recipe is in no range") from None
    return int(found) if isinstance(choice["low"], int) and found.is_integer() else found


def with_own(name: str, choice: Any, recipe: Recipe) -> Any:
    """A choice or a range, wide enough for the value that the recipe has.

    Raises
    ------
    RecipeError: neither
    """
    if isinstance(choice, list) and choice:
        own = own_value(name, choice, recipe)
        return choice if own in choice else [*choice, own]
    number = int | float
    ok = isinstance(choice, Mapping) and {"low", "high"} <= set(choice)
    if not ok or set(choice) - {"low", "high", "log", "schedule"}:
        raise RecipeError(
            f"{name} = {choice!r} must be a list of choices or {{low, high, log, schedule}}"
        )
    low, high = choice["low"], choice["high"]
    if not (isinstance(low, number) and isinstance(high, number) and low < high):
        raise RecipeError(f"{name}: low = {low!r} must be a number below high = {high!r}")
    if choice.get("schedule", "lin") != "lin" or (choice.get("log") and low <= 0):
        raise RecipeError(f"{name} = {choice!r}: schedule must be lin, and log needs low above 0")
    own = own_value(name, choice, recipe)
    return {**choice, "low": min(low, own), "high": max(high, own)}
