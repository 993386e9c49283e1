"""Scores of trainings: `make scores`, or `python tests/long/scores.py --trainings 10`.

Trains the swing-up's recipe on several seeds, plays every agent and the LQR on the same 100 seeds,
and writes docs/scores.md with its pictures. What is trained already is not trained again: ended, it
goes on when it is called once more.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from rodgym.evaluation import Evaluation, comparison_table, evaluate, statistics
from rodgym.evaluation.pooled import pooled, scores
from rodgym.report import statistics as pictures
from rodgym.runs import Run
from rodgym.training import Training, load_recipe, train_seeds
from rodgym.training.watch import CURVE, VALIDATION_SEEDS

DOCS = Path(__file__).parents[2] / "docs"
ENV = "rodgym/PendulumSwingUp-v0"
#: The first training seed. Those below were used while the recipe was looked for.
FIRST = 20


def row(name: str, about: statistics.Summary, evaluation: Evaluation) -> str:
    """A policy in the table of all: the intervals, then means."""
    return (
        f"| {name} | {about.interquartile_mean} | {about.mean} | {about.median.value:.1f} "
        f"| {100 * evaluation.mean('upright'):.0f} % | {evaluation.mean('time_to_upright'):.2f} s "
        f"| {1e3 * evaluation.mean('effort'):.1f} mN m "
        f"| {np.degrees(evaluation.mean('sway')):.1f} deg |"
    )


def page(trainings: list[Training], agents: list[Evaluation], lqr: Evaluation, run: Run) -> str:
    """The text of docs/scores.md."""
    versions = ", ".join(f"{name} {value}" for name, value in run.facts["versions"].items())
    rows = "\n".join(
        f"| {t.seed} | {e.mean('return'):.1f} | {e.columns['return'].min():.1f} "
        f"| {100 * e.mean('upright'):.0f} % | {e.mean('time_to_upright'):.2f} s "
        f"| {1e3 * e.mean('effort'):.1f} mN m | {np.degrees(e.mean('sway')):.1f} deg "
        f"| {t.best_steps:,} | {t.seconds:.0f} s |"
        for t, e in zip(trainings, agents, strict=True)
    )
    ours, theirs = scores(agents), scores([lqr])
    name = f"PPO, {len(trainings)} training seeds"
    table = "\n".join(
        [
            row(name, statistics.summary(ours), pooled(agents, name)),
            row("LQR (`lqr`)", statistics.summary(theirs), lqr),
        ]
    )
    better = statistics.probability_of_improvement(ours, theirs)
    returns = [e.mean("return") for e in agents]
    return f"""# Scores

This page compares agents that PPO trained with the linear quadratic regulator (LQR) in
`{ENV}`. The recipe of the trainings is `baselines/zoo/ppo.yml`. It was found with other
training seeds than the {len(trainings)} of this page, which are {trainings[0].seed} to
{trainings[-1].seed}.
Every agent and the LQR play the episodes with the seeds 0 to {len(lqr.seeds) - 1}, which were not
used for any choice.

Written by `make scores` on
{run.facts["date"]} ({run.facts["machine"]}; {versions}).

| policy | return: interquartile mean | mean | median | upright | time | torque (rms) | sway |
|---|---|---|---|---|---|---|---|
{table}

The brackets hold 95 % intervals of the stratified bootstrap. For PPO it draws training seeds and
episodes; for the LQR, which is not trained, it draws episodes alone. PPO returns more than the LQR
with probability {better}. The mean returns of the trainings lie between {min(returns):.1f} and
{max(returns):.1f}.

The next table has one row for each training:

| training seed | return | worst | upright | time | torque (rms) | sway | kept at step | wall time |
|---|---|---|---|---|---|---|---|---|
{rows}

![Learning curves](images/scores.png)

* *Upright*: the share of episodes in which the tip stands above 0.95 rod lengths on average over
  the last second.
* *Time*: the time from which on the tip stays above 0.9 rod lengths.
* *Sway*: the root mean square of the angles between edges and vertical over the last second.
* *Kept at step*: an agent is tested 25 times while it trains, with {len(VALIDATION_SEEDS)}
  validation seeds ({VALIDATION_SEEDS[0]} and up). The agent of the test with the best return is
  kept.

The learning curves show the returns on the validation seeds. The line is the interquartile mean,
and the band its 95 % interval.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trainings", type=int, default=10)
    parser.add_argument("--first", type=int, default=FIRST, help="first training seed")
    args = parser.parse_args()
    run = Run("scores")
    seeds = range(args.first, args.first + args.trainings)
    trainings = train_seeds(ENV, run, seeds, recipe=load_recipe(ENV))
    if trainings[-1].interrupted:
        raise SystemExit("interrupted; called again, it goes on")
    agents = [evaluate(str(t.policy), ENV, name=f"PPO, seed {t.seed}") for t in trainings]
    lqr = evaluate("lqr", ENV, name="LQR")
    columns = [CURVE.index(name) for name in ("steps", "seconds", "return")]
    curves = [tuple([row[c] for row in t.curve] for c in columns) for t in trainings]
    reference = {"LQR": evaluate("lqr", ENV, VALIDATION_SEEDS).mean("return")}
    pictures.learning_curves(DOCS / "images" / "scores.png", {"PPO": curves}, reference)
    (DOCS / "scores.md").write_text(page(trainings, agents, lqr, run), encoding="utf-8")
    print(comparison_table([*agents, lqr]))
    print(f"wrote {DOCS / 'scores.md'}")


if __name__ == "__main__":
    main()
