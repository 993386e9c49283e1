"""Promise: a machine is described once in Python, and what the description names, the core has."""

from __future__ import annotations

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
import rodgym
from rodgym import _native, machines
from rodgym.baselines import CONTROLLERS
from rodgym.errors import ParameterError
from rodgym.evaluation import evaluate, record
from rodgym.evaluation.policies import Zero
from rodgym.study import StudyError
from rodgym.study.spec import parse

ROWS = rodgym.ENVIRONMENTS.values()


@pytest.fixture
def restored(monkeypatch):
    """Descriptions and registrations as they were, after the test."""
    monkeypatch.setattr(machines, "_KNOWN", dict(machines._KNOWN))
    entries = dict(gym.registry)
    yield
    gym.registry.clear()
    gym.registry.update(entries)


def test_gymnasium_knows_the_rows_of_the_catalogue():
    for entry, row in zip(ROWS, _native.catalog(), strict=True):
        assert dataclasses.asdict(entry) == row | {"entry_point": entry.entry_point}
        spec = gym.spec(entry.id)
        assert (spec.max_episode_steps, spec.reward_threshold) == (
            entry.max_episode_steps,
            entry.reward_threshold,
        )
        assert isinstance(gym.make(entry.id).unwrapped, machines.load(str(spec.entry_point)))


def test_every_machine_and_task_of_the_catalogue_is_described_and_no_other():
    assert {about.machine for about in machines.known()} == {entry.machine for entry in ROWS}
    for about in machines.known():
        assert about.tasks.keys() <= {e.task for e in ROWS if e.machine == about.machine}


@pytest.mark.parametrize("entry", ROWS, ids=lambda entry: entry.id)
def test_what_is_drawn_and_scored_is_reported_by_the_core(entry):
    env = gym.make(entry.id)
    spec = machines.spec_of(env)
    about = machines.of(spec)
    assert {trace.metric for trace in about.traces_of(entry.task)} <= set(spec["metrics"])
    result = evaluate(Zero(env.action_space), entry.id, range(2))
    assert [c.name for c in result.described] == list(result.columns)
    assert sum(c.success for c in result.described) <= 1
    # A column that may be undefined says so by NaN; the return never is.
    assert np.isfinite(result.columns["return"]).all()
    assert all(values.shape == (2,) for values in result.columns.values())
    # At rest the edges' angles are near 0, whatever direction that is.
    if not spec["config"].get("start_bend"):
        played = record(Zero(env.action_space), entry.id, max_seconds=2 * spec["control_dt"])
        assert np.abs(played.angles[0]).max() < 0.2


@pytest.mark.parametrize("entry", ROWS, ids=lambda entry: entry.id)
def test_the_usual_controller_plays_the_environment(entry):
    env = gym.make(entry.id)
    spec = machines.spec_of(env)
    names = machines.of(spec).controllers(spec)
    assert names and dict(_native.controllers()).keys() >= set(names)
    for name in names:
        law = CONTROLLERS[name](spec)
        action, _ = law.predict(env.reset(seed=0)[0])
        assert env.action_space.contains(action)


def test_controllers_are_those_of_the_core_in_its_order():
    assert list(CONTROLLERS) == [name for name, _ in _native.controllers()]
    assert all(law.name == name for name, law in CONTROLLERS.items())


def test_a_machines_copy_has_its_own_word_and_the_common_one():
    for entry in ROWS:
        env = gym.make(entry.id).unwrapped
        env.reset(seed=1)
        about = machines.of(env.core_spec)
        for copy in (env.simulation, getattr(env, about.word)):
            assert type(copy) is machines.load(about.simulation)
            assert np.array_equal(copy.positions, env.positions)
        for other in machines.known():
            assert hasattr(env, other.word) == (other is about)
    with pytest.raises(AttributeError, match="has no attribute 'wings'"):
        _ = env.wings


def test_a_machine_that_nobody_has_described_is_scored_by_its_return(restored, monkeypatch):
    env_id = next(iter(rodgym.ENVIRONMENTS))
    machine = rodgym.ENVIRONMENTS[env_id].machine
    described = evaluate("lqr", env_id, range(2)).columns["return"]
    del machines._KNOWN[machine]
    result = evaluate("lqr", env_id, range(2))
    assert list(result.columns) == ["return", "length"]
    assert np.array_equal(result.columns["return"], described)
    env = gym.make(env_id).unwrapped
    env.reset(seed=0)
    assert np.array_equal(env.simulation.positions, env.positions)


def test_another_package_describes_its_machine(restored):
    pendulum = machines.known()[0]
    del machines._KNOWN[pendulum.machine]
    own = dataclasses.replace(pendulum, environment="rodgym.envs:RodEnv", word="beam")
    machines.register(own)
    env = gym.make(next(e.id for e in ROWS if e.machine == own.machine)).unwrapped
    env.reset(seed=0)
    assert type(env) is rodgym.envs.RodEnv and np.array_equal(env.beam.positions, env.positions)
    with pytest.raises(ParameterError, match="described already"):
        machines.register(own)


def test_a_study_may_start_a_machine_where_its_description_says():
    content = {"sweep": {"policy": ["zero"], "start.angle": [0.1]}}
    for entry in ROWS:
        if "angle" in machines.of(dataclasses.asdict(entry)).starts:
            assert len(parse({"env": entry.id, **content}, "study")) == 1
        else:
            with pytest.raises(StudyError, match=r"'start.angle' is no key of a case in rodgym/"):
                parse({"env": entry.id, **content}, "study")


@pytest.mark.parametrize("entry", ROWS, ids=lambda entry: entry.id)
def test_the_preset_of_the_thesis_and_its_short_word_are_the_same(entry):
    spec = gym.make(entry.id, preset="burch2019").unwrapped.core_spec
    assert spec == gym.make(entry.id, thesis=True).unwrapped.core_spec
    assert spec["config"]["preset"] == "burch2019" and spec["config"]["thesis"] is True
    plain = gym.make(entry.id).unwrapped.core_spec["config"]
    assert plain["preset"] is None and plain != spec["config"]
    with pytest.raises(ParameterError, match=r"preset = \"burch\" is .*'burch2019'"):
        gym.make(entry.id, preset="burch")
    with pytest.raises(ParameterError, match=r"thesis = [Ff]alse is .*beside preset"):
        gym.make(entry.id, preset="burch2019", thesis=False)
