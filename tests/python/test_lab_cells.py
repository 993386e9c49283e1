"""Promise: signals of load cells are read, calibrated, filtered, aligned and averaged as is said.

Compared with signals whose answer is known in closed form.
"""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("scipy")

from rodgym import lab
from rodgym.errors import ParameterError
from rodgym.lab import cells, clocks, phases

RATE = 300.0
TIMES = np.arange(3000) / RATE


def signals(**values):
    return cells.Signals(TIMES, values)


def test_a_calibration_is_the_line_and_says_how_sure_it_is():
    random, volts = np.random.default_rng(1), np.linspace(-1e-3, 1e-3, 21)
    inside = 0
    for _ in range(200):
        newtons = 1058.0 * volts - 0.2 + random.normal(0, 0.01, volts.shape)
        line = cells.calibrate_cell(volts, newtons)
        inside += abs(line.gain - 1058.0) < 1.96 * line.deviations[0]
        assert abs(line.residual - 0.01) < 0.006
    assert 175 <= inside <= 199
    exact = cells.calibrate_cell([0.0, 1.0, 2.0], [0.5, 2.5, 4.5])
    assert np.isclose(exact.newtons(np.array([3.0]))[0], 6.5)


def test_the_thesis_bands_are_stopped_and_the_rest_passes_without_a_shift():
    thrust = 0.1 + 0.05 * np.sin(2 * np.pi * 3.0 * TIMES)
    dirt = 0.2 * np.sin(2 * np.pi * 7.0 * TIMES) + 0.1 * np.sin(2 * np.pi * 55.0 * TIMES)
    clean = signals(thrust=thrust + dirt).without_bands().values["thrust"]
    inner = slice(600, -600)
    assert np.abs(clean - thrust)[inner].max() < 0.01
    # Any filter of scipy, or any function.
    from scipy import signal

    low = signal.iirfilter(4, 5.0, btype="lowpass", fs=RATE, output="sos")
    smooth = signals(thrust=thrust + dirt).filtered(low).values["thrust"]
    assert np.abs(smooth - thrust)[inner].max() < 0.02
    doubled = signals(thrust=thrust).filtered(lambda v: 2 * v)
    assert np.array_equal(doubled.values["thrust"], 2 * thrust)


@pytest.mark.parametrize(("offset", "rate"), [(0.0, 1.0), (1.2345, 1.0), (-0.71, 1.0004)])
def test_clocks_are_aligned_with_their_drift(offset, rate):
    """A chirp seen at 300 Hz and, by a clock that is off, at 120 Hz, with noise."""
    random = np.random.default_rng(2)
    true = np.arange(0.0, 20.0, 1 / RATE)

    def shown(t):
        return np.sin(2 * np.pi * (0.3 * t + 0.02 * t**2))

    reference = cells.Signals(true, {"angle": shown(true) + random.normal(0, 0.05, true.shape)})
    theirs = np.arange(3.0, 17.0, 1 / 120)
    noisy = shown(offset + rate * theirs) + random.normal(0, 0.05, theirs.shape)
    clock = clocks.align(reference, "angle", cells.Signals(theirs, {"pot": noisy}), "pot", 2.0)
    moved = cells.Signals(theirs, {"pot": noisy}).moved(clock)
    assert np.abs(moved.times - (offset + rate * theirs)).max() < 5e-3
    assert clock.alike > 0.98


def test_clocks_that_cannot_be_aligned_are_refused_by_name():
    sine = np.sin(2 * np.pi * 1.5 * TIMES)
    with pytest.raises(lab.ClockError, match="happens once"):
        clocks.align(signals(a=sine), "a", signals(b=sine), "b", 2.0)
    # Within half a period there is one place only.
    assert abs(clocks.align(signals(a=sine), "a", signals(b=sine), "b", 0.3).offset) < 1e-3
    noise = np.random.default_rng(3).normal(size=(2, len(TIMES)))
    with pytest.raises(lab.ClockError, match="alike nowhere"):
        clocks.align(signals(a=noise[0]), "a", signals(b=noise[1]), "b", 1.0)


