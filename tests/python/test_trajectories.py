"""Every step of every episode can be kept: tables, data sets, best known returns beside them."""

import csv
import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from rodgym.errors import ParameterError
from rodgym.evaluation import evaluate

stable_baselines3 = pytest.importorskip("stable_baselines3")

from rodgym.cli import main  # noqa: E402

ENV = "rodgym/PendulumSwingUp-v0"
BALANCE = "rodgym/PendulumBalance-v0"
#: Arguments of a comparison whose pictures are soon drawn.
SHORT = ["--env-arg", "max_episode_steps=40"]


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_every_step_is_written_to_the_bit(kind, capsys):
    arguments = ["--env", BALANCE, "--seeds", "3", "--trajectories", kind, "--name", "all"]
    if kind == "parquet":
        parquet = pytest.importorskip("pyarrow.parquet")
    assert main(["evaluate", "zero", *arguments]) == 0
    path = Path(f"runs/all/trajectories.{kind}")
    assert str(path) in capsys.readouterr().out
    if kind == "csv":
        with path.open() as stream:
            rows = list(csv.DictReader(stream))
    else:
        table = parquet.read_table(path).to_pylist()
        rows = [{k: "" if v is None else v for k, v in row.items()} for row in table]
    for seed in range(3):
        env = gym.make(BALANCE)
        observation, _ = env.reset(seed=seed)
        mine = [row for row in rows if int(row["seed"]) == seed]
        for step, row in enumerate(mine):
            seen = [np.float32(row[f"observation_{k}"]) for k in range(18)]
            assert np.array_equal(seen, observation)
            last = step == len(mine) - 1
            assert (row["reward"] == "") == (row["action_0"] == "") == last
            assert int(row["terminated"]) == last and int(row["truncated"]) == 0
            if last:
                break
            observation, reward, terminated, truncated, info = env.step([0.0])
            assert float(row["reward"]) == reward and float(row["tip_height"]) == info["tip_height"]
            assert terminated == (step == len(mine) - 2) and not truncated


def test_episodes_become_a_data_set_of_minari(tmp_path, monkeypatch, capsys):
    minari = pytest.importorskip("minari")
    pytest.importorskip("h5py")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "data"))
    arguments = ["--seeds", "5:8", "--env-arg", "width=0.008", *SHORT]
    assert main(["evaluate", "lqr", *arguments, "--minari", "pendulum/lqr-v0"]) == 0
    assert "data set: " in capsys.readouterr().out
    data = minari.load_dataset("pendulum/lqr-v0")
    assert data.total_episodes == 3 and data.total_steps == 120
    kwargs = {"width": 0.008, "max_episode_steps": 40}
    scores = evaluate("lqr", ENV, range(5, 8), env_kwargs=kwargs).columns["return"]
    env = data.recover_environment()
    for i, episode in enumerate(data.iterate_episodes()):
        assert episode.rewards.sum() == pytest.approx(scores[i], rel=1e-12)
        observation, info = env.reset(seed=5 + i)
        assert info["parameters"]["width"] == 0.008
        for step, action in enumerate(episode.actions):
            assert np.array_equal(observation, episode.observations[step])
            observation, reward, _, truncated, _ = env.step(action)
            assert reward == episode.rewards[step]
        assert np.array_equal(observation, episode.observations[-1])
        assert truncated and episode.truncations[-1] and not episode.terminations.any()
    # Nothing is overwritten.
    assert main(["evaluate", "lqr", *arguments, "--minari", "pendulum/lqr-v0"]) == 2
    assert "dataset_id = 'pendulum/lqr-v0' is not allowed" in capsys.readouterr().err


def test_steps_that_were_not_kept_cannot_be_written():
    result = evaluate("zero", ENV, range(1), env_kwargs={"max_episode_steps": 2})
    with pytest.raises(ParameterError, match=r"trajectories=True\) keeps them"):
        result.write_trajectories("steps.csv")
    kept = evaluate("zero", ENV, range(1), env_kwargs={"max_episode_steps": 2}, trajectories=True)
    with pytest.raises(ParameterError, match=r"must end in \.csv or \.parquet"):
        kept.write_trajectories("steps.txt")
    kept.write_trajectories("steps.csv")
    assert len(Path("steps.csv").read_text().splitlines()) == 4


def test_best_known_returns_stand_in_the_table_where_they_are_known(tmp_path, monkeypatch, capsys):
    from rodgym.evaluation import best_known, comparison_table

    kept = [{"id": ENV, "config": {"width": 0.008}, "return": 489.25, "source": "a test"}]
    monkeypatch.setattr(best_known, "FILE", tmp_path / "best_known.json")
    assert evaluate("zero", ENV, range(1), env_kwargs={"width": 0.008}).best_known is None
    best_known.FILE.write_text(json.dumps(kept))
    there = evaluate("zero", ENV, range(1), env_kwargs={"width": 0.008})
    assert there.best_known == 489.25
    assert "best known return here: 489.2" in comparison_table([there])
    assert evaluate("zero", ENV, range(1)).best_known is None
    # Shorter episodes have another best.
    short = {"width": 0.008, "max_episode_steps": 5}
    assert evaluate("zero", ENV, range(1), env_kwargs=short).best_known is None
