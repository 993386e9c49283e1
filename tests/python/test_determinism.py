"""Promise: an environment's bits do not depend on its neighbours, on threads, or on being saved.

Environment i of any batch, on any number of threads, before and after a snapshot, visits the same
observations and rewards as the same seed alone.
"""

from __future__ import annotations

import hashlib
import pickle

import gymnasium as gym
import numpy as np
import pytest
from conftest import BALANCE, FINS, PENDULUMS, RANDOM, RANDOM_FIN, SWING_UP, assert_same

STEPS = 60
LONGEST = 1000
SEED = 100


def trajectory(env_id: str, num_envs: int, threads: int, steps: int = STEPS, **kwargs) -> list[str]:
    """One hash an environment over everything it returned; actions depend on its number only."""
    env = gym.make_vec(
        env_id, num_envs=num_envs, num_threads=threads, max_episode_steps=25, **kwargs
    )
    actions = np.stack(
        [np.random.default_rng(i).uniform(-1, 1, (steps, 1)) for i in range(num_envs)], axis=1
    ).astype(np.float32)
    hashes = [hashlib.sha256() for _ in range(num_envs)]
    observation, _ = env.reset(seed=SEED)
    for action in actions:
        for i, h in enumerate(hashes):
            h.update(observation[i].tobytes())
        observation, reward, terminated, truncated, _ = env.step(action)
        for i, h in enumerate(hashes):
            h.update(reward[i].tobytes() + terminated[i].tobytes() + truncated[i].tobytes())
    return [h.hexdigest() for h in hashes]


@pytest.mark.parametrize("env_id", PENDULUMS)
@pytest.mark.parametrize(
    "kwargs",
    [
        {},
        RANDOM,
        {"stepper": "implicit", "physics_dt": 1e-3},
        {"stepper": "esdirk3"},
        {"stepper": "bdf2"},
    ],
)
def test_batch_size_and_threads_change_nothing(env_id, kwargs):
    expected = trajectory(env_id, LONGEST, 2, **kwargs)
    assert len(set(expected)) == LONGEST
    for num_envs, threads in [(1, 1), (1, 2), (5, 1), (64, 1), (64, 2), (LONGEST, 1)]:
        got = trajectory(env_id, num_envs, threads, **kwargs)
        assert got == expected[:num_envs], (num_envs, threads)


@pytest.mark.parametrize("env_id", FINS)
@pytest.mark.parametrize("kwargs", [{}, RANDOM_FIN])
def test_batch_size_and_threads_change_nothing_for_fins(env_id, kwargs):
    expected = trajectory(env_id, 64, 2, 10, **kwargs)
    assert len(set(expected)) == 64
    for num_envs, threads in [(1, 1), (1, 2), (5, 1), (64, 1)]:
        got = trajectory(env_id, num_envs, threads, 10, **kwargs)
        assert got == expected[:num_envs], (num_envs, threads)


def test_threads_may_change_in_mid_episode(rng):
    one, two = (gym.make_vec(SWING_UP, num_envs=100, num_threads=1) for _ in range(2))
    one.reset(seed=0), two.reset(seed=0)
    for t in range(20):
        two.num_threads = 1 + t % 3
        action = rng.uniform(-1, 1, (100, 1)).astype(np.float32)
        assert_same(two.step(action), one.step(action))


@pytest.mark.parametrize("env_id", [SWING_UP, BALANCE, *FINS])
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_batch_snapshots_go_on_to_the_bit(env_id, mode, rng):
    random = RANDOM_FIN if env_id in FINS else RANDOM
    kwargs = {"autoreset_mode": mode, "max_episode_steps": 15, **random}
    env = gym.make_vec(env_id, num_envs=9, **kwargs)
    env.reset(seed=4)
    actions = rng.uniform(-1, 1, (60, 9, 1)).astype(np.float32)
    for action in actions[:20]:
        env.step(action)
    other = gym.make_vec(env_id, num_envs=9, **kwargs)
    other.set_state(env.get_state())
    # Environments in another order: a snapshot does not know its place.
    order = rng.permutation(9)
    shuffled = gym.make_vec(env_id, num_envs=9, **kwargs)
    shuffled.set_state(env.get_state(order))
    twin = pickle.loads(pickle.dumps(env))
    for action in actions[20:]:
        expected = env.step(action)
        assert_same(other.step(action), expected)
        assert_same(twin.step(action), expected)
        got = shuffled.step(action[order])
        for ours, theirs in zip(got[:4], expected[:4], strict=True):
            assert np.array_equal(ours, theirs[order])


def test_a_snapshot_moves_between_single_and_batch(rng):
    single = gym.make(SWING_UP, **RANDOM).unwrapped
    single.reset(seed=8)
    for action in rng.uniform(-1, 1, (10, 1)):
        single.step(action)
    batch = gym.make_vec(SWING_UP, num_envs=3, **RANDOM)
    batch.reset(seed=0)
    batch.set_state([single.get_state()], [1])
    for action in rng.uniform(-1, 1, (10, 1)):
        expected = single.step(action)
        got = batch.step(np.tile(action, (3, 1)))
        assert_same(got[0][1], expected[0])
        assert got[1][1] == expected[1]
