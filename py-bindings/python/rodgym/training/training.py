"""What a training leaves: its policy, its curve, and what can be read back from its folder."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rodgym.evaluation.policies import read_card
from rodgym.runs import RunError
from rodgym.training.recipe import Recipe

#: Files of a training, and the member of a policy's file with the statistics of `VecNormalize`.
POLICY, CURVE_FILE, STATISTICS = "policy.zip", "learning_curve.csv", "vecnormalize.pkl"


@dataclass(frozen=True)
class Training:
    """What came out: the best validated stage of the agent, saved, and its curve.

    ``curve`` has the columns named ``columns``: those of `rodgym.training.watch.CURVE` and
    successes; ``seconds`` is the wall time, validation included; ``interrupted`` says that Ctrl-C
    ended it early.
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


def load_training(folder: Path) -> Training:
    """Reads a training back from its folder.

    Raises
    ------
    RunError: a policy without its curve
    """
    card = read_card(folder / POLICY)
    try:
        with (folder / CURVE_FILE).open(encoding="utf-8", newline="") as stream:
            columns, *rows = csv.reader(stream)
        curve = [[int(row[0]), *map(float, row[1:])] for row in rows]
        recipe = dict(card["recipe"])
        return Training(
            policy=folder / POLICY,
            recipe=Recipe(recipe.pop("algorithm")).with_changes(recipe),
            seed=card["seed"],
            columns=tuple(columns),
            curve=curve,
            best_steps=card["best_steps"],
            seconds=float(card.get("seconds", curve[-1][1])),
            steps=card["steps"],
            interrupted=bool(card.get("interrupted")),
        )
    except (OSError, ValueError, KeyError, IndexError) as error:
        raise RunError(f"{folder} has no whole training: {error}") from error
