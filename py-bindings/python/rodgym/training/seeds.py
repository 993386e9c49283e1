"""Several trainings of one recipe, which differ in their seeds alone."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from rodgym.runs import Run, RunError
from rodgym.training.recipe import Recipe, load_recipe
from rodgym.training.trainer import resume, train, unfinished
from rodgym.training.training import POLICY, Training, load_training


def train_seeds(
    env_id: str,
    run: Run,
    seeds: Sequence[int] = range(10),
    *,
    recipe: Recipe | None = None,
    env_kwargs: Mapping[str, Any] | None = None,
    tensorboard: bool = False,
    fresh: bool = False,
    quiet: bool = False,
) -> list[Training]:
    """Trains once a seed, each in a folder ``seed-N`` of the run, and returns all trainings.

    What is there already is not trained again: called a second time, after Ctrl-C or a kill, it
    goes on. Ctrl-C ends the training at hand; the list then ends with it.
    With ``fresh`` all are trained anew.

    Raises
    ------
    RunError: a folder has a training by another recipe or in another environment
    """
    recipe = recipe or load_recipe(env_id)
    trainings: list[Training] = []
    for seed in seeds:
        one = Run(f"seed-{seed}", run.folder(), facts={"command": run.facts["command"]})
        if not fresh and (unfinished(one) or (one.path / POLICY).is_file()):
            trainings.append(_goes_on(one, env_id, recipe, seed, env_kwargs, quiet))
        else:
            trainings.append(
                train(
                    env_id, one, recipe=recipe, seed=seed, env_kwargs=env_kwargs,
                    tensorboard=tensorboard, quiet=quiet,
                )
            )  # fmt: skip
        if trainings[-1].interrupted:
            break
    return trainings


def _goes_on(
    run: Run,
    env_id: str,
    recipe: Recipe,
    seed: int,
    env_kwargs: Mapping[str, Any] | None,
    quiet: bool,
) -> Training:
    """A training that is there already: read back, or gone on with."""
    asked = {
        "env": env_id,
        "env_kwargs": {**recipe.env_kwargs, **(env_kwargs or {})},
        "seed": seed,
        "recipe": recipe.as_dict(),
    }
    facts = json.loads((run.path / "run.json").read_text(encoding="utf-8"))
    for name, value in json.loads(json.dumps(asked)).items():
        if facts.get(name) != value:
            raise RunError(
                f"{run.path} has a training with {name} = {facts.get(name)!r}, not {value!r}: "
                "choose another name, or begin anew with --force"
            )
    return resume(run, quiet=quiet) if unfinished(run) else load_training(run.path)
