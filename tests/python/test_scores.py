"""A score is the policy's own: what its training put before it is put before it again, or it is
refused by name.
"""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import rodgym
from gymnasium.wrappers import NormalizeObservation, RescaleAction, RescaleObservation
from rodgym.baselines import Lqr
from rodgym.errors import ParameterError
from rodgym.evaluation import PolicyError, evaluate, record

stable_baselines3 = pytest.importorskip("stable_baselines3")

from learners import judged_by_sb3, learn  # noqa: E402
from rodgym.cli import main  # noqa: E402
from rodgym.sb3 import make_vec_env  # noqa: E402
from stable_baselines3 import A2C, DDPG, PPO, SAC, TD3  # noqa: E402
from stable_baselines3.common.vec_env import (  # noqa: E402
    DummyVecEnv,
    VecFrameStack,
    VecNormalize,
)

ENV = "rodgym/PendulumSwingUp-v0"
BALANCE = "rodgym/PendulumBalance-v0"
BASE = "rodgym/PendulumSwingUpBase-v0"
SEEDS = range(8)
#: Arguments of a comparison whose pictures are soon drawn.
SHORT = ["--env-arg", "max_episode_steps=40"]
#: A bound of a space, in the type of the space: Gymnasium warns of others.
TWO = np.float32(2.0)


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


# ----- normalisation, stacked frames


def test_a_model_behind_vecnormalize_scores_as_sb3_scores_it():
    venv = VecNormalize(make_vec_env(ENV, 8, 0))
    model = learn(venv)
    own = evaluate(model, ENV, SEEDS)
    assert sorted(own.columns["return"]) == pytest.approx(judged_by_sb3(model, venv), rel=1e-5)
    # Raw observations, which it never saw, give another score.
    raw = evaluate(model.policy, ENV, SEEDS)
    assert abs(raw.mean("return") - own.mean("return")) > 1e-3


@pytest.mark.parametrize("normalized_first", [True, False])
def test_frames_and_statistics_are_applied_in_the_order_of_the_training(normalized_first, tmp_path):
    venv = make_vec_env(ENV, 4, 0)
    if normalized_first:
        statistics = VecNormalize(venv)
        venv = VecFrameStack(statistics, 3)
    else:
        venv = statistics = VecNormalize(VecFrameStack(venv, 3))
    model = learn(venv)
    statistics.training = False
    theirs = judged_by_sb3(model, venv)
    assert sorted(evaluate(model, ENV, range(4)).columns["return"]) == pytest.approx(
        theirs, rel=1e-5
    )
    # The same from its file.
    model.save(tmp_path / "stacked.zip")
    statistics.save(tmp_path / "vecnormalize.pkl")
    saved = evaluate(str(tmp_path / "stacked.zip"), ENV, range(4))
    assert sorted(saved.columns["return"]) == pytest.approx(theirs, rel=1e-5)


def test_a_file_of_sb3_alone_finds_its_statistics_or_is_refused(tmp_path):
    venv = VecNormalize(make_vec_env(ENV, 8, 0))
    model = learn(venv)
    mine = evaluate(model, ENV, SEEDS).columns["return"]
    file = tmp_path / "elsewhere" / "plain.zip"
    file.parent.mkdir()
    model.save(file)
    with pytest.raises(PolicyError, match=r"normalised observations.*put vecnormalize.pkl beside"):
        evaluate(str(file), ENV, SEEDS)
    venv.save(tmp_path / "kept.pkl")
    for given in (str(tmp_path / "kept.pkl"), venv):
        assert evaluate(str(file), ENV, SEEDS, normalize=given).columns["return"] == pytest.approx(
            mine, rel=1e-6
        )
    # As rl_zoo3 lays it down, and beside it.
    for place in (file.with_suffix("") / "vecnormalize.pkl", file.parent / "vecnormalize.pkl"):
        place.parent.mkdir(exist_ok=True)
        venv.save(place)
        assert evaluate(str(file), ENV, SEEDS).columns["return"] == pytest.approx(mine, rel=1e-6)
        place.unlink()
    # Whoever knows better says so.
    assert evaluate(str(file), ENV, SEEDS, normalize=False).mean("return") != pytest.approx(
        mine.mean()
    )
    with pytest.raises(PolicyError, match=r"normalize = 'nowhere.pkl' is not allowed: No such"):
        evaluate(str(file), ENV, SEEDS, normalize="nowhere.pkl")
    (tmp_path / "no.pkl").write_bytes(b"nothing")
    with pytest.raises(PolicyError, match=r"no.pkl holds no VecNormalize"):
        evaluate(str(file), ENV, SEEDS, normalize=tmp_path / "no.pkl")
    # A loaded model knows as little as its file.
    with pytest.raises(PolicyError, match="PPO was trained on normalised observations"):
        record(PPO.load(file), ENV, 0)


@pytest.mark.parametrize("algorithm", [PPO, A2C, SAC, TD3, DDPG])
def test_every_file_of_sb3_is_read_without_our_card(algorithm, tmp_path):
    model = algorithm("MlpPolicy", make_vec_env(ENV, 2, 0), seed=0)
    file = tmp_path / "plain.zip"
    model.save(file)
    assert rodgym.evaluation.policies.read_card(file) == {"algorithm": algorithm.__name__}
    ours = evaluate(str(file), ENV, range(2))
    assert ours.columns["return"] == pytest.approx(evaluate(model, ENV, range(2)).columns["return"])


