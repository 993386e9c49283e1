"""E and damping of a fin that is pitched in air, from where its nodes are seen (thesis 3.4.1).

Twice: as the thesis did it, by Nelder and Mead's simplex on its cost (3.1); and by Gauss and
Newton's method with the camera's scale and place as unknowns, with intervals.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rodgym._checks import number, refused
from rodgym.errors import RodgymError
from rodgym.lab.errors import FramesError, MisfitError
from rodgym.lab.gauss_newton import Estimate, Prior, solve
from rodgym.lab.nelder_mead import minimise
from rodgym.lab.result import Interval
from rodgym.lab.tracks import Array
from rodgym.lab.trust import ADVICE, TOLD, TWICE, VAGUE, deviance, interval
from rodgym.sim import Fin

#: What may be found, and where a fit of it starts.
START = {"youngs_modulus": 1e6, "damping": 0.05, "bending_damping": 1e-3, "density": 1100.0}
#: Deviation of the logarithm of a parameter that nothing is known of, of the camera's scale, and
#: of the place of the pivot [m].
UNKNOWN, SCALE, PLACE = 3.0, 0.1, 0.02
#: Steps of the differences: logarithms, and metres.
STEP = 1e-4
#: Residuals that no camera goes below [m].
FLOOR = 1e-8
#: Multiples of the start's E from which a fit is tried.
TRIALS = (1.0, 1 / 8, 8.0)
#: The thesis' start, first simplex and rounds.
THESIS = {"youngs_modulus": 2e6, "damping": 0.05}
SIMPLEX, ROUNDS = 0.7, 60
STIFFNESS = "youngs_modulus"
#: Frames a second, where an experiment does not say.
RATE = 30.0


@dataclass(frozen=True)
class Experiment:
    """A fin in air, at rest at first, pitched by its drive.

    Parameters
    ----------
    sideways: y of every node, nose first, at the end of each frame [m], NaN where it was lost,
        (frames, nodes)
    pitch: of the drive [rad] at the end of every physics step, as many steps in each frame
    rate: frames a second
    """

    sideways: Array
    pitch: Array
    rate: float = RATE

    @property
    def steps(self) -> int:
        """Physics steps in a frame."""
        return len(self.pitch) // len(self.sideways)


@dataclass(frozen=True)
class FinFit:
    """Parameters of a fin in air, and how far they can be trusted."""

    parameters: dict[str, Interval]
    #: Of the logarithms of these parameters.
    covariance: Array
    known: Mapping[str, float]
    not_identifiable: dict[str, str]
    #: The camera's scale as a factor and the pivot's y [m].
    camera: dict[str, Interval]
    #: What is left over [m]: of all, and root mean squares of each experiment (Fig. 3.9).
    sigma: float
    errors: list[float]
    #: The thesis' cost (3.1) [m].
    cost: float
    notes: list[str] = field(default_factory=list)

    @property
    def identified(self) -> dict[str, Interval]:
        """The parameters that the recordings tell."""
        return {k: v for k, v in self.parameters.items() if k not in self.not_identifiable}

    def as_dict(self) -> dict[str, Any]:
        """What `rod.yml` holds."""
        return {
            "machine": "fin",
            "parameters": {name: i._asdict() for name, i in self.identified.items()},
            "known": dict(self.known),
            "not_identifiable": list(self.not_identifiable),
            "advice": dict(self.not_identifiable),
            # (A fin has the nodes of its geometry, in recording and environment.)
            "equivalent": {
                "nodes": None,
                "parameters": {name: i.value for name, i in self.identified.items()},
            },
            "covariance_of_logarithms": {
                "names": list(self.parameters),
                "matrix": self.covariance.tolist(),
            },
            "camera": {name: i._asdict() for name, i in self.camera.items()},
            "residual_mm": 1e3 * self.sigma,
            "notes": list(self.notes),
        }

    def write(self, path: Path) -> None:
        """Writes `rod.yml`."""
        import yaml

        text = yaml.safe_dump(self.as_dict(), sort_keys=False, allow_unicode=True)
        path.write_text(text, encoding="utf-8")


def moved(pitch: Array, steps: int, fin: Mapping[str, Any], rate: float = RATE) -> Array:
    """Sideways positions of all nodes [m] at the end of every frame, (frames, nodes)."""
    plant = Fin(
        **{"thesis": True, "stepper": "bdf2", "hydrodynamics": "air", **fin},
        physics_dt=1.0 / (rate * steps),
    )
    seen = []
    for frame in np.reshape(pitch, (-1, steps)):
        plant.follow(frame)
        seen.append(plant.positions[:, 1])
    return np.array(seen)


def cost_of(gaps: Sequence[Array]) -> float:
    """The thesis' cost (3.1) [m]: of each experiment the root of the summed squares, summed up."""
    return float(sum(np.sqrt(np.nansum(gap**2)) for gap in gaps))


