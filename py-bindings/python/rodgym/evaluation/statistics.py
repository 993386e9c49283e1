"""What few training runs tell: interquartile means, intervals, profiles.

After Agarwal, Schwarzer, Castro, Courville and Bellemare, "Deep reinforcement learning at the edge
of the statistical precipice" (NeurIPS 2021), in numpy alone. Every function takes *scores*:

* an array (training seeds, episodes), one number an episode, the same episodes for every training
  seed; an array (episodes,) stands for a policy that was not trained, or for a single training;
* or a list of such arrays, one a *stratum*: a task, a band, anything that runs are not drawn from.

Intervals come from the stratified bootstrap. Within each stratum it draws training seeds with
replacement, and for each training seed drawn its episodes with replacement: episodes of one
training share its luck, so they must not be drawn as if they were trainings. With one training
seed the interval covers the episodes alone, which `Summary.trained` lets a table say. The draws
have a fixed seed, so the same scores give the same interval.

>>> import numpy as np
>>> from rodgym.evaluation import statistics
>>> scores = np.array([[470.0, 471.0, 472.0, 473.0], [460.0, 470.0, 471.0, 479.0]])
>>> statistics.interquartile_mean(scores)
471.0
>>> bounds = statistics.interval(scores)
>>> bounds.low <= bounds.value <= bounds.high
True
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from rodgym._checks import refused

Floats: TypeAlias = npt.NDArray[np.float64]
#: Scores (training seeds, episodes) or (episodes,), or a list of them, one a stratum.
Scores: TypeAlias = npt.ArrayLike | Sequence[npt.ArrayLike]
#: A number that many scores are summed up in, along the last axis.
Statistic: TypeAlias = Callable[[Floats], Floats]

#: Draws of the bootstrap and their seed; share that an interval covers.
RESAMPLES = 2000
SEED = 0
LEVEL = 0.95
#: Draws that are made at once.
TURN = 100
#: Share of the scores that the interquartile mean leaves out at each end.
TRIM = 0.25


@dataclass(frozen=True)
class Interval:
    """A statistic of the scores, and where its interval begins and ends."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.4g} [{self.low:.4g}, {self.high:.4g}]"


@dataclass(frozen=True)
class Summary:
    """Scores summed up: ``trained`` training seeds of ``episodes`` episodes each."""

    mean: Interval
    interquartile_mean: Interval
    median: Interval
    trained: int
    episodes: int


@dataclass(frozen=True)
class Profile:
    """Share of the episodes, (t,), that score above each of the thresholds (t,), with its band."""

    thresholds: Floats
    share: Floats
    low: Floats
    high: Floats


@dataclass(frozen=True)
class CurveBand:
    """A curve over x (t,) with the interval about it, over training seeds."""

    x: Floats
    value: Floats
    low: Floats
    high: Floats


def trimmed_mean(values: Floats) -> Floats:
    """Mean of the middle half along the last axis (as `scipy.stats.trim_mean` with 0.25)."""
    count = values.shape[-1]
    cut = int(TRIM * count)
    middle = np.sort(values, axis=-1)[..., cut : count - cut]
    return np.asarray(middle.mean(axis=-1), np.float64)


def mean(values: Floats) -> Floats:
    """Mean along the last axis."""
    return np.asarray(values.mean(axis=-1), np.float64)


def middle(values: Floats) -> Floats:
    """Median along the last axis."""
    return np.asarray(np.median(values, axis=-1), np.float64)


def interquartile_mean(scores: Scores) -> float:
    """Mean of the middle half of all scores: less bent by one bad run than the mean, and surer than
    the median.
    """
    return float(trimmed_mean(_all(strata(scores))))


def median(scores: Scores) -> float:
    """Median of all scores."""
    return float(middle(_all(strata(scores))))


