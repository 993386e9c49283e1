"""Training, evaluation and report, end to end and short."""

import csv
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import rodgym.evaluation
from rodgym.cli import main
from rodgym.evaluation.policies import Stacked, load_policy, read_card
from rodgym.evaluation.score import Trajectories, score
from rodgym.extras import installed

ENV = "rodgym/PendulumSwingUp-v0"
SMALL = ["--set", "n_envs=8", "--set", "n_steps=32", "--set", "batch_size=64", "--steps", "512"]


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_an_evaluation_is_what_single_environments_play_one_by_one() -> None:
    seeds = [5, 17, 2]
    result = rodgym.evaluation.evaluate("lqr", ENV, seeds)
    for i, seed in enumerate(seeds):
        env = gym.make(ENV)
        policy = load_policy("lqr", env)
        observation, _ = env.reset(seed=seed)
        state, start, rewards, torques, over = None, np.ones(1, bool), [], [], False
        while not over:
            action, state = policy.predict(observation, state, start, deterministic=True)
            start = np.zeros(1, bool)
            observation, reward, terminated, truncated, info = env.step(action)
            rewards.append(reward)
            torques.append(info["torque"])
            over = terminated or truncated
        assert result.columns["return"][i] == pytest.approx(sum(rewards), rel=1e-12)
        effort = np.sqrt(np.mean(np.square(torques)))
        assert result.columns["effort"][i] == pytest.approx(effort, rel=1e-12)


def test_scores_of_a_made_up_episode() -> None:
    """One is up from step 30 of 100 on, one falls at step 60, one swings through up."""
    height = np.full((100, 3), -1.0)
    height[30:, 0] = 0.99
    height[20:60, 1] = 1.0
    height[::2, 2] = 1.0
    alive = np.ones((100, 3), bool)
    alive[60:, 1] = False
    spec = {"machine": "pendulum", "task": "swing_up", "control_dt": 0.01}
    played = Trajectories(
        spec=spec,
        alive=alive,
        rewards=np.ones((100, 3)),
        actions=np.zeros((100, 3, 1), np.float32),
        metrics={
            "tip_height": height,
            "torque": np.full((100, 3), 0.02),
            "upright_error": np.full((100, 3), 0.1),
        },
        terminated=np.array([False, True, False]),
    )
    scores = score(played)
    assert scores["return"].tolist() == [100.0, 60.0, 100.0]
    # Mean height over the last second, which is the whole episode here, decides.
    assert scores["upright"].tolist() == [0.0, 0.0, 0.0]
    assert scores["length"] == pytest.approx([1.0, 0.6, 1.0])
    assert scores["effort"] == pytest.approx([0.02, 0.02, 0.02])

    longer = {
        key: np.concatenate([value, value[-1:].repeat(100, 0)])
        for key, value in played.metrics.items()
    }
    stood = Trajectories(
        spec=spec,
        alive=np.concatenate([alive, alive[-1:].repeat(100, 0)]),
        rewards=np.ones((200, 3)),
        actions=np.zeros((200, 3, 1), np.float32),
        metrics=longer,
        terminated=played.terminated,
    )
    scores = score(stood)
    assert scores["upright"].tolist() == [1.0, 0.0, 0.0]
    assert scores["time_to_upright"][0] == pytest.approx(0.30)
    assert np.isnan(scores["time_to_upright"][1:]).all()
    assert scores["sway"][0] == pytest.approx(0.1)


def test_a_stacked_policy_sees_the_past_of_its_own_episode_only() -> None:
    class Last:
        def predict(self, observation, state=None, episode_start=None, deterministic=False):
            seen.append(observation.copy())
            return np.zeros((len(observation), 1)), None

    seen: list[np.ndarray] = []
    policy = Stacked(Last(), 3)
    _, state = policy.predict(np.array([[1.0], [10.0]]), None, np.array([True, True]))
    _, state = policy.predict(np.array([[2.0], [20.0]]), state, np.array([False, False]))
    policy.predict(np.array([[3.0], [30.0]]), state, np.array([False, True]))
    assert seen[0].tolist() == [[0, 0, 1], [0, 0, 10]]
    assert seen[1].tolist() == [[0, 1, 2], [0, 10, 20]]
    assert seen[2].tolist() == [[1, 2, 3], [0, 0, 30]]


