"""Promise: the native `VecEnv` returns what `DummyVecEnv` over single environments returns."""

from __future__ import annotations

import copy
import pickle
import warnings

import gymnasium as gym
import numpy as np
import pytest
from conftest import BALANCE, RANDOM, SWING_UP, actions_for, assert_same

sb3 = pytest.importorskip("stable_baselines3")

from rodgym import errors  # noqa: E402
from rodgym.sb3 import RodVecEnv, make_vec_env  # noqa: E402
from stable_baselines3.common import env_util  # noqa: E402
from stable_baselines3.common.monitor import Monitor, load_results  # noqa: E402
from stable_baselines3.common.vec_env import (  # noqa: E402
    DummyVecEnv,
    VecEnv,
    VecMonitor,
    VecNormalize,
)

N = 5


def pair(env_id: str, steps: int | None, **kwargs) -> tuple[VecEnv, DummyVecEnv]:
    ours = make_vec_env(env_id, N, monitor=False, max_episode_steps=steps, **kwargs)
    oracle = DummyVecEnv([lambda: gym.make(env_id, max_episode_steps=steps, **kwargs)] * N)
    return ours, oracle


@pytest.mark.parametrize(
    ("env_id", "kwargs", "steps"),
    [(SWING_UP, {}, 19), (SWING_UP, RANDOM, 19), (BALANCE, RANDOM, 80), (BALANCE, {}, None)],
)
def test_equals_dummy_vec_env(env_id, kwargs, steps, rng):
    ours, oracle = pair(env_id, steps, **kwargs)
    assert ours.observation_space == oracle.observation_space
    assert ours.action_space == oracle.action_space
    assert ours.seed(21) == oracle.seed(21)
    assert_same(ours.reset(), oracle.reset())
    assert_same(ours.reset_infos, oracle.reset_infos)
    ends = 0
    for t, action in enumerate(actions_for(rng, 150, N)):
        got = ours.step(action)
        assert_same(got, oracle.step(action), f"step {t}")
        assert_same(ours.reset_infos, oracle.reset_infos)
        ends += int(got[2].sum())
    assert ends > N
    assert_same(ours.reset(), oracle.reset())


def test_time_limit_and_fall_are_told_apart():
    env = make_vec_env(BALANCE, 2, max_episode_steps=5, monitor=False)
    env.seed(0)
    env.reset()
    for _ in range(5):
        _, _, dones, infos = env.step(np.zeros((2, 1)))
    assert dones.all() and all(info["TimeLimit.truncated"] for info in infos)
    env = make_vec_env(BALANCE, 2, monitor=False)
    env.seed(0)
    env.reset()
    for _ in range(1000):
        _, _, dones, infos = env.step(np.ones((2, 1)))
        if dones.any():
            break
    ended = infos[int(np.argmax(dones))]
    assert dones.any() and ended["TimeLimit.truncated"] is False
    assert ended["terminal_observation"].shape == env.observation_space.shape


def test_options_are_used_once():
    ours, oracle = pair(SWING_UP, None)
    options = [{"parameters": {"width": 0.0075 + 1e-4 * (i % 2)}} for i in range(N)]
    options[3] = {}
    for env in (ours, oracle):
        env.seed(4)
        env.set_options(options)
    assert_same(ours.reset(), oracle.reset())
    assert_same(ours.reset_infos, oracle.reset_infos)
    assert [info["parameters"]["width"] for info in ours.reset_infos[:4]] == [
        0.0075,
        0.0076,
        0.0075,
        0.007,
    ]
    assert_same(ours.reset(), oracle.reset())
    for env in (ours, oracle):
        env.set_options({"parameters": {"width": 0.0081}})
    assert_same(ours.reset(), oracle.reset())
    assert {info["parameters"]["width"] for info in ours.reset_infos} == {0.0081}


def test_attributes_and_methods_reach_each_environment():
    env = make_vec_env(SWING_UP, 3, seed=0)
    env.reset()
    states = env.env_method("get_state")
    assert len(set(states)) == 3 and all(isinstance(state, bytes) for state in states)
    env.step(np.ones((3, 1)))
    env.env_method("set_state", states[1], indices=[0, 2])
    assert env.env_method("get_state", indices=[0, 2]) == [states[1]] * 2
    assert [w["width"] for w in env.get_attr("parameters", indices=1)] == [0.007]
    env.set_attr("render_mode", "rgb_array", indices=[1])
    assert env.get_attr("render_mode") == [None, "rgb_array", None]
    env.set_attr("render_mode", None)
    assert env.has_attr("positions") and not env.has_attr("wings")
    assert env.env_is_wrapped(Monitor) == [False] * 3
    assert env.get_attr("render_mode") == [None] * 3
    with pytest.raises(AttributeError, match="wings"):
        env.get_attr("wings")


