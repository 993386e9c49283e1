"""Promise: `rodgym.sim.Pendulum` is the environments' plant and hits the reference numbers."""

from __future__ import annotations

import copy
import pickle
import signal
import time

import gymnasium as gym
import numpy as np
import pytest
import rodgym
from conftest import RANDOM, SWING_UP
from rodgym import errors
from rodgym.sim import Fin, Pendulum

HORIZONTAL = [np.pi / 2] * 6


def test_free_swing_from_horizontal_ends_where_the_reference_ends():
    rod = Pendulum(bending_damping=0.0)
    rod.set_angles(HORIZONTAL)
    assert rod.energy()["total"] == pytest.approx(0.0, abs=1e-12)
    rod.step(0.0, n=2000)
    assert rod.time == pytest.approx(1.0)
    # Independent converged run; the default, Verlet at 5e-4 s, is within 0.01 mm of it.
    assert rod.positions[-1] == pytest.approx([0.298143, -0.033309], abs=1e-5)
    energy = rod.energy()
    parts = sum(energy[kind] for kind in ("kinetic", "stretch", "bend", "gravity"))
    assert energy["total"] == pytest.approx(parts)


def test_backward_euler_loses_the_energy_that_it_is_known_to_lose():
    rod = Pendulum(bending_damping=0.0, stepper="backward_euler", physics_dt=1e-4)
    rod.set_angles(HORIZONTAL)
    before = rod.energy()["total"]
    rod.step(n=10_000)
    assert rod.energy()["total"] - before == pytest.approx(-3.67e-4, rel=0.01)


def test_many_steps_are_one_step_many_times():
    one, many = Pendulum(), Pendulum()
    for _ in range(100):
        one.step(0.03)
    many.step(0.03, n=100)
    assert np.array_equal(one.positions, many.positions)
    assert np.array_equal(one.velocities, many.velocities)
    assert one.time == many.time == pytest.approx(0.05)


def test_poles_about_upright():
    rod = Pendulum(bending_damping=0.0)
    rod.set_angles([np.pi] * 6)
    # Let it find its equilibrium length; upright it is shorter by its own weight.
    positions = rod.positions
    mass = 1500.0 * 0.007**2 * 0.05
    above = np.array([mass * (5.5 - k) for k in range(6)]) * 9.81
    lengths = 0.05 * (1.0 - above / 490.0)
    positions[1:, 1] = np.cumsum(lengths)
    rod.set_state(positions)
    a, b, c = rod.linearize()
    assert (a.shape, b.shape, c.shape) == ((24, 24), (24, 1), (12, 24))
    poles = np.linalg.eigvals(a)
    real = np.sort(poles[np.abs(poles.imag) < 1e-6].real)
    # The reference is the inextensible rod; stretching shifts the pole by 1.2e-4 of it.
    assert real == pytest.approx([-7.0201, 7.0201], rel=1e-3)


def test_a_copy_goes_its_own_way():
    rod = Pendulum()
    rod.set_angles(HORIZONTAL)
    rod.step(n=37)
    twin = copy.deepcopy(rod)
    assert twin.time == rod.time
    rod.step(n=50)
    assert not np.array_equal(twin.positions, rod.positions)
    twin.step(n=50)
    assert np.array_equal(twin.positions, rod.positions)


@pytest.mark.parametrize(
    "machine",
    [
        Pendulum(width=0.0081),
        Pendulum(nodes=9, stepper="implicit", physics_dt=2e-3),
        Pendulum(thesis=True),
        Fin(youngs_modulus=3e5),
        Fin(stepper="backward_euler", hydrodynamics="morison"),
        Fin(free_swimming=True),
    ],
)
def test_a_pickled_machine_goes_on_to_the_bit(machine):
    machine.step(0.01, n=13)
    twin = pickle.loads(pickle.dumps(machine))
    assert twin.config == machine.config and twin.parameters == machine.parameters
    for _ in range(2):
        assert twin.time == machine.time > 0
        assert np.array_equal(twin.positions, machine.positions)
        assert np.array_equal(twin.velocities, machine.velocities)
        assert twin.energy() == machine.energy()
        assert getattr(twin, "loads", None) == getattr(machine, "loads", None)
        # What the stepper remembers beside the state shows in the next steps.
        for one in (machine, twin):
            one.step(0.02, n=7)


