"""Promise: `rodgym.optimize` finds what it says, within its limits, and leaves the environment
alone; the best known actions return what is kept, to the last digit.
"""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
import rodgym
from conftest import BALANCE, SWING_UP
from rodgym.cli import main
from rodgym.errors import ParameterError, ShapeError
from rodgym.optimal import Quadratic, kept, replay

STEPS = 60


@pytest.fixture
def env():
    env = gym.make(SWING_UP)
    env.reset(seed=2000)
    return env


def played(env, actions):
    return float(np.sum([env.step(action)[1] for action in actions]))


def test_it_earns_what_it_says_and_more_than_the_regulator(env):
    before = env.unwrapped.get_state()
    seen = []
    found = rodgym.optimize(env, STEPS, progress=lambda start, at: seen.append((start, at)))
    assert env.unwrapped.get_state() == before
    assert found.actions.shape == (STEPS, 1) and found.actions.dtype == np.float32
    assert found.best.done and [one.done for one in found.attempts] == [True, True]
    assert {start for start, _ in seen} == {0, 1}
    assert seen[-1][1]["horizon"] == STEPS and seen[-1][1]["done"]
    law, state = rodgym.baselines.Lqr.for_env(env), None
    other = gym.make(SWING_UP)
    observation, _ = other.reset(seed=2000)
    total = 0.0
    for _ in range(STEPS):
        action, state = law.predict(observation, state)
        observation, reward, *_ = other.step(action)
        total += reward
    assert found.total > total + 3.0
    assert found.total == max(one.total for one in found.attempts)
    assert played(env, found.actions) == found.total == found.rewards.sum()


def test_the_same_search_finds_the_same_bits_whatever_the_pace(env):
    first = rodgym.optimize(env, 40, starts=3, seed=4)
    second = rodgym.optimize(env, 40, starts=3, seed=4, time_limit=1e3)
    assert first.actions.tobytes() == second.actions.tobytes()


def test_the_time_limit_ends_a_search_with_what_there_is(env):
    found = rodgym.optimize(env, time_limit=0.0, starts=1)
    assert not found.best.done and found.best.iterations == 1
    assert found.actions.shape == (found.best.horizon, 1)
    assert played(env, found.actions) == found.total


def test_actions_of_a_table_are_whole_multiples(env):
    found = rodgym.optimize(env, 30, starts=1, levels=100)
    whole = found.actions.astype(float) * 100
    assert np.abs(whole - np.rint(whole)).max() < 1e-5
    assert played(env, found.actions) == found.total


def test_a_quadratic_cost_holds_a_rod_whose_reward_has_no_slope():
    env = gym.make(BALANCE)
    env.reset(seed=2001)
    with pytest.raises(ParameterError, match="give a quadratic cost"):
        rodgym.optimize(env, STEPS)
    up = np.zeros((6, 2))
    up[:, 1] = 0.05 * np.arange(1, 7)
    target = np.concatenate([up.ravel(), np.zeros(12)])
    weights = np.repeat([10.0, 0.01], 12)
    cost = Quadratic(target, weights, last=np.diag(weights))
    found = rodgym.optimize(env, STEPS, cost=cost)
    assert found.total > STEPS - 0.1
    played(env, found.actions)
    assert np.abs(env.unwrapped.positions[-1] - up[-1]).max() < 0.01


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"steps": 0}, "steps = 0"),
        ({"steps": 2.5}, "steps = 2.5"),
        ({"starts": 0}, "starts = 0"),
        ({"starts": "two"}, "starts = 'two'"),
        ({"starts": []}, r"starts = \[\]"),
        ({"starts": [[2.0]]}, r"\[-1, 1\]"),
        ({"starts": [[np.nan]]}, r"\[-1, 1\]"),
        ({"starts": [np.zeros((3, 2))]}, r"shape \(3, 2\)"),
        ({"starts": [np.zeros(31)]}, r"t from 1 to 30"),
        ({"time_limit": -1.0}, "time_limit = -1"),
        ({"time_limit": "soon"}, "time_limit = 'soon'"),
        ({"levels": -1}, "levels = -1"),
        ({"cost": 3}, "cost = 3"),
        ({"cost": Quadratic(np.zeros(3), np.zeros(3))}, r"target has shape \(3,\)"),
        ({"cost": Quadratic(np.zeros(24), np.zeros((2, 2)))}, r"state has shape \(2, 2\)"),
        ({"cost": Quadratic(np.zeros(24), -np.ones(24))}, "state = -1"),
        ({"cost": Quadratic(np.zeros(24), np.ones(24), action=0.0)}, "action = 0"),
    ],
)
def test_what_is_not_allowed_is_refused_by_name(env, arguments, says):
    with pytest.raises((ParameterError, ShapeError), match=says):
        rodgym.optimize(env, **{"steps": 30, **arguments})


def test_what_has_no_derivatives_is_refused():
    with pytest.raises(ParameterError, match="an environment of rodgym"):
        rodgym.optimize(gym.make("CartPole-v1"))
    with pytest.raises(rodgym.RodgymError, match="reset"):
        rodgym.optimize(gym.make(SWING_UP).unwrapped, 10)


def test_best_known_actions_return_what_is_kept():
    episodes = list(kept())
    assert episodes
    chosen = np.random.default_rng(7).choice(len(episodes), 6, replace=False)
    for i in chosen:
        assert replay(episodes[i]) == episodes[i].total
    seven = [one for one in episodes if one.id == SWING_UP and one.config == {}]
    best = {}
    for one in seven:
        best[one.seed] = max(one.total, best.get(one.seed, 0.0))
    assert sorted(best) == list(range(20))
    assert np.mean(list(best.values())) > 481.3


def test_the_program_searches_and_replays(tmp_path, capsys):
    file = tmp_path / "actions.npy"
    assert main(["optimize", "--steps", "30", "--starts", "1", "--out", str(file)]) == 0
    assert "best: " in capsys.readouterr().out
    assert np.load(file).shape == (30, 1)
