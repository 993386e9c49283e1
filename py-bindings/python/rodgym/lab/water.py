"""The water's force on a fin from its measured motion, by the model's own terms (thesis 3.4.3).

Positions and velocities come from the tracks by local polynomials; what the water does in such a
state comes from the core (`rodgym.sim.Fin.forces`). The force is

    F = -dp/dt + dT/dq + G + R,

with the momentum p of the water, the gradient of its energy T, the flux G of the wake, and drag and
friction R, summed over the nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rodgym._checks import refused
from rodgym.lab import shapes
from rodgym.lab.errors import FramesError, RecordingError
from rodgym.lab.tracks import Array, Tracks
from rodgym.sim import Fin

#: Degree of the local polynomials: the acceleration may change within a window.
DEGREE = 3
#: Recordings of the noise that the error band is made of.
DRAWS = 20


@dataclass(frozen=True)
class WaterForce:
    """The water's force over time.

    Parameters
    ----------
    times: [s], (frames,)
    force: on the fin, x downstream and y to the side [N], (frames, 2)
    deviation: what the noise of the tracks makes of it [N], (frames, 2)
    mount_deviation: the same of `mount_thrust` [N], (frames,)
    parts: the same by cause, `momentum`, `gradient`, `wake` and `resistive`, (frames, 2) each
    inertia: change of the fin's own momentum [N], (frames, 2)
    noise: of the tracks, as the polynomials leave it [m]
    """

    times: Array
    force: Array
    deviation: Array
    parts: Mapping[str, Array]
    inertia: Array
    mount_deviation: Array
    noise: float

    @property
    def thrust(self) -> Array:
        """Force along -x [N]."""
        return -self.force[:, 0]

    @property
    def mount_thrust(self) -> Array:
        """Force with which the fin pulls its mount along -x [N], which a load cell measures."""
        return self.thrust + self.inertia[:, 0]

    @property
    def band(self) -> tuple[Array, Array]:
        """Thrust less and plus two deviations, as in the thesis' Fig. 3.13."""
        return self.thrust - 2 * self.deviation[:, 0], self.thrust + 2 * self.deviation[:, 0]


def fluid_force(
    tracks: Tracks, window: float, seed: int = 0, places: Array | None = None, **fin: Any
) -> WaterForce:
    """The model's force of the water on a fin that moves as the tracks do.

    Parameters
    ----------
    tracks: nose first, x downstream, metres
    window: of the local polynomials [s], about a quarter of the shortest period that matters: a
        shorter one lets noise through, a longer one smooths the motion away
    seed: of the noise that the error band is made of
    places: of the markers as shares of the length, nose 0; left out: evenly from nose to tail
    **fin: keywords of `rodgym.sim.Fin`: flow, geometry and coefficients of the water

    Raises
    ------
    FramesError: a window of too few frames
    ParameterError: a keyword that the fin does not have
    """
    model = Fin(**fin)
    nodes = len(model.positions)
    along = np.linspace(0.0, 1.0, tracks.markers) if places is None else np.asarray(places)
    if len(along) != tracks.markers or (np.diff(along) <= 0).any() or along[0] < 0 or along[-1] > 1:
        raise refused("places", along.tolist(), f"{tracks.markers} rising shares from 0 to 1")
    if not window >= (DEGREE + 2) * tracks.frame_time:
        raise FramesError(
            f"window = {window:g} s holds fewer than {DEGREE + 2} frames of {tracks.frame_time:g} s"
        )
    seen = np.asarray(np.isfinite(tracks.points).all(axis=2))
    if seen.mean(axis=0).min() < 0.5:
        lost = int(seen.mean(axis=0).argmin()) + 1
        raise RecordingError(f"marker {lost} was lost in more than half of the frames")
    spread = _between(along, nodes)
    smooth = Smoother(tracks.times, seen, window)
    points, rates = smooth(np.nan_to_num(tracks.points))
    noise = smooth.noise(tracks.points, points)
    momentum = Smoother(tracks.times, np.ones((len(tracks.times), 1), bool), window)
    masses = _masses(model) @ spread

    def inertia(rates: Array) -> Array:
        return momentum((masses @ rates)[:, np.newaxis])[1][:, 0]

    parts = _forces(model, spread, points, rates, momentum)
    random, drawn, mounts = np.random.default_rng(seed), [], []
    for _ in range(DRAWS):
        noisy = smooth(points + random.normal(0.0, noise, points.shape))
        drawn.append(_sum(_forces(model, spread, *noisy, momentum)))
        mounts.append(inertia(noisy[1])[:, 0] - drawn[-1][:, 0])
    force, mount = (np.std(one, axis=0, ddof=1) for one in (drawn, mounts))
    return WaterForce(tracks.times, _sum(parts), force, parts, inertia(rates), mount, noise)