def test_a_fin_pickled_in_mid_stroke_keeps_servo_and_low_pass():
    fin = Fin()
    fin.drive(0.3, n=100)
    twin = pickle.loads(pickle.dumps(fin))
    for one in (fin, twin):
        one.drive(-0.3, n=10)
    assert fin.loads["pitch"] > 0.2
    assert twin.loads == fin.loads
    assert np.array_equal(twin.positions, fin.positions)


def test_a_damaged_pickle_is_refused():
    rod = Pendulum()
    before = rod.positions
    with pytest.raises(errors.SnapshotError, match="3 numbers, but 57 are needed"):
        rod._native.__setstate__(([0.0] * 3, 1))
    assert np.array_equal(rod.positions, before) and rod.time == 0


def test_an_environment_shows_its_rod():
    env = gym.make(SWING_UP, nodes=9, **RANDOM).unwrapped
    env.reset(seed=3)
    for _ in range(20):
        env.step([0.7])
    rod = env.rod
    assert isinstance(rod, Pendulum)
    assert np.array_equal(rod.positions, env.positions)
    assert np.array_equal(rod.velocities, env.velocities)
    assert rod.config["nodes"] == 9 and rod.physics_dt == env.physics_dt
    width = env.parameters["width"]
    assert rod.parameters["width"] == width and 0.006 <= width <= 0.009
    before = env.get_state()
    rod.step(0.05, n=10)
    assert env.get_state() == before
    batch = gym.make_vec(SWING_UP, num_envs=2)
    batch.reset(seed=0)
    assert np.array_equal(batch.members[1].rod.positions, batch.get_attr("positions")[1])


def test_rod_moves_as_in_the_environment():
    env = gym.make(SWING_UP).unwrapped
    env.reset(seed=0)
    rod = env.rod
    env.step([0.8])
    rod.step(0.8 * 0.05, n=round(env.control_dt / env.physics_dt))
    assert rod.positions == pytest.approx(env.positions, abs=1e-8)


def test_thesis_feedback_catches_the_rod_from_near_up():
    gain = [41.9915, -6.4612, 13.5714, 8.5106, 0.8539, 2.2641]
    gain += [2.2083, 2.0638, 1.6190, 1.3820, 0.8615, 0.3368]
    rod = Pendulum(thesis=True)
    rod.set_angles([np.pi - 0.1] * 6)
    rod.step_feedback(0.0, [-k for k in gain], n=20_000)
    assert np.abs(np.abs(rod.angles) - np.pi).max() < 1e-4


@pytest.mark.parametrize(
    ("call", "error", "named"),
    [
        (lambda rod: Pendulum(widht=1.0), errors.ParameterError, "widht"),
        (lambda rod: Pendulum(torque_limit=0.05), errors.ParameterError, "torque_limit"),
        (lambda rod: rod.step(float("nan")), errors.ParameterError, "torque"),
        (lambda rod: rod.step("x"), errors.ParameterError, "torque = 'x'"),
        (lambda rod: rod.step(None), errors.ParameterError, "torque = None"),
        (lambda rod: rod.step([0.1]), errors.ParameterError, "torque"),
        (lambda rod: rod.step(0.0, n=10**30), errors.ParameterError, "n = 1000"),
        (lambda rod: rod.step(0.0, n=True), errors.ParameterError, "n = True"),
        (lambda rod: rod.linearize(float("nan")), errors.ParameterError, "torque = nan"),
        (lambda rod: rod.step_feedback("x", [0.0] * 12), errors.ParameterError, "constant = 'x'"),
        (lambda rod: Fin().step("x"), errors.ParameterError, "pitch = 'x'"),
        (lambda rod: rod.step(0.0, n=-1), errors.ParameterError, "n = -1"),
        (lambda rod: rod.step(0.0, n=1.5), errors.ParameterError, "n = 1.5"),
        (lambda rod: rod.set_angles([0.0] * 5), errors.ShapeError, "angles"),
        (lambda rod: rod.set_angles([float("inf")] * 6), errors.ParameterError, "angles"),
        (lambda rod: rod.set_state(np.zeros((6, 2))), errors.ShapeError, "positions"),
        (lambda rod: rod.set_state(np.zeros((7, 3))), errors.ShapeError, "positions"),
        (lambda rod: rod.set_state(np.zeros((7, 2))), errors.ParameterError, "positions"),
        (lambda rod: rod.set_state("here"), errors.ShapeError, "positions"),
        (lambda rod: rod.step_feedback(0.0, [0.0] * 12), errors.ParameterError, "stepper"),
        (lambda rod: rod.step_feedback(0.0, [0.0] * 3), errors.ShapeError, "gain"),
    ],
)
def test_bad_arguments_change_nothing(call, error, named):
    rod = Pendulum()
    rod.set_angles(HORIZONTAL)
    rod.step(n=3)
    before = rod.positions, rod.velocities, rod.time
    with pytest.raises(error, match=named) as caught:
        call(rod)
    assert isinstance(caught.value, (rodgym.RodgymError, ValueError))
    assert np.array_equal(rod.positions, before[0])
    assert np.array_equal(rod.velocities, before[1])
    assert rod.time == before[2]


