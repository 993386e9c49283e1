"""A training that ends early can go on, and ends then as if nothing had happened: the same curve
and the same agent, to the bit, whatever the algorithm and what stands around its environments."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3")

import torch
from conftest import SWING_UP
from rodgym.cli import main
from rodgym.evaluation import evaluate, load_policy
from rodgym.evaluation.policies import read_card
from rodgym.runs import Run, RunError
from rodgym.training import Recipe, load_training, resume, train, train_seeds
from rodgym.zoo.algorithms import algorithm_class
from training_helpers import DYING

SHORT = {"max_episode_steps": 12}
ON_POLICY = {"n_timesteps": 384, "n_envs": 4, "n_steps": 16, "batch_size": 32, "n_epochs": 2}
OFF_POLICY = {"n_timesteps": 256, "n_envs": 4, "learning_starts": 40, "buffer_size": 200}
NET = {"policy_kwargs": "dict(net_arch=[8])"}
DIES = {"callback": [{"training_helpers.Dies": {"calls": 53}}]}

RECIPES = {
    "PPO": ON_POLICY,
    "PPO normalised, stacked": {**ON_POLICY, "normalize": True, "frame_stack": 2},
    "PPO, own actions, staggered": {
        **ON_POLICY,
        "vec_env_wrapper": ["rodgym.training.Staggered", "rodgym.training.OwnActions"],
    },
    "PPO, state-dependent noise": {**ON_POLICY, "use_sde": True, "sde_sample_freq": 5},
    "PPO behind wrappers": {
        **ON_POLICY,
        "env_wrapper": [{"training_helpers.Halves": {"factor": 0.25}}],
        "vec_env_wrapper": "training_helpers.Doubles",
        "normalize": "dict(norm_reward=False)",
    },
    "SAC": {**OFF_POLICY, "normalize": True},
    "TD3": {**OFF_POLICY, "noise_type": "ornstein-uhlenbeck", "noise_std": 0.2},
    "TQC": OFF_POLICY,
    "CrossQ": OFF_POLICY,
    "RecurrentPPO": {
        **ON_POLICY,
        "policy": "MlpLstmPolicy",
        "policy_kwargs": "dict(net_arch=[8], lstm_hidden_size=8)",
    },
}


def recipe(name: str, **changes: object) -> Recipe:
    return Recipe(name.partition(",")[0].split()[0]).with_changes(
        {**NET, **RECIPES[name], **changes}
    )


def curve(folder: Path) -> list[dict[str, str]]:
    """A curve but for its wall time."""
    with (folder / "learning_curve.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    return [{name: value for name, value in row.items() if name != "seconds"} for row in rows]


def parameters(policy: Path) -> dict[str, torch.Tensor]:
    card = read_card(policy)
    return algorithm_class(card["algorithm"]).load(policy, device="cpu").policy.state_dict()


def assert_same_training(folder: Path, other: Path) -> None:
    assert curve(folder) == curve(other)
    mine, theirs = parameters(folder / "policy.zip"), parameters(other / "policy.zip")
    assert mine.keys() == theirs.keys()
    for name, value in mine.items():
        assert torch.equal(value, theirs[name]), name


@pytest.mark.parametrize("name", RECIPES)
def test_a_resumed_training_ends_as_an_uninterrupted_one(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, broken = Run("whole", tmp_path), Run("broken", tmp_path)
    how = {"recipe": recipe(name, **DIES), "seed": 3, "env_kwargs": SHORT, "quiet": True}
    train(SWING_UP, whole, **how)
    monkeypatch.setenv(DYING, "raise")
    with pytest.raises(RuntimeError, match="died"):
        train(SWING_UP, broken, **how)
    monkeypatch.delenv(DYING)
    facts = json.loads((broken.path / "run.json").read_text())
    of = how["recipe"].n_timesteps
    assert facts["training"]["state"] == "interrupted" and 0 < facts["training"]["steps"] < of
    # What another training draws meanwhile changes nothing.
    torch.manual_seed(77)
    training = resume(Run("broken", tmp_path), quiet=True)
    assert_same_training(broken.path, whole.path)
    assert (training.steps, training.interrupted) == (of, False)
    facts = json.loads((broken.path / "run.json").read_text())
    assert facts["training"] == {"state": "finished", "steps": of, "of": of}
    assert not (broken.path / "checkpoint.pkl").exists()
    # What has ended is read back as it is.
    again = resume(Run("broken", tmp_path))
    assert repr(again) == repr(load_training(broken.path))
    assert repr(again.curve) == repr([list(row) for row in training.curve])


def test_a_killed_training_goes_on_in_the_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    recipe("PPO", **DIES).write(tmp_path / "mine.yml", SWING_UP)
    begin = ["train", "--recipe", "mine.yml", "--env-arg", "max_episode_steps=12", "--seed", "5"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), DYING: "kill"}
    killed = subprocess.run(
        [sys.executable, "-m", "rodgym", *begin, "--name", "killed"],
        env=environment, capture_output=True, timeout=300,
    )  # fmt: skip
    assert killed.returncode == -signal.SIGKILL
    facts = json.loads(Path("runs/killed/run.json").read_text())
    assert facts["training"]["state"] == "running" and facts["training"]["of"] == 384
    assert main([*begin, "--name", "killed"]) == 2
    assert "was not finished: --resume goes on with it" in capsys.readouterr().err
    assert main(["train", "--resume", "--name", "killed", "--seed", "6"]) == 2
    assert "--seed: --resume goes on with what" in capsys.readouterr().err
    assert main(["train", "--resume", "--name", "killed"]) == 0
    assert main([*begin, "--name", "whole"]) == 0
    assert_same_training(Path("runs/killed"), Path("runs/whole"))
    assert main(["train", "--resume", "--name", "nowhere"]) == 2
    assert "nothing to resume in" in capsys.readouterr().err


def test_a_damaged_checkpoint_is_refused(tmp_path: Path) -> None:
    run = Run("bad", tmp_path)
    run.file("checkpoint.pkl").write_bytes(b"\x80\x05nothing")
    with pytest.raises(RunError, match=r"checkpoint.pkl is no checkpoint"):
        resume(run)


@pytest.mark.parametrize(
    "name", ["PPO normalised, stacked", "PPO, own actions, staggered", "RecurrentPPO"]
)
def test_what_is_saved_plays_as_it_was_validated(name: str, tmp_path: Path) -> None:
    run = Run("one", tmp_path)
    training = train(SWING_UP, run, recipe=recipe(name), env_kwargs=SHORT, quiet=True)
    best = max(row[training.columns.index("return")] for row in training.curve)
    played = evaluate(str(training.policy), SWING_UP, range(10_000, 10_032), env_kwargs=SHORT)
    assert played.mean("return") == best


def test_what_was_trained_behind_unknown_wrappers_is_not_played_without_them(
    tmp_path: Path,
) -> None:
    import gymnasium as gym

    run = Run("one", tmp_path)
    training = train(
        SWING_UP, run, recipe=recipe("PPO behind wrappers"), env_kwargs=SHORT, quiet=True
    )
    with pytest.raises(ValueError, match="behind Halves"):
        load_policy(str(training.policy), gym.make(SWING_UP))


def test_several_seeds_are_trained_once_and_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    how = {"recipe": recipe("PPO", **DIES), "env_kwargs": SHORT, "quiet": True}
    run = Run("many", tmp_path)
    first = train_seeds(SWING_UP, run, range(1), **how)
    made = first[0].policy.stat().st_mtime_ns
    monkeypatch.setenv(DYING, "raise")
    with pytest.raises(RuntimeError, match="died"):
        train_seeds(SWING_UP, run, range(2), **how)
    monkeypatch.delenv(DYING)
    both = train_seeds(SWING_UP, run, range(2), **how)
    assert both[0].policy.stat().st_mtime_ns == made
    assert [training.seed for training in both] == [0, 1]
    assert both[0].curve != both[1].curve
    alone = train(SWING_UP, Run("alone", tmp_path), seed=1, **how)
    assert_same_training(both[1].policy.parent, alone.policy.parent)
    with pytest.raises(RunError, match="has a training with recipe"):
        train_seeds(SWING_UP, run, range(2), **{**how, "recipe": recipe("PPO")})
    anew = train_seeds(SWING_UP, run, range(1), fresh=True, **how)
    assert anew[0].policy.stat().st_mtime_ns > made
    assert anew[0].curve[-1][2:] == first[0].curve[-1][2:]


def test_the_program_trains_several_seeds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    recipe("PPO").write(tmp_path / "mine.yml", SWING_UP)
    short = ["train", "--recipe", "mine.yml", "--env-arg", "max_episode_steps=12"]
    command = [*short, "--train-seeds", "4:6", "--name", "two"]
    assert main(command) == 0
    shown = capsys.readouterr().out
    assert "seed-4" in shown and "seed-5" in shown
    assert main(command) == 0
    assert capsys.readouterr().out == shown
    assert main([*command, "--seed", "3"]) == 2
    assert "--train-seeds names the seeds" in capsys.readouterr().err


def test_stages_events_and_facts_are_written(tmp_path: Path) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    run = Run("one", tmp_path)
    training = train(
        SWING_UP, run, recipe=recipe("PPO", normalize=True), env_kwargs=SHORT,
        tensorboard=True, stages=True, quiet=True,
    )  # fmt: skip
    stages = sorted(run.path.glob("stages/*.zip"))
    assert len(stages) == len(training.curve)
    returns = {row[0]: row[3] for row in training.curve}
    last = evaluate(str(stages[-1]), SWING_UP, range(10_000, 10_032), env_kwargs=SHORT)
    assert last.mean("return") in returns.values()
    (events,) = run.path.glob("tensorboard/*")
    scalars = EventAccumulator(str(events)).Reload().Scalars("validation/return")
    assert {event.step for event in scalars} == set(returns)
    assert scalars[-1].value == pytest.approx(training.curve[-1][3], rel=1e-6)
    card = read_card(training.policy)
    # The library's defaults are among them.
    assert card["hyperparameters"]["vf_coef"] == 0.5 and card["hyperparameters"]["n_steps"] == 16
    again = Recipe("PPO").with_changes(card["recipe"])
    assert again == training.recipe
