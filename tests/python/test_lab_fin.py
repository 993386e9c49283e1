"""Promise: a fin that is pitched in air gives its E and damping, or is named as too stiff to tell.

The recordings are *synthetic*: our fin with smaller steps, before a camera with noise, a wrong
scale and a pivot that is off.
"""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from rodgym import lab
from rodgym.errors import ParameterError
from rodgym.lab.fin_in_air import cost_of, moved

FRAMES, STEPS, NOISE = 60, 12, 5e-4
TRUTH = {"youngs_modulus": 2.5e5, "damping": 0.1238}
#: The recordings are those of a fin that has eight nodes itself.
EIGHT = {"nodes": 8}
CASES = [(a, f) for a in (6.0, 10.0) for f in (1.0, 2.0)]


def pitched(amplitude, frequency, steps):
    t = np.arange(1, FRAMES * steps + 1) / (30 * steps)
    x, turn = np.minimum(t * frequency, 1.0), 2 * np.pi * frequency * t
    return x**3 * (10 - 15 * x + 6 * x**2) * np.radians(amplitude) * np.sin(turn)


def recorded(truth, scale=1.0, place=0.0, seed=0, fine=5):
    """Experiments: made with `fine` times smaller steps than they are fitted with."""
    random, found = np.random.default_rng(seed), []
    for case in CASES:
        seen = moved(pitched(*case, fine * STEPS), fine * STEPS, truth)
        noisy = scale * seen + place + random.normal(0.0, NOISE, seen.shape)
        found.append(lab.Experiment(noisy, pitched(*case, STEPS)))
    return found


@pytest.fixture(scope="module")
def soft():
    return recorded(TRUTH, scale=1.02, place=3e-3)


def test_a_soft_fin_gives_its_modulus_and_damping(soft):
    fit = lab.fit_fin(soft, known=EIGHT, start={"youngs_modulus": 1e6, "damping": 0.03})
    for name, most in (("youngs_modulus", 0.03), ("damping", 0.2)):
        best, low, high = fit.parameters[name]
        assert abs(best / TRUTH[name] - 1) < most, name
        assert 2 * low - best < TRUTH[name] < 2 * high - best
    assert fit.not_identifiable == {}
    assert abs(fit.camera["scale"].value - 1.02) < 2e-3
    assert abs(fit.camera["base_y"].value - 3e-3) < 2e-4
    assert abs(fit.sigma / NOISE - 1) < 0.05 and max(fit.errors) < 1.1 * NOISE
    # The twin: an environment of that fin.
    env = gym.make("rodgym/FinThrust-v0", rod=fit)
    drawn = env.reset(seed=0)[1]["parameters"]
    assert drawn["youngs_modulus"] != fit.parameters["youngs_modulus"].value
    assert abs(drawn["youngs_modulus"] / TRUTH["youngs_modulus"] - 1) < 0.1


def test_lost_positions_and_outliers_do_not_change_the_result(soft):
    random, dirty = np.random.default_rng(1), []
    for one in soft:
        seen = one.sideways.copy()
        seen[random.random(seen.shape) < 0.1] = np.nan
        far = random.random(seen.shape) < 0.05
        seen[far] += random.normal(0.0, 0.03, int(far.sum()))
        dirty.append(lab.Experiment(seen, one.pitch))
    fit = lab.fit_fin(dirty, known=EIGHT)
    assert abs(fit.parameters["youngs_modulus"].value / 2.5e5 - 1) < 0.03
    assert "outliers" in " ".join(fit.notes)


def test_a_stiff_fin_is_named_as_not_identifiable():
    stiff = recorded({"youngs_modulus": 8e8, "damping": 0.1238})
    fit = lab.fit_fin(stiff, known=EIGHT)
    assert "faster" in fit.not_identifiable["youngs_modulus"]
    assert fit.as_dict()["parameters"].keys().isdisjoint(fit.not_identifiable)
    with pytest.raises(lab.RecordingError, match="does not tell"):
        gym.make("rodgym/FinThrust-v0", rod=fit)


def test_the_thesis_cost_is_its_equation():
    gaps = [np.array([[3.0, 4.0]]), np.array([[0.0, np.nan], [2.0, 0.0]])]
    assert cost_of(gaps) == 7.0


@pytest.mark.parametrize(
    ("experiments", "words", "error", "says"),
    [
        ([], {}, ParameterError, "at least one"),
        ([lab.Experiment(np.zeros((5, 3)), np.zeros(10))], {}, ParameterError, "8 nodes"),
        ([lab.Experiment(np.zeros((5, 8)), np.zeros(11))], {}, lab.FramesError, "11 pitches"),
        (
            [lab.Experiment(np.zeros((5, 8)), np.zeros(10))],
            {"free": ["width"]},
            ParameterError,
            "free",
        ),
        (
            [lab.Experiment(np.zeros((5, 8)), np.zeros(10))],
            {"start": {"damping": 0.0}},
            ParameterError,
            "above 0",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(experiments, words, error, says):
    with pytest.raises(error, match=says):
        lab.fit_fin(experiments, **words)
