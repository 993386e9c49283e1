"""Promise: rewards and observations of one's own run on the native batch: they see the state that
the step ended in, in every autoreset mode, and change nothing else."""

from __future__ import annotations

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
import rodgym
import rodgym.own_task
from conftest import SWING_UP, assert_same
from gymnasium.utils.env_checker import check_env
from rodgym.errors import ParameterError, ShapeError
from rodgym.own_task import State


def same_reward(state: State) -> dict[str, np.ndarray]:
    """The environment's own terms."""
    return dict(state.terms)


def same_observation(state: State) -> np.ndarray:
    return state.observation


def tip(state: State) -> np.ndarray:
    """Position and velocity of the tip."""
    return np.concatenate([state.positions[:, -1], state.velocities[:, -1]], axis=1)


def tip_reward(state: State) -> np.ndarray:
    return state.positions[:, -1, 1] / state.parameters["length"] - 0.1 * state.actions[:, 0] ** 2


#: Bounds by attribute.
tip.low, tip.high = -10.0, [10.0, 10.0, 10.0, 10.0]
OWN = {"reward": same_reward, "observation": same_observation}


def make(mode: str, **kwargs):
    envs = gym.make_vec(SWING_UP, num_envs=5, autoreset_mode=mode, max_episode_steps=7, **kwargs)
    return envs, envs.reset(seed=3)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_functions_that_return_the_environments_own_numbers_change_no_bit(mode):
    plain, first = make(mode, randomize={"width": (0.006, 0.009)})
    own, also_first = make(mode, randomize={"width": (0.006, 0.009)}, **OWN)
    assert_same(first, also_first)
    rng = np.random.default_rng(0)
    for _ in range(20):
        actions = rng.uniform(-1.2, 1.2, (5, 1))
        for a, b in zip(plain.step(actions), own.step(actions), strict=True):
            assert_same(a, b)
    assert_same(np.array([plain.call("width")]), np.array([own.call("width")]))


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_function_sees_the_state_in_which_the_step_ended(mode):
    """The same rods one by one, whose nodes can be asked for after each step."""
    own, _ = make(mode, reward=tip_reward, observation=tip)
    singles = [gym.make(SWING_UP, max_episode_steps=-1).unwrapped for _ in range(5)]
    for i, env in enumerate(singles):
        env.reset(seed=3 + i)
    rng = np.random.default_rng(1)
    for step in range(1, 8):
        actions = rng.uniform(-1, 1, (5, 1))
        observations, rewards, _, truncated, infos = own.step(actions)
        for env, action in zip(singles, actions, strict=True):
            env.step(action)
        seen = np.array([[*env.positions[-1], *env.velocities[-1]] for env in singles], np.float32)
        heights = np.array([env.positions[-1][1] for env in singles]) / 0.3
        paid = heights - 0.1 * actions[:, 0] ** 2
        np.testing.assert_allclose(rewards, paid, atol=1e-12)
        assert truncated.all() == (step == 7)
        if mode == "SameStep" and step == 7:
            np.testing.assert_array_equal(np.stack(list(infos["final_obs"])), seen)
            begun = np.array([[*m.positions[-1], *m.velocities[-1]] for m in own.members])
            np.testing.assert_array_equal(observations, begun.astype(np.float32))
            np.testing.assert_array_equal(observations[:, 2:], 0.0)
        else:
            np.testing.assert_array_equal(observations, seen)
    if mode == "NextStep":
        observations, rewards, *_ = own.step(actions)
        np.testing.assert_array_equal(rewards, 0.0)
        np.testing.assert_array_equal(observations[:, 2:], 0.0)


def test_disabled_mode_resets_by_mask():
    own, _ = make("Disabled", observation=tip)
    for _ in range(7):
        last, *_ = own.step(np.ones((5, 1)))
    mask = np.array([True, False, True, False, False])
    observations, _ = own.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(observations[~mask], last[~mask])
    np.testing.assert_array_equal(observations[mask][:, 2:], 0.0)


def test_a_single_environment_takes_the_same_functions():
    env = gym.make(SWING_UP, reward=tip_reward, observation=tip)
    check_env(env.unwrapped, skip_render_check=True)
    batch = gym.make_vec(SWING_UP, num_envs=2, reward=tip_reward, observation=tip)
    assert_same(env.reset(seed=7)[0], batch.reset(seed=7)[0][0])
    alone, together = env.step([0.3]), batch.step(np.full((2, 1), 0.3))
    assert_same(alone[0], together[0][0])
    assert alone[1] == together[1][0]
    assert alone[4]["reward_terms"] == {"reward": alone[1]}