@pytest.mark.parametrize("steps", [None, 7, -1])
def test_each_environment_has_the_spec_that_gym_make_gives_it(steps):
    kwargs = {"width": 0.0081, "randomize": {"density": (1400.0, 1500.0)}}
    ours, oracle = pair(SWING_UP, steps, render_mode="rgb_array", **kwargs)
    assert ours.get_attr("spec") == oracle.get_attr("spec")
    spec = ours.get_attr("spec", indices=1)[0]
    # JSON writes tuples as lists; the environment is the same.
    again = gym.make(gym.envs.registration.EnvSpec.from_json(spec.to_json()))
    assert again.unwrapped.config == ours.get_attr("config")[0]
    again.reset(seed=3)
    ours.seed(3)
    ours.reset()
    assert again.unwrapped.get_state() == ours.env_method("get_state", indices=0)[0]
    for name in ("metadata", "render_mode", "observation_space", "action_space", "control_dt"):
        assert ours.has_attr(name) and oracle.has_attr(name)
        assert ours.get_attr(name) == oracle.get_attr(name)
    assert ours.get_attr("unwrapped") == ours.members


@pytest.mark.parametrize("monitor", [True, False])
@pytest.mark.parametrize("twin_of", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_pickled_or_copied_batch_goes_on_to_the_bit(monitor, twin_of, rng, tmp_path):
    path = str(tmp_path) if monitor else None
    env = make_vec_env(
        SWING_UP, N, seed=5, monitor=monitor, monitor_dir=path, max_episode_steps=9, **RANDOM
    )
    fresh = twin_of(env)
    assert_same(fresh.reset(), env.reset())
    actions = actions_for(rng, 40, N)
    for action in actions[:13]:
        env.step(action)
    twin = twin_of(env)
    assert twin.get_attr("spec") == env.get_attr("spec")

    def timeless(step):
        for info in step[3]:
            info.get("episode", {}).pop("t", None)
        return step

    for t, action in enumerate(actions[13:]):
        assert_same(timeless(twin.step(action)), timeless(env.step(action)), f"step {t}")
    assert_same(twin.reset_infos, env.reset_infos)
    if monitor:
        assert_same(twin.episode_returns, env.episode_returns)
        env.close()
        # Only the first one writes: two headers and four episodes of each environment.
        assert len((tmp_path / "0.monitor.csv").read_text().splitlines()) == 2 + 4 * N


def test_bad_arguments_are_refused_and_change_nothing():
    env = make_vec_env(SWING_UP, 2, seed=0, monitor=False)
    env.reset()
    before = env.env_method("get_state")
    for call, error, named in [
        (lambda: env.seed("x"), errors.ParameterError, "seed = 'x'"),
        (lambda: env.set_options([]), errors.ShapeError, "0 options were given for 2"),
        (lambda: env.set_options(3), errors.ParameterError, "options = 3"),
        (lambda: env.set_options([{}, 3]), errors.ParameterError, "options = 3"),
        (lambda: env.get_attr("config", indices=7), errors.EnvIndexError, "environment 7"),
        (lambda: env.env_method("set_state", None), errors.ParameterError, "state = None"),
        (lambda: env.step("x"), errors.ShapeError, "'x'"),
        (lambda: make_vec_env(3), errors.ParameterError, "env_id = 3"),
        (lambda: make_vec_env(SWING_UP, env_kwargs=3), errors.ParameterError, "env_kwargs = 3"),
    ]:
        with pytest.raises(error, match=named):
            call()
        assert env.env_method("get_state") == before


def test_monitor_counts_returns(tmp_path):
    env = make_vec_env(SWING_UP, 2, seed=0, monitor_dir=str(tmp_path / "run"), max_episode_steps=7)
    assert isinstance(env, VecMonitor) and isinstance(env.unwrapped, RodVecEnv)
    env.reset()
    total = np.zeros(2)
    for _ in range(7):
        _, rewards, _, infos = env.step(np.zeros((2, 1)))
        total += rewards
    assert [info["episode"]["l"] for info in infos] == [7, 7]
    assert [info["episode"]["r"] for info in infos] == pytest.approx(total, abs=1e-4)
    env.close()
    # A folder that Stable-Baselines3 reads.
    assert load_results(str(tmp_path / "run"))["l"].tolist() == [7, 7]


class Smaller(gym.Wrapper):
    """Rewards times `factor`."""

    def __init__(self, env, factor=0.5):
        super().__init__(env)
        self.factor = factor

    def step(self, action):
        observation, reward, *rest = self.env.step(action)
        return observation, self.factor * reward, *rest


@pytest.mark.parametrize("native", [True, False])
def test_the_arguments_of_stable_baselines3_are_taken_by_place(native, tmp_path):
    """`make_vec_env(env_id, n_envs, seed, start_index, monitor_dir, wrapper_class, ...)`."""
    wrapped = (None, None) if native else (Smaller, {"factor": 0.25})
    given = (SWING_UP, 2, 5, 3, str(tmp_path / "x"), wrapped[0], {"width": 0.0081}, None, None)
    keywords = {"monitor_kwargs": {"info_keywords": ("tip_height",)}, "wrapper_kwargs": wrapped[1]}
    ours = make_vec_env(*given, **keywords, max_episode_steps=6)
    theirs = env_util.make_vec_env(
        SWING_UP, 2, 5, 3, str(tmp_path / "y"), wrapped[0],
        {"width": 0.0081, "max_episode_steps": 6}, None, None, **keywords,
    )  # fmt: skip
    assert isinstance(ours.unwrapped, RodVecEnv if native else DummyVecEnv)
    assert_same(ours.reset(), theirs.reset())
    assert ours.action_space.sample() == theirs.action_space.sample()
    for _ in range(6):
        ours_step, their_step = ours.step(np.ones((2, 1))), theirs.step(np.ones((2, 1)))
        for mine, other in zip(ours_step, their_step, strict=True):
            if isinstance(mine, np.ndarray):
                assert mine == pytest.approx(other, abs=1e-6)
    ours.close(), theirs.close()
    mine, other = (load_results(str(tmp_path / name)) for name in "xy")
    assert mine["tip_height"].tolist() == pytest.approx(other["tip_height"].tolist(), abs=1e-6)
    assert mine["r"].tolist() == pytest.approx(other["r"].tolist(), abs=1e-4)
    assert (tmp_path / "x/3.monitor.csv").is_file()


def test_environments_are_named_as_for_gym_make_or_made_by_a_function():
    named = make_vec_env(f"rodgym:{SWING_UP}", 2, seed=3)
    made = make_vec_env(lambda **kwargs: gym.make(SWING_UP, **kwargs), 2, seed=3)
    asked = make_vec_env(SWING_UP, 2, seed=3, vec_env_cls=DummyVecEnv)
    assert isinstance(asked.unwrapped, DummyVecEnv)
    observation = named.reset()
    assert_same(made.reset(), observation)
    assert_same(asked.reset(), observation)
    threads = make_vec_env(SWING_UP, 2, vec_env_kwargs={"num_threads": 1})
    assert isinstance(threads.unwrapped, RodVecEnv)
    for keywords, named in [
        ({"wrapper_kwargs": {"factor": 2}}, "needs a wrapper_class"),
        ({"monitor_kwargs": {"allow_early_resets": False}}, "allow_early_resets = False"),
        ({"monitor_kwargs": {"speed": 1}}, "speed = 1"),
        ({"vec_env_cls": DummyVecEnv, "server": "tcp://x:1"}, "server = 'tcp://x:1'"),
    ]:
        with pytest.raises(errors.ParameterError, match=named):
            make_vec_env(SWING_UP, 2, **keywords)
    with pytest.raises(errors.ParameterError, match="module 'nowhere' is not found"):
        make_vec_env(f"nowhere:{SWING_UP}")


def test_learning_and_prediction_run_without_a_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = VecNormalize(make_vec_env(SWING_UP, 4, seed=0, max_episode_steps=16))
        model = sb3.PPO("MlpPolicy", env, n_steps=32, batch_size=64, n_epochs=1, device="cpu")
        model.learn(256)
        assert len(model.ep_info_buffer) == 8 * 2
        action, _ = model.predict(env.reset(), deterministic=True)
        assert action.shape == (4, 1)


def test_pictures():
    env = make_vec_env(SWING_UP, 3, seed=0, render_mode="rgb_array", render_size=(64, 48))
    env.reset()
    images = env.get_images()
    assert [image.shape for image in images] == [(48, 64, 3)] * 3
    assert env.render().shape == (96, 128, 3)
    assert make_vec_env(SWING_UP, 2, monitor=False).get_images() == [None, None]


def test_the_parameters_of_an_info_follow_a_state_that_is_set():
    kwargs = {"randomize": {"width": (0.006, 0.009)}}
    env, other = (RodVecEnv(SWING_UP, 2, **kwargs) for _ in range(2))
    env.seed(1), env.reset(), other.seed(7), other.reset()
    (state,) = other.env_method("get_state", indices=1)
    env.env_method("set_state", state, indices=1)
    infos = env.step(np.zeros((2, 1), np.float32))[3]
    widths = [info["parameters"]["width"] for info in infos]
    assert widths == [
        env.reset_infos[0]["parameters"]["width"],
        other.members[1].parameters["width"],
    ]
