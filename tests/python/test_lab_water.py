"""Promise: the water's force on a fin follows from its tracks as the simulation has it.

The tracks are *synthetic*: our own fin, seen with noise; the truth is the thrust that the core
computed while it swam, which the tracks do not have.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("scipy")

from rodgym import lab, sim
from rodgym.errors import ParameterError
from rodgym.lab.bench import Flaws
from rodgym.lab.fin_bench import FinBench, record_fin

SECONDS, FREQUENCY, AMPLITUDE, NOISE = 1.6, 1.5, np.radians(8), 2e-4


@pytest.fixture(scope="module")
def swum():
    """Times, positions of all nodes and thrust of a fin that pitches, after its first second."""
    fin, times, positions, thrust = sim.Fin(), [], [], []
    for k in range(round((1.0 + SECONDS) / fin.physics_dt)):
        t = (k + 1) * fin.physics_dt
        fin.step(AMPLITUDE * np.sin(2 * np.pi * FREQUENCY * t) * min(1.0, t / 0.5))
        if t > 1.0:
            times.append(t)
            positions.append(fin.positions)
            thrust.append(fin.thrust)
    return np.array(times), np.array(positions), np.array(thrust)


def noisy(points, seed=0):
    return points + np.random.default_rng(seed).normal(0.0, NOISE, points.shape)


def test_thrust_from_tracks_is_that_of_the_simulation(swum):
    times, positions, thrust = swum
    force = lab.fluid_force(lab.Tracks(times, noisy(positions)), window=0.08)
    inner = slice(20, -20)
    gap = (force.thrust - thrust)[inner]
    assert abs(force.noise / NOISE - 1) < 0.1
    assert np.sqrt(np.mean(gap**2)) < 0.2 * np.std(thrust)
    assert abs(np.mean(gap)) < 0.03 * np.mean(thrust[inner])
    low, high = force.band
    assert 0.85 < np.mean((thrust > low)[inner] & (thrust < high)[inner]) < 1.0
    assert np.allclose(sum(force.parts.values()), force.force)


def test_without_noise_a_short_window_leaves_little(swum):
    times, positions, thrust = swum
    force = lab.fluid_force(lab.Tracks(times, positions), window=0.04)
    assert np.abs(force.thrust - thrust)[20:-20].max() < 0.05 * np.std(thrust)


def test_the_thrust_at_the_mount_is_what_a_load_cell_measures_over_the_phase(tmp_path):
    """The figure of the thesis' 3.11 and 3.13: cell and model on the measured motion."""
    plots = pytest.importorskip("rodgym.lab.force_figure")
    bench = FinBench(rate=100.0, parts=1, substeps=4, periods=4.5, flaws=Flaws(noise=1e-4))
    recording = record_fin(bench, 3)
    force = lab.fluid_force(recording.tracks, window=0.08)
    cell, model = plots.thrust_over_phase(recording, force)
    assert abs(cell.period * bench.frequency - 1) < 3e-3
    # Twice a beat, and where the pitch goes up through 0 the phase is 0.
    assert np.sqrt(np.mean((cell.mean - model.mean) ** 2)) < 0.1 * np.std(cell.mean)
    turn = np.exp(1j * (cell.phase - np.pi / 2))
    angles = np.angle([np.sum(one.mean * turn**2) for one in (cell, model)])
    assert abs(angles[0] - angles[1]) < 0.1
    plots.write_force_figure(tmp_path / "force.png", recording, force)
    assert (tmp_path / "force.png").stat().st_size > 10_000
    with pytest.raises(lab.RecordingError, match="no cell"):
        plots.thrust_over_phase(replace(recording, loads={}), force)
    with pytest.raises(lab.RecordingError, match="periods"):
        plots.thrust_over_phase(recording, force, period=2.0)


def test_lost_markers_and_markers_between_nodes_are_bridged(swum):
    times, positions, thrust = swum
    clean = lab.fluid_force(lab.Tracks(times, noisy(positions)), window=0.1).thrust
    random = np.random.default_rng(1)
    lost = noisy(positions)
    lost[random.random(lost.shape[:2]) < 0.1] = np.nan
    bridged = lab.fluid_force(lab.Tracks(times, lost), window=0.1).thrust
    assert np.sqrt(np.mean((bridged - clean)[20:-20] ** 2)) < 0.15 * np.std(thrust)
    # Fifteen markers, at the nodes and between them.
    between = np.repeat(positions, 2, axis=1)[:, :-1]
    between[:, 1::2] = 0.5 * (positions[:, 1:] + positions[:, :-1])
    dense = lab.fluid_force(lab.Tracks(times, noisy(between)), window=0.1).thrust
    assert np.sqrt(np.mean((dense - clean)[20:-20] ** 2)) < 0.15 * np.std(thrust)


@pytest.mark.parametrize(
    ("change", "words", "error", "says"),
    [
        (lambda p: p, {"window": 0.01}, lab.FramesError, "fewer than 5 frames"),
        (lambda p: p, {"window": 0.08, "viscosity": 1.0}, ParameterError, "viscosity"),
        (lambda p: p, {"window": 0.08, "places": [0.0, 1.0]}, ParameterError, "8 rising"),
    ],
)
def test_what_makes_no_sense_is_refused(change, words, error, says, swum):
    times, positions, _ = swum
    with pytest.raises(error, match=says):
        lab.fluid_force(lab.Tracks(times, change(positions)), **words)


def test_a_marker_that_was_never_seen_is_refused(swum):
    times, positions, _ = swum
    hidden = positions.copy()
    hidden[:, 3] = np.nan
    with pytest.raises(lab.RecordingError, match="marker 4"):
        lab.fluid_force(lab.Tracks(times, hidden), window=0.08)