def interval(
    scores: Scores,
    statistic: Statistic = trimmed_mean,
    *,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> Interval:
    """A statistic of all scores with its interval by the stratified bootstrap (percentiles).

    Arguments:
        scores: see above.
        statistic: `trimmed_mean`, `mean`, `middle`, or a function of yours from (r, n) to (r,).
        level: share of the draws that the interval covers.
        resamples: draws.
        seed: of the draws.

    Raises:
        ParameterError: scores that are not finite numbers of such a shape.
    """
    parts = strata(scores)
    value = float(statistic(_all(parts)))
    turns = _resampled(parts, resamples, seed)
    drawn = np.concatenate([statistic(np.concatenate(turn, axis=1)) for turn in turns])
    low, high = _ends(drawn, level)
    return Interval(value, float(low), float(high))


def summary(scores: Scores, *, resamples: int = RESAMPLES, seed: int = SEED) -> Summary:
    """Mean, interquartile mean and median with their 95 % intervals."""
    parts = strata(scores)

    def found(statistic: Statistic) -> Interval:
        return interval(parts, statistic, resamples=resamples, seed=seed)

    return Summary(
        mean=found(mean),
        interquartile_mean=found(trimmed_mean),
        median=found(middle),
        trained=min(len(part) for part in parts),
        episodes=sum(part.shape[1] for part in parts),
    )


def probability_of_improvement(
    scores: Scores,
    other: Scores,
    *,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> Interval:
    """Probability that a training behind `scores`, drawn at random, beats one behind `other` on the
    same episode; a tie counts half (the U statistic of Mann and Whitney, episode by episode).

    Raises:
        ParameterError: the two were not scored on as many episodes, stratum by stratum.
    """
    return _compared(_better, scores, other, level, resamples, seed)


def ratio(
    scores: Scores,
    other: Scores,
    *,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> Interval:
    """Mean of the scores over that of others on the same episodes, which are drawn together.

    Raises:
        ParameterError: the two were not scored on as many episodes, stratum by stratum.
    """
    return _compared(_ratio, scores, other, level, resamples, seed)


def _compared(
    statistic: Callable[[list[tuple[Floats, Floats]]], float],
    scores: Scores,
    other: Scores,
    level: float,
    resamples: int,
    seed: int,
) -> Interval:
    """A number of two policies that played the same episodes: trainings are drawn apart, episodes
    together.
    """
    ours, theirs = strata(scores), strata(other)
    if [a.shape[1] for a in ours] != [b.shape[1] for b in theirs]:
        shapes = [a.shape for a in ours], [b.shape for b in theirs]
        raise refused("scores", shapes, "scores of both policies on the same episodes")
    rng = np.random.default_rng(seed)
    drawn = []
    for _ in range(resamples):
        pairs = []
        for a, b in zip(ours, theirs, strict=True):
            episodes = rng.integers(a.shape[1], size=a.shape[1])
            left, right = (rng.integers(len(part), size=len(part)) for part in (a, b))
            pairs.append((a[left][:, episodes], b[right][:, episodes]))
        drawn.append(statistic(pairs))
    low, high = _ends(np.array(drawn), level)
    return Interval(statistic(list(zip(ours, theirs, strict=True))), float(low), float(high))


def performance_profile(
    scores: Scores,
    thresholds: npt.ArrayLike,
    *,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> Profile:
    """Share of the episodes above each threshold, with a band point by point: one picture that
    shows the whole distribution. Strata weigh alike.
    """
    parts = strata(scores)
    at = np.asarray(thresholds, np.float64)

    def share(rows: list[Floats]) -> Floats:
        return np.asarray(np.mean([_above(row, at) for row in rows], axis=0), np.float64)

    turns = _resampled(parts, resamples, seed)
    drawn = np.array([share(list(rows)) for turn in turns for rows in zip(*turn, strict=True)])
    low, high = _ends(drawn, level)
    return Profile(at, share(parts), np.asarray(low), np.asarray(high))


def curve_band(
    curves: Sequence[tuple[npt.ArrayLike, npt.ArrayLike]],
    points: int = 200,
    *,
    statistic: Statistic = trimmed_mean,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> CurveBand:
    """Learning curves of several training seeds as one curve with an interval.

    Arguments:
        curves: pairs (x, y) of each training seed, x growing: steps or seconds.
        points: places between the first and the last x that all curves have, evenly; curves are
            read between their points along straight lines.
        statistic: what stands for the training seeds at each place.
        level: as for `interval`, and so are `resamples` and `seed`.
    """
    pairs = [(np.asarray(x, np.float64), np.asarray(y, np.float64)) for x, y in curves]
    if not pairs or any(x.ndim != 1 or x.shape != y.shape or x.size == 0 for x, y in pairs):
        shapes = [(x.shape, y.shape) for x, y in pairs]
        raise refused("curves", shapes, "at least one pair of arrays (t,) and (t,)")
    first, last = max(x[0] for x, _ in pairs), min(x[-1] for x, _ in pairs)
    grid = np.linspace(first, max(first, last), points)
    values = np.array([np.interp(grid, x, y) for x, y in pairs])
    rng = np.random.default_rng(seed)
    rows = rng.integers(len(values), size=(resamples, len(values)))
    drawn = np.array([statistic(values[chosen].T) for chosen in rows])
    low, high = _ends(drawn, level)
    return CurveBand(grid, statistic(values.T), np.asarray(low), np.asarray(high))


def strata(scores: Scores) -> list[Floats]:
    """Scores as a list of arrays (training seeds, episodes), checked.

    Raises:
        ParameterError: not of that shape, empty, or with numbers that are not finite.
    """
    given: Any = scores
    several = isinstance(given, list | tuple) and any(np.ndim(part) == 2 for part in given)
    parts = [np.asarray(part, np.float64) for part in (given if several else [given])]
    checked = [part[np.newaxis] if part.ndim == 1 else part for part in parts]
    for part in checked:
        if part.ndim != 2 or not part.size:
            raise refused("scores", part.shape, "an array (training seeds, episodes)")
        if not np.isfinite(part).all():
            raise refused("scores", part, "finite numbers only")
    return checked


def _all(parts: Sequence[Floats]) -> Floats:
    return np.concatenate([part.ravel() for part in parts])


def _resampled(parts: list[Floats], resamples: int, seed: int) -> Iterator[list[Floats]]:
    """Draws, `TURN` at a time: for each stratum its scores as rows (draws, scores)."""
    rng = np.random.default_rng(seed)
    for first in range(0, resamples, TURN):
        count = min(TURN, resamples - first)
        yield [_resample(part, count, rng) for part in parts]


def _resample(part: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Training seeds, and for each its episodes."""
    trained, episodes = part.shape
    rows = rng.integers(trained, size=(count, trained, 1))
    columns = rng.integers(episodes, size=(count, trained, episodes))
    return part[rows, columns].reshape(count, -1)


def _ratio(pairs: list[tuple[Floats, Floats]]) -> float:
    ours, theirs = (np.concatenate([pair[i].ravel() for pair in pairs]).mean() for i in (0, 1))
    return float(ours / theirs)


def _better(pairs: Sequence[tuple[Floats, Floats]]) -> float:
    """Mean over strata and episodes of the share of pairs of trainings that the first one wins."""
    shares = []
    for a, b in pairs:
        left, right = a[:, np.newaxis], b[np.newaxis]
        shares.append(np.mean((left > right) + 0.5 * (left == right)))
    return float(np.mean(shares))


def _above(part: Floats, thresholds: Floats) -> Floats:
    """Share of the scores above each threshold."""
    ordered = np.sort(part, axis=None)
    below = np.searchsorted(ordered, thresholds, side="right")
    return np.asarray(1.0 - below / ordered.size, np.float64)


def _ends(drawn: Floats, level: float) -> tuple[Any, Any]:
    if not 0.0 < level < 1.0:
        raise refused("level", level, "a share above 0 and below 1")
    rest = 50.0 * (1.0 - level)
    low, high = np.percentile(drawn, [rest, 100.0 - rest], axis=0)
    return low, high
