"""Environments and policies of one's own play like ours, by their own reward."""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import rodgym
from rodgym.errors import ParameterError, UnknownEnvError
from rodgym.evaluation import PolicyError, evaluate, load_policy, record

stable_baselines3 = pytest.importorskip("stable_baselines3")

from learners import judged_by_sb3, learn  # noqa: E402
from rodgym.cli import main  # noqa: E402
from stable_baselines3.common.vec_env import DummyVecEnv  # noqa: E402

ENV = "rodgym/PendulumSwingUp-v0"
#: Rods of which a design for 7 mm holds two in three.
DRAWN = {"randomize": {"width": (0.006, 0.010)}}
SEEDS = range(8)
#: Arguments of a comparison whose pictures are soon drawn.
SHORT = ["--env-arg", "max_episode_steps=40"]
#: A bound of a space, in the type of the space: Gymnasium warns of others.
TWO = np.float32(2.0)


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


MINE = '''
import gymnasium as gym
import numpy as np
import rodgym

TWO = np.float32(2.0)

class Low(gym.RewardWrapper):
    """Pays for hanging."""
    def reward(self, reward):
        return 1.0 - reward

class Quiet(gym.Wrapper):
    """Pays for a little torque; neither observations nor actions change."""
    def step(self, action):
        observation, _, terminated, truncated, info = self.env.step(action)
        return observation, -float(info["torque"]) ** 2, terminated, truncated, info

class Mirror(gym.Wrapper):
    """Shows the rod in a mirror, and does not say so."""
    def step(self, action):
        observation, *rest = self.env.step(action)
        return -observation, *rest
    def reset(self, *, seed=None, options=None):
        observation, info = self.env.reset(seed=seed, options=options)
        return -observation, info

def low(**keywords):
    return Low(gym.make("rodgym/PendulumSwingUp-v0", **keywords))

def quiet(**keywords):
    return Quiet(gym.make("rodgym/PendulumSwingUp-v0", **keywords))

def mirror(**keywords):
    return Mirror(gym.make("rodgym/PendulumSwingUp-v0", **keywords))

def rescaled(**keywords):
    return gym.wrappers.RescaleAction(gym.make("rodgym/PendulumSwingUp-v0", **keywords), -TWO, TWO)

def running(**keywords):
    return gym.wrappers.NormalizeObservation(gym.make("rodgym/PendulumSwingUp-v0", **keywords))

for name in ("low", "quiet", "mirror", "rescaled", "running"):
    gym.registry.pop(f"Mine/{name.title()}-v0", None)  # Another test of this process had it.
    gym.register(f"Mine/{name.title()}-v0", entry_point=globals()[name], max_episode_steps=None)

class Full:
    """All the torque there is."""
    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        assert observation.ndim == 2
        return np.ones((len(observation), 1), np.float32), state

class Designed(Full):
    def __init__(self, env):
        assert env.action_space.shape[-1] == 1
'''


@pytest.fixture
def mine(tmp_path, request):
    """A module of the user's, under a name of this test: a module is imported once."""
    name = "mine_" + request.node.name.split("[")[0][-20:]
    (tmp_path / f"{name}.py").write_text(MINE)
    return name


def test_an_environment_of_ones_own_is_scored_by_its_own_reward(mine, capsys):
    theirs = evaluate("lqr", ENV, SEEDS).columns["return"]
    own = evaluate("lqr", f"{mine}.py:Mine/Low-v0", SEEDS)
    assert own.columns["return"] == pytest.approx(500 - theirs)
    assert own.columns["upright"].tolist() == [1.0] * len(SEEDS)
    quiet = evaluate("lqr", f"{mine}:Mine/Quiet-v0", SEEDS)
    effort = quiet.columns["effort"]
    assert quiet.columns["return"] == pytest.approx(-500 * effort**2)
    one = record("lqr", f"{mine}.py:Mine/Low-v0", 3)
    assert one.rewards.sum() == pytest.approx(own.columns["return"][3])
    drawn = evaluate("lqr", f"{mine}.py:Mine/Low-v0", SEEDS, env_kwargs=DRAWN)
    assert drawn.design == "each" and len(set(drawn.parameters["width"])) == len(SEEDS)

    there = ["--env", f"{mine}.py:Mine/Low-v0", "--seeds", "2", *SHORT]
    assert main(["evaluate", "lqr", *there]) == 0
    assert main(["compare", "--policy", f"{mine}.py:Full,zoo", *there]) == 0
    shown = capsys.readouterr().out
    assert "Full" in shown and "\nzoo" in shown and "trained: rodgym/PendulumSwingUp-v0" in shown
    assert main(["render", f"{mine}:Full", "strip.png", "--stills", "2", *there[:2], *SHORT]) == 0
    with pytest.raises(SystemExit):
        main(["evaluate", "lqr", "--env", f"{mine}.py:Mine/Other-v0"])
    assert "registers no environment 'Mine/Other-v0'" in capsys.readouterr().err


