"""Plays several policies on the same seeds and writes everything about it into a run's folder."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgym import _checks as checks
from rodgym import machines
from rodgym.evaluation import Evaluation, Policy, Record, evaluate, record, statistics
from rodgym.evaluation.conditions import make_single
from rodgym.evaluation.design import Design
from rodgym.evaluation.pooled import pooled, scores, several
from rodgym.evaluation.trajectories import write_trajectories
from rodgym.extras import installed
from rodgym.report import animation, plots
from rodgym.report import statistics as pictures
from rodgym.report.gif import write_gif
from rodgym.report.players import Player, describe
from rodgym.runs import Run, write_csv

if TYPE_CHECKING:
    from rodgym.robustness import Robustness
    from rodgym.training import Training

#: GIF delays are whole hundredths of a second: 25 pictures a second is exact.
FRAME_RATE = 25.0
#: Longest animation [s] of simulated time.
MAX_SECONDS = 12.0


@dataclass(frozen=True)
class Entrant:
    """A policy, what it is called, what a controller is designed for, and the statistics of a
    trained one (see `rodgym.evaluation.evaluate`); `others` are further trainings of its recipe.
    """

    name: str
    policy: str | Policy
    design: Design | None = None
    normalize: Any = None
    others: tuple[str, ...] = ()

    def each(self) -> list[tuple[str, str | Policy]]:
        """The policy and the others, and what each is called in ``scores.csv``."""
        every = (self.policy, *self.others)
        if not self.others:
            return [(self.name, self.policy)]
        return [(f"{self.name}, training {number}", p) for number, p in enumerate(every, start=1)]

    def how(self) -> dict[str, Any]:
        """Keywords of an evaluation."""
        return {"design": self.design, "normalize": self.normalize}


@dataclass(frozen=True)
class Comparison:
    """What a report tells: every tuple has one item per entrant."""

    env_id: str
    env_kwargs: Mapping[str, Any]
    evaluations: tuple[Evaluation, ...]
    records: tuple[Record, ...]
    players: tuple[Player, ...]
    #: Trainings whose curves are shown: none, one, or several that differ in their seeds.
    trainings: tuple[Training, ...]
    #: What several trainings of one recipe tell, a line each.
    statistics: tuple[str, ...]
    seconds: float
    #: How much may go wrong, where that was measured; ``robustness.png`` is drawn then.
    robustness: Robustness | None = None


def compare(
    entrants: Sequence[Entrant],
    env_id: str,
    run: Run,
    *,
    seeds: Sequence[int] = range(100),
    env_kwargs: Mapping[str, Any] | None = None,
    trainings: Sequence[Training] = (),
    trajectories: str | None = None,
) -> Comparison:
    """Evaluates all on the same seeds, then writes tables, plots and the animation.

    Files: ``scores.csv`` (one row per policy and seed), ``episode.csv`` (the steps of the episode
    that is shown), ``scores.png``, ``episode.png``, ``moment.png``, ``animation.gif``, where
    imageio-ffmpeg is installed ``animation.mp4``, with trainings ``learning_curve.png``; where an
    entrant was trained several times, ``intervals.png`` and ``profiles.png``; with a policy that
    learns its machine ``estimates.png``; and the machine's own pictures. With `trajectories`,
    ``"csv"`` or ``"parquet"``, every step of every episode too.
    """
    began = time.perf_counter()
    seeds = checks.seeds(seeds)
    kwargs = dict(env_kwargs or {})
    kept = trajectories is not None
    singles = [
        [
            evaluate(p, env_id, seeds, env_kwargs=kwargs, trajectories=kept, name=name, **e.how())
            for name, p in e.each()
        ]
        for e in entrants
    ]
    evaluations = tuple(
        pooled(found, several(e.name, len(found))) if len(found) > 1 else found[0]
        for e, found in zip(entrants, singles, strict=True)
    )
    records = tuple(
        record(
            e.policy,
            env_id,
            seeds[0],
            env_kwargs=kwargs,
            frame_rate=FRAME_RATE,
            max_seconds=MAX_SECONDS,
            name=e.each()[0][0],
            **e.how(),
        )
        for e in entrants
    )
    _write_scores(run, [one for found in singles for one in found])
    if trajectories is not None:
        write_trajectories(run.file(f"trajectories.{trajectories}"), evaluations)
    _write_episode(run, records)
    env = make_single(env_id, kwargs)
    try:
        players = tuple(describe(e, env, env_id) for e in entrants)
    finally:
        env.close()
    plots.distributions(run.file("scores.png"), evaluations)
    plots.episodes(run.file("episode.png"), records)
    if plots.learned(records):
        plots.estimates(run.file("estimates.png"), records)
    plots.moment(run.file("moment.png"), records)
    for own in machines.of(records[0].spec).pictures:
        own.draw(run.file(own.file), records, evaluations)
    frames = animation.side_by_side(records)
    write_gif(run.file("animation.gif"), frames, records[0].frame_dt)
    if installed("imageio_ffmpeg"):
        animation.write_mp4(run.file("animation.mp4"), frames, records[0].frame_dt)
    if trainings:
        _draw_learning(run, trainings, entrants, evaluations, env_id, kwargs)
    grouped = {e.name: scores(found) for e, found in zip(entrants, singles, strict=True)}
    lines: tuple[str, ...] = ()
    if any(len(found) > 1 for found in singles):
        lines = several_trainings(run, grouped)
    seconds = time.perf_counter() - began
    return Comparison(
        env_id, kwargs, evaluations, records, players, tuple(trainings), lines, seconds
    )


def _draw_learning(
    run: Run,
    trainings: Sequence[Training],
    entrants: Sequence[Entrant],
    evaluations: Sequence[Evaluation],
    env_id: str,
    kwargs: Mapping[str, Any],
) -> None:
    """The curves; the other policies' lines are their means on the very same validation seeds."""
    from rodgym.training.watch import CURVE, VALIDATION_SEEDS

    levels = {
        e.name: evaluate(e.policy, env_id, VALIDATION_SEEDS, env_kwargs=kwargs, **e.how()).mean(
            "return"
        )
        for e in entrants[1:]
    }
    best = evaluations[0].best_known
    if best is not None:
        levels["best known"] = best
    path = run.file("learning_curve.png")
    if len(trainings) == 1:
        (training,) = trainings
        plots.learning_curve(
            path, training.curve, training.columns, entrants[0].name, levels, training.best_steps
        )
        return
    columns = [CURVE.index(name) for name in ("steps", "seconds", "return")]
    curves = [tuple([row[c] for row in t.curve] for c in columns) for t in trainings]
    pictures.learning_curves(path, {entrants[0].name: curves}, levels)  # type: ignore[dict-item]