def fit_as_the_thesis(
    experiments: Sequence[Experiment], **known: Any
) -> tuple[dict[str, float], float]:
    """E [Pa] and zeta [kg/s] by Nelder and Mead's simplex on (3.1), and the cost [m]."""
    names, start = list(THESIS), np.array(list(THESIS.values()))

    def cost(x: Array) -> float:
        e, zeta = (float(value) for value in np.exp(x))
        if not (1e4 < e < 1e10 and zeta < 10.0):
            return 1e9
        fin = {**known, "youngs_modulus": e, "damping": zeta}
        return cost_of([o.sideways - moved(o.pitch, o.steps, fin, o.rate) for o in experiments])

    found = minimise(cost, np.log(start), SIMPLEX, ROUNDS)
    return dict(zip(names, (float(v) for v in np.exp(found)), strict=True)), cost(found)


def fit_fin(
    experiments: Sequence[Experiment],
    free: Sequence[str] = ("youngs_modulus", "damping"),
    known: Mapping[str, float] | None = None,
    start: Mapping[str, float] | None = None,
    scale: float = SCALE,
) -> FinFit:
    """Fits a fin that is pitched in air.

    Parameters
    ----------
    experiments: of one fin and one camera
    free: parameters to find, of `youngs_modulus`, `damping`, `bending_damping` and `density`
    known: other keywords of `rodgym.sim.Fin`
    start: where the fit starts
    scale: how well the camera's scale is known, a deviation as a share: of a calibrated one 0.002

    Raises
    ------
    ParameterError, FramesError: what is asked or given makes no sense
    MisfitError: no such fin can be simulated near the start
    """
    given, names = dict(known or {}), tuple(dict.fromkeys(free))
    nodes = len(Fin(**given).positions)
    if not names or not set(names) <= set(START) or set(names) & set(given):
        raise refused("free", free, f"some of {', '.join(START)}, not in known, too")
    values = {**START, **(start or {})}
    for name in names:
        if not number(name, values[name], "SI units") > 0:
            raise refused("start", {name: values[name]}, "above 0")
    if not experiments:
        raise refused("experiments", [], "at least one")
    for i, one in enumerate(experiments, 1):
        shape = np.shape(one.sideways)
        if len(shape) != 2 or shape[1] != nodes:
            raise refused(f"sideways of experiment {i}", shape, f"(frames, {nodes} nodes)")
        if one.steps < 1 or len(one.pitch) % shape[0] or not np.isfinite(one.pitch).all():
            raise FramesError(
                f"experiment {i}: {len(one.pitch)} pitches for {shape[0]} frames; there must be as "
                "many in each frame, all finite"
            )
    if not 0 < scale <= 1:
        raise refused("scale", scale, "a deviation above 0, at most 1")
    return _Fit(experiments, names, given, values, scale).run()


