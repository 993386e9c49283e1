"""Plays several policies on the same seeds and writes everything about it into a run's folder."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rodgym import _checks as checks
from rodgym import machines
from rodgym.evaluation import Evaluation, Policy, Record, evaluate, record
from rodgym.report import animation, plots
from rodgym.runs import Run, write_csv

if TYPE_CHECKING:
    from rodgym.training import Training

#: GIF delays are whole hundredths of a second: 25 pictures a second is exact.
FRAME_RATE = 25.0
#: Longest animation [s] of simulated time.
MAX_SECONDS = 12.0


@dataclass(frozen=True)
class Entrant:
    """A policy and what it is called."""

    name: str
    policy: str | Policy


@dataclass(frozen=True)
class Comparison:
    """What a report tells: every tuple has one item per entrant."""

    env_id: str
    env_kwargs: Mapping[str, Any]
    evaluations: tuple[Evaluation, ...]
    records: tuple[Record, ...]
    training: Training | None
    seconds: float


def compare(
    entrants: Sequence[Entrant],
    env_id: str,
    run: Run,
    *,
    seeds: Sequence[int] = range(100),
    env_kwargs: Mapping[str, Any] | None = None,
    training: Training | None = None,
) -> Comparison:
    """Evaluates all on the same seeds, then writes tables, plots and the animation.

    Files: ``scores.csv`` (one row per policy and seed), ``episode.csv`` (the steps of the episode
    that is shown), ``scores.png``, ``episode.png``, ``animation.gif``; with a training
    ``learning_curve.png``; with a policy that learns its machine ``estimates.png``; and the
    machine's own pictures.
    """
    began = time.perf_counter()
    seeds = checks.seeds(seeds)
    kwargs = dict(env_kwargs or {})
    evaluations = tuple(
        evaluate(e.policy, env_id, seeds, env_kwargs=kwargs, name=e.name) for e in entrants
    )
    records = tuple(
        record(
            e.policy,
            env_id,
            seeds[0],
            env_kwargs=kwargs,
            name=e.name,
            frame_rate=FRAME_RATE,
            max_seconds=MAX_SECONDS,
        )
        for e in entrants
    )
    _write_scores(run, evaluations)
    _write_episode(run, records)
    plots.distributions(run.file("scores.png"), evaluations)
    plots.episodes(run.file("episode.png"), records)
    if plots.learned(records):
        plots.estimates(run.file("estimates.png"), records)
    for picture in machines.of(records[0].spec).pictures:
        picture.draw(run.file(picture.file), records, evaluations)
    animation.write_gif(
        run.file("animation.gif"), animation.side_by_side(records), records[0].frame_dt
    )
    if training is not None:
        _draw_learning(run, training, entrants, env_id, kwargs)
    seconds = time.perf_counter() - began
    return Comparison(env_id, kwargs, evaluations, records, training, seconds)


def _draw_learning(
    run: Run,
    training: Training,
    entrants: Sequence[Entrant],
    env_id: str,
    kwargs: Mapping[str, Any],
) -> None:
    """The curve; the other policies' lines are their means on the very same validation seeds."""
    from rodgym.training.trainer import VALIDATION_SEEDS

    levels = {
        e.name: evaluate(e.policy, env_id, VALIDATION_SEEDS, env_kwargs=kwargs).mean("return")
        for e in entrants[1:]
    }
    plots.learning_curve(
        run.file("learning_curve.png"),
        training.curve,
        training.columns,
        entrants[0].name,
        levels,
        training.best_steps,
    )


def _write_scores(run: Run, evaluations: Sequence[Evaluation]) -> None:
    header = ["policy", "seed", *(c.name for c in evaluations[0].described)]
    rows = [row for evaluation in evaluations for row in evaluation.rows()]
    write_csv(run.file("scores.csv"), header, rows)


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
