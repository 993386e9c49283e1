"""From tracks of a swinging rod to its parameters, with what is known of them and how surely."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rodgym import _native
from rodgym._checks import number, refused, whole
from rodgym.lab import trust
from rodgym.lab.alike import widening
from rodgym.lab.errors import FramesError, MisfitError
from rodgym.lab.film import Torque
from rodgym.lab.gauss_newton import Estimate
from rodgym.lab.result import Fit, Interval, Level
from rodgym.lab.sanity import checked
from rodgym.lab.search import COARSE, FINE, NODES, ROUGH, Search, extrapolated
from rodgym.lab.swings import ENVIRONMENT
from rodgym.lab.tracks import Array, Tracks
from rodgym.lab.trust import WIDE, interval

#: What a rod is as long as.
LENGTH = "length"
#: Where a fit of a parameter starts that is zero by default.
START = {"damping": 1e-3, "bending_damping": 5e-4}
#: Residuals of the whole over those of pieces: beyond, the model is doubted, or refused.
DOUBTFUL, WRONG = 1.25, 2.5
#: Refused is also what leaves this much over and does not foretell its own film.
HALF_WRONG = 1.4
#: And what is off by more than this share of the length and does not foretell it.
COARSE_EYE = 0.01


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
    torque: Torque | None = None,
) -> Fit:
    """Fits a pendulum that swings freely, or that a known torque drives.

    Parameters
    ----------
    free: parameters to find
    known: the others, where they differ from the environments' defaults; `nodes` says that the rod
        itself is one of so many nodes
    start: where the fit starts
    places: of the markers along the rod [m]; left out: evenly from base to tip
    nodes: of the environment that the equivalent parameters are for; the damping is that of each of
        these, also of a continuous rod
    torque: on the base; left out: the base turns freely. Its clock is corrected by some hundredths
        of a second

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
    if torque is not None:
        driven(torque, tracks)
    start_values = [values[name] for name in free]
    shared = nodes if discrete is None else None
    search = Search(tracks, along, fixed, free, start_values, rows, torque, shared)
    return searched(search, None if discrete is None else int(discrete), nodes, given)


def driven(torque: Torque, tracks: Tracks) -> None:
    """Refuses what drives no rod of this film.

    Raises
    ------
    FramesError: times that do not rise, or that are others than the film's
    """
    times, values = np.asarray(torque.times), np.asarray(torque.values)
    if times.ndim != 1 or times.shape != values.shape or len(times) < 2:
        raise FramesError(f"{values.shape} torques for {times.shape} times; there must be as many")
    if (np.diff(times) <= 0).any() or not np.isfinite(values).all():
        raise FramesError("times of the torque must rise, and torques be finite")
    if not torque.largest > 0:
        raise FramesError("the torque is 0 all the time: leave it out")
    if times[0] > tracks.times[-1] or times[-1] < tracks.times[0]:
        raise FramesError(
            f"the torque is from {times[0]:g} to {times[-1]:g} s, the film from "
            f"{tracks.times[0]:g} to {tracks.times[-1]:g} s: they need one clock (lab.clocks "
            "aligns)"
        )


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


def searched(search: Search, discrete: int | None, nodes: int, known: Mapping[str, float]) -> Fit:
    """The whole search, and how far its result can be trusted."""
    smooth = discrete is None
    coarse, nodes_of_whole = (COARSE, NODES) if smooth else (discrete, (discrete,))
    levels, rough, noise = search.whole(int(coarse or 0), int(nodes_of_whole[0] or 0), smooth)
    if smooth:
        levels = search.refined(levels)
        logs = extrapolated(search.free, *(level.x[: len(search.free)] for _, level in levels[-2:]))
    else:
        logs = levels[0][1].x[: len(search.free)]
    film, best = levels[-1]
    misfit = float(best.sigma / noise)
    gaps = np.full(search.tracks.points.shape, np.nan)
    gaps[np.isfinite(search.tracks.points)] = best.residuals
    wider = widening([gaps])
    best = replace(best, covariance=wider * best.covariance)
    holdout = trust.holdout(search, *levels[0], wider)
    if misfit > WRONG or (misfit > HALF_WRONG and not holdout.passed):
        raise MisfitError(
            f"no {' and '.join(search.free)} makes the rod move like the film: the whole is off "
            f"by {1e3 * best.sigma:.2f} mm where short pieces are by {1e3 * noise:.2f} mm. A "
            "known value may be wrong (length, width, gravity), or the clock (frames a "
            "second), or the base does not turn freely, or the fit began too far off (--start)"
        )
    if holdout.useless or (not holdout.passed and best.sigma > COARSE_EYE * search.places[-1]):
        raise MisfitError(
            f"the fit does not foretell its own film: {holdout.words}. Too many markers may be "
            "wrong or swapped (look at the tracks), or the fit began too far off (--start)"
        )
    twin = None
    if discrete is None:
        own = search.solved(
            search.film(nodes, False, FINE), search.moved(rough.x, COARSE, nodes), final=False
        )
        twin = Level(nodes, _named(search.free, own.x), own.sigma)
    covariance = best.covariance[: len(search.free), : len(search.free)]
    vague = trust.vague(search, covariance, search.film(int(coarse or 0), smooth, ROUGH), rough)
    notes = [*search.tracks.notes]
    if misfit > DOUBTFUL:
        notes.append(
            f"the model does not follow the film well: {misfit:.2f} times the noise remains"
        )
    if wider > 1:
        notes.append(
            "residuals of neighbouring frames or markers are alike (lens, or model): intervals are "
            f"{np.sqrt(wider):.1f} times as wide for it"
        )
    if outliers := int((~best.kept).sum()):
        notes.append(f"{outliers} of {len(best.kept)} coordinates were outliers")
    return Fit(
        film=film,
        estimate=best,
        parameters=_intervals(search.free, logs, covariance),
        covariance=covariance,
        camera=_camera(search.free, film.bench, best),
        known={**known, **({"nodes": discrete} if discrete else {})},
        fixed=dict(search.fixed),
        not_identifiable=vague,
        together=trust.together(search.free, logs, covariance, vague),
        levels=[Level(f.rod.nodes, _named(search.free, e.x), e.sigma) for f, e in levels],
        twin=twin,
        holdout=holdout,
        noise=noise,
        misfit=misfit,
        notes=notes,
    )


def _named(free: tuple[str, ...], x: Array) -> dict[str, float]:
    return dict(zip(free, np.exp(x).tolist(), strict=False))


def _intervals(free: tuple[str, ...], logs: Array, covariance: Array) -> dict[str, Interval]:
    deviations = np.sqrt(np.diag(covariance))
    rows = zip(free, logs, deviations, strict=True)
    return {name: interval(log, deviation) for name, log, deviation in rows}


def _camera(free: tuple[str, ...], bench: tuple[str, ...], found: Estimate) -> dict[str, Interval]:
    """The camera's scale as a factor, the others as they are."""
    shared = len(free) + len(bench)
    deviations = np.sqrt(np.diag(found.covariance))[len(free) : shared]
    pairs = zip(found.x[len(free) : shared], deviations, strict=True)
    rows = dict(zip(bench, pairs, strict=True))
    camera = {
        name: Interval(float(x), float(x - WIDE * d), float(x + WIDE * d))
        for name, (x, d) in rows.items()
    }
    return {**camera, "scale": interval(*rows["scale"])}
