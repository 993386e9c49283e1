"""Promises of the bare fin, of the gaits and of chapter 3 anew."""

from __future__ import annotations

import csv
import functools
from pathlib import Path

import gaits as gaits_page
import gymnasium as gym
import numpy as np
import pytest
import rodgym
from rodgym.baselines import Gait, Lqr
from rodgym.errors import ParameterError, ShapeError
from rodgym.evaluation import evaluate, record
from rodgym.machines import gaits

THRUST = "rodgym/FinThrust-v0"
TABLE = Path(__file__).parents[1] / "data" / "fin" / "flex_grid_ilm.csv"


def test_n_steps_are_n_times_one_step():
    once, often = rodgym.sim.Fin(), rodgym.sim.Fin()
    once.step(0.01, n=20)
    for _ in range(20):
        often.step(0.01)
    assert np.array_equal(once.positions, often.positions)
    assert once.loads == often.loads and once.time == often.time


def test_forces_in_a_flow_are_those_of_relative_velocity():
    rng = np.random.default_rng(0)
    x = rodgym.sim.Fin().positions + rng.normal(0.0, 2e-3, (8, 2))
    v = rng.normal(0.0, 0.2, (8, 2))
    flow = rodgym.sim.Fin(flow_speed=0.25).forces(x, v)
    still = rodgym.sim.Fin(flow_speed=0.0).forces(x, v - [0.25, 0.0])
    for name, value in flow.items():
        assert np.array_equal(value, still[name]), name
    assert np.abs(flow["elastic"].sum(axis=0)).max() < 1e-9 * np.abs(flow["elastic"]).max()


def test_the_fin_of_an_environment_is_where_the_environment_is():
    env = gym.make(THRUST).unwrapped
    env.reset(seed=1)
    for _ in range(5):
        env.step(np.ones(1, np.float32))
    fin = env.fin
    assert np.array_equal(fin.positions, env.positions)
    assert fin.parameters == env.parameters
    fin.step(fin.loads["pitch"], n=10)
    assert not np.array_equal(fin.positions, env.positions)


def test_the_bare_fin_has_the_servo_of_the_environments():
    env = gym.make(THRUST, youngs_modulus=2.5e5)
    env.reset(seed=2)
    fin = rodgym.sim.Fin.of(env)
    bare = rodgym.sim.Fin(command_cutoff=None)
    bare.set_state(fin.positions, fin.velocities)
    for action in (1.0, 1.0, 1.0, 0.5, 0.5):
        env.step(np.array([action], np.float32))
        for each in (fin, bare):
            each.drive(action * env.unwrapped.config["pitch_limit"], n=10)
    # (The pitch at the start is read from the positions, so to rounding only.)
    assert fin.positions == pytest.approx(env.unwrapped.positions, abs=1e-12)
    # Without its low-pass the servo is far ahead after 0.2 s.
    assert abs(bare.loads["pitch"] - fin.loads["pitch"]) > 0.05
    with pytest.raises(ParameterError, match="command = nan"):
        fin.drive(float("nan"))
    with pytest.raises(ParameterError, match=r"command_cutoff = 0 .* 0.1 to 100, or None"):
        gym.make(THRUST, command_cutoff=0)


def test_an_agent_sees_what_the_low_pass_holds():
    env = gym.make(THRUST, youngs_modulus=2.5e5, start_pitch=(0.0, 0.0))
    env.reset(seed=4)
    seen = [env.step(np.ones(1, np.float32))[0] for _ in range(150)]
    # A step comes through stage by stage, and in the end all stand at the limit of 20 degrees.
    stages = seen[1][2:12:2]
    assert (np.diff(stages) < 0).all() and stages[-1] > 0
    limit = np.radians(20.0) / 0.5
    assert seen[-1][[0, 2, 4, 6, 8, 10]] == pytest.approx(limit, abs=1e-3)
    assert seen[-1][[1, 3, 5, 7, 9, 11]] == pytest.approx(0.0, abs=1e-3)
    assert max(o[10] for o in seen) < 1.25 * limit
    bare = gym.make(THRUST, command_cutoff=None)
    bare.reset(seed=4)
    observation = bare.step(np.full(1, 0.5, np.float32))[0]
    assert observation[2:12] == pytest.approx([0.5 * limit, 0.0] * 5)