def _masses(model: Fin) -> Array:
    """Of the nodes [kg] (thesis 2.4, 2.5): half of each edge's to either end."""
    shape = model.config["geometry"]
    areas = np.array(shape["areas"])
    edges = model.parameters["density"] * shape["edge_length"] * (areas[1:] + areas[:-1]) / 2
    return np.asarray((np.append(edges, 0.0) + np.append(0.0, edges)) / 2)


def _forces(
    model: Fin, spread: Array, points: Array, rates: Array, momentum: Smoother
) -> dict[str, Array]:
    """The parts of the force for positions and velocities of the markers."""
    x, v = spread @ points, spread @ rates
    found = [model.forces(*state) for state in zip(x, v, strict=True)]

    def total(name: str) -> Array:
        return np.array([np.sum(one[name], axis=0) for one in found])

    _, change = momentum(total("fluid_momentum")[:, np.newaxis])
    return {
        "momentum": -change[:, 0],
        "gradient": total("fluid_gradient"),
        "wake": total("tail_flux"),
        "resistive": total("resistive"),
    }


def _sum(parts: Mapping[str, Array]) -> Array:
    return np.asarray(np.sum(list(parts.values()), axis=0), np.float64)


def _between(along: Array, nodes: int) -> Array:
    """Nodes from markers, (nodes, markers): a cubic through the four nearest markers."""
    share = np.linspace(0.0, 1.0, nodes)
    if len(along) == nodes and np.allclose(along, share):
        return np.eye(nodes)
    # (Markers that are not evenly spaced: places counted in markers.)
    index = np.interp(share, along, np.arange(len(along))) / (len(along) - 1)
    return shapes.marks(index, len(along), smooth=True)


class Smoother:
    """Local polynomials: the value and the slope at each frame from the frames about it."""

    def __init__(self, times: Array, seen: npt.NDArray[np.bool_], window: float) -> None:
        frames = len(times)
        #: Weights of all frames in the value and in the slope, (markers, frames, frames).
        self._value = np.zeros((seen.shape[1], frames, frames))
        self._slope = np.zeros_like(self._value)
        for i, time in enumerate(times):
            # A Gaussian whose window holds two deviations either way.
            away = (times - time) / (0.25 * window)
            near = np.abs(away) < 4.0
            design = np.vander(away[near], DEGREE + 1, increasing=True)
            for marker in range(seen.shape[1]):
                weight = np.exp(-0.5 * away[near] ** 2) * seen[near, marker]
                if (weight > 1e-3).sum() <= DEGREE:
                    raise FramesError(
                        f"marker {marker + 1} is lost for too long at {time:.3f} s for this window"
                    )
                normal = design.T * weight
                solved = np.linalg.solve(normal @ design, normal)
                self._value[marker, i, near] = solved[0]
                self._slope[marker, i, near] = solved[1] / (0.25 * window)

    def __call__(self, points: Array) -> tuple[Array, Array]:
        """Values and slopes, (frames, markers, 2) each, of points of that shape."""
        by_marker = np.swapaxes(points, 0, 1)
        return tuple(  # type: ignore[return-value]
            np.swapaxes(weights @ by_marker, 0, 1) for weights in (self._value, self._slope)
        )

    def noise(self, points: Array, smooth: Array) -> float:
        """Deviation of the points about the values, with what the fit took away put back."""
        gaps = (points - smooth)[np.isfinite(points)]
        taken = float(np.mean([np.trace(one) for one in self._value])) / len(points)
        return float(np.sqrt(np.mean(gaps**2) / max(1 - taken, 0.05)))