def test_phase_averages_have_the_mean_and_the_noise_of_every_phase():
    period, random = 1 / 1.5, np.random.default_rng(4)
    clean = 0.1 + 0.06 * np.cos(4 * np.pi * TIMES / period)
    noisy = clean + random.normal(0, 0.02, TIMES.shape)
    found = phases.period_of(signals(thrust=noisy), "thrust")
    assert abs(found / (period / 2) - 1) < 1e-3
    average = phases.phase_average(signals(thrust=noisy), "thrust", period, bins=40)
    truth = 0.1 + 0.06 * np.cos(2 * average.phase)
    assert np.abs(average.mean - truth).max() < 5 * 0.02 / np.sqrt(average.counts.min())
    assert abs(np.median(average.deviation) / 0.02 - 1) < 0.1
    low, high = average.band
    place = np.minimum((np.mod(TIMES / period, 1) * 40).astype(int), 39)
    assert 0.93 < np.mean((noisy > low[place]) & (noisy < high[place])) < 0.97


def test_two_cells_are_thrust_and_torque():
    thrust, torque = cells.thrust_and_torque(np.array([1.0, 2.0]), np.array([1.5, 1.0]), 0.08)
    assert np.allclose(thrust, [2.5, 3.0]) and np.allclose(torque, [0.02, -0.04])


def test_tables_of_cells_are_read_in_their_units(tmp_path):
    path = tmp_path / "cells.csv"
    path.write_text("time [ms],left [mV],thrust [mN],spare\n0,1,2,3\n10,2,4,6\n20,3,6,9\n")
    read = lab.read_cells(path)
    assert np.allclose(read.times, [0, 0.01, 0.02]) and np.isclose(read.rate, 100)
    assert np.allclose(read.values["left"], [1e-3, 2e-3, 3e-3])
    assert np.allclose(read.values["thrust"], [2e-3, 4e-3, 6e-3])
    assert read.units == {"left": "v", "thrust": "n", "spare": ""}


@pytest.mark.parametrize(
    ("text", "error", "says"),
    [
        ("t,left\n0,1\n", lab.HeaderError, "not time"),
        ("time\n0\n", lab.HeaderError, "signals"),
        ("time,a,a\n0,1,1\n", lab.HeaderError, "named once"),
        ("time [h],a\n0,1\n", lab.UnitsError, "'h'"),
        ("time,a [kg]\n0,1\n", lab.UnitsError, "'kg'"),
        ("time,a\n0,1\n1,\n", lab.CellError, "line 3: a is empty"),
        ("time,a\n0,1\n0,2\n", lab.FramesError, "rise"),
    ],
)
def test_tables_that_are_none_are_refused_by_name(text, error, says, tmp_path):
    path = tmp_path / "cells.csv"
    path.write_text(text)
    with pytest.raises(error, match=says):
        lab.read_cells(path)


@pytest.mark.parametrize(
    ("call", "error", "says"),
    [
        (lambda: cells.calibrate_cell([1.0, 2.0], [1.0, 2.0]), ParameterError, "at least 3"),
        (lambda: cells.calibrate_cell([1.0] * 3, [1.0] * 3), ParameterError, "not all the same"),
        (lambda: signals(a=TIMES).without_bands([(100, 200)]), ParameterError, "half the rate"),
        (lambda: signals(a=TIMES).filtered(np.ones(3)), ParameterError, "sections"),
        (lambda: phases.phase_average(signals(a=TIMES), "a", 8.0), ParameterError, "half the rec"),
        (lambda: phases.phase_average(signals(a=TIMES), "a", 1.0, 5000), ParameterError, "bins"),
        (
            lambda: cells.Signals(np.array([0.0, 1.0, 3.0]), {"a": np.zeros(3)}).rate,
            lab.FramesError,
            "resampled",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(call, error, says):
    with pytest.raises(error, match=says):
        call()
