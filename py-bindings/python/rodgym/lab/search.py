"""The search for the most probable rod: pieces of the film first, then the film as a whole.

A film shows a continuous rod, a model has so many nodes: few nodes bend more easily. So the whole
film is fitted with more and more nodes, and the parameters are those of infinitely many.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence

import numpy as np

from rodgym.lab import shapes
from rodgym.lab.errors import FramesError, MisfitError
from rodgym.lab.film import CAMERA, SHARED, Film, Rod, Torque
from rodgym.lab.gauss_newton import Estimate, solve
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
#: Duration of the shortest pieces of a rod of 0.3 m [s], and how many become one in the next round.
PIECE, TOGETHER = 0.25, 4
#: Residuals that no camera goes below, over the length.
FLOOR = 1e-7
#: What bends a rod.
STIFFNESS = "youngs_modulus"


class Search:
    """The steps of a fit; every step begins where the one before has ended."""

    def __init__(
        self,
        tracks: Tracks,
        places: Array,
        fixed: Mapping[str, float],
        free: tuple[str, ...],
        values: Sequence[float],
        rows: Mapping[str, Mapping[str, float]],
        torque: Torque | None = None,
        shared: int | None = None,
    ) -> None:
        self.tracks, self.places, self.fixed, self.free = tracks, places, fixed, free
        self.values, self.torque, self.shared = values, torque, shared
        # (Within the range, so that differences are, too.)
        self.limits = {
            name: (
                float(np.log(1.001 * max(float(rows[name]["low"]), 1e-9))),
                float(np.log(float(rows[name]["high"]) / 1.001)),
            )
            for name in free
        }
        self.floor = FLOOR * places[-1]

    def film(self, nodes: int, smooth: bool, steps: int, firsts: Sequence[int] = (0,)) -> Film:
        """A model of so many nodes."""
        rod = Rod(nodes, smooth, self.fixed, self.free, steps, self.shared)
        return Film(self.tracks, self.places, rod, tuple(firsts), self.torque)

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
        bench = np.zeros(len(film.bench))
        bench[2 : len(CAMERA)] = base
        x = film.start(np.array(self.values), bench, at)
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
        rounds, firsts = 0, self.cut(0)
        shared = self.film(nodes, smooth, ROUGH, firsts).shared
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


def extrapolated(free: Sequence[str], coarse: Array, fine: Array) -> Array:
    """Logarithms of parameters of infinitely many nodes.

    The error falls with the square of the edges' length. That of what nodes share falls with the
    length itself: the tip has the share of a whole edge, where half of one ends in it.
    """
    orders = np.array([1.0 if name == SHARED else 2.0 for name in free])
    return fine + (fine - coarse) / (((NODES[-1] - 1) / (NODES[-2] - 1)) ** orders - 1)


def cuts(times: Array, seconds: float) -> tuple[int, ...]:
    """First frames of pieces of at least so long; a rest that is too short joins the last."""
    firsts = [0]
    for i, time in enumerate(times):
        if time - times[firsts[-1]] >= seconds * 0.999 and times[-1] - time >= 0.7 * seconds:
            firsts.append(i)
    if len(times) < 2:
        raise FramesError("a film needs more than one frame")
    return tuple(firsts)
