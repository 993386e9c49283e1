"""A search for hyperparameters begins with the recipe, goes on where it was ended, and leaves a
recipe that trains."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

pytest.importorskip("optuna")
pytest.importorskip("stable_baselines3")

from conftest import SWING_UP
from rodgym.cli import main
from rodgym.runs import Run, RunError
from rodgym.training import Recipe, load_recipe
from rodgym.training.expressions import RecipeError
from rodgym.training.tuning import tune, with_own

RECIPE = Recipe("PPO").with_changes(
    {
        "n_timesteps": 128,
        "n_envs": 4,
        "n_steps": 16,
        "batch_size": 32,
        "n_epochs": 1,
        "learning_rate": "lin_0.02",
        "policy_kwargs": "dict(net_arch=[8])",
    }
)
SPACE = {
    "learning_rate": {"low": 1e-4, "high": 1e-2, "log": True, "schedule": "lin"},
    "n_epochs": {"low": 2, "high": 3},
    "gamma": [0.9, 0.95],
}


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "trials.csv").open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_a_search_begins_with_the_recipe_and_goes_on_as_if_it_had_not_ended(
    tmp_path: Path,
) -> None:
    how = {"space": SPACE, "seeds": [1000], "env_kwargs": {"max_episode_steps": 8}, "quiet": True}
    whole, parted = Run("whole", tmp_path), Run("parted", tmp_path)
    best = tune(SWING_UP, whole, RECIPE, trials=3, **how)
    tune(SWING_UP, parted, RECIPE, trials=1, **how)
    assert tune(SWING_UP, parted, RECIPE, trials=3, **how) == best
    assert rows(parted.path) == rows(whole.path)
    first = rows(whole.path)[0]
    # What the recipe has is tried first, although the space does not hold it.
    assert (first["learning_rate"], first["n_epochs"], first["gamma"]) == ("0.02", "1", "0.99")
    assert load_recipe(SWING_UP, "PPO", whole.path / "recipe.yml") == best
    assert str(best.hyperparams["learning_rate"]).startswith("lin_")
    with pytest.raises(RunError, match="has a search of something else"):
        tune(SWING_UP, parted, RECIPE.with_changes({"n_envs": 2}), trials=3, **how)


@pytest.mark.parametrize(
    ("choice", "named"),
    [
        (3, "learning_rate = 3 must be a list of choices"),
        ({"low": 1}, "must be a list of choices"),
        ({"low": 2, "high": 1}, "low = 2 must be a number below high = 1"),
        ({"low": 0, "high": 1, "log": True}, "log needs low above 0"),
        ({"low": 0.1, "high": 1, "schedule": "cos"}, "schedule must be lin"),
        ({"low": 0.1, "high": 1, "step": 3}, "must be a list of choices"),
    ],
)
def test_a_space_that_cannot_be_searched_is_refused(choice: object, named: str) -> None:
    with pytest.raises(RecipeError, match=named):
        with_own("learning_rate", choice, RECIPE)


def test_the_program_searches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    RECIPE.write(Path("mine.yml"), SWING_UP)
    Path("space.yml").write_text("speed: [1, 2]")
    command = ["tune", "--recipe", "mine.yml", "--env-arg", "max_episode_steps=8", "--trials", "1"]
    assert main([*command, "--space", "space.yml", "--name", "bad"]) == 2
    assert "'speed' is no hyperparameter of PPO" in capsys.readouterr().err
    Path("space.yml").write_text("gamma: [0.9]")
    assert main([*command, "--space", "space.yml", "--name", "good"]) == 0
    assert "trial 0: return" in capsys.readouterr().out
    assert Path("runs/good/recipe.yml").is_file()