def test_an_agent_sees_its_own_actions_in_training_as_in_evaluation() -> None:
    """The same numbers reach the network whether the training or the evaluation stacks them."""
    from rodgym.training import load_recipe
    from rodgym.training.trainer import make_training_env

    env_id = "rodgym/PendulumSwingUpBase-v0"
    own = {"vec_env_wrapper": "rodgym.training.OwnActions"}
    recipe = load_recipe(env_id).with_changes({"n_envs": 2, "frame_stack": 3, **own})
    kwargs = {"max_episode_steps": 5}
    training = make_training_env(env_id, recipe, 0, kwargs)
    bare = rodgym.sb3.make_vec_env(env_id, 2, 0, env_kwargs=kwargs)

    class Echo:
        def predict(self, observation, state=None, episode_start=None, deterministic=False):
            seen.append(observation.copy())
            return actions[len(seen) - 1], None

    seen: list[np.ndarray] = []
    actions = np.random.default_rng(0).uniform(-1, 1, (12, 2, 1)).astype(np.float32)
    policy = Stacked(Echo(), 3, own_actions=1)
    stacked, observation = training.reset(), bare.reset()
    state, start = None, np.ones(2, bool)
    for action in actions:
        _, state = policy.predict(observation, state, start)
        assert np.array_equal(seen[-1], stacked)
        stacked, _, _, infos = training.step(action)
        observation, _, start, _ = bare.step(action)
        for info in infos:
            if "terminal_observation" in info:
                assert info["terminal_observation"].shape == (12,)
    assert seen[5][0, :8].tolist() == [0.0] * 8 and seen[6][0, 7] == 0.0
    assert seen[6][0, 11] == actions[5, 0, 0]


def test_compare_trains_and_leaves_everything_in_the_run_folder(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["compare", *SMALL, "--seeds", "4", "--name", "small"]) == 0
    table = capsys.readouterr().out
    assert "PPO" in table and "LQR" in table
    folder = Path("runs/small")
    files = {path.name for path in folder.iterdir()}
    assert files == {
        "animation.gif",
        *(["animation.mp4"] if installed("imageio_ffmpeg") else []),
        "episode.csv",
        "episode.png",
        "learning_curve.csv",
        "learning_curve.png",
        "moment.png",
        "policy.zip",
        "recipe.yml",
        "report.html",
        "run.json",
        "scores.csv",
        "scores.png",
    }
    page = (folder / "report.html").read_text()
    # Self-contained: nothing is fetched from anywhere.
    assert page.count("data:image/") == 5
    assert "://" not in page
    assert "Ctrl-C" not in page
    with (folder / "scores.csv").open() as stream:
        scores = list(csv.DictReader(stream))
    assert [row["policy"] for row in scores] == ["PPO"] * 4 + ["LQR"] * 4
    with (folder / "learning_curve.csv").open() as stream:
        curve = list(csv.DictReader(stream))
    assert float(curve[0]["steps"]) == 0
    assert float(curve[-1]["steps"]) == 512

    # The saved policy is the one of the table.
    assert main(["evaluate", str(folder), "--seeds", "4", "--name", "again"]) == 0
    with Path("runs/again/scores.csv").open() as stream:
        again = list(csv.DictReader(stream))
    assert [row["return"] for row in again] == [row["return"] for row in scores[:4]]
    assert read_card(folder / "policy.zip")["env"] == ENV


def test_a_policy_for_other_observations_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", *SMALL, "--name", "full"]) == 0
    code = main(["evaluate", "runs/full", "--env", "rodgym/PendulumSwingUpBase-v0"])
    assert code == 2
    assert "was trained in rodgym/PendulumSwingUp-v0 and sees 18 numbers" in capsys.readouterr().err


def test_repeated_options_name_more_players(capsys: pytest.CaptureFixture[str]) -> None:
    players = ["--policy", "random", "--policy", "zero", "--controller", "lqr"]
    assert main(["compare", *players, "--controller", "lqr-hybrid", "--seeds", "1"]) == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in ("\nrandom", "\nzero", "\nLQR", "\nhybrid LQR"))


