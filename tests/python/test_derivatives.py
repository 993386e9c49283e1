"""Promise: derivatives of steps in Python are those of the steps, and what has none says so."""

from __future__ import annotations

import os
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
import rodgym
from conftest import BALANCE, FINS, SWING_UP
from rodgym.errors import ActionError, ParameterError, ShapeError

STEPPERS = ["verlet", "backward_euler", "implicit", "bdf2", "tr_bdf2", "esdirk3"]


def moving(stepper):
    rod = rodgym.sim.Pendulum(stepper=stepper, physics_dt=2e-4, nodes=5)
    rod.set_angles([1.0, 1.1, 1.3, 1.2], [3.0, -2.0, 1.0, 4.0])
    rod.step(0.01, n=10)
    return rod


@pytest.mark.parametrize("stepper", STEPPERS)
def test_the_jacobian_predicts_the_step(stepper):
    rod = moving(stepper)
    before, time = rod.get_vector(), rod.time
    A, B, P = rod.jacobian(0.02, n=15, parameters=["gravity"])
    assert P.shape == (len(before), 1)
    assert rod.time == time and rod.get_vector().tobytes() == before.tobytes()

    def after(x, torque):
        rod.set_vector(x)
        rod.step(torque, n=15)
        return rod.get_vector()

    # A direction in which all numbers change, in proportion to their size.
    size = np.abs(before) + 1e-3
    direction = size * np.random.default_rng(1).uniform(-1, 1, len(before))
    if stepper == "bdf2":
        direction[-1] = 0
    moved, still = (after(before + s * direction, 0.02 + s) for s in (1e-5, -1e-5))
    exact = A @ direction + B[:, 0]
    # (Newton's tolerance, over the step of the differences, is what they are off by.)
    assert np.abs((moved - still) / 2e-5 - exact).max() < 2e-4 * np.abs(exact).max()


def test_vectors_go_round_and_say_what_they_are_not():
    for stepper in STEPPERS:
        rod, twin = moving(stepper), rodgym.sim.Pendulum(stepper=stepper, physics_dt=2e-4, nodes=5)
        twin.set_vector(rod.get_vector())
        assert twin.time == 0 and twin.get_vector().tobytes() == rod.get_vector().tobytes()
        np.testing.assert_array_equal(twin.positions, rod.positions)
    # Nothing is carried but motion and acceleration: the same bits.
    rod, twin = moving("verlet"), rodgym.sim.Pendulum(stepper="verlet", physics_dt=2e-4, nodes=5)
    twin.set_vector(rod.get_vector())
    rod.step(0.02, n=50), twin.step(0.02, n=50)
    assert twin.get_vector().tobytes() == rod.get_vector().tobytes()
    with pytest.raises(ShapeError, match=r"\(24,\) is needed"):
        rod.set_vector([1.0, 2.0])
    with pytest.raises(ParameterError, match="x = NaN"):
        rod.set_vector(np.full(24, np.nan))
    with pytest.raises(ParameterError, match="neighbouring"):
        rod.set_vector(np.zeros(24))
    last = moving("bdf2").get_vector()
    last[-1] = 0.5
    with pytest.raises(ParameterError, match=r"0\.5 .* 0 or 1"):
        moving("bdf2").set_vector(last)


def test_arguments_are_checked_by_name():
    rod = moving("verlet")
    with pytest.raises(ParameterError, match="input = 'a'"):
        rod.jacobian("a")
    with pytest.raises(ParameterError, match="n = -1"):
        rod.jacobian(0.0, -1)
    with pytest.raises(ParameterError, match=r"'colour'.*width"):
        rod.jacobian(0.0, parameters=["colour"])
    with pytest.raises(ParameterError, match="parameters = 'width'"):
        rod.jacobian(0.0, parameters="width")
    env = gym.make(SWING_UP).unwrapped
    with pytest.raises(rodgym.RodgymError, match="reset"):
        env.step_jacobian([0.0])
    env.reset(seed=0)
    with pytest.raises(ActionError):
        env.step_jacobian([np.nan])
    with pytest.raises(ShapeError):
        env.step_jacobian([0.0, 0.0])


def test_no_steps_are_the_unit_matrix():
    A, B, P = moving("esdirk3").jacobian(0.3, n=0)
    np.testing.assert_array_equal(A, np.eye(len(A)))
    assert not B.any() and P.shape == (len(A), 0)


def test_a_control_step_is_its_physics_steps_and_stays_where_it_is():
    env = gym.make(SWING_UP, stepper="verlet", physics_dt=2e-4).unwrapped
    env.reset(seed=1)
    for _ in range(20):
        env.step([0.8])
    state, limit = env.get_state(), env.parameters["torque_limit"]
    step = env.step_jacobian([0.4], ["torque_limit", "density"])
    action = float(np.float32(0.4))
    A, B, P = env.simulation.jacobian(action * limit, n=50, parameters=["density"])
    np.testing.assert_array_equal(step.A, A)
    np.testing.assert_allclose(step.B, B * limit, rtol=1e-12)
    np.testing.assert_allclose(step.P, np.hstack([B * action, P]), rtol=1e-12)
    assert env.get_state() == state
    # Of cos(theta) and sin(theta) of the first edge by its end node: perpendicular to the edge.
    assert step.C.shape == (18, len(A)) and np.isfinite(step.C).all()
    assert step.reward_action != 0