def test_spaces_terms_snapshots_and_copies():
    def parts(state: State) -> dict[str, np.ndarray]:
        return {
            "up": state.metrics["tip_height"],
            "calm": -0.1 * np.abs(state.velocities).mean((1, 2)),
        }

    envs = gym.make_vec(SWING_UP, num_envs=3, reward=parts, observation=tip, copy=False)
    assert envs.single_observation_space.shape == (4,)
    assert envs.single_observation_space.high[0] == 10.0
    envs.reset(seed=0)
    _, rewards, _, _, infos = envs.step(np.ones((3, 1)))
    assert {k for k in infos["reward_terms"] if not k.startswith("_")} == {"up", "calm"}
    np.testing.assert_allclose(
        infos["reward_terms"]["up"] + infos["reward_terms"]["calm"], rewards, atol=1e-12
    )
    states = envs.get_state()
    first = envs.step(np.ones((3, 1)))[1].copy()
    np.testing.assert_array_equal(
        envs.set_state(states)[:, :2], [m.positions[-1].astype("f4") for m in envs.members]
    )
    np.testing.assert_array_equal(envs.step(np.ones((3, 1)))[1], first)
    picklable = gym.make_vec(SWING_UP, num_envs=2, reward=tip_reward)
    picklable.reset(seed=0)
    for twin in (pickle.loads(pickle.dumps(picklable)), copy.deepcopy(picklable)):
        np.testing.assert_array_equal(
            twin.step(np.ones((2, 1)))[1], copy.deepcopy(picklable).step(np.ones((2, 1)))[1]
        )


def test_stable_baselines_learns_on_it():
    sb3 = pytest.importorskip("rodgym.sb3")
    from stable_baselines3 import PPO

    envs = sb3.make_vec_env(
        SWING_UP, n_envs=4, seed=0, reward=tip_reward, observation=tip, max_episode_steps=5
    )
    envs.reset()
    for _ in range(5):
        observations, _, dones, infos = envs.step(np.ones((4, 1)))
    assert dones.all() and infos[0]["terminal_observation"].shape == (4,)
    assert np.abs(infos[0]["terminal_observation"][2:]).max() > 0 and observations[0, 2] == 0
    PPO("MlpPolicy", envs, n_steps=8, batch_size=16, n_epochs=1).learn(64)


@pytest.mark.parametrize(
    ("keywords", "error", "words"),
    [
        ({"reward": 3}, ParameterError, "reward = 3 .* must be a function"),
        ({"reward": lambda state: 1.0}, ShapeError, r"shape \(\), but \(2,\) is needed"),
        ({"reward": lambda state: {"a": np.zeros(1)}}, ShapeError, "returned a of shape"),
        ({"observation": lambda state: state.positions}, ShapeError, r"\(2, k\) is needed"),
    ],
)
def test_a_function_of_the_wrong_kind_is_refused_when_the_batch_is_made(keywords, error, words):
    for maker in (
        lambda: gym.make_vec(SWING_UP, num_envs=3, **keywords),
        lambda: gym.make(SWING_UP, **keywords),
    ):
        with pytest.raises(error, match=words):
            maker()


def test_derivatives_are_refused():
    envs = gym.make_vec(SWING_UP, num_envs=2, reward=tip_reward)
    envs.reset(seed=0)
    with pytest.raises(ParameterError, match="derivatives"):
        envs.step_jacobian(np.zeros((2, 1)))
    with pytest.raises(ParameterError, match="derivatives"):
        envs.rollout_gradient(np.zeros((2, 3, 1)))
    env = gym.make(SWING_UP, reward=tip_reward)
    env.reset(seed=0)
    with pytest.raises(ParameterError, match="derivatives"):
        rodgym.optimize(env, starts=1, time_limit=1.0)


def test_the_other_environments_take_functions_too():
    for env_id in rodgym.ENVIRONMENTS:
        envs = gym.make_vec(
            env_id, num_envs=2, reward=lambda s: s.positions[:, -1, 1], observation=tip
        )
        envs.reset(seed=0)
        assert envs.step(np.zeros((2, 1)))[0].shape == (2, 4)


def test_an_environment_with_an_id_of_ones_own_is_a_native_batch_for_stable_baselines3():
    """It was an unknown environment, so that nobody could train on it."""
    pytest.importorskip("stable_baselines3")
    import rodgym.sb3

    gym.register(
        "OwnTask/Spin-v0",
        entry_point="rodgym.envs:PendulumEnv",
        max_episode_steps=20,
        kwargs={
            "env_id": "rodgym/PendulumSwingUp-v0",
            "reward": lambda state: np.tanh(state.observation[:, 12]),
            "width": 0.008,
        },
    )
    try:
        batch = rodgym.sb3.make_vec_env("OwnTask/Spin-v0", n_envs=2, seed=0)
        single = gym.make("OwnTask/Spin-v0")
        assert (batch.reset()[0] == single.reset(seed=0)[0]).all()
        for _ in range(20):
            _, rewards, dones, _ = batch.step(np.full((2, 1), 0.3, np.float32))
            _, reward, _, truncated, _ = single.step([0.3])
            assert rewards[0] == np.float32(reward)
            assert dones[0] == truncated
        assert truncated
    finally:
        del gym.registry["OwnTask/Spin-v0"]