def test_an_environment_that_nobody_registered_is_named():
    for play in (lambda env: evaluate("zero", env, range(1)), lambda env: record("zero", env)):
        for env in ("Mine/Nowhere-v0", "rodgym/PendulumSwingUp-v7"):
            with pytest.raises(UnknownEnvError, match=f"no environment '{env}'"):
                play(env)


def test_what_an_own_environment_does_to_the_numbers_is_noticed(mine):
    with pytest.raises(ParameterError, match="behind RescaleAction"):
        evaluate("lqr", f"{mine}.py:Mine/Rescaled-v0", SEEDS)
    with pytest.raises(ParameterError, match="observations behind Mirror are not allowed"):
        evaluate("lqr", f"{mine}.py:Mine/Mirror-v0", SEEDS)
    with pytest.raises(ParameterError, match="observations behind Mirror are not allowed"):
        record("lqr", f"{mine}.py:Mine/Mirror-v0", 0)
    with pytest.raises(ParameterError, match=r"NormalizeObservation.*its statistics run on"):
        evaluate("zero", f"{mine}.py:Mine/Running-v0", SEEDS)
    with pytest.raises(PolicyError, match="such as RescaleAction"):
        evaluate("zoo", f"{mine}.py:Mine/Rescaled-v0", SEEDS)


def test_a_model_plays_in_the_wrapped_environment_that_it_was_trained_in(mine):
    rodgym._own.module_of(f"{mine}.py")
    venv = DummyVecEnv([lambda: gym.make("Mine/Rescaled-v0") for _ in range(4)])
    model = learn(venv, steps=64)
    result = evaluate(model, "Mine/Rescaled-v0", range(4))
    assert result.design == ""
    venv = make_monitored("Mine/Rescaled-v0", 4)
    assert sorted(result.columns["return"]) == pytest.approx(judged_by_sb3(model, venv), rel=1e-5)


def make_monitored(env_id, count):
    from stable_baselines3.common.env_util import make_vec_env as theirs

    return theirs(env_id, count)


def test_a_class_of_ones_own_plays(mine, capsys):
    env = gym.make(ENV)
    for name in ("Full", "Designed"):
        policy = load_policy(f"{mine}.py:{name}", env)
        assert type(policy).__name__ == name
    assert evaluate(f"{mine}.py:Designed", ENV, range(2)).mean("effort") == pytest.approx(0.05)
    for text, said in (
        (f"{mine}.py:Fuller", "has no 'Fuller'"),
        ("nowhere.py:Full", "no file 'nowhere.py'"),
        ("nowhere:Full", "no module 'nowhere'"),
        (f"{mine}.py:low", "has no predict"),
    ):
        assert main(["evaluate", text, "--seeds", "1"]) == 2
        assert said in capsys.readouterr().err


def test_a_policy_sees_rows_wherever_it_plays():
    class Rows:
        def predict(self, observation, state=None, episode_start=None, deterministic=False):
            shapes.append(observation.shape)
            assert episode_start.shape == (len(observation),)
            return np.zeros((len(observation), 1)), state

    shapes: list[tuple[int, ...]] = []
    evaluate(Rows(), ENV, range(3), env_kwargs={"max_episode_steps": 2})
    record(Rows(), ENV, 0, env_kwargs={"max_episode_steps": 2})
    assert shapes == [(3, 18)] * 2 + [(1, 18)] * 2
