"""Synthetic recordings of a fin: a hidden fin before a camera and on load cells with flaws.

The fin is simulated with more nodes, by another scheme and with a smaller step than any fit. A
hidden fin is continuous: its motion is that of infinitely many nodes, as three numbers of nodes
tell it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from rodgym.lab import shapes
from rodgym.lab.bench import Flaws, filmed
from rodgym.lab.fin_model import LOADS, Recording, refined
from rodgym.lab.tracks import Array
from rodgym.sim import Fin

#: Into how many every edge of the given geometry is cut (113 nodes of eight), and physics steps of
#: backward Euler in a sample of the bench at 300 Hz.
PARTS, SUBSTEPS = 16, 48
#: What motions with a quarter, half and all of these parts count: errors that fall with the length
#: of an edge and with its square cancel.
LIMIT = {4: 1 / 3, 2: -6 / 3, 1: 8 / 3}


@dataclass(frozen=True)
class FinBench:
    """A fin that is pitched by a sine which sets in over its first period.

    Parameters
    ----------
    fin: keywords of the hidden fin
    amplitude: of the pitch [rad]
    frequency: [Hz]
    periods: of the recording, at least
    rate: of the camera [Hz]
    sampling: of the bench [Hz], a multiple of the camera's
    markers: evenly from nose to tail
    noise: deviations of the loads by name [N, N m]; what is not named is not measured
    gain, bias: what the cells make of 1, and what they add [N, N m]
    clamp: angle at which the fin sits on its drive [rad]
    parts: into how many every edge of the geometry is cut, a multiple of four; or 1: the fin is one
        of its geometry's nodes
    """

    fin: Mapping[str, Any] = field(default_factory=dict)
    amplitude: float = 0.15
    frequency: float = 1.5
    periods: float = 10.0
    rate: float = 30.0
    sampling: float = 300.0
    markers: int = 8
    flaws: Flaws = field(default_factory=Flaws)
    noise: Mapping[str, float] = field(default_factory=lambda: {"thrust": 5e-3})
    gain: float = 1.0
    bias: float = 0.0
    clamp: float = 0.0
    parts: int = PARTS
    substeps: int = SUBSTEPS

    def pitch(self, times: Array) -> Array:
        """Of the drive [rad]."""
        x = np.minimum(times * self.frequency, 1.0)
        ramp = x**3 * (10 - 15 * x + 6 * x**2)
        return ramp * self.amplitude * np.sin(2 * np.pi * self.frequency * times)


def record_fin(bench: FinBench, seed: int) -> Recording:
    """Film and load cells of a hidden fin."""
    every = round(bench.sampling / bench.rate)
    frames = int(np.ceil(bench.periods / bench.frequency * bench.rate))
    samples = np.arange(frames * every + 1)
    limit = {1: 1.0} if bench.parts == 1 else LIMIT
    moved = [moves(bench, bench.parts // share, samples, every) for share in limit]
    points, loads = (
        sum(weight * values for weight, values in zip(limit.values(), each, strict=True))
        for each in zip(*moved, strict=True)
    )
    tracks = filmed(points, bench.rate, bench.flaws, seed)
    random = np.random.default_rng([seed, 1])
    times = samples / bench.sampling
    return Recording(
        tracks,
        times,
        bench.pitch(times),
        {
            name: bench.gain * values + bench.bias + random.normal(0, bench.noise[name], len(times))
            for name, values in zip(LOADS, loads.T, strict=True)
            if name in bench.noise
        },
    )


def moves(
    bench: FinBench, parts: int, samples: npt.NDArray[np.int_], every: int
) -> tuple[Array, Array]:
    """Markers (frames, markers, 2) and loads (samples, loads) of a fin of so many parts."""
    step = 1 / (bench.sampling * bench.substeps)
    fin = Fin(**{**refined(bench.fin, parts), "stepper": "backward_euler", "physics_dt": step})
    straight = fin.positions
    c, s = np.cos(bench.clamp), np.sin(bench.clamp)
    fin.set_state(straight @ np.array([[c, s], [-s, c]]))
    seen, loads = [], np.zeros((len(samples), len(LOADS)))
    for k in samples:
        if k > 0:
            ends = step * ((k - 1) * bench.substeps + np.arange(1, bench.substeps + 1))
            fin.follow(bench.clamp + bench.pitch(ends))
            found = fin.loads
            loads[k] = [found[name] for name in LOADS.values()]
        if k % every == 0:
            seen.append(fin.positions)
    marks = shapes.marks(np.linspace(0.0, 1.0, bench.markers), len(straight), smooth=True)
    return np.einsum("mn,fni->fmi", marks, np.array(seen)), loads