def test_an_earlier_policy_is_kept_unless_forced(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", *SMALL, "--name", "mine"]) == 0
    policy = Path("runs/mine/policy.zip")
    before = policy.read_bytes()
    assert main(["train", *SMALL, "--seed", "1", "--name", "mine"]) == 2
    assert "choose another --name, or give --force" in capsys.readouterr().err
    # A comparison goes beside what is there.
    assert main(["compare", *SMALL, "--seeds", "1", "--seed", "1", "--name", "mine"]) == 0
    assert "runs/mine is there: this run is runs/mine-2" in capsys.readouterr().err
    assert policy.read_bytes() == before
    assert read_card(Path("runs/mine-2/policy.zip"))["seed"] == 1
    assert main(["train", *SMALL, "--seed", "1", "--name", "mine", "--force"]) == 0
    assert read_card(policy)["seed"] == 1


def test_a_second_run_lies_beside_the_first(capsys: pytest.CaptureFixture[str]) -> None:
    evaluation = ["evaluate", "zero", "--seeds", "1", "--name", "mine"]
    for number in ("", "-2", "-3"):
        assert main(evaluation) == 0
        assert f"runs/mine{number}/scores.csv" in capsys.readouterr().out
    first = Path("runs/mine/scores.csv")
    first.write_text("mine\n")
    assert main(evaluation) == 0
    assert first.read_text() == "mine\n"
    assert main([*evaluation, "--force"]) == 0
    assert first.read_text() != "mine\n"
    assert not Path("runs/mine-5").exists()


def test_a_training_says_what_it_makes_of_its_steps(capsys: pytest.CaptureFixture[str]) -> None:
    """Stable-Baselines3 learns in whole rollouts: 8 environments times 32 steps here."""
    assert main(["train", *SMALL[:-2], "--steps", "300", "--name", "odd"]) == 0
    shown = capsys.readouterr()
    assert "300 steps become 512" in shown.err and "every 256 steps" in shown.err
    assert "trained for 512 steps" in shown.out
    assert main(["train", *SMALL, "--name", "even"]) == 0
    assert "become" not in capsys.readouterr().err


def test_an_algorithm_without_a_recipe_says_so_and_trains(
    capsys: pytest.CaptureFixture[str],
) -> None:
    arguments = ["--algorithm", "TD3", "--steps", "64", "--set", "learning_starts=32"]
    assert main(["train", *arguments, "--name", "td3"]) == 0
    shown = capsys.readouterr()
    assert "no recipe for TD3" in shown.err and "defaults of Stable-Baselines3" in shown.err
    card = read_card(Path("runs/td3/policy.zip"))
    assert card["algorithm"] == "TD3" and card["steps"] == 64
    # As many learning steps as environment steps, as with one environment.
    assert card["recipe"]["n_envs"] == 8 and card["recipe"]["gradient_steps"] == -1


def test_the_same_seed_trains_the_same_agent() -> None:
    for name in ("one", "two"):
        assert main(["train", *SMALL, "--seed", "4", "--name", name]) == 0
    curves = [Path(f"runs/{name}/learning_curve.csv").read_text() for name in ("one", "two")]
    tables = [list(csv.DictReader(curve.splitlines())) for curve in curves]
    # All but the wall time.
    for row in [*tables[0], *tables[1]]:
        del row["seconds"]
    assert tables[0] == tables[1]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT for one child process")
def test_ctrl_c_keeps_what_was_learnt() -> None:
    command = [sys.executable, "-m", "rodgym", "train", "--steps", "100000000", "--name", "long"]
    running = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert running.stderr is not None
    try:
        # The first validation has been said: the training is under way.
        first = running.stderr.readline()
        assert "training PPO" in first
        time.sleep(1.0)
        running.send_signal(signal.SIGINT)
        out, _ = running.communicate(timeout=60)
    finally:
        running.kill()
    assert running.returncode == 0
    assert "interrupted after" in out
    result = rodgym.evaluation.evaluate("runs/long", ENV, range(2))
    assert np.isfinite(result.columns["return"]).all()


def test_a_report_shows_what_a_policy_learns_of_its_rod() -> None:
    keywords = ["--env-arg", "randomize={'youngs_modulus': (7e6, 1.3e7)}"]
    command = ["compare", "--env", "rodgym/PendulumSwingUpBase-v0", "--seeds", "0:2", *keywords]
    policies = ["--policy", "lqg-adaptive", "--controller", "lqg"]
    assert main([*command, *policies, "--name", "learns"]) == 0
    assert Path("runs/learns/estimates.png").stat().st_size > 5000
    page = Path("runs/learns/report.html").read_text(encoding="utf-8")
    assert "What was learnt of the rod" in page
    record = rodgym.evaluation.record(
        "lqg-adaptive",
        "rodgym/PendulumSwingUpBase-v0",
        env_kwargs={"randomize": {"youngs_modulus": (7e6, 1.3e7)}},
        max_seconds=2.0,
    )
    value, low, high = record.estimates["youngs_modulus"].T
    truth = record.parameters["youngs_modulus"]
    assert abs(value[-1] / truth - 1) < 0.02 and (low < value).all() and (value < high).all()
