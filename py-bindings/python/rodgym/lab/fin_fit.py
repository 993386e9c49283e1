"""Parameters of a fin from film and load cells, in air and in water (thesis 3.4).

A recording shows a continuous fin, a model has so many nodes. So every edge is cut in four and in
eight, and the parameters are those of infinitely many nodes, unless the fin itself has known ones.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rodgym import _native
from rodgym._checks import number, refused
from rodgym.lab import fin_checks
from rodgym.lab.alike import likeness, widening
from rodgym.lab.errors import MisfitError
from rodgym.lab.film import SHARED
from rodgym.lab.fin_in_air import Experiment, cost_of
from rodgym.lab.fin_model import CAMERA, GAIN, FinModel, Recording
from rodgym.lab.fin_result import FinFit
from rodgym.lab.gauss_newton import Estimate, Kinds, solve
from rodgym.lab.result import Holdout, Interval, Level
from rodgym.lab.servo import fit_servo
from rodgym.lab.tracks import Array
from rodgym.lab.trust import (
    ADVICE,
    SEEN,
    TOLD,
    TWICE,
    VAGUE,
    WIDE,
    deviance,
    foreseen,
    interval,
)
from rodgym.sim import Fin

#: What may be found, and where a fit of it starts.
START = {
    "youngs_modulus": 1e6,
    "damping": 0.05,
    "bending_damping": 1e-3,
    "density": 1100.0,
    "drag_coefficient": 1.0,
    "added_mass_coefficient": 0.6,
    "friction_coefficient": 0.01,
}
#: What is found in air, and in water where cells measure the thrust.
IN_AIR = ("youngs_modulus", "damping")
IN_WATER = ("youngs_modulus", "drag_coefficient", "added_mass_coefficient")
#: Deviation of the logarithm of the camera's scale, where nothing is said.
SCALE = 0.1
#: Residuals that no camera and no cell goes below [m, N, N m].
FLOORS = (1e-8, 1e-7, 1e-8)
#: Multiples of the start's E from which a fit is tried.
TRIALS = (1.0, 1 / 8, 8.0)
STIFFNESS = "youngs_modulus"
#: Trials see so much of each recording [s], and go so many rounds.
GLANCE, ROUNDS = 1.5, 8
#: Into how many every edge is cut, from level to level.
PARTS = (1, 4, 8)
#: Residuals of neighbouring frames that are more alike than this are no noise.
ALIKE = 0.3
#: What is alike and off by more than this share of what it changes by is no such fin: of a load,
#: and of the tail's place.
WRONG = (0.3, 0.05)
#: What to measure where a parameter is not identifiable, beside the pendulum's.
FIN_ADVICE = {
    "drag_coefficient": "pitch it farther, and put it on a load cell",
    "added_mass_coefficient": "put it on a load cell: the thrust tells it",
    "friction_coefficient": "pitch it little in fast water, on a load cell",
    "density": ADVICE["density"],
}


def fit_fin(
    recordings: Sequence[Recording | Experiment],
    free: Sequence[str] | None = None,
    known: Mapping[str, Any] | None = None,
    start: Mapping[str, float] | None = None,
    scale: float = SCALE,
    places: Sequence[float] | None = None,
    settle: float = 0.0,
) -> FinFit:
    """Fits a fin that its drive pitches, in water or in air.

    Parameters
    ----------
    recordings: of one fin, one camera and one bench
    free: parameters to find; left out: in water E, drag and added mass, in air E and damping
    known: other keywords of `rodgym.sim.Fin`, such as `hydrodynamics="air"`, the flow's speed or
        the geometry; and `nodes`, which says that the fin itself is one of its geometry's nodes
    start: where the fit starts
    scale: how well the camera's scale is known, a deviation as a share: of a calibrated one 0.002
    places: of the markers as shares of the length, nose 0; left out: evenly from nose to tail
    settle: time from the start of each recording that is not fitted [s], where it does not begin at
        rest

    Raises
    ------
    ParameterError, RecordingError: what is asked or given makes no sense, by name
    MisfitError: no such fin moves like the recordings
    """
    given = dict(known or {})
    nodes = given.pop("nodes", None)
    for one in recordings[:1]:
        if isinstance(one, Experiment):
            given = {**Experiment.KEYWORDS, "physics_dt": one.step_time, **given}
    count = len(Fin(**given).positions)
    if nodes not in (None, count):
        raise refused("known nodes", nodes, f"{count}, the nodes of the fin's geometry")
    air = given.get("hydrodynamics") == "air"
    names = tuple(dict.fromkeys(free if free is not None else IN_AIR if air else IN_WATER))
    if not names or not set(names) <= set(START) or set(names) & set(given):
        raise refused("free", free, f"some of {', '.join(START)}, not in known, too")
    values = {**START, **(start or {})}
    for name in names:
        if not number(name, values[name], "SI units") > 0:
            raise refused("start", {name: values[name]}, "above 0")
    if not 0 < scale <= 1:
        raise refused("scale", scale, "a deviation above 0, at most 1")
    ready = [one.recording(count) if isinstance(one, Experiment) else one for one in recordings]
    markers = fin_checks.markers(ready)
    along = np.linspace(0.0, 1.0, markers) if places is None else np.asarray(places, np.float64)
    ready, notes = fin_checks.checked(ready, along, given, settle)
    search = FinSearch(FinModel(ready, names, given, scale, along, settle=settle), values)
    servo = fit_servo(ready) if any(one.command is not None for one in ready) else {}
    return replace(search.run(nodes is not None, dict(known or {}), notes), servo=servo)


class FinSearch:
    """The steps of a fit; every step begins where the one before has ended."""

    def __init__(self, model: FinModel, start: Mapping[str, float]) -> None:
        self.model, self.start = model, start
        rows = {
            row["name"]: row for row in _native.Batch("rodgym/FinThrust-v0", 1).spec["parameters"]
        }
        # (Within the range, so that differences are, too.)
        self.limits = {
            name: (
                float(np.log(1.001 * max(float(rows[name]["low"]), 1e-9))),
                float(np.log(float(rows[name]["high"]) / 1.001)),
            )
            for name in START
        }
        self.place = fin_checks.pivot(model.recordings, model.places, model.known)

    def run(self, discrete: bool, known: Mapping[str, Any], notes: Sequence[str]) -> FinFit:
        """Tries several starts, keeps the best, and goes on with more nodes."""
        coarse = self.solved(self.model, self.tried())
        levels = [(self.model, coarse)]
        for parts in () if discrete else PARTS[1:]:
            levels.append(self.finer(levels, parts))
        model, best = levels[-1]
        count = len(model.free)
        logs = best.x[:count]
        if not discrete:
            logs = extrapolated(model.free, *(estimate.x[:count] for _, estimate in levels[-2:]))
        gaps = self.gaps(model, best.x)
        parted = {
            name: [one[name] for one in gaps if name in one] for name in ("film", *model.loads)
        }
        alike = {name: likeness(own) for name, own in parted.items()}
        wider = max(widening(own) for own in parted.values())
        told = self.doubts(best, alike)
        best = replace(best, covariance=wider * best.covariance)
        covariance = best.covariance[:count, :count]
        deviations = np.sqrt(np.diag(covariance))
        if outliers := int((~best.kept).sum()):
            told.append(f"{outliers} of {len(best.kept)} numbers were outliers")
        return FinFit(
            model=model,
            estimate=best,
            parameters={
                name: interval(x, float(d))
                for name, x, d in zip(model.free, logs, deviations, strict=True)
            },
            covariance=covariance,
            known=known,
            not_identifiable=self.vague(levels[:2], deviations),
            camera=camera(model, best),
            cells=cells(model, best),
            levels=[
                Level(nodes_of(m), dict(zip(m.free, np.exp(e.x).tolist(), strict=False)), e.sigma)
                for m, e in levels
            ],
            errors=[float(np.sqrt(np.nanmean(one["film"] ** 2))) for one in gaps],
            cost=cost_of([one["film"] for one in gaps]),
            alike=alike,
            holdout=self.holdout(coarse, wider),
            notes=[*notes, *told],
        )

    def tried(self) -> Array:
        """Unknowns that suit the first part of the recordings best, of several starts."""
        duration = max(float(np.ptp(one.times)) for one in self.model.recordings)
        share = min(1.0, (self.model.settle + GLANCE) / duration)
        glance, trials = replace(self.model, share=share), []
        factors = TRIALS if STIFFNESS in glance.free else (1.0,)
        for factor in factors:
            # What one start cannot be simulated from, another may.
            with contextlib.suppress(MisfitError):
                x = self.begun(glance, factor)
                trials.append(self.solved(glance, x, rounds=ROUNDS, final=False))
        if not trials:
            raise MisfitError("no fin near the start of the fit can be simulated (--start)")
        return min(trials, key=lambda one: self.score(glance, one)).x

    def begun(self, model: FinModel, factor: float = 1.0) -> Array:
        """Where a fit begins, with so many times the start's E."""
        values = [self.start[n] * (factor if n == STIFFNESS else 1.0) for n in model.free]
        return model.start(values, self.place)

    def finer(
        self, levels: Sequence[tuple[FinModel, Estimate]], parts: int
    ) -> tuple[FinModel, Estimate]:
        """The fit with every edge cut in so many."""
        before, found = levels[-1]
        model, x = replace(before, parts=parts), found.x
        if len(levels) > 1:
            # (What the error is from level to level tells the next.)
            older, _ = levels[-2]
            change = (1 / before.parts - 1 / parts) / (1 / older.parts - 1 / before.parts)
            x = x + change * (found.x - levels[-2][1].x)
        return model, self.solved(model, x, differences=False)

    def solved(
        self,
        model: FinModel,
        x: Array,
        rounds: int = 30,
        final: bool = True,
        differences: bool = True,
    ) -> Estimate:
        """The most probable unknowns; without `differences` by the start's derivatives alone."""
        seen, kinds = model.seen()
        there = np.isfinite(seen)
        prior = model.prior(self.begun(model))
        count = len(model.free)
        wide = np.ones(len(x) - count)
        lows, highs = (np.array([self.limits[name][end] for name in model.free]) for end in (0, 1))

        kept: list[Array] = []

        def residuals(x: Array) -> tuple[Array, Array]:
            if kept and not differences:
                return (model.predict(x, differences=False)[0] - seen)[there], kept[0]
            values, slopes = model.predict(x)
            kept[:] = [slopes[there]]
            return (values - seen)[there], kept[0]

        return solve(
            residuals,
            x,
            prior,
            (np.concatenate([lows, -wide]), np.concatenate([highs, wide])),
            model.strides(),
            FLOORS[0],
            rounds,
            final,
            kinds=Kinds(kinds[there], FLOORS[: len(model.loads) + 1]),
        )

    def score(self, model: FinModel, found: Estimate) -> float:
        """Less is better: what is left over, whatever its unit."""
        seen, kinds = model.seen()
        counts = np.bincount(kinds[np.isfinite(seen)], minlength=len(found.sigmas))
        return float(counts @ np.log(found.sigmas))

    def vague(
        self, levels: Sequence[tuple[FinModel, Estimate]], deviations: Array
    ) -> dict[str, str]:
        """Parameters that the recordings do not tell, with what would.

        (Few nodes may follow badly with any E. So a fin does not bend that bends at no level.)
        """
        names = self.model.free
        found = {
            name: FIN_ADVICE.get(name, "pitch it faster and farther")
            for name, deviation in zip(names, deviations, strict=True)
            if deviation > VAGUE
        }
        if not any(self.bends(model, best) for model, best in levels):
            hint = "pitch the fin faster, or hang a weight on its tail: it hardly bends"
            found |= {n: hint for n in names if n in (STIFFNESS, "damping", "bending_damping")}
        return found

    def bends(self, model: FinModel, best: Estimate) -> bool:
        """Whether neither twice nor half of E fits as well."""
        if STIFFNESS not in model.free:
            return True
        place = model.free.index(STIFFNESS)
        rest = tuple(name for name in model.free if name != STIFFNESS)
        costs = []
        for factor in (TWICE, 1 / TWICE):
            value = factor * float(np.exp(best.x[place]))
            other = replace(model, free=rest, known={**model.known, STIFFNESS: value})
            with contextlib.suppress(MisfitError):
                x = np.delete(best.x, place)
                found = self.solved(other, x, rounds=ROUNDS, final=False)
                costs.append(self._deviance(found.residuals, best))
        return not costs or min(costs) - self._deviance(best.residuals, best) > TOLD

    def _deviance(self, residuals: Array, best: Estimate) -> float:
        seen, kinds = self.model.seen()
        return deviance(residuals / np.array(best.sigmas)[kinds[np.isfinite(seen)]], 1.0)

    def gaps(self, model: FinModel, x: Array) -> list[dict[str, Array]]:
        """Model less recording of what is fitted: `film` [m], and loads by name."""
        seen, _ = model.seen()
        return model.parted(model.predict(x, differences=False)[0] - seen)

    def holdout(self, best: Estimate, wider: float) -> Holdout:
        """Fits the first part of each recording and foretells the rest."""
        part = replace(self.model, share=SEEN)
        ends = [one.times[0] + SEEN * float(np.ptp(one.times)) for one in self.model.recordings]
        found = self.solved(part, best.x)

        seen, kinds = self.model.seen()
        fitted, _ = part.seen()
        rest = (kinds == 0) & np.isfinite(seen) & ~np.isfinite(fitted)

        def off(model: Array) -> float:
            return 1.4826 * float(np.median(np.abs((model - seen)[rest])))

        guessed = found.x.copy()
        guessed[: len(part.free)] = self.begun(part)[: len(part.free)]
        frames = sum(
            int((one.tracks.times > end).sum())
            for one, end in zip(self.model.recordings, ends, strict=True)
        )
        model, slopes = self.model.predict(found.x)
        before, _ = self.model.predict(guessed, differences=False)
        expected = foreseen(found, slopes[rest], wider)
        return Holdout(frames, found.sigma, off(model), off(before), expected)

    def doubts(self, best: Estimate, alike: Mapping[str, float]) -> list[str]:
        """What makes the fit doubtful, in words.

        Raises
        ------
        MisfitError: no such fin moves like the recordings
        """
        notes, recorded = list[str](), self.model.parted(self.model.seen()[0])
        for name, sigma in zip(alike, best.sigmas, strict=True):
            if alike[name] <= ALIKE:
                continue
            moves = max(changes(one[name]) for one in recorded if name in one)
            if sigma > WRONG[name == "film"] * moves:
                raise MisfitError(
                    f"no {' and '.join(self.model.free)} makes the fin move like the recording: "
                    f"its {name} is off by {100 * sigma / moves:.0f} % of what it changes by, and "
                    "not by chance. A known value may be wrong (geometry, water or air, flow), or "
                    "the pitch (another recording's), or the recording does not begin at rest "
                    "(--settle)"
                )
            notes.append(
                f"the model does not follow the {name} but for chance: neighbouring residuals are "
                f"alike ({alike[name]:.2f}, of noise about 0); intervals are wider for it"
            )
        count = self.model.cells
        for i, name in enumerate(self.model.loads):
            if abs(best.x[count + 2 * i]) > 3 * GAIN:
                off = 100 * np.expm1(best.x[count + 2 * i])
                notes.append(
                    f"the gain of the {name} is off by {off:.0f} %: calibrate the cell, or doubt "
                    "the model"
                )
        return notes


