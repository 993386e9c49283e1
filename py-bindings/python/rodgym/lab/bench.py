"""Synthetic recordings: a hidden rod before a camera with flaws, to test fits on.

The rod is simulated with more nodes, by another scheme and with a smaller step than any fit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rodgym.lab import shapes
from rodgym.lab.film import SHARED
from rodgym.lab.swings import swing
from rodgym.lab.tracks import Array, Tracks

#: What a rod has where nothing else is said.
ROD = {
    "youngs_modulus": 1e7,
    "bending_damping": 5e-4,
    "width": 0.007,
    "length": 0.3,
    "density": 1500.0,
    "damping": 0.0,
    "gravity": 9.81,
}
#: Nodes of a hidden rod, and physics steps in a frame at 30 Hz.
NODES, SUBSTEPS = 241, 128
#: Nodes that the damping of a continuous rod is given for.
SHARING = 7


@dataclass(frozen=True)
class Flaws:
    """What a camera and who reads its film do wrong."""

    #: Standard deviation of each coordinate [m].
    noise: float = 5e-4
    #: Turn of the camera [rad], counter-clockwise as the rod is seen.
    tilt: float = 0.0
    #: What is seen of a metre [m].
    scale: float = 1.0
    #: Where the base is seen [m].
    base: tuple[float, float] = (0.0, 0.0)
    #: Time of the first frame [s].
    clock: float = 0.0
    #: Shares of frames that are missing, of markers that are lost and that are somewhere else.
    dropped: float = 0.0
    lost: float = 0.0
    outliers: float = 0.0
    #: How far an outlier is off, as a standard deviation [m].
    far: float = 0.03
    #: Two markers, counted from 1, that change their names in the middle third of the film.
    swapped: tuple[int, int] | None = None


@dataclass(frozen=True)
class Bench:
    """A rod that is let go and filmed while it swings freely.

    Parameters
    ----------
    rod: parameters that differ from `ROD`; `nodes` makes it one of so many nodes. The damping of
        a continuous rod is that of each of seven nodes
    angle, bend: of the base from hanging, and the turn from base to tip, when it is let go [rad]
    waited: time from then to the first frame [s]
    torque: on the base [N m] as a function of the film's time, 0 before the first frame
    """

    rod: Mapping[str, float] = field(default_factory=dict)
    angle: float = 1.2
    bend: float = 0.6
    waited: float = 0.1
    seconds: float = 3.0
    rate: float = 30.0
    markers: int = 7
    flaws: Flaws = Flaws()
    torque: Callable[[Array], Array] | None = None

    def keywords(self) -> dict[str, float]:
        """Every parameter of the hidden rod."""
        own = {**ROD, **{name: value for name, value in self.rod.items() if name != "nodes"}}
        if self.rod.get("nodes") is None:
            # (As they swing: the tip's node has the share of a whole edge, which counts as 1.5.)
            own[SHARED] *= (SHARING - 1) / (NODES - 1 + 1.5)
        return own


def record(benches: Sequence[Bench], seeds: Sequence[int]) -> list[Tracks]:
    """Films of all benches, whose rates, seconds and nodes are the same; a seed for each camera."""
    first = benches[0]
    nodes = int(first.rod.get("nodes", NODES))
    shares = (np.arange(nodes - 1) + 0.5) / (nodes - 1)
    start = np.array([b.angle + b.bend * (1 - np.cos(np.pi * shares)) / 2 for b in benches])
    # Let go once, seen twice: the wait in steps of its own.
    steps = round(first.rate * 40)
    waits = [round(b.waited * steps) for b in benches]
    frames = round(first.seconds * first.rate)
    every = round(steps / first.rate)
    needed = np.unique(np.add.outer(waits, every * np.arange(frames)))
    parameters = [b.keywords() for b in benches]
    torques = np.zeros((len(benches), int(needed[-1])))
    for row, bench, wait in zip(torques, benches, waits, strict=True):
        if bench.torque is not None:
            row[wait:] = bench.torque((np.arange(len(row) - wait) + 0.5) / steps)
    limit = 1.001 * float(np.abs(torques).max())
    positions, _ = swing(
        {
            "nodes": nodes,
            "stepper": "tr_bdf2",
            "control_dt": 1 / steps,
            "physics_dt": 1 / steps / max(1, round(SUBSTEPS * 30 / steps)),
            **({"torque_limit": limit} if limit > 0 else {}),
        },
        {name: np.array([own[name] for own in parameters]) for name in ROD},
        start,
        np.zeros_like(start),
        needed,
        torques if limit > 0 else None,
    )
    films = []
    for bench, wait, seed, nodes_seen in zip(benches, waits, seeds, positions, strict=True):
        places = np.linspace(0.0, 1.0, bench.markers)
        marks = shapes.marks(places, nodes, smooth=bench.rod.get("nodes") is None)
        chosen = np.searchsorted(needed, wait + every * np.arange(frames))
        points = np.einsum("mn,fni->fmi", marks, nodes_seen[chosen])
        films.append(filmed(points, bench.rate, bench.flaws, seed))
    return films


def filmed(points: Array, rate: float, flaws: Flaws, seed: int) -> Tracks:
    """True places of markers (frames, markers, 2) as a camera with flaws records them."""
    random = np.random.default_rng(seed)
    c, s = np.cos(flaws.tilt), np.sin(flaws.tilt)
    seen = flaws.scale * points @ np.array([[c, s], [-s, c]]) + flaws.base
    seen += random.normal(0.0, flaws.noise, seen.shape)
    wrong = random.random(seen.shape[:2]) < flaws.outliers
    seen[wrong] += random.normal(0.0, flaws.far, (int(wrong.sum()), 2))
    seen[random.random(seen.shape[:2]) < flaws.lost] = np.nan
    if flaws.swapped is not None:
        one, other = (marker - 1 for marker in flaws.swapped)
        middle = slice(len(seen) // 3, 2 * len(seen) // 3)
        seen[middle, [one, other]] = seen[middle, [other, one]]
    times = flaws.clock + np.arange(len(seen)) / rate
    there = random.random(len(seen)) >= flaws.dropped
    return Tracks(times[there], seen[there])
