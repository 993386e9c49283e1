"""Promise: the single environments are ordinary Gymnasium environments, without a warning."""

from __future__ import annotations

import copy
import json
import pickle
import warnings

import gymnasium as gym
import numpy as np
import pytest
import rodgym
from conftest import (
    BALANCE,
    FINS,
    PENDULUMS,
    RANDOM,
    RANDOM_FIN,
    SWING_UP,
    actions_for,
    assert_same,
)
from gymnasium.utils.env_checker import check_env

IDS = list(rodgym.ENVIRONMENTS)


@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.parametrize("render_mode", [None, "rgb_array"])
def test_gymnasium_has_nothing_to_say(env_id, render_mode, recwarn):
    warnings.simplefilter("always")
    check_env(gym.make(env_id, render_mode=render_mode).unwrapped, skip_render_check=False)
    assert [str(w.message) for w in recwarn] == []


@pytest.mark.parametrize("env_id", IDS)
def test_stable_baselines_has_nothing_to_say(env_id, recwarn):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    warnings.simplefilter("always")
    checker.check_env(gym.make(env_id), warn=True, skip_render_check=True)
    assert [str(w.message) for w in recwarn] == []


@pytest.mark.parametrize("env_id", IDS)
def test_registered_limits_are_those_of_the_core(env_id):
    env = gym.make(env_id)
    about = env.unwrapped._batch.spec
    assert env.spec.max_episode_steps == about["default_max_episode_steps"]
    assert about["id"] == env_id
    assert {row["id"] for row in rodgym._native.catalog()} == set(IDS)


@pytest.mark.parametrize("env_id", IDS)
def test_observations_have_finite_bounds_and_names(env_id):
    env = gym.make(env_id)
    space = env.observation_space
    assert np.isfinite(space.low).all() and np.isfinite(space.high).all()
    assert len(env.unwrapped._batch.spec["observation"]["names"]) == space.shape[0]
    assert env.action_space == gym.spaces.Box(-1.0, 1.0, (1,), np.float32)


def test_the_module_prefix_imports_the_package():
    env = gym.make("rodgym:rodgym/PendulumSwingUp-v0", width=0.0081)
    _, info = env.reset(seed=0)
    assert info["parameters"]["width"] == 0.0081
    assert isinstance(env.unwrapped, rodgym.envs.PendulumEnv)


@pytest.mark.parametrize("env_id", IDS)
def test_reward_is_the_sum_of_its_terms(env_id, rng):
    env = gym.make(env_id)
    env.reset(seed=1)
    for action in actions_for(rng, 50, 1)[:, 0]:
        _, reward, _, _, info = env.step(action)
        assert reward == pytest.approx(sum(info["reward_terms"].values()), abs=1e-12)
        assert info["parameters"] == env.unwrapped.parameters


def test_no_time_limit_inside_and_stepping_goes_on(rng):
    env = gym.make(SWING_UP).unwrapped
    env.reset(seed=0)
    for action in actions_for(rng, 600, 1)[:, 0]:
        *_, truncated, info = env.step(action)
        assert not truncated and not info["solver_failure"]
    env = gym.make(BALANCE).unwrapped
    env.reset(seed=0)
    terminated = [env.step([1.0])[2] for _ in range(300)]
    assert terminated[-1] and not terminated[0]


def test_a_seed_says_everything(rng):
    actions = actions_for(rng, 30, 1)[:, 0]

    def run(env):
        results = [env.reset(seed=42), *(env.step(a) for a in actions), env.reset()]
        return [*results, *(env.step(a) for a in actions)]

    env = gym.make(SWING_UP, **RANDOM)
    first = run(env)
    assert_same(run(env), first)
    assert_same(run(gym.make(SWING_UP, **RANDOM)), first)
    assert not np.array_equal(first[0][0], first[31][0]), "an unseeded reset draws anew"


def test_numpy_is_asked_only_for_a_first_seed():
    env = gym.make(SWING_UP).unwrapped
    env.reset(seed=3)
    before = env.np_random.bit_generator.state
    env.reset()
    env.step([0.5])
    assert env.np_random.bit_generator.state == before
    one, two = (gym.make(SWING_UP).unwrapped for _ in range(2))
    one.np_random, two.np_random = np.random.default_rng(5), np.random.default_rng(5)
    assert_same(one.reset(), two.reset())
    fresh = gym.make(SWING_UP).unwrapped.reset()[0]
    assert not np.array_equal(fresh, gym.make(SWING_UP).unwrapped.reset()[0])