def test_balance_pays_by_the_step_what_no_slope_shows():
    env = gym.make(BALANCE).unwrapped
    env.reset(seed=0)
    step = env.step_jacobian([0.5])
    assert not step.reward_state.any()
    np.testing.assert_allclose(step.reward_action, -0.02 * 2 * 0.5)


def test_members_of_a_batch_have_the_same_bits():
    envs = gym.make_vec(SWING_UP, num_envs=3)
    envs.reset(seed=5)
    envs.step(np.full((3, 1), 0.7, np.float32))
    alone = gym.make(SWING_UP).unwrapped
    alone.reset(seed=7)
    alone.step([0.7])
    member = envs.call("step_jacobian", [0.1])[2]
    for ours, theirs in zip(member, alone.step_jacobian([0.1]), strict=True):
        assert ours.tobytes() == theirs.tobytes()
    batch = envs.unwrapped
    actions = np.float32([[0.5], [-0.2], [0.1]])
    for ours, theirs in zip(batch.step_jacobian(actions), member, strict=True):
        assert ours.shape == (3, *theirs.shape) and ours[2].tobytes() == theirs.tobytes()
    plans = np.stack([actions, -actions, 0.3 * actions])
    theirs = alone.rollout_gradient(plans[2])
    for ours, own in zip(batch.rollout_gradient(plans), theirs, strict=True):
        assert ours.shape == (3, *own.shape) and ours[2].tobytes() == own.tobytes()
    with pytest.raises(ShapeError, match="each of 3 environments"):
        batch.step_jacobian([[0.5]])


@pytest.mark.parametrize("machine", [SWING_UP, FINS[0]])
def test_threads_have_the_same_bits(machine):
    actions = np.random.default_rng(0).uniform(-1, 1, (5, 3, 1)).astype(np.float32)
    found = []
    for num_threads in (1, 3):
        envs = gym.make_vec(machine, num_envs=5, num_threads=num_threads).unwrapped
        envs.reset(seed=3)
        envs.step(actions[:, 0])
        arrays = [*envs.step_jacobian(actions[:, 1], ["density"]), *envs.rollout_gradient(actions)]
        found.append([array.tobytes() for array in arrays])
        with pytest.raises(ParameterError, match="colour"):
            envs.step_jacobian(actions[:, 1], ["colour"])
    assert found[0] == found[1]


def test_instruction_sets_have_the_same_bits():
    code = (
        "import gymnasium as gym, rodgym, hashlib\n"
        "seen = hashlib.sha256()\n"
        "for stepper in ('verlet', 'esdirk3'):\n"
        "    env = gym.make('rodgym/PendulumSwingUp-v0', stepper=stepper).unwrapped\n"
        "    env.reset(seed=2)\n"
        "    for array in env.step_jacobian([0.3], ['width']):\n"
        "        seen.update(array.tobytes())\n"
        "env = gym.make('rodgym/FinSwim-v0').unwrapped\n"
        "env.reset(seed=2)\n"
        "for array in (*env.step_jacobian([0.3], ['density']), *env.rollout_gradient([[0.3]])):\n"
        "    seen.update(array.tobytes())\n"
        "print(seen.hexdigest())\n"
    )
    hashes = set()
    for name in ("baseline", "avx2", "avx512"):
        command = [sys.executable, "-c", code]
        environ = {**os.environ, "RODGYM_ISA": name}
        done = subprocess.run(command, capture_output=True, text=True, env=environ, check=False)
        if "RODGYM_ISA" in done.stderr:
            continue
        assert done.returncode == 0, done.stderr
        hashes.add(done.stdout)
    assert len(hashes) == 1


def test_the_gradient_of_a_rollout_is_that_of_its_steps():
    env = gym.make(SWING_UP).unwrapped
    env.reset(seed=4, options={"state": {"angles": [2.0] * 6, "rates": [0.0] * 6}})
    state = env.get_state()
    actions = np.float32(np.sin(np.arange(6.0))[:, None] * 0.9)
    found = env.rollout_gradient(actions, ["torque_limit"])
    assert env.get_state() == state
    # The chain rule over the steps, backwards.
    steps, rewards = [], []
    for action in actions:
        steps.append(env.step_jacobian(action, ["torque_limit"]))
        rewards.append(env.step(action)[1])
    np.testing.assert_allclose(found.rewards, rewards, rtol=1e-13)
    by_state, by_limit = np.zeros(len(found.state)), 0.0
    for t, step in reversed(list(enumerate(steps))):
        by_action = step.reward_action + by_state @ step.B
        by_limit += step.reward_parameters[0] + by_state @ step.P[:, 0]
        by_state = step.reward_state + by_state @ step.A
        np.testing.assert_allclose(found.actions[t], by_action, rtol=1e-9)
    np.testing.assert_allclose(found.state, by_state, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.parameters, [by_limit], rtol=1e-9)
    with pytest.raises(ShapeError, match=r"\(t, 1\)"):
        env.rollout_gradient([0.0, 1.0])
    with pytest.raises(ActionError):
        env.rollout_gradient([[np.inf]])


