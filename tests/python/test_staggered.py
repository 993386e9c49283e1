"""A staggered batch is in all phases of an episode at once; beyond the first, its episodes are as
ever."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import rodgym.sb3
from conftest import SWING_UP, assert_same
from rodgym.training import Staggered


def test_environments_begin_at_different_times_of_an_episode(rng: np.random.Generator) -> None:
    kwargs = {"max_episode_steps": 8, "seed": 3, "randomize": {"width": (0.006, 0.009)}}
    plain = rodgym.sb3.make_vec_env(SWING_UP, 4, **kwargs)
    env = Staggered(rodgym.sb3.make_vec_env(SWING_UP, 4, **kwargs))
    shown = env.reset()
    # What a batch shows that does nothing for 0, 2, 4 and 6 steps.
    seen = [plain.reset(), *(plain.step(np.zeros((4, 1)))[0] for _ in range(6))]
    assert_same(shown, np.array([seen[2 * i][i] for i in range(4)]))
    lengths: list[list[int]] = [[] for _ in range(4)]
    for t in range(1, 17):
        _, _, dones, infos = env.step(rng.uniform(-1, 1, (4, 1)))
        for i in np.flatnonzero(dones):
            lengths[i].append(t)
            assert infos[i]["TimeLimit.truncated"]
    # At every second step another one ends, and each lasts eight steps.
    assert lengths == [[8, 16], [6, 14], [4, 12], [2, 10]]


def test_a_staggered_batch_is_the_same_for_the_same_seed(rng: np.random.Generator) -> None:
    first, second = (
        Staggered(rodgym.sb3.make_vec_env(SWING_UP, 3, 5, max_episode_steps=9)) for _ in range(2)
    )
    assert_same(first.reset(), second.reset())
    for _ in range(20):
        action = rng.uniform(-1, 1, (3, 1))
        assert_same(first.step(action)[:3], second.step(action)[:3])