def several_trainings(run: Run, grouped: Mapping[str, NDArray[np.float64]]) -> tuple[str, ...]:
    """Draws intervals and profiles, and puts the intervals into words."""
    pictures.intervals(run.file("intervals.png"), grouped)
    pictures.profiles(run.file("profiles.png"), grouped)
    lines = []
    first, *others = grouped
    for name, found in grouped.items():
        about = statistics.summary(found)
        who = several(name, about.trained) if about.trained > 1 else name
        text = f"{who}: interquartile mean {about.interquartile_mean}, mean {about.mean}"
        lines.append(f"{text}, median {about.median}")
    for name in others:
        better = statistics.probability_of_improvement(grouped[first], grouped[name])
        lines.append(f"{first} returns more than {name} with probability {better}")
    return tuple(lines)


def _write_scores(run: Run, evaluations: Sequence[Evaluation]) -> None:
    rows = [row for evaluation in evaluations for row in evaluation.rows()]
    write_csv(run.file("scores.csv"), evaluations[0].header, rows)


def _write_episode(run: Run, records: Sequence[Record]) -> None:
    """One row per policy and step: time, reward, action, metrics [SI], edge angles [rad]."""
    keys = list(records[0].metrics)
    edges = records[0].angles.shape[1]
    header = ["policy", "seed", "time", "reward", "action", *keys]
    header += [f"angle_{k + 1}" for k in range(edges)]
    rows = [
        [
            r.policy,
            r.seed,
            *(
                f"{value:.9g}"
                for value in (
                    r.time[t],
                    r.rewards[t],
                    r.actions[t, 0],
                    *(r.metrics[key][t] for key in keys),
                    *r.angles[t],
                )
            ),
        ]
        for r in records
        for t in range(len(r.time))
    ]
    write_csv(run.file("episode.csv"), header, rows)