@pytest.mark.parametrize("env_id", [*PENDULUMS, *FINS])
def test_snapshots_pickles_and_copies_go_on_to_the_bit(env_id, rng):
    random = RANDOM_FIN if env_id in FINS else RANDOM
    env = gym.make(env_id, **random)
    env.reset(seed=9)
    actions = actions_for(rng, 40, 1)[:, 0]
    for action in actions[:20]:
        last = env.step(action)
    state = env.unwrapped.get_state()
    other = gym.make(env_id, **random).unwrapped
    assert_same(other.set_state(state), last[0])
    assert other.get_state() == state
    twins = [pickle.loads(pickle.dumps(env)), copy.deepcopy(env)]
    expected = [*(env.step(a) for a in actions[20:]), env.reset(), env.step(actions[0])]
    for twin in [other, *twins]:
        got = [*(twin.step(a) for a in actions[20:]), twin.reset(), twin.step(actions[0])]
        assert_same(got, expected)
    env.unwrapped.set_state(state)
    assert_same([env.step(a) for a in actions[20:]], expected[:20])


def test_copies_before_the_first_reset():
    env = gym.make(SWING_UP)
    twin = pickle.loads(pickle.dumps(env))
    assert_same(twin.reset(seed=1), env.reset(seed=1))


def test_spec_is_json_and_makes_the_same_environment_again():
    env = gym.make(
        SWING_UP, width=np.float64(0.008), randomize={"density": np.array([1400.0, 1600.0])}
    )
    json.loads(env.spec.to_json())
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert_same(again.reset(seed=5), env.reset(seed=5))


def test_exact_start_and_parameters():
    env = gym.make(SWING_UP)
    angles = [3.0] * 6
    observation, info = env.reset(
        seed=0,
        options={"parameters": {"width": 0.009}, "state": {"angles": angles, "rates": [0.0] * 6}},
    )
    assert info["parameters"]["width"] == 0.009
    assert observation[:6] == pytest.approx(np.cos(angles), abs=1e-6)
    assert env.unwrapped.parameters["width"] == 0.009
    _, info = env.reset()
    assert info["parameters"]["width"] == 0.007


def test_the_environment_shows_its_machine():
    env = gym.make(SWING_UP, nodes=13).unwrapped
    env.reset(seed=0)
    assert env.positions.shape == env.velocities.shape == (13, 2)
    assert env.config["nodes"] == 13
    assert env.control_dt == 0.01 and env.physics_dt <= 5e-4
    scene = env.scene()
    assert scene["machine"] == "pendulum" and len(scene["nodes"]) == 13
    assert np.array_equal(scene["nodes"], env.positions)


def keys_of(info):
    """Keys at every level."""
    return {key: keys_of(value) if isinstance(value, dict) else None for key, value in info.items()}


@pytest.mark.parametrize("env_id", IDS)
def test_an_info_has_the_same_keys_at_reset_and_step(env_id):
    """Recorders (Minari, TorchRL) take the first info for the form of all."""
    env = gym.make(env_id)
    _, first = env.reset(seed=0)
    *_, info = env.step(env.action_space.sample())
    assert keys_of(info) == keys_of(first)
    about = env.unwrapped.core_spec
    assert {*about["metrics"], "parameters", "reward_terms", "solver_failure"} == first.keys()
    # Before any step nothing was earned, and nothing measured.
    assert set(first["reward_terms"].values()) == {0.0}
    assert all(np.isnan(first[name]) for name in about["metrics"])
    assert first["solver_failure"] is info["solver_failure"] is False
    assert info["parameters"] == first["parameters"] == env.unwrapped.parameters
    # It is the caller's own.
    info["parameters"].clear()
    assert env.step(env.action_space.sample())[4]["parameters"] == first["parameters"]
    for mode in ("NextStep", "SameStep", "Disabled"):
        batch = gym.make_vec(env_id, num_envs=2, autoreset_mode=mode, max_episode_steps=2)
        _, first = batch.reset(seed=0)
        for _ in range(3 if mode != "Disabled" else 2):
            *_, infos = batch.step(batch.action_space.sample())
            ended = {"final_obs", "_final_obs", "final_info", "_final_info"}
            assert keys_of({k: v for k, v in infos.items() if k not in ended}) == keys_of(first)


def test_the_parameters_of_an_info_follow_a_state_that_is_set():
    kwargs = {"randomize": {"width": (0.006, 0.009)}}
    env, batch = gym.make(SWING_UP, **kwargs), gym.make_vec(SWING_UP, num_envs=2, **kwargs)
    _, first = env.reset(seed=1)
    state = env.unwrapped.get_state()
    env.reset(seed=2)
    env.unwrapped.set_state(state)
    assert env.step([0.0])[4]["parameters"] == first["parameters"]
    for put in (
        lambda: batch.unwrapped.set_state([state], [1]),
        lambda: batch.unwrapped.members[1].set_state(state),
    ):
        batch.reset(seed=5)
        before = batch.unwrapped.members[0].parameters["width"]
        put()
        *_, infos = batch.step(np.zeros((2, 1)))
        assert infos["parameters"]["width"].tolist() == [before, first["parameters"]["width"]]