def test_a_rollout_ends_where_the_task_ends_the_episode():
    env = gym.make(BALANCE).unwrapped
    env.reset(seed=0)
    found = env.rollout_gradient(np.ones((400, 1), np.float32))
    ended = int(np.argmin(found.rewards != 0))
    assert 0 < ended < 399
    assert not found.rewards[ended:].any() and not found.actions[ended + 1 :].any()


def beating(**keywords):
    fin = rodgym.sim.Fin(**keywords)
    for step in range(8):
        fin.step(0.2 * np.sin(0.5 * step))
    return fin


@pytest.mark.parametrize("keywords", [{}, {"stepper": "backward_euler"}, {"free_swimming": True}])
def test_the_jacobian_of_a_fin_predicts_its_step(keywords):
    fin = beating(**keywords)
    before = fin.get_vector()
    A, B, P = fin.jacobian(0.1, n=6, parameters=["density", "drag_coefficient"])
    assert fin.get_vector().tobytes() == before.tobytes() and P.shape == (len(before), 2)

    def after(x, pitch):
        fin.set_vector(x)
        fin.step(pitch, n=6)
        return fin.get_vector()

    direction = (np.abs(before) + 1e-3) * np.random.default_rng(1).uniform(-1, 1, len(before))
    if "stepper" not in keywords:
        direction[-13] = 0
    moved, still = (after(before + s * direction, 0.1 + s) for s in (1e-4, -1e-4))
    exact = A @ direction + B[:, 0]
    assert np.abs((moved - still) / 2e-4 - exact).max() < 1e-5 * np.abs(exact).max()


def test_vectors_of_fins_go_round_and_say_what_they_are_not():
    fin, twin = beating(), rodgym.sim.Fin()
    x = fin.get_vector()
    assert len(x) == 2 * 30 + 1 + 12
    twin.set_vector(x)
    assert twin.time == 0 and twin.get_vector().tobytes() == x.tobytes()
    fin.drive(0.1, n=20), twin.drive(0.1, n=20)
    np.testing.assert_allclose(twin.get_vector(), fin.get_vector(), rtol=1e-12, atol=1e-13)
    for bad, words in [
        (x[:-1], r"\(72,\), but \(73,\)"),
        (np.where(np.arange(73) == 3, np.nan, x), "x = NaN"),
        (np.where(np.arange(73) == 60, 0.5, x), r"0\.5 .* 0 or 1"),
        (np.where(np.arange(73) == 61, 0.5, x), "where the servo's angle 0.5 rad"),
        (np.where(np.arange(73) < 4, 0.0, x), "neighbouring"),
    ]:
        with pytest.raises((ShapeError, ParameterError), match=words):
            twin.set_vector(bad)


@pytest.mark.parametrize("task", FINS)
def test_the_gradient_of_a_fin_is_that_of_its_steps(task):
    env = gym.make(task, actuator_delay=0.008).unwrapped
    env.reset(seed=4)
    for t in range(10):
        env.step([np.sin(0.5 * t)])
    state = env.get_state()
    actions = np.float32(np.sin(np.arange(8.0))[:, None] * 0.9)
    found = env.rollout_gradient(actions, ["youngs_modulus"])
    assert env.get_state() == state
    steps, rewards = [], []
    for action in actions:
        steps.append(env.step_jacobian(action, ["youngs_modulus"]))
        rewards.append(env.step(action)[1])
    np.testing.assert_allclose(found.rewards, rewards, rtol=1e-13)
    by_state, by_modulus = np.zeros(len(found.state)), 0.0
    scale = max(np.abs(found.actions).max(), 1e-6)
    for t, step in reversed(list(enumerate(steps))):
        by_action = step.reward_action + by_state @ step.B
        by_modulus += step.reward_parameters[0] + by_state @ step.P[:, 0]
        by_state = step.reward_state + by_state @ step.A
        np.testing.assert_allclose(found.actions[t], by_action, atol=1e-10 * scale)
    scale = np.abs(by_state).max()
    np.testing.assert_allclose(found.state, by_state, rtol=1e-9, atol=1e-10 * scale)
    np.testing.assert_allclose(found.parameters, [by_modulus], rtol=1e-9)
