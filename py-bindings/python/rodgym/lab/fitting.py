"""From tracks of a swinging rod to its parameters: pieces first, then the film as a whole.

A film shows a continuous rod, a model has so many nodes: few nodes bend more easily. So the whole
film is fitted with more and more nodes, and the parameters are those of infinitely many.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from rodgym import _native
from rodgym._checks import number, refused, whole
from rodgym.lab import shapes
from rodgym.lab.errors import FramesError, MisfitError
from rodgym.lab.film import CAMERA, Film, Rod
from rodgym.lab.gauss_newton import OUTLIER, Estimate, solve
from rodgym.lab.result import Fit, Holdout, Interval, Level
from rodgym.lab.sanity import checked
from rodgym.lab.swings import ENVIRONMENT
from rodgym.lab.tracks import Array, Tracks

#: Nodes of the models: of pieces, then of the whole film. From the last two follow infinitely many.
COARSE, NODES = 13, (25, 49, 97)
#: E of a model of n edges is higher by about this over n^2: where the fit with more nodes starts.
STIFFER = 6.0
#: Physics steps in a period of the slowest bending: of pieces, and of the whole film.
ROUGH, FINE = 60, 200
#: Pieces are fitted from these multiples of the start's E, for so many rounds; the best goes on.
TRIALS, ROUNDS = (1 / 8, 1 / 4, 1 / 2, 1.0, 2.0, 4.0, 8.0), 4
#: Trials whose residuals are within this factor of the best may be right, too; they differ where
#: their E does by more than this factor. (A film does not tell 4 Hz at once from 26 Hz at 30 Hz.)
NEAR, DIFFERENT, AT_MOST = 2.0, 1.3, 2
#: What twice or half of E must cost, as a difference of chi-square, where a film tells E.
TOLD, TWICE = 30.0, 2.0
#: Duration of the shortest pieces of a rod of 0.3 m [s], and how many become one in the next round.
PIECE, TOGETHER = 0.25, 4
#: Where a fit of a parameter starts that is zero by default.
START = {"damping": 1e-3, "bending_damping": 5e-4}
#: A parameter is not identified whose logarithm is known no better than this: a factor of 2.
VAGUE = float(np.log(2.0)) / 1.96
#: Residuals of the whole over those of pieces: beyond, the model is doubted, or refused.
DOUBTFUL, WRONG = 1.25, 2.5
#: Refused is also what leaves this much over and does not foretell its own film.
HALF_WRONG = 1.4
#: Share of the film that is fitted to foretell the rest.
SEEN = 2 / 3
#: Residuals that no camera goes below, over the length.
FLOOR = 1e-7
#: Two parameters are known by their ratio or product only, beyond this correlation.
TOGETHER_ONLY = 0.98
WIDE = 1.96
#: Parameters that the swing tells even where the rod does not bend.
MOVES = ("damping", "gravity")
#: What bends a rod, and what it is as long as.
STIFFNESS, LENGTH = "youngs_modulus", "length"

ADVICE = {
    "density": "weigh the rod and give --known density=...",
    "youngs_modulus": "film a rod that is let go bent, or give --known youngs_modulus=...",
    "bending_damping": "film a rod that is let go bent, with more frames a second",
    "damping": "film for longer, or give --known damping=...",
    "width": "measure the rod and give --known width=...",
    "gravity": "give --known gravity=...",
}


def table() -> dict[str, dict[str, float]]:
    """Parameters that a fit knows: default, low and high of each."""
    rows = _native.Batch(ENVIRONMENT, 1).spec["parameters"]
    return {row["name"]: row for row in rows if row["name"] != "torque_limit"}


def fit(
    tracks: Tracks,
    free: Sequence[str] = ("youngs_modulus", "bending_damping"),
    known: Mapping[str, float] | None = None,
    start: Mapping[str, float] | None = None,
    places: Sequence[float] | None = None,
    nodes: int = 7,
) -> Fit:
    """Fits a pendulum that swings freely.

    Parameters
    ----------
    free: parameters to find
    known: the others, where they differ from the environments' defaults; `nodes` says that the rod
        itself is one of so many nodes
    start: where the fit starts
    places: of the markers along the rod [m]; left out: evenly from base to tip
    nodes: of the environment that the equivalent parameters are for

    Raises
    ------
    ParameterError: a parameter that there is not, or a value beyond its range
    RecordingError: the recording is refused, by name
    """
    rows, given = table(), dict(known or {})
    discrete = given.pop("nodes", None)
    for what, count in (("nodes", nodes), ("known nodes", discrete)):
        if count is not None:
            whole(what, count, 3, 1001, "a whole number from 3 to 1001")
    values = {name: float(row["default"]) for name, row in rows.items()}
    for said in (given, start or {}):
        for name, value in said.items():
            values[name] = _value(rows, name, value)
    free = tuple(dict.fromkeys(free))
    if not free:
        raise refused("free", free, "at least one parameter")
    for name in free:
        _value(rows, name, 1.0, checked_range=False)
        if name == LENGTH:
            raise refused("free", name, "a parameter other than the length: it gives the scale")
        if name in given:
            raise refused("free", name, "a parameter that is not in known, too")
        if name not in (start or {}) and name in START:
            values[name] = START[name]
        if values[name] <= 0:
            raise refused("start", {name: values[name]}, "above 0 for a parameter that is free")
    along = np.linspace(0, values["length"], tracks.markers) if places is None else np.array(places)
    if (np.diff(along) <= 0).any() or along[0] < 0 or along[-1] > values["length"] * (1 + 1e-9):
        raise refused("places", along.tolist(), f"rising, from 0 to the length {values['length']}")
    tracks = checked(tracks, along)
    fixed = {name: value for name, value in values.items() if name not in free}
    fitter = Fitter(tracks, along, fixed, free, [values[name] for name in free], rows)
    return fitter.run(None if discrete is None else int(discrete), nodes, given)


def _value(
    rows: Mapping[str, Mapping[str, float]], name: str, value: float, checked_range: bool = True
) -> float:
    """A parameter's value.

    Raises
    ------
    ParameterError: no such parameter, or beyond its range
    """
    if name not in rows:
        raise refused("parameter", name, f"one of {', '.join(rows)} (or nodes, where known)")
    low, high = float(rows[name]["low"]), float(rows[name]["high"])
    value = number(name, value, "SI units")
    if checked_range and not low <= value <= high:
        raise refused(name, value, f"from {low:g} to {high:g}")
    return value


class Fitter:
    """The steps of a fit; every step begins where the one before has ended."""

    def __init__(
        self,
        tracks: Tracks,
        places: Array,
        fixed: Mapping[str, float],
        free: tuple[str, ...],
        values: Sequence[float],
        rows: Mapping[str, Mapping[str, float]],
    ) -> None:
        self.tracks, self.places, self.fixed, self.free = tracks, places, fixed, free
        self.values = values
        # (Within the range, so that differences are, too.)
        self.limits = {
            name: (
                float(np.log(1.001 * max(float(rows[name]["low"]), 1e-9))),
                float(np.log(float(rows[name]["high"]) / 1.001)),
            )
            for name in free
        }
        self.floor = FLOOR * places[-1]

    def run(self, discrete: int | None, nodes: int, known: Mapping[str, float]) -> Fit:
        """All steps."""
        smooth = discrete is None
        coarse, nodes_of_whole = (COARSE, NODES) if smooth else (discrete, (discrete,))
        levels, rough, noise = self.whole(int(coarse or 0), int(nodes_of_whole[0] or 0), smooth)
        if smooth:
            levels = self.refined(levels)
            logs = extrapolated(*(level.x[: len(self.free)] for _, level in levels[-2:]))
        else:
            logs = levels[0][1].x[: len(self.free)]
        film, found = levels[-1]
        misfit = float(found.sigma / noise)
        holdout = self.holdout(*levels[0])
        if misfit > WRONG or (misfit > HALF_WRONG and not holdout.passed):
            raise MisfitError(
                f"no {' and '.join(self.free)} makes the rod move like the film: the whole is off "
                f"by {1e3 * found.sigma:.2f} mm where short pieces are by {1e3 * noise:.2f} mm. A "
                "known value may be wrong (length, width, gravity), or the clock (frames a "
                "second), or the base does not turn freely, or the fit began too far off (--start)"
            )
        twin = None
        if discrete is None:
            own = self.solved(
                self.film(nodes, False, FINE), self.moved(rough.x, COARSE, nodes), final=False
            )
            twin = Level(nodes, self._named(own.x), own.sigma)
        covariance = found.covariance[: len(self.free), : len(self.free)]
        vague = self.vague(covariance, self.film(int(coarse or 0), smooth, ROUGH), rough)
        notes = [*self.tracks.notes]
        if misfit > DOUBTFUL:
            notes.append(
                f"the model does not follow the film well: {misfit:.2f} times the noise remains"
            )
        if outliers := int((~found.kept).sum()):
            notes.append(f"{outliers} of {len(found.kept)} coordinates were outliers")
        return Fit(
            film=film,
            estimate=found,
            parameters=self._intervals(logs, covariance),
            covariance=covariance,
            camera=self._camera(found),
            known={**known, **({"nodes": discrete} if discrete else {})},
            fixed=dict(self.fixed),
            not_identifiable=vague,
            together=self.together(logs, covariance, vague),
            levels=[Level(f.rod.nodes, self._named(e.x), e.sigma) for f, e in levels],
            twin=twin,
            holdout=holdout,
            noise=noise,
            misfit=misfit,
            notes=notes,
        )

    def film(self, nodes: int, smooth: bool, steps: int, firsts: Sequence[int] = (0,)) -> Film:
        """A model of so many nodes."""
        rod = Rod(nodes, smooth, self.fixed, self.free, steps)
        return Film(self.tracks, self.places, rod, tuple(firsts))

    def whole(
        self, coarse: int, nodes: int, smooth: bool
    ) -> tuple[list[tuple[Film, Estimate]], Estimate, float]:
        """The whole film fitted with `nodes`, the same with the coarse model, and the deviation
        within pieces: of all starts that pieces leave the one that suits the whole best.
        """
        starts, at = self.starts(coarse, smooth)
        grown = [self.grown(coarse, smooth, start.x, at) for start in starts]
        best = min(estimate.sigma for estimate in grown)
        film, found = self.film(nodes, smooth, FINE), []
        for rough in grown:
            if rough.sigma < NEAR * best:
                estimate = self.solved(film, self.moved(rough.x, coarse, nodes))
                found.append((estimate.sigma, estimate, rough))
        _, estimate, rough = min(found, key=lambda one: one[0])
        # (Every piece has a start of its own, which takes some of the noise away.)
        taken = 1 - len(starts[0].x) / len(starts[0].residuals)
        noise = starts[0].sigma / float(np.sqrt(max(taken, 0.1)))
        return [(film, estimate)], rough, noise

    def starts(self, nodes: int, smooth: bool) -> tuple[list[Estimate], tuple[Array, Array]]:
        """Fits of the shortest pieces that may be right, the best first, and the coefficients of
        every frame that they began with.

        Many trials go a few rounds, the better ones a few more, and the best to the end.
        """
        at = shapes.guess(self.tracks, self.places)
        film = self.film(nodes, smooth, ROUGH, self.cut(0))
        base = np.nanmedian(self.tracks.points[:, 0], axis=0)
        x = film.start(np.array(self.values), np.array([0.0, 0.0, *base]), at)
        trials = list[Estimate]()
        for start in self.tried(x):
            # What one start cannot be simulated from, another may.
            with contextlib.suppress(MisfitError):
                trials.append(self.solved(film, start, rounds=ROUNDS, final=False))
        if not trials:
            raise MisfitError("no rod near the start of the fit can be simulated (--start)")
        for rounds in (ROUNDS, 30):
            chosen = list[Estimate]()
            trials.sort(key=lambda trial: trial.sigma)
            for trial in trials:
                new = not any(self.alike(trial.x, other.x) for other in chosen)
                if new and len(chosen) < AT_MOST and trial.sigma < NEAR * trials[0].sigma:
                    chosen.append(trial)
            trials = [self.solved(film, one.x, rounds=rounds, final=False) for one in chosen]
        return sorted(trials, key=lambda trial: trial.sigma), at

    def tried(self, x: Array) -> list[Array]:
        """Starts with several values of E."""
        if STIFFNESS not in self.free:
            return [x]
        place, starts = self.free.index(STIFFNESS), []
        for factor in TRIALS:
            start = x.copy()
            start[place] = np.clip(x[place] + np.log(factor), *self.limits[STIFFNESS])
            starts.append(start)
        return starts

    def alike(self, one: Array, other: Array) -> bool:
        """Whether two fits have nearly the same E."""
        place = self.free.index(STIFFNESS) if STIFFNESS in self.free else 0
        return abs(one[place] - other[place]) < np.log(DIFFERENT)

    def cut(self, rounds: int) -> tuple[int, ...]:
        """First frames of pieces, longer in every round, in the end one."""
        seconds = PIECE * float(np.sqrt(self.places[-1] / 0.3))
        frames = max(6, int(np.ceil(seconds / self.tracks.frame_time)))
        return cuts(self.tracks.times, frames * TOGETHER**rounds * self.tracks.frame_time)

    def grown(self, nodes: int, smooth: bool, x: Array, at: tuple[Array, Array]) -> Estimate:
        """The whole film from the unknowns of its shortest pieces, by ever longer ones."""
        angles, rates = at[0].copy(), at[1].copy()
        shared, rounds, firsts = len(self.free) + len(CAMERA), 0, self.cut(0)
        while True:
            starts = x[shared:].reshape(len(firsts), 2, shapes.SHAPES)
            for first, (angle, rate) in zip(firsts, starts, strict=True):
                angles[first], rates[first] = angle, rate
            rounds += 1
            firsts = self.cut(rounds)
            film = self.film(nodes, smooth, ROUGH, firsts)
            values, camera = np.exp(x[: len(self.free)]), x[len(self.free) : shared]
            found = self.solved(film, film.start(values, camera, (angles, rates)), final=False)
            x = found.x
            if len(firsts) == 1:
                return found

    def refined(self, levels: list[tuple[Film, Estimate]]) -> list[tuple[Film, Estimate]]:
        """Fits of the whole film with more and more nodes."""
        for nodes in NODES[1:]:
            before, found = levels[-1]
            # Derivatives of the rod before are good enough, and cost a fraction.
            _, slopes = before.residuals(found.x)
            film = self.film(nodes, True, FINE)
            start = self.moved(found.x, before.rod.nodes, nodes)
            levels.append((film, self.solved(film, start, slopes=slopes)))
        return levels

    def moved(self, x: Array, before: int, nodes: int) -> Array:
        """Unknowns for a rod of so many nodes from those of one of `before`."""
        there = x.copy()
        if STIFFNESS in self.free:
            change = STIFFER * ((nodes - 1.0) ** -2 - (before - 1.0) ** -2)
            there[self.free.index(STIFFNESS)] += change
        return there

    def solved(
        self,
        film: Film,
        x: Array,
        final: bool = True,
        rounds: int = 30,
        slopes: Array | None = None,
    ) -> Estimate:
        """The most probable unknowns of a model."""
        free = film.rod.free
        wide = np.full(len(x) - len(free), np.inf)
        lows, highs = (np.array([self.limits[name][end] for name in free]) for end in (0, 1))
        bounds = np.concatenate([lows, -wide]), np.concatenate([highs, wide])
        start = dict(zip(self.free, self.values, strict=True))
        logs = np.log(np.array([start[name] for name in free]))
        prior = film.prior(np.concatenate([logs, x[len(free) :]]))
        model = film.residuals if slopes is None else lambda x: (film.gaps(x), slopes)
        return solve(model, x, prior, bounds, film.strides(), self.floor, rounds, final)

    def vague(self, covariance: Array, film: Film, rough: Estimate) -> dict[str, str]:
        """Parameters that the film does not tell, with what would."""
        deviations = np.sqrt(np.diag(covariance))
        bends = self.bends(film, rough)
        return {
            name: ADVICE[name]
            for name, deviation in zip(self.free, deviations, strict=True)
            if deviation > VAGUE or not (bends or name in MOVES)
        }

    def bends(self, film: Film, found: Estimate) -> bool:
        """Whether the rod is seen to bend: then neither twice nor half of E fits as well.

        (Noise has a best E, too, and near it an interval that is too narrow.)
        """
        if STIFFNESS not in self.free:
            return True
        place = self.free.index(STIFFNESS)
        rest = tuple(name for name in self.free if name != STIFFNESS)
        costs = []
        for factor in (TWICE, 1 / TWICE):
            value = float(np.exp(found.x[place])) * factor
            rod = replace(film.rod, free=rest, known={**film.rod.known, STIFFNESS: value})
            other = self.solved(
                replace(film, rod=rod), np.delete(found.x, place), rounds=ROUNDS, final=False
            )
            costs.append(deviance(other.residuals, found.sigma))
        return min(costs) - deviance(found.residuals, found.sigma) > TOLD

    def together(
        self, logs: Array, covariance: Array, vague: Mapping[str, str]
    ) -> dict[str, Interval]:
        """Ratios and products of vague parameters that the film does tell."""
        found = {}
        for i, j in combinations(range(len(self.free)), 2):
            one, other = self.free[i], self.free[j]
            scale = np.sqrt(covariance[i, i] * covariance[j, j])
            if not {one, other} <= set(vague) or abs(covariance[i, j]) < TOGETHER_ONLY * scale:
                continue
            sign = -1.0 if covariance[i, j] > 0 else 1.0
            variance = covariance[i, i] + covariance[j, j] + 2 * sign * covariance[i, j]
            if variance < VAGUE**2:
                name = f"{one} {'/' if sign < 0 else '*'} {other}"
                found[name] = interval(logs[i] + sign * logs[j], float(np.sqrt(variance)))
        return found

    def holdout(self, film: Film, whole: Estimate) -> Holdout:
        """Fits the first part of the film and foretells the rest."""
        frames = len(self.tracks.times)
        seen = int(SEEN * frames)
        first = replace(film, tracks=self.tracks.part(0, seen))
        found = self.solved(first, whole.x, final=False)
        rest = slice(seen, frames)

        def off(x: Array) -> float:
            gaps = film.predict(x)[0][rest] - self.tracks.points[rest]
            gaps = gaps[np.isfinite(gaps)]
            # (Outliers are no fault of the model.)
            return 1.4826 * float(np.median(np.abs(gaps)))

        guessed = found.x.copy()
        guessed[: len(self.free)] = np.log(self.values)
        return Holdout(frames - seen, found.sigma, off(found.x), off(guessed))

    def _named(self, x: Array) -> dict[str, float]:
        return dict(zip(self.free, np.exp(x).tolist(), strict=False))

    def _intervals(self, logs: Array, covariance: Array) -> dict[str, Interval]:
        deviations = np.sqrt(np.diag(covariance))
        rows = zip(self.free, logs, deviations, strict=True)
        return {name: interval(log, deviation) for name, log, deviation in rows}

    def _camera(self, found: Estimate) -> dict[str, Interval]:
        """The camera's scale as a factor, the others as they are."""
        shared = len(self.free) + len(CAMERA)
        deviations = np.sqrt(np.diag(found.covariance))[len(self.free) : shared]
        pairs = zip(found.x[len(self.free) : shared], deviations, strict=True)
        rows = dict(zip(CAMERA, pairs, strict=True))
        camera = {
            name: Interval(float(x), float(x - WIDE * d), float(x + WIDE * d))
            for name, (x, d) in rows.items()
        }
        return {**camera, "scale": interval(*rows["scale"])}


def interval(log: float, deviation: float) -> Interval:
    """A value and its 95 % interval, from its logarithm."""
    ends = log - WIDE * deviation, log + WIDE * deviation
    return Interval(float(np.exp(log)), *(float(np.exp(end)) for end in ends))


def deviance(residuals: Array, sigma: float) -> float:
    """Chi-square, in which an outlier counts no more than the least outlier."""
    return float(np.sum(np.minimum(np.abs(residuals) / sigma, OUTLIER) ** 2))


def extrapolated(coarse: Array, fine: Array) -> Array:
    """Logarithms of parameters of infinitely many nodes: the error falls with the edges' square."""
    ratio = ((NODES[-1] - 1) / (NODES[-2] - 1)) ** 2
    return fine + (fine - coarse) / (ratio - 1)


def cuts(times: Array, seconds: float) -> tuple[int, ...]:
    """First frames of pieces of at least so long; a rest that is too short joins the last."""
    firsts = [0]
    for i, time in enumerate(times):
        if time - times[firsts[-1]] >= seconds * 0.999 and times[-1] - time >= 0.7 * seconds:
            firsts.append(i)
    if len(times) < 2:
        raise FramesError("a film needs more than one frame")
    return tuple(firsts)