@pytest.mark.parametrize(("f", "left"), [(2.0, 0.97), (3.0, 0.63), (4.0, 0.05), (5.0, 0.006)])
def test_the_low_pass_leaves_of_a_sine_what_its_transfer_function_says(f, left):
    dt, tick, w = 0.004, 1e-3, 2 * np.pi * 3.0
    env = gym.make(THRUST, control_dt=dt, start_pitch=(0.0, 0.0), max_episode_steps=1500)
    env.reset(seed=0)
    sine = np.sin(2 * np.pi * f * dt * np.arange(1500)).astype(np.float32)
    seen = np.array([env.step(sine[k : k + 1])[0][10] for k in range(1500)])
    # Five damped oscillators by backward Euler, at z on the unit circle.
    z, gain = np.exp(2j * np.pi * f * tick), 1.0
    for k in range(5):
        damping = np.sin(np.pi * (2 * k + 1) / 20)
        backward = 1 + 2 * damping * w * tick + (w * tick) ** 2
        gain *= (w * tick) ** 2 * z / ((z - 1) * (backward * z - 1) + (w * tick) ** 2 * z)
    assert seen[-250:].max() == pytest.approx(abs(gain) * np.radians(20.0) / 0.5, rel=0.01)
    # What the page of the fin says.
    assert abs(gain) == pytest.approx(left, abs=0.003)


def test_a_fin_is_not_a_pendulum():
    env = gym.make(THRUST)
    env.reset(seed=0)
    with pytest.raises(AttributeError, match=r"has a fin, not a pendulum: see `.fin`"):
        _ = env.unwrapped.rod
    with pytest.raises(AttributeError, match=r"see `.rod`"):
        _ = gym.make("rodgym/PendulumSwingUp-v0").unwrapped.fin
    with pytest.raises(ParameterError, match="one environment of rodgym with a pendulum"):
        rodgym.sim.Pendulum.of(env)
    with pytest.raises(ParameterError, match="one environment of rodgym with a fin"):
        rodgym.sim.Fin.of(gym.make_vec(THRUST, num_envs=2))
    for name in ("FinThrust-v0", "FinSwim-v0", "FinEfficiency-v0"):
        with pytest.raises(ParameterError, match=r"lqr cannot control .* this one is a 'fin'"):
            Lqr.for_env(gym.make(f"rodgym/{name}"))


def test_bad_arguments_are_named():
    with pytest.raises(ParameterError, match="hydrodynamics"):
        rodgym.sim.Fin(hydrodynamics="wind")
    with pytest.raises(ShapeError):
        rodgym.sim.Fin().set_state(np.zeros((3, 2)))
    with pytest.raises(ParameterError, match="stiffness_profile"):
        gym.make(THRUST, stiffness_profile=[1.0] * 7 + [-1.0])
    with pytest.raises(ParameterError, match=r"geometry\['widths'\]\[3\] = 1000000 .* 1 m"):
        gym.make(THRUST, geometry={"widths": [0.0, 0.02, 0.02, 1e6, 0.01, 0.01, 0.004, 0.0]})
    # A free swimmer's water is at rest: another flow would be ignored in silence.
    swim = gym.make("rodgym/FinSwim-v0").unwrapped
    _, info = swim.reset(seed=0)
    assert info["parameters"]["flow_speed"] == 0.0
    with pytest.raises(ParameterError, match=r"flow_speed = 0.1 .* must be 0$"):
        gym.make("rodgym/FinSwim-v0", flow_speed=0.1)
    wrong = {"widths": [0.0, 0.01, 0.0], "height": 0, "pivot": 7, "areas": [1e-3]}
    for name, value in wrong.items():
        with pytest.raises((ParameterError, ShapeError), match=rf"geometry\['{name}'\]"):
            gym.make(THRUST, geometry={name: value})
    with pytest.raises(ParameterError, match="flow_speed"):
        swim.reset(options={"parameters": {"flow_speed": 0.1}})


