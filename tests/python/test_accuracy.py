"""Promise: default steps are exact, what is not promised is told, what is asked for is kept."""

from __future__ import annotations

import warnings

import gymnasium as gym
import pytest
from fin_beats import FINE, beat, errors
from rodgym.cli.commands.list import describe, overview
from rodgym.errors import AccuracyWarning, ParameterError
from rodgym.sb3 import make_vec_env

SWING_UP = "rodgym/PendulumSwingUp-v0"
#: No step follows such an undamped whip for a second.
WHIP = {"youngs_modulus": 1e5, "width": 0.002, "length": 1.0, "bending_damping": 0.0}


def spec(**kwargs):
    return gym.make(SWING_UP, **kwargs).unwrapped.core_spec


def test_defaults_are_chosen_by_the_rod_and_say_their_error():
    default, steel, many = spec(), spec(youngs_modulus=2e11), spec(nodes=101)
    assert (default["config"]["stepper"], default["physics_dt"]) == ("verlet", 5e-4)
    assert steel["config"]["stepper"] == many["config"]["stepper"] == "esdirk3"
    for shown in (default, steel, many):
        assert 0 < shown["error"] <= 1e-4 and shown["warning"] is None
    assert "verlet 0.5 ms" in overview() and "verlet 0.5 ms" in describe(SWING_UP)


def test_what_is_asked_for_is_kept():
    kept = spec(stepper="implicit")
    assert (kept["config"]["stepper"], kept["physics_dt"], kept["error"]) == (
        "implicit",
        1e-3,
        None,
    )
    kept = spec(stepper="esdirk3", physics_dt=0.01, youngs_modulus=2e11)
    assert kept["physics_dt"] == 0.01 and kept["error"] > 1e-4 and kept["warning"] is None
    assert spec(physics_dt=1e-3)["config"]["stepper"] == "implicit"
    with pytest.raises(ParameterError, match="stepper"):
        gym.make(SWING_UP, stepper="verlet", youngs_modulus=1e9)


@pytest.mark.parametrize(
    "make",
    [
        lambda: gym.make(SWING_UP, **WHIP),
        lambda: gym.make_vec(SWING_UP, num_envs=2, **WHIP),
        lambda: make_vec_env(SWING_UP, 2, env_kwargs=WHIP),
    ],
)
def test_what_cannot_be_promised_is_told_once(make):
    with pytest.warns(AccuracyWarning, match="after 1 s of free swing") as told:
        make()
    assert len([w for w in told if w.category is AccuracyWarning]) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        make()


@pytest.mark.parametrize(
    "fin",
    [
        {"youngs_modulus": 4e4},
        {"youngs_modulus": 2.5e5},
        {"youngs_modulus": 3e6},
        {"youngs_modulus": 2.5e5, "hydrodynamics": "morison"},
        {"youngs_modulus": 1e5, "hydrodynamics": "morison", "damping": 0.1238},
    ],
)
def test_a_beat_of_the_fin_is_within_one_percent(fin):
    assert max(errors(beat(**fin), beat(**fin, physics_dt=FINE))) < 0.01


def test_a_fin_whose_vibration_never_dies_is_told():
    fin = {"hydrodynamics": "morison", "youngs_modulus": 1e5}
    with pytest.warns(AccuracyWarning, match=r"youngs_modulus = 1\.000e5 Pa"):
        told = gym.make("rodgym/FinThrust-v0", **fin)
    assert "never dies" in told.unwrapped.core_spec["warning"]
    with warnings.catch_warnings():
        warnings.simplefilter("error", AccuracyWarning)
        for calm in (
            {**fin, "damping": 0.1238},
            {**fin, "physics_dt": 1e-3},
            {"youngs_modulus": 4e4},
        ):
            silent = gym.make("rodgym/FinThrust-v0", **calm)
            assert silent.unwrapped.core_spec["warning"] is None