def interrupted(seconds, call):
    """Calls with a Ctrl-C that comes after so many seconds; how long it took to act."""
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    began = time.monotonic()
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        with pytest.raises(KeyboardInterrupt):
            call()
    finally:
        signal.signal(signal.SIGALRM, before)
    return time.monotonic() - began - seconds


@pytest.mark.parametrize("nodes", [7, 1001])
def test_ctrl_c_ends_a_long_run_and_leaves_the_state_before_it(nodes):
    rod = Pendulum(nodes=nodes, stepper="implicit", physics_dt=1e-3)
    rod.step(0.01, n=3)
    kept = rod.positions
    # Looks are some 20 ms apart; the bound allows for a busy machine.
    assert interrupted(0.2, lambda: rod.step(0.01, n=10**12)) < 5
    assert np.array_equal(rod.positions, kept) and rod.time == pytest.approx(3e-3)
    rod.step(0.01, n=2)
    assert rod.time == pytest.approx(5e-3)


@pytest.mark.parametrize(
    "stepper", ["verlet", "implicit", "backward_euler", "bdf2", "tr_bdf2", "esdirk3"]
)
@pytest.mark.parametrize("members", [1, 9])
def test_the_rod_of_an_environment_goes_on_with_its_bits(stepper, members):
    # What the stepper remembers (carried accelerations, first guesses) comes along.
    keywords = {"stepper": stepper, "physics_dt": 2e-4 if stepper == "verlet" else 1e-3}
    batch = gym.make_vec("rodgym/PendulumSwingUp-v0", num_envs=members, **keywords)
    batch.reset(seed=3)
    rng = np.random.default_rng(0)
    for _ in range(7):
        batch.step(rng.uniform(-1, 1, (members, 1)).astype(np.float32))
    env = batch.unwrapped.members[members - 1]
    rod = env.rod
    action = np.full((members, 1), 0.4, np.float32)
    batch.step(action)
    rod.step(float(action[0, 0]) * env.parameters["torque_limit"], n=round(0.01 / rod.physics_dt))
    assert np.array_equal(rod.positions, env.positions)
    assert np.array_equal(rod.velocities, env.velocities)


@pytest.mark.parametrize("stepper", ["bdf2", "backward_euler"])
@pytest.mark.parametrize("env_id", ["rodgym/FinThrust-v0", "rodgym/FinSwim-v0"])
def test_the_fin_of_an_environment_goes_on_with_its_bits(env_id, stepper):
    # The step before, the water's momentum, servo and low-pass come along.
    env = gym.make(env_id, stepper=stepper).unwrapped
    env.reset(seed=3)
    rng = np.random.default_rng(0)
    for _ in range(7):
        env.step(rng.uniform(-1, 1, 1).astype(np.float32))
    fin = pickle.loads(pickle.dumps(env.fin))
    assert fin.loads["thrust"] != 0
    action = np.array([0.4], np.float32)
    env.step(action)
    command = float(action[0]) * env.config["pitch_limit"]
    fin.drive(command, n=round(env.control_dt / fin.physics_dt))
    assert np.array_equal(fin.positions, env.positions)
    assert np.array_equal(fin.velocities, env.velocities)