def test_gaits_play_the_environment_they_were_found_in():
    env = gym.make(THRUST, youngs_modulus=2.5e5)
    gait = Gait.for_env(env, "sine")
    assert 2.0 < gait.parameters["frequency"] < 4.0
    observation, _ = env.reset(seed=3)
    state, total, start = None, 0.0, np.ones(1, dtype=bool)
    for _ in range(200):
        action, state = gait.predict(observation, state, start)
        start = np.zeros(1, dtype=bool)
        observation, reward, *_ = env.step(action)
        total += float(reward)
    assert total == pytest.approx(gait.parameters["found_return"], rel=0.1)
    with pytest.raises(ParameterError, match="waveform"):
        Gait.for_env(env, "sawtooth")


def test_scores_of_a_fin_say_how_it_beats(tmp_path: Path):
    env = gym.make(THRUST, youngs_modulus=2.5e5)
    gait = Gait.for_env(env, "sine")
    seeds, kwargs = range(3), {"youngs_modulus": 2.5e5}
    found = evaluate(gait, THRUST, seeds, env_kwargs=kwargs)
    assert found.columns["beat"] == pytest.approx([gait.parameters["frequency"]] * 3, abs=0.03)
    assert found.columns["youngs_modulus"].tolist() == [2.5e5] * 3
    # Speed times impulse over work, by hand.
    played = record(gait, THRUST, 1, env_kwargs=kwargs)
    by_hand = 0.05 * played.metrics["thrust"].sum() / played.metrics["power"].sum()
    assert found.columns["efficiency"][1] == pytest.approx(by_hand, rel=1e-9)
    # At rest a fin points downstream.
    assert np.abs(played.angles[0]).max() < 0.5
    gaits.draw(tmp_path / "gaits.png", [played], [found])
    assert (tmp_path / "gaits.png").stat().st_size > 10_000


def test_chapter_3_grid_is_the_references_grid():
    from rodgym.reproduction.fin_runs import period

    with TABLE.open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    row = next(r for r in rows if (r["E_Pa"], r["A_deg"], r["f_Hz"]) == ("250000", "10", "1.5"))
    found = period(10.0, 1.5, youngs_modulus=2.5e5)
    assert found.mean_thrust == pytest.approx(float(row["T_x_N"]), rel=5e-3)
    assert found.efficiency == pytest.approx(float(row["eff_x"]), rel=5e-3)


@functools.cache
def laws() -> tuple[Gait, rodgym.baselines.AdaptiveGait]:
    """Designs that know the range of stiffnesses alone."""
    drawn = gym.make(THRUST)
    return Gait.for_env(drawn, "sine"), rodgym.baselines.AdaptiveGait.for_env(drawn)


@pytest.mark.parametrize(("modulus", "more"), [(4.3e4, 5), (4.1e5, -5), (2.2e6, 10)])
def test_a_gait_that_feels_the_stiffness_suits_every_fin(modulus, more):
    """Never far below the best fixed sinusoid for all fins, and far above it at both ends."""
    env = gym.make(THRUST, youngs_modulus=modulus)
    returns = []
    for law in laws():
        observation, _ = env.reset(seed=5000)
        state, total = None, 0.0
        for _ in range(200):
            action, state = law.predict(observation, state)
            observation, reward, *_ = env.step(action)
            total += reward
        returns.append(total)
    assert returns[1] - returns[0] > more
    [[value, low, high]] = law.estimate(state)["youngs_modulus"]
    assert abs(value / modulus - 1) < 0.25 and low < value < high


def test_a_gait_that_feels_needs_to_see_torque_and_thrust():
    with pytest.raises(ParameterError, match="observation='full'"):
        rodgym.baselines.make("gait-adaptive", gym.make(THRUST, observation="camera"))


def test_the_page_of_gaits_sets_returns_of_the_same_episodes_side_by_side():
    ours, theirs = np.array([3.0, 5.0, 2.0, 7.0]), np.array([2.0, 4.0, 1.0, 6.0])
    assert gaits_page.more(ours, theirs).tolist() == [1.0, 1.0, 1.0]
    value, low, high = gaits_page.ratio(ours, theirs)
    assert value == 17 / 13 and 1 < low < value < high
    rows = gaits_page.quarters({"gait": ours}, np.array([4e4, 2e5, 6e5, 2e6]))
    assert rows[-1] == "| `gait` | 3.0 | 5.0 | 2.0 | 7.0 |"
    lines, truth = gaits_page.estimates(range(5000, 5002), laws()[1])
    assert len(lines) == 2 + len(gaits_page.STEPS) and truth.shape == (2,)
