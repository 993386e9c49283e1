"""Several trainings of one recipe stand in one row, with what they tell together; one alone is
called that."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from conftest import SWING_UP
from rodgym.cli import main
from rodgym.evaluation import evaluate

SHORT = ["--env-arg", "max_episode_steps=20"]
SMALL = ["--set", "n_envs=8", "--set", "n_steps=16", "--set", "batch_size=64", "--steps", "256"]


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def returns_of(folder: Path) -> dict[str, list[float]]:
    result: dict[str, list[float]] = {}
    with (folder / "scores.csv").open(encoding="utf-8") as stream:
        for row in csv.DictReader(stream):
            result.setdefault(row["policy"], []).append(float(row["return"]))
    return result


def test_several_trainings_are_one_row_with_intervals(capsys: pytest.CaptureFixture[str]) -> None:
    command = ["compare", *SHORT, *SMALL, "--train-seeds", "3:5", "--seeds", "4", "--name", "two"]
    assert main(command) == 0
    shown = capsys.readouterr().out
    folder = Path("runs/two")
    assert {"seed-3", "seed-4", "intervals.png", "profiles.png", "learning_curve.png"} <= {
        path.name for path in folder.iterdir()
    }
    returns = returns_of(folder)
    assert list(returns) == ["PPO, training 1", "PPO, training 2", "LQR"]
    played = evaluate(
        str(folder / "seed-4"), SWING_UP, range(4), env_kwargs={"max_episode_steps": 20}
    )
    assert returns["PPO, training 2"] == pytest.approx(played.columns["return"], rel=1e-8)
    # The row is that of all episodes of all trainings.
    mean = np.mean([returns["PPO, training 1"], returns["PPO, training 2"]])
    row = next(line for line in shown.splitlines() if line.startswith("PPO, 2 training seeds"))
    assert f"{mean:.1f}" in row
    assert "PPO, 2 training seeds: interquartile mean" in shown
    assert "PPO returns more than LQR with probability" in shown
    facts = json.loads((folder / "run.json").read_text())
    assert facts["training_seeds"] == [3, 4]
    page = (folder / "report.html").read_text()
    assert "interquartile mean" in page and "learnt 2 times" in page
    # The same from the folder, as policies that are there.
    again = ["compare", *SHORT, "--policy", "runs/two", "--controller", "lqr", "--seeds", "4"]
    assert main([*again, "--name", "again"]) == 0
    assert returns_of(Path("runs/again")) == returns
    assert (Path("runs/again") / "learning_curve.png").is_file()


def test_an_evaluation_takes_the_folder_of_several_trainings(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["train", *SHORT, *SMALL, "--train-seeds", "3:5", "--name", "two"]) == 0
    assert main(["evaluate", "runs/two", "--seeds", "4", "--name", "all"]) == 0
    shown = capsys.readouterr().out
    returns = returns_of(Path("runs/all"))
    assert list(returns) == ["PPO, training 1", "PPO, training 2"]
    mean = np.mean([returns["PPO, training 1"], returns["PPO, training 2"]])
    row = next(line for line in shown.splitlines() if line.startswith("PPO, 2 training seeds"))
    assert f"{mean:.1f}" in row
    # It plays where they were trained: episodes of 20 steps, each of which earns at most 1.
    assert "mean of 4 episodes, seeds 0 to 3" in shown
    assert max(map(max, returns.values())) < 20


def test_one_training_is_called_that(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", *SHORT, *SMALL, "--seeds", "2", "--name", "one"]) == 0
    assert "interquartile" not in capsys.readouterr().out
    assert not Path("runs/one/intervals.png").exists()
    assert "one training seed" in (Path("runs/one") / "report.html").read_text()


def test_nothing_is_trained_beside_given_policies(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", "--policy", "zero", "--train-seeds", "2"]) == 2
    assert "--train-seeds: nothing is trained" in capsys.readouterr().err