def test_the_program_plays_a_file_of_sb3_alone(capsys):
    venv = VecNormalize(make_vec_env(BASE, 4, 0))
    learn(venv).save("plain.zip")
    venv.save("kept.pkl")
    assert main(["evaluate", "plain.zip", "--seeds", "1"]) == 2
    assert "plain.zip does not say where it was trained: give --env ID" in capsys.readouterr().err
    there = ["--env", BASE, "--normalize", "kept.pkl", *SHORT]
    assert main(["evaluate", "plain.zip", "--seeds", "2", *there]) == 0
    assert main(["compare", "--policy", "plain.zip", "--seeds", "1", *there]) == 0
    assert main(["render", "plain.zip", "strip.png", "--stills", "2", *there]) == 0
    shown = capsys.readouterr().out
    assert "PPO" in shown and "LQG" in shown
    assert main(["evaluate", "plain.zip", "--seeds", "1", "--env", BASE]) == 2
    assert "--normalize FILE" in capsys.readouterr().err


# ----- other tasks, other parameters, other spaces


def test_a_policy_of_another_task_is_refused(tmp_path):
    with pytest.raises(PolicyError, match="trained for the task 'swing_up' of a pendulum"):
        evaluate(str(rodgym.zoo.zoo_policy(ENV)), BALANCE, SEEDS)
    model = learn(make_vec_env(ENV, 2, 0))
    for play in (evaluate, record):
        with pytest.raises(PolicyError, match=r"PPO does not fit.*task of rodgym/PendulumBalance"):
            play(model, BALANCE, range(1) if play is evaluate else 0)
    with pytest.raises(PolicyError, match="sees 18 numbers; this environment shows 3"):
        evaluate(model, BASE, SEEDS)


def test_other_parameters_are_marked(capsys):
    same = evaluate("zoo", ENV, SEEDS)
    other = evaluate("zoo", ENV, SEEDS, env_kwargs={"width": 0.0081})
    assert same.design == ""
    assert other.design == "trained: width=0.007"
    model = learn(make_vec_env(ENV, 2, 0, width=0.008))
    assert evaluate(model, ENV, SEEDS).design == "trained: width=0.008"
    arguments = ["--env", ENV, "--env-arg", "width=0.0081", "--seeds", "2", *SHORT]
    assert main(["compare", "--policy", "zoo", *arguments, "--name", "marked"]) == 0
    shown = capsys.readouterr().out
    assert "trained: width=0.007" in shown
    assert "trained: what was otherwise in its training than it is here" in shown
    assert "trained: width=0.007" in Path("runs/marked/report.html").read_text()


def test_a_model_trained_behind_a_wrapper_is_refused_where_it_is_missing():
    class Louder(gym.ObservationWrapper):
        def observation(self, observation):
            return np.clip(1.1 * observation, -20, 20).astype(np.float32)

    def behind(wrap):
        return DummyVecEnv([lambda: wrap(gym.make(ENV))] * 2)

    model = learn(behind(Louder), steps=64)
    with pytest.raises(PolicyError, match="PPO was trained behind Louder"):
        evaluate(model, ENV, SEEDS)
    model = learn(behind(lambda env: RescaleAction(env, -TWO, TWO)), steps=64)
    model.save("rescaled.zip")
    for policy in (model, "rescaled.zip"):
        with pytest.raises(PolicyError, match=r"acts in Box\(-2.*such as RescaleAction"):
            evaluate(policy, ENV, SEEDS)
    model = learn(behind(lambda env: RescaleObservation(env, 0 * TWO, TWO)), steps=64)
    model.save("rescaled.zip")
    with pytest.raises(PolicyError, match="PPO was trained behind RescaleObservation"):
        evaluate(model, ENV, SEEDS)
    for wrap in (lambda env: RescaleObservation(env, 0 * TWO, TWO), NormalizeObservation):
        learn(behind(wrap), steps=64).save("other.zip")
        with pytest.raises(PolicyError, match="a wrapper such as NormalizeObservation"):
            evaluate("other.zip", ENV, SEEDS)


# ----- controllers behind wrappers


@pytest.mark.parametrize(
    ("name", "wrap"),
    [
        ("NormalizeObservation", NormalizeObservation),
        ("RescaleObservation", lambda env: RescaleObservation(env, -TWO, TWO)),
        ("RescaleAction", lambda env: RescaleAction(env, -TWO, TWO)),
    ],
)
def test_controllers_refuse_wrappers_that_change_their_numbers(name, wrap):
    vector = getattr(gym.wrappers.vector, name)
    bounds = {"RescaleObservation": (-TWO, TWO), "RescaleAction": (-TWO, TWO)}.get(name, ())
    for env in (
        wrap(gym.make(ENV)),
        vector(gym.make_vec(ENV, num_envs=2), *bounds),
        DummyVecEnv([lambda: wrap(gym.make(ENV))]),
    ):
        with pytest.raises(ParameterError, match=f"behind {name} is not allowed"):
            Lqr.for_env(env)
        with pytest.raises(ParameterError, match=f"behind {name} is not allowed"):
            rodgym.baselines.make("lqr-hybrid", env)


def test_controllers_refuse_what_sb3_puts_between():
    with pytest.raises(ParameterError, match="behind VecNormalize is not allowed"):
        Lqr.for_env(VecNormalize(make_vec_env(ENV, 2)))
    with pytest.raises(ParameterError, match="behind VecFrameStack is not allowed"):
        Lqr.for_env(VecFrameStack(make_vec_env(ENV, 2), 3))
    # Rewards are nobody's observation.
    rewards = VecNormalize(make_vec_env(ENV, 2), norm_obs=False)
    assert Lqr.for_env(rewards).design["width"] == 0.007
