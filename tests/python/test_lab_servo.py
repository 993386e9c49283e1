"""Promise: commands beside the pitch tell the servo, and the twin has it. Bench is *synthetic*."""

from __future__ import annotations

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from rodgym import lab
from rodgym.lab.fin_bench import FinBench, record_fin
from rodgym.sim import Fin

TRUTH = {"actuator_gain": 0.93, "command_cutoff": 4.2}
RATE, FINER = 300, 4


def commanded(seed=0, amplitude=0.15):
    """A servo in steps four times as fine as the bench's, seen with 1 mrad of noise."""
    times = np.arange(0, 3.0, 1 / RATE)
    command = amplitude * np.sin(2 * np.pi * (0.5 + 0.6 * times) * times)
    fin = Fin(hydrodynamics="air", physics_dt=1 / (RATE * FINER), **TRUTH)
    pitch = [0.0]
    for value in command[:-1]:
        fin.drive(float(value), FINER)
        edge = fin.positions[3] - fin.positions[2]
        pitch.append(np.arctan2(edge[1], edge[0]))
    noisy = np.array(pitch) + 0.01 + np.random.default_rng(seed).normal(0, 1e-3, len(pitch))
    tracks = lab.Tracks(times[::10], np.zeros((len(times[::10]), 8, 2)))
    return lab.Recording(tracks, times, noisy, command=command)


def test_commands_tell_gain_and_cut_off():
    found = lab.fit_servo([commanded(0), commanded(1)])
    for name, truth in TRUTH.items():
        best, low, high = found[name]
        assert abs(best / truth - 1) < 0.01, name
        assert high / low < 1.02


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        (lambda r: replace(r, command=None), lab.RecordingError, "no recording"),
        (lambda r: replace(r, command=r.command[:-1]), lab.FramesError, "as many"),
        (lambda r: replace(r, times=r.times**1.1), lab.FramesError, "even samples"),
    ],
)
def test_commands_that_make_no_sense_are_refused(change, error, says):
    with pytest.raises(error, match=says):
        lab.fit_servo([change(commanded())])


def test_a_servo_that_is_told_to_hold_still_is_not_known():
    with pytest.raises(lab.RecordingError, match="do not tell"):
        lab.fit_servo([commanded(amplitude=0.0)])


def test_what_is_no_such_servo_is_refused():
    with pytest.raises(lab.MisfitError, match="no servo"):
        lab.fit_servo([replace(commanded(), command=commanded().pitch)])


class Served(FinBench):
    """A fin that the servo pitches."""

    servo = commanded()

    def pitch(self, times):
        return np.interp(times, self.servo.times, self.servo.pitch - 0.01)


def test_the_twin_has_the_servo():
    recording = record_fin(Served(fin={"youngs_modulus": 3e5}, periods=4.0, parts=1), 2)
    size = len(recording.times)
    told = replace(recording, command=Served.servo.command[:size])
    fit = lab.fit_fin([told], free=["youngs_modulus"], known={"nodes": 8})
    config = gym.make("rodgym/FinThrust-v0", rod=fit).unwrapped.config
    for name, (best, *_) in fit.servo.items():
        assert abs(best / TRUTH[name] - 1) < 0.03
        assert config[name] == pytest.approx(best)
        assert fit.as_dict()["servo"][name]["value"] == best
