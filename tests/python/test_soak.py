"""Promise: a million random steps at full torque bring no NaN, no panic and no growth of memory."""

from __future__ import annotations

import gc
import os
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from conftest import PENDULUMS, RANDOM, SWING_UP

STATUS = Path("/proc/self/statm")


def resident() -> int:
    """Memory of this process in bytes."""
    if not STATUS.exists():
        pytest.skip("the size of a process is read from Linux' /proc")
    return int(STATUS.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.parametrize("env_id", PENDULUMS)
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_million_random_steps(env_id, mode, rng):
    num_envs, steps = 1000, 1000
    env = gym.make_vec(env_id, num_envs=num_envs, autoreset_mode=mode, **RANDOM)
    space = env.single_observation_space
    env.reset(seed=0)
    for t in range(steps):
        if t == 200:
            gc.collect()
            before = resident()
        # Full torque in changing directions is what pumps most energy into the rod.
        action = rng.choice([-1.0, 1.0], size=(num_envs, 1)).astype(np.float32)
        observation, reward, *_, infos = env.step(action)
        assert np.isfinite(reward).all()
        assert ((observation >= space.low) & (observation <= space.high)).all()
        assert not infos["solver_failure"].any()
    gc.collect()
    assert resident() - before < 8e6


def test_single_steps_and_snapshots_do_not_leak(rng):
    env = gym.make(SWING_UP, render_mode="rgb_array", render_size=(64, 64)).unwrapped
    env.reset(seed=0)
    for t in range(20_000):
        if t == 5_000:
            gc.collect()
            before = resident()
        env.step(rng.uniform(-1, 1, 1))
        if t % 10 == 0:
            env.set_state(env.get_state())
            env.reset()
        if t % 500 == 0:
            env.render()
    gc.collect()
    assert resident() - before < 4e6
