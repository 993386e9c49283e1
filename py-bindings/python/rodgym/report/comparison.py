"""Plays several policies on the same seeds and writes everything about it into a run's folder."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rodgym import _checks as checks
from rodgym import machines
from rodgym.evaluation import Evaluation, Policy, Record, evaluate, record
from rodgym.evaluation.conditions import make_single
from rodgym.evaluation.design import Design
from rodgym.evaluation.trajectories import write_trajectories
from rodgym.extras import installed
from rodgym.report import animation, plots
from rodgym.report.players import Player, describe
from rodgym.runs import Run, write_csv

if TYPE_CHECKING:
    from rodgym.training import Training

#: GIF delays are whole hundredths of a second: 25 pictures a second is exact.
FRAME_RATE = 25.0
#: Longest animation [s] of simulated time.
MAX_SECONDS = 12.0


@dataclass(frozen=True)
class Entrant:
    """A policy, what it is called, what a controller is designed for, and the statistics of a
    trained one (see `rodgym.evaluation.evaluate`).
    """

    name: str
    policy: str | Policy
    design: Design | None = None
    normalize: Any = None

    def how(self) -> dict[str, Any]:
        """Keywords of an evaluation."""
        return {"name": self.name, "design": self.design, "normalize": self.normalize}


@dataclass(frozen=True)
class Comparison:
    """What a report tells: every tuple has one item per entrant."""

    env_id: str
    env_kwargs: Mapping[str, Any]
    evaluations: tuple[Evaluation, ...]
    records: tuple[Record, ...]
    players: tuple[Player, ...]
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
    trajectories: str | None = None,
) -> Comparison:
    """Evaluates all on the same seeds, then writes tables, plots and the animation.

    Files: ``scores.csv`` (one row per policy and seed), ``episode.csv`` (the steps of the episode
    that is shown), ``scores.png``, ``episode.png``, ``moment.png``, ``animation.gif``, where
    imageio-ffmpeg is installed ``animation.mp4``, with a training ``learning_curve.png``, and the
    machine's own pictures. With `trajectories`, ``"csv"`` or ``"parquet"``, every step of every
    episode too.
    """
    began = time.perf_counter()
    seeds = checks.seeds(seeds)
    kwargs = dict(env_kwargs or {})
    evaluations = tuple(
        evaluate(
            e.policy,
            env_id,
            seeds,
            env_kwargs=kwargs,
            trajectories=trajectories is not None,
            **e.how(),
        )
        for e in entrants
    )
    records = tuple(
        record(
            e.policy,
            env_id,
            seeds[0],
            env_kwargs=kwargs,
            frame_rate=FRAME_RATE,
            max_seconds=MAX_SECONDS,
            **e.how(),
        )
        for e in entrants
    )
    _write_scores(run, evaluations)
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
    plots.moment(run.file("moment.png"), records)
    for picture in machines.of(records[0].spec).pictures:
        picture.draw(run.file(picture.file), records, evaluations)
    pictures = animation.side_by_side(records)
    animation.write_gif(run.file("animation.gif"), pictures, records[0].frame_dt)
    if installed("imageio_ffmpeg"):
        animation.write_mp4(run.file("animation.mp4"), pictures, records[0].frame_dt)
    if training is not None:
        _draw_learning(run, training, entrants, evaluations, env_id, kwargs)
    seconds = time.perf_counter() - began
    return Comparison(env_id, kwargs, evaluations, records, players, training, seconds)


def _draw_learning(
    run: Run,
    training: Training,
    entrants: Sequence[Entrant],
    evaluations: Sequence[Evaluation],
    env_id: str,
    kwargs: Mapping[str, Any],
) -> None:
    """The curve; the other policies' lines are their means on the very same validation seeds."""
    from rodgym.training.trainer import VALIDATION_SEEDS

    levels = {
        e.name: evaluate(e.policy, env_id, VALIDATION_SEEDS, env_kwargs=kwargs, **e.how()).mean(
            "return"
        )
        for e in entrants[1:]
    }
    best = evaluations[0].best_known
    if best is not None:
        levels["best known"] = best
    plots.learning_curve(
        run.file("learning_curve.png"),
        training.curve,
        training.columns,
        entrants[0].name,
        levels,
        training.best_steps,
    )


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