def extrapolated(free: Sequence[str], coarse: Array, fine: Array) -> Array:
    """Logarithms of parameters of infinitely many nodes.

    The error falls with the square of the edges' length. That of the damping falls with the length
    itself: the tail's node has the share of a whole edge, where half of one ends in it.
    """
    orders = np.array([1.0 if name == SHARED else 2.0 for name in free])
    return fine + (fine - coarse) / ((PARTS[-1] / PARTS[-2]) ** orders - 1)


def changes(values: Array) -> float:
    """Deviation of a load over time, or of a film's last marker sideways."""
    return float(np.nanstd(values[:, -1, 1] if values.ndim > 1 else values))


def nodes_of(model: FinModel) -> int:
    """Nodes of a model."""
    return model.parts * (len(Fin(**model.known).positions) - 1) + 1


def camera(model: FinModel, best: Estimate) -> dict[str, Interval]:
    """The camera's scale as a factor, the others as they are."""
    places = {name: model.camera + i for i, name in enumerate(CAMERA)}
    places |= {"clamp": model.clamp, "clock": model.clocks}
    found = {name: plain(best, at) for name, at in places.items()}
    return {**found, "scale": logarithmic(best, places["scale"])}


def cells(model: FinModel, best: Estimate) -> dict[str, Interval]:
    """Gain and bias of each cell."""
    found = {}
    for i, name in enumerate(model.loads):
        found[f"{name}_gain"] = logarithmic(best, model.cells + 2 * i)
        found[f"{name}_bias"] = plain(best, model.cells + 2 * i + 1)
    return found


def plain(best: Estimate, at: int) -> Interval:
    """An unknown and its interval."""
    x, wide = float(best.x[at]), WIDE * float(np.sqrt(best.covariance[at, at]))
    return Interval(x, x - wide, x + wide)


def logarithmic(best: Estimate, at: int) -> Interval:
    """An unknown that is a logarithm."""
    return interval(float(best.x[at]), float(np.sqrt(best.covariance[at, at])))