class _Fit:
    """Unknowns: logarithms of the parameters and of the scale, and the pivot's y."""

    def __init__(
        self,
        experiments: Sequence[Experiment],
        free: tuple[str, ...],
        known: Mapping[str, Any],
        start: Mapping[str, float],
        scale: float,
    ) -> None:
        self.scale = scale
        self.experiments, self.free, self.known, self.start = experiments, free, known, start
        self.seen = np.concatenate([np.ravel(one.sideways) for one in experiments])
        self.there = np.isfinite(self.seen)

    def run(self) -> FinFit:
        """Tries several starts and keeps the best."""
        trials = []
        for factor in TRIALS if STIFFNESS in self.free else (1.0,):
            # What one start cannot be simulated from, another may.
            with contextlib.suppress(MisfitError):
                trials.append(self.solved(self.free, self.known, factor))
        if not trials:
            raise MisfitError("no fin near the start of the fit can be simulated")
        best = min(trials, key=lambda one: one.sigma)
        count = len(self.free)
        deviations = np.sqrt(np.diag(best.covariance))
        vague = {
            name: ADVICE.get(name, "pitch it faster and farther")
            for name, deviation in zip(self.free, deviations, strict=False)
            if deviation > VAGUE
        }
        if not self.bends(best):
            hint = "pitch the fin faster, or hang a weight on its tail: it hardly bends"
            vague |= {n: hint for n in self.free if n in (STIFFNESS, "damping", "bending_damping")}
        fin = {**self.known, **dict(zip(self.free, np.exp(best.x[:count]), strict=True))}
        gaps = [o.sideways - self.model(o, fin, best.x[count:]) for o in self.experiments]
        notes = []
        if outliers := int((~best.kept).sum()):
            notes.append(f"{outliers} of {len(best.kept)} positions were outliers")
        scale, place = best.x[count:]
        wide = 1.96 * float(deviations[count + 1])
        return FinFit(
            parameters={
                name: interval(x, float(d))
                for name, x, d in zip(self.free, best.x, deviations, strict=False)
            },
            covariance=best.covariance[:count, :count],
            known=dict(self.known),
            not_identifiable=vague,
            camera={
                "scale": interval(scale, float(deviations[count])),
                "base_y": Interval(float(place), float(place - wide), float(place + wide)),
            },
            sigma=best.sigma,
            errors=[float(np.sqrt(np.nanmean(gap**2))) for gap in gaps],
            cost=cost_of(gaps),
            notes=notes,
        )

    def bends(self, best: Estimate) -> bool:
        """Whether neither twice nor half of E fits as well."""
        if STIFFNESS not in self.free:
            return True
        value = float(np.exp(best.x[self.free.index(STIFFNESS)]))
        rest = tuple(name for name in self.free if name != STIFFNESS)
        costs = []
        for factor in (TWICE, 1 / TWICE):
            with contextlib.suppress(MisfitError):
                other = self.solved(rest, {**self.known, STIFFNESS: factor * value}, 1.0)
                costs.append(deviance(other.residuals, best.sigma))
        return not costs or min(costs) - deviance(best.residuals, best.sigma) > TOLD

    def solved(self, free: tuple[str, ...], known: Mapping[str, Any], factor: float) -> Estimate:
        """The most probable unknowns, from a start with so many times the E."""
        count = len(free)
        values = [self.start[n] * (factor if n == STIFFNESS else 1.0) for n in free]
        x = np.concatenate([np.log(values), [0.0, 0.0]])
        prior = Prior(x.copy(), np.array([UNKNOWN] * count + [self.scale, PLACE]))
        bounds = (
            np.array([x[i] - 3 * UNKNOWN for i in range(count)] + [-1.0, -1.0]),
            np.array([x[i] + 3 * UNKNOWN for i in range(count)] + [1.0, 1.0]),
        )
        stride = np.array([1.0] * count + [0.1, 0.05])

        def residuals(x: Array) -> tuple[Array, Array]:
            base = self.shown(free, known, x)
            slopes = np.empty((len(base), len(x)))
            for i in range(len(x)):
                there = x.copy()
                there[i] += STEP
                slopes[:, i] = (self.shown(free, known, there) - base) / STEP
            return (base - self.seen)[self.there], slopes[self.there]

        return solve(residuals, x, prior, bounds, stride, FLOOR)

    def shown(self, free: tuple[str, ...], known: Mapping[str, Any], x: Array) -> Array:
        """What the camera sees of all experiments; NaN where the fin cannot be simulated."""
        fin = {**known, **dict(zip(free, (float(v) for v in np.exp(x)), strict=False))}
        try:
            parts = [self.model(one, fin, x[len(free) :]) for one in self.experiments]
        except RodgymError:  # Beyond a parameter's range, or a step that fails.
            return np.full(len(self.seen), np.nan)
        return np.concatenate([part.ravel() for part in parts])

    def model(self, one: Experiment, fin: Mapping[str, Any], camera: Array) -> Array:
        """An experiment before the camera."""
        return np.exp(camera[0]) * moved(one.pitch, one.steps, fin, one.rate) + camera[1]
