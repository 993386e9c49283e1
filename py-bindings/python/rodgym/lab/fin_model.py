"""The fin before a camera and on load cells: from parameters to what a bench records.

A drive pitches the fin; its angle is a part of the recording, so the model is pitched the same way.
What the bench does wrong is unknown, too: the camera's scale, tilt and place, the angle at which
the fin is clamped, the clock of the film against that of the bench, gain and bias of the cells.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from rodgym.errors import RodgymError
from rodgym.lab import shapes
from rodgym.lab.gauss_newton import Prior
from rodgym.lab.samples import cubic
from rodgym.lab.tracks import Array, Tracks
from rodgym.sim import Fin

#: What cells measure, by the name that the model has for it: the force with which the fin pulls its
#: mount along -x [N], and the torque of the drive about the pivot [N m].
LOADS = {"thrust": "mount_thrust", "torque": "torque"}
#: How the camera may be off: logarithm of the scale, tilt [rad], place of the pivot x and y [m].
CAMERA = ("scale", "tilt", "base_x", "base_y")
#: Deviations before the fit: of a camera that was not calibrated; of the clamp's angle [rad]; of
#: the logarithm of a cell's gain, and of its bias [N, N m]; of a parameter's logarithm.
TILT, PLACE, CLAMP, GAIN, BIAS, UNKNOWN = 0.1, 0.05, 0.02, 0.02, 0.1, 3.0
#: Step of the differences: logarithms of parameters, and the clamp's angle [rad].
STEP = 1e-4
#: Physics step of a fin of its given nodes, and of one with more [s].
PHYSICS_DT, FINE_DT = 1 / 300, 1 / 600
#: Factor of the modulus where the clamp holds the fin.
CLAMPED = 1e3


@dataclass(frozen=True)
class Recording:
    """A fin that starts straight and at rest, and is pitched by its drive.

    Parameters
    ----------
    tracks: markers, nose first, x downstream and y to the side [m]
    times: of the bench [s], rising
    pitch: of the drive at those times [rad]
    loads: what cells measured at those times, by name: `thrust` [N], `torque` [N m]
    clock: how well the film's clock is known against the bench's, a deviation [s]
    command: what the servo was told at the bench's times [rad], where that was recorded
    """

    tracks: Tracks
    times: Array
    pitch: Array
    loads: Mapping[str, Array] = field(default_factory=dict)
    clock: float = 0.02
    command: Array | None = None


def refined(keywords: Mapping[str, Any], parts: int) -> dict[str, Any]:
    """Keywords of the same fin with every edge cut in so many.

    Thickness and area are linear between the given nodes. The drive holds the fin from the pivot to
    the next given node, as it does with few nodes; there it bends on one side only, over half of a
    node's share of the length, and so half as much. The damping is that of each given node: more
    nodes share it.
    """
    if parts == 1:
        return dict(keywords)
    fin = Fin(**keywords)
    config = fin.config
    shape, profile = config["geometry"], np.array(config["stiffness_profile"])
    nodes = len(shape["widths"])
    at = np.linspace(0, nodes - 1, (nodes - 1) * parts + 1)

    def fine(values: npt.ArrayLike) -> Array:
        return np.interp(at, np.arange(nodes), np.asarray(values, np.float64))

    pivot = shape["pivot"] * parts
    stiffness = fine(profile)
    stiffness[pivot + 1 : pivot + parts] = CLAMPED
    stiffness[pivot + parts] *= 2.0
    return {
        **keywords,
        "damping": fin.parameters["damping"] / parts,
        "geometry": {
            "edge_length": shape["edge_length"] / parts,
            "height": shape["height"],
            "pivot": pivot,
            "widths": fine(shape["widths"]).tolist(),
            "areas": fine(shape["areas"]).tolist(),
        },
        "stiffness_profile": stiffness.tolist(),
    }


@dataclass(frozen=True)
class Motion:
    """What the model did at the end of every physics step.

    Parameters
    ----------
    times: [s], (steps,)
    positions, velocities: of the nodes, (steps, nodes, 2), NaN where nobody asked
    loads: by name, (steps,) each
    """

    times: Array
    positions: Array
    velocities: Array
    loads: dict[str, Array]


def pitched(
    keywords: Mapping[str, Any],
    times: Array,
    pitch: Array,
    loads: Sequence[str] = (),
    needed: npt.NDArray[np.int_] | None = None,
) -> Motion:
    """A fin that starts straight and at rest, pitched at even times.

    Parameters
    ----------
    needed: steps at which the state is wanted, rising; at the others it is NaN. None, and where
        loads are measured: all

    Raises
    ------
    RodgymError: no such fin, or a step that fails
    """
    fin = Fin(**{"physics_dt": float(times[1] - times[0]), **keywords})
    straight = fin.positions
    c, s = np.cos(pitch[0]), np.sin(pitch[0])
    fin.set_state(straight @ np.array([[c, s], [-s, c]]))
    shape = (len(times), *straight.shape)
    positions, velocities = np.full(shape, np.nan), np.full(shape, np.nan)
    measured, before = np.zeros((len(times), len(loads))), 0
    for k in (np.arange(len(times)) if needed is None or loads else needed).tolist():
        if k > before:
            fin.follow(pitch[before + 1 : k + 1])
            before = k
        positions[k], velocities[k] = fin.positions, fin.velocities
        if loads:
            found = fin.loads
            measured[k] = [found[LOADS[name]] for name in loads]
    return Motion(times, positions, velocities, dict(zip(loads, measured.T, strict=True)))


@dataclass(frozen=True)
class FinModel:
    """Recordings of one fin and one bench, and the model of them.

    The unknowns x are the logarithms of the free parameters, the four of `CAMERA`, the clamp's
    angle, the film's clock in each recording, and gain (its logarithm) and bias of each cell.

    Parameters
    ----------
    free: parameters to find
    known: keywords of the fin
    scale: deviation of the logarithm of the camera's scale before the fit
    places: of the markers as shares of the length, nose 0
    parts: into how many every edge is cut
    settle: what is not fitted, from the start of each recording [s]
    share: of each recording that is fitted, from its start
    """

    recordings: Sequence[Recording]
    free: tuple[str, ...]
    known: Mapping[str, Any]
    scale: float
    places: Array
    parts: int = 1
    settle: float = 0.0
    share: float = 1.0

    @property
    def loads(self) -> tuple[str, ...]:
        """Names of what cells measured in any recording."""
        return tuple(n for n in LOADS if any(n in one.loads for one in self.recordings))

    @property
    def camera(self) -> int:
        """Where the unknowns of the camera begin."""
        return len(self.free)

    @property
    def clamp(self) -> int:
        """Where the clamp's angle stands."""
        return self.camera + len(CAMERA)

    @property
    def clocks(self) -> int:
        """Where the clocks begin."""
        return self.clamp + 1

    @property
    def cells(self) -> int:
        """Where gain and bias of the cells begin."""
        return self.clocks + len(self.recordings)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.cells + 2 * len(self.loads)

    def start(self, values: Sequence[float], place: Array) -> Array:
        """Unknowns from parameters and the pivot's place in the film."""
        x = np.zeros(self.size)
        x[: self.camera] = np.log(values)
        x[self.camera + 2 : self.clamp] = place
        return x

    def prior(self, x: Array) -> Prior:
        """What is known before, about a start."""
        clocks = [max(one.clock, 1e-9) for one in self.recordings]
        return Prior(
            x.copy(),
            np.array(
                [UNKNOWN] * self.camera
                + [self.scale, TILT, PLACE, PLACE, CLAMP]
                + clocks
                + [GAIN, BIAS] * len(self.loads)
            ),
        )

    def strides(self) -> Array:
        """The longest step of each unknown."""
        return np.array(
            [1.0] * self.camera
            + [0.1, 0.1, 0.05, 0.05, 0.05]
            + [0.05] * len(self.recordings)
            + [0.1, 1.0] * len(self.loads)
        )

    def seen(self) -> tuple[Array, npt.NDArray[np.int_]]:
        """Everything that was recorded, NaN where it is not fitted, and its kind: 0 places, then
        the loads.
        """
        parts, kinds = [], []
        for one in self.recordings:
            first = one.times[0] + self.settle
            last = one.times[0] + self.share * (one.times[-1] - one.times[0])
            points = one.tracks.points.copy()
            frames = one.tracks.times
            # (A frame at the ends may be outside when the clock is corrected.)
            slack = 3 * one.clock
            early = frames < first + slack * (self.settle > 0)
            points[early | (frames > last - slack + 1e-9)] = np.nan
            parts.append(points.ravel())
            kinds.append(np.zeros(points.size, int))
            inside = (one.times >= first) & (one.times <= last)
            for kind, name in enumerate(self.loads, 1):
                if name in one.loads:
                    parts.append(np.where(inside, one.loads[name], np.nan))
                    kinds.append(np.full(len(one.times), kind))
        return np.concatenate(parts), np.concatenate(kinds)

    def parted(self, values: Array) -> list[dict[str, Array]]:
        """What belongs to each recording: `film` (frames, markers, 2), and loads by name."""
        found, first = [], 0
        for one in self.recordings:
            shape, size = one.tracks.points.shape, one.tracks.points.size
            own = {"film": values[first : first + size].reshape(shape)}
            first += size
            for name in (n for n in self.loads if n in one.loads):
                own[name] = values[first : first + len(one.times)]
                first += len(one.times)
            found.append(own)
        return found

    def predict(self, x: Array, differences: bool = True) -> tuple[Array, Array]:
        """What is recorded, and its derivatives by the unknowns; NaN where there is no such fin."""
        values = [self._recorded(one, i, x, differences) for i, one in enumerate(self.recordings)]
        return np.concatenate([v for v, _ in values]), np.concatenate([s for _, s in values])

    def _recorded(
        self, one: Recording, index: int, x: Array, differences: bool
    ) -> tuple[Array, Array]:
        """The same of one recording."""
        base, slopes = self._shown(one, index, x)
        for i in (*range(self.camera), self.clamp) if differences else ():
            there = x.copy()
            there[i] += STEP
            slopes[:, i] = (self._shown(one, index, there)[0] - base) / STEP
        return base, slopes

    def motion(self, one: Recording, x: Array, clock: float) -> Motion:
        """How the fin moves in a recording, at its frames at least.

        Raises
        ------
        RodgymError: there is no such fin
        """
        values = {name: float(v) for name, v in zip(self.free, np.exp(x), strict=False)}
        times, pitch = self._drive(one)
        keywords = refined({**self.known, **values}, self.parts)
        low, _ = between(times, one.tracks.times + clock)
        needed = np.unique(np.concatenate([low, low + 1]))
        return pitched(keywords, times, pitch + x[self.clamp], tuple(one.loads), needed)

    def outlines(self, x: Array, index: int = 0, points: int = 61) -> Array:
        """The fin as the camera has it in every frame of a recording, evenly from nose to tail,
        (frames, points, 2).
        """
        one, clock = self.recordings[index], float(x[self.clocks + index])
        along = replace(self, places=np.linspace(0.0, 1.0, points))
        places, _ = along._filmed(one, self.motion(one, x, clock), clock)
        return places @ self._turn(x).T + x[self.camera + 2 : self.clamp]

    def _turn(self, x: Array) -> Array:
        """Scale and tilt of the camera, as a matrix."""
        scale, tilt = np.exp(x[self.camera]), x[self.camera + 1]
        c, s = np.cos(tilt), np.sin(tilt)
        return np.asarray(scale * np.array([[c, -s], [s, c]]))

    def _drive(self, one: Recording) -> tuple[Array, Array]:
        """Even times over a recording, and the pitch there."""
        dt = float(self.known.get("physics_dt", PHYSICS_DT if self.parts == 1 else FINE_DT))
        # (Frames and samples after the share that is fitted stand still, and count nothing.)
        duration = self.share * (one.times[-1] - one.times[0])
        times = one.times[0] + dt * np.arange(int(duration / dt + 1e-9) + 2)
        return times, cubic(one.times, one.pitch, np.minimum(times, one.times[-1]))

    def _shown(self, one: Recording, index: int, x: Array) -> tuple[Array, Array]:
        """A recording as camera and cells make it, and derivatives by what they do wrong."""
        count = one.tracks.points.size + len(one.times) * len(one.loads)
        slopes = np.zeros((count, len(x)))
        try:
            motion = self.motion(one, x, x[self.clocks + index])
        except RodgymError:  # Beyond a parameter's range, or a step that fails.
            return np.full(count, np.nan), slopes
        places, rates = self._filmed(one, motion, x[self.clocks + index])
        turn = self._turn(x)
        image = places @ turn.T
        size = image.size
        slopes[:size, self.camera] = image.ravel()
        slopes[:size, self.camera + 1] = np.stack([-image[..., 1], image[..., 0]], -1).ravel()
        slopes[0:size:2, self.camera + 2] = 1.0
        slopes[1:size:2, self.camera + 3] = 1.0
        slopes[:size, self.clocks + index] = (rates @ turn.T).ravel()
        parts = [(image + x[self.camera + 2 : self.clamp]).ravel()]
        for name in (n for n in self.loads if n in one.loads):
            at = self.cells + 2 * self.loads.index(name)
            load = np.exp(x[at]) * cubic(motion.times, motion.loads[name], one.times)
            rows = slice(size, size + len(load))
            slopes[rows, at], slopes[rows, at + 1] = load, 1.0
            parts.append(load + x[at + 1])
            size += len(load)
        return np.concatenate(parts), slopes

    def _filmed(self, one: Recording, motion: Motion, clock: float) -> tuple[Array, Array]:
        """Places and velocities of the markers at the film's frames, (frames, markers, 2) each."""
        nodes = motion.positions.shape[1]
        marks = shapes.marks(self.places, nodes, smooth=self.parts > 1)
        dt = motion.times[1] - motion.times[0]
        low, share = between(motion.times, one.tracks.times + clock)
        u = share[:, np.newaxis, np.newaxis]
        x0, x1 = (marks @ motion.positions[i] for i in (low, low + 1))
        v0, v1 = (marks @ motion.velocities[i] for i in (low, low + 1))
        places = (
            (1 + 2 * u) * (1 - u) ** 2 * x0
            + u * (1 - u) ** 2 * dt * v0
            + u**2 * (3 - 2 * u) * x1
            + u**2 * (u - 1) * dt * v1
        )
        return places, (1 - u) * v0 + u * v1


def between(times: Array, at: Array) -> tuple[npt.NDArray[np.int_], Array]:
    """The step before each time, of even steps, and the share of the step that has passed."""
    after = np.clip((at - times[0]) / (times[1] - times[0]), 0, len(times) - 1)
    low = np.minimum((after + 1e-9).astype(int), len(times) - 2)
    return low, after - low
