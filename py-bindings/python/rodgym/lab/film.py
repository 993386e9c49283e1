"""The pendulum before a camera: from parameters, camera and starts to where markers are seen.

A film is cut in pieces. Every piece has a start of its own, so that an error of the parameters
does not grow over the whole film (multiple shooting); one piece is the whole film.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rodgym.lab import shapes
from rodgym.lab.gauss_newton import Prior
from rodgym.lab.samples import cubic
from rodgym.lab.swings import swing
from rodgym.lab.tracks import Array, Tracks

#: How the camera may be off: logarithm of the scale, tilt [rad], place of the base x and y [m].
CAMERA = ("scale", "tilt", "base_x", "base_y")
CAMERA_DEVIATION = (0.1, 0.3, 0.05, 0.05)
#: What comes after them where a torque drives the rod: its clock less that of the film [s].
CLOCK, CLOCK_DEVIATION = "clock", 0.02
#: What every node has, so that it means another rod where there are more of them.
SHARED = "damping"
#: Step of its difference [s], and the longest time for which a torque is held [s].
CLOCK_STEP, HELD = 1e-4, 2.1e-3
#: Deviation of the logarithm of a parameter that nothing is known of: a factor of 20.
UNKNOWN = 3.0
#: Steps of the differences: logarithms of parameters, angles [rad], rates [rad/s].
STEPS = (1e-6, 1e-5, 1e-3)
#: The longest steps of the fit.
STRIDES = (0.5, 0.5, 10.0)


@dataclass(frozen=True)
class Rod:
    """What the model is made with: nodes, known parameters and the names of the free ones."""

    nodes: int
    smooth: bool
    known: Mapping[str, float]
    free: tuple[str, ...]
    #: Physics steps in the period of the slowest bending, about.
    steps: int
    #: Nodes that the damping is given for, each with so much; other numbers of nodes share it.
    shared: int | None = None

    @property
    def length(self) -> float:
        """Length of the rod [m]."""
        return self.known["length"]

    @property
    def shares(self) -> dict[str, float]:
        """What a node of this model has of each parameter that nodes share."""
        return {} if self.shared is None else {SHARED: (self.shared - 1) / (self.nodes - 1)}


@dataclass(frozen=True)
class Torque:
    """What drove the base.

    Parameters
    ----------
    times: [s], rising
    values: [N m], smooth in between; none before and after
    """

    times: Array
    values: Array

    @property
    def largest(self) -> float:
        """The most that it is, either way [N m]."""
        return float(np.abs(self.values).max())

    def __call__(self, at: Array) -> Array:
        """Torque at these times [N m]."""
        inside = (at >= self.times[0]) & (at <= self.times[-1])
        return np.where(inside, cubic(self.times, self.values, at), 0.0)


@dataclass(frozen=True)
class Film:
    """Tracks cut in pieces, and the model of them.

    The unknowns x are the logarithms of the free parameters, the four of `CAMERA`, the clock where
    there is a torque, then for each piece the coefficients of angles and of rates at its first
    frame.

    Parameters
    ----------
    places: of the markers along the rod [m]
    firsts: the first frame of each piece
    torque: on the base; None: the rod swings freely
    """

    tracks: Tracks
    places: Array
    rod: Rod
    firsts: tuple[int, ...]
    torque: Torque | None = None

    @property
    def shared(self) -> int:
        """Unknowns that all pieces have in common."""
        return len(self.rod.free) + len(self.bench)

    @property
    def bench(self) -> tuple[str, ...]:
        """Names of the unknowns of camera and clock."""
        return CAMERA if self.torque is None else (*CAMERA, CLOCK)

    @property
    def turned(self) -> int:
        """Where the camera's unknowns begin."""
        return len(self.rod.free)

    @property
    def pieces(self) -> list[tuple[int, int]]:
        """First frame and end of each piece."""
        ends = (*self.firsts[1:], len(self.tracks.times))
        return list(zip(self.firsts, ends, strict=True))

    def start(self, parameters: Array, camera: Array, at: tuple[Array, Array]) -> Array:
        """Unknowns from parameters, camera and coefficients of all frames."""
        parts = [np.concatenate([at[0][first], at[1][first]]) for first in self.firsts]
        return np.concatenate([np.log(parameters), camera, *parts])

    def prior(self, x: Array) -> Prior:
        """Hardly anything is known but that rods are smooth and cameras stand nearly straight."""
        mean, camera = np.zeros(len(x)), slice(len(self.rod.free), self.shared)
        mean[: self.shared] = x[: self.shared]
        mean[camera.start : camera.start + 2] = 0.0
        start = np.concatenate([shapes.ANGLES, shapes.RATES])
        free = np.full(len(self.rod.free), UNKNOWN)
        bench = (*CAMERA_DEVIATION, CLOCK_DEVIATION)[: len(self.bench)]
        mean[camera.start + len(CAMERA) : self.shared] = 0.0
        deviation = np.concatenate([free, bench, np.tile(start, len(self.firsts))])
        return Prior(mean, deviation)

    def strides(self) -> Array:
        """The longest step of each unknown."""
        logs, angles, rates = STRIDES
        start = np.repeat([angles, rates], shapes.SHAPES)
        camera = np.full(len(self.bench), 0.1)
        shared = np.concatenate([np.full(len(self.rod.free), logs), camera])
        return np.concatenate([shared, np.tile(start, len(self.firsts))])

    def residuals(self, x: Array) -> tuple[Array, Array]:
        """Model less film at every marker that was seen [m], and the derivatives."""
        seen = np.isfinite(self.tracks.points)
        model, slopes = self.predict(x)
        return (model - self.tracks.points)[seen], slopes[seen]

    def gaps(self, x: Array) -> Array:
        """The residuals alone."""
        seen = np.isfinite(self.tracks.points)
        return (self._filmed(self._swings(x, differences=False)[0], x) - self.tracks.points)[seen]

    def outlines(self, x: Array, points: int = 61) -> Array:
        """The rod in every frame as the camera has it, from base to tip, (frames, points, 2)."""
        along = replace(self, places=np.linspace(0.0, self.rod.length, points))
        return self._filmed(along._swings(x, differences=False)[0], x)

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Where markers are seen (frames, markers, 2), and the derivatives (..., unknowns)."""
        places, slopes = self._swings(x)
        frees = len(self.rod.free)
        turn = self._turn(x)
        model = places @ turn.T
        image = np.matmul(turn, slopes)
        image[..., frees] = model
        image[..., frees + 1] = np.stack([-model[..., 1], model[..., 0]], axis=-1)
        image[..., 0, frees + 2] = 1.0
        image[..., 1, frees + 3] = 1.0
        return self._filmed(places, x), image

    def _turn(self, x: Array) -> Array:
        """Scale and tilt of the camera, as a matrix."""
        scale, tilt = np.exp(x[len(self.rod.free)]), x[len(self.rod.free) + 1]
        c, s = np.cos(tilt), np.sin(tilt)
        return np.asarray(scale * np.array([[c, -s], [s, c]]))

    def _filmed(self, places: Array, x: Array) -> Array:
        """What the camera makes of places on the rod."""
        return places @ self._turn(x).T + x[self.turned + 2 : self.turned + 4]

    def _swings(self, x: Array, differences: bool = True) -> tuple[Array, Array]:
        """Markers on the rods of all pieces, by one batch with a rod more for each difference."""
        shared, width = self.shared, 2 * shapes.SHAPES
        frees, clock = len(self.rod.free), shared - self.turned - len(CAMERA)
        common = frees + clock
        steps = np.concatenate(
            [
                np.full(frees, STEPS[0]),
                np.full(clock, CLOCK_STEP),
                np.repeat(STEPS[1:], shapes.SHAPES),
            ]
        )
        own = np.concatenate([x[:frees], x[shared - clock : shared]])
        base = [
            np.concatenate([own, x[shared + i * width : shared + (i + 1) * width]])
            for i in range(len(self.firsts))
        ]
        moved = np.zeros((1, len(steps)))
        if differences:
            moved = np.vstack([moved, np.diag(steps)])
        rows = np.vstack([row + moved for row in base])
        seen = self._seen(rows).reshape(len(base), len(moved), -1, len(self.places), 2)
        frames = len(self.tracks.times)
        places = np.empty((frames, len(self.places), 2))
        slopes = np.zeros((frames, len(self.places), 2, len(x) if differences else 0))
        for i, (first, end) in enumerate(self.pieces):
            piece = seen[i, :, : end - first]
            places[first:end] = piece[0]
            if differences:
                change = np.moveaxis(piece[1:] - piece[0], 0, -1) / steps
                slopes[first:end, ..., :frees] = change[..., :frees]
                slopes[first:end, ..., shared - clock : shared] = change[..., frees:common]
                starts = slice(shared + i * width, shared + (i + 1) * width)
                slopes[first:end, ..., starts] = change[..., common:]
        return places, slopes

    def _seen(self, rows: Array) -> Array:
        """Markers (rows, frames of the longest piece, markers, 2) of rods with these numbers."""
        frees, shape = len(self.rod.free), shapes.edges(self.rod.nodes)
        coefficients = rows[:, frees + (self.torque is not None) :]
        dt = self.tracks.frame_time
        # Frames of each piece from its start, in steps of the camera; between two, by the cubic
        # through positions and velocities.
        times = [(self.tracks.times[a:b] - self.tracks.times[a]) / dt for a, b in self.pieces]
        longest = max(len(t) for t in times)
        after = np.array([np.pad(t, (0, longest - len(t)), mode="edge") for t in times])
        whole = np.floor(after + 1e-6)
        share = np.where(np.abs(after - whole) < 1e-3, 0.0, after - whole)
        needed = np.unique(np.concatenate([whole.ravel(), (whole + (share > 0)).ravel()]))
        shares = self.rod.shares
        parameters = {
            name: shares.get(name, 1.0) * np.exp(rows[:, i]) for i, name in enumerate(self.rod.free)
        }
        known = {name: shares.get(name, 1.0) * value for name, value in self.rod.known.items()}
        positions, velocities = swing(
            {**known, "nodes": self.rod.nodes, **self._timing(rows[0])},
            parameters,
            coefficients[:, : shapes.SHAPES] @ shape.T,
            coefficients[:, shapes.SHAPES :] @ shape.T,
            needed * self.held,
            self._torques(rows, int(needed[-1])),
        )
        marks = shapes.marks(self.places / self.rod.length, self.rod.nodes, self.rod.smooth)
        x, v = (np.matmul(marks, state) for state in (positions, velocities))
        piece = np.repeat(np.arange(len(times)), len(rows) // len(times))
        low = np.searchsorted(needed, whole)[piece]
        high = np.searchsorted(needed, whole + (share > 0))[piece]
        u = share[piece][..., np.newaxis, np.newaxis]
        row = np.arange(len(rows))[:, np.newaxis]
        return (
            (1 + 2 * u) * (1 - u) ** 2 * x[row, low]
            + u * (1 - u) ** 2 * dt * v[row, low]
            + u**2 * (3 - 2 * u) * x[row, high]
            + u**2 * (u - 1) * dt * v[row, high]
        )

    @property
    def held(self) -> int:
        """Into how many parts a frame is cut, in each of which a torque is held."""
        return 1 if self.torque is None else int(np.ceil(self.tracks.frame_time / HELD))

    def _torques(self, rows: Array, frames: int) -> Array | None:
        """Torque on each rod in the middle of each part of so many frames (rows, parts) [N m]."""
        if self.torque is None:
            return None
        part = self.tracks.frame_time / self.held
        starts = np.repeat(self.tracks.times[list(self.firsts)], len(rows) // len(self.firsts))
        starts = starts + rows[:, len(self.rod.free)]
        return self.torque(np.add.outer(starts, part * (np.arange(frames * self.held) + 0.5)))

    def _timing(self, row: Array) -> dict[str, object]:
        """Scheme and step: fine against the slowest bending, coarse against the camera."""
        values = {**self.rod.known, **dict(zip(self.rod.free, np.exp(row), strict=False))}
        speed = values["width"] * np.sqrt(values["youngs_modulus"] / (12 * values["density"]))
        period = 2 * np.pi / 15.42 * self.rod.length**2 / speed
        fine = np.clip(period / self.rod.steps, self.tracks.frame_time / 64, 1 / 480)
        dt = self.tracks.frame_time / self.held
        motor = {} if self.torque is None else {"torque_limit": 1.001 * self.torque.largest}
        return {
            "stepper": "esdirk3",
            "control_dt": dt,
            "physics_dt": dt / int(np.ceil(dt / fine - 1e-9)),
            **motor,
        }
