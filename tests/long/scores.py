"""Scores of trainings: `make scores`, or `python tests/long/scores.py --trainings 5`.

Trains the swing-up's recipe on several seeds, plays every agent and the LQR on the same 100 seeds,
and writes docs/scores.md with its picture.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from rodgym.evaluation import Evaluation, comparison_table, evaluate
from rodgym.report.style import COLOURS, level, styled
from rodgym.runs import Run
from rodgym.training import Training, load_recipe, train
from rodgym.training.trainer import CURVE, VALIDATION_SEEDS

DOCS = Path(__file__).parents[2] / "docs"
ENV = "rodgym/PendulumSwingUp-v0"


def draw(path: Path, trainings: list[Training], lqr: float) -> None:
    """Every training's validation return against steps, the LQR as a line."""
    with styled():
        figure, axes = plt.subplots(figsize=(8.4, 4.2))
        for training in trainings:
            steps, returns = (
                [row[CURVE.index(name)] for row in training.curve] for name in ("steps", "return")
            )
            axes.plot(np.array(steps) / 1e3, returns, color=COLOURS[0], lw=1.2, alpha=0.8)
        level(axes, lqr, "LQR", COLOURS[1])
        axes.set_title(f"PPO, {len(trainings)} trainings, on the validation seeds")
        axes.set_xlabel("environment steps [thousands]")
        axes.set_ylabel("mean return")
        axes.set_xlim(0)
        figure.savefig(path)
        plt.close(figure)


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
    returns = [e.mean("return") for e in agents]
    return f"""# Scores

PPO by the recipe of `baselines/zoo/ppo.yml` in `{ENV}`, trained on {len(trainings)} seeds;
every agent and the LQR play the seeds 0 to {len(lqr.seeds) - 1}, which chose nothing.
Written by `make scores` on
{run.facts["date"]} ({run.facts["machine"]}; {versions}).

Return of the agents: {np.mean(returns):.1f} on average over the trainings,
from {min(returns):.1f} to {max(returns):.1f}.
The LQR: {lqr.mean("return"):.1f}, upright in {100 * lqr.mean("upright"):.0f} %,
{lqr.mean("time_to_upright"):.2f} s, {1e3 * lqr.mean("effort"):.1f} mN m.

| training seed | return | worst | upright | time | torque (rms) | sway | kept at step | wall time |
|---|---|---|---|---|---|---|---|---|
{rows}

![Learning curves](images/scores.png)

*Upright*: the tip stands, on average over the last second, above 0.95 L.
*Time*: from when on it stays above 0.9 L.
*Sway*: rms angle of the edges to the vertical over the last second.
*Kept*: of 25 stages of the training the one with the best return on
{len(VALIDATION_SEEDS)} validation seeds ({VALIDATION_SEEDS[0]} and up).
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trainings", type=int, default=5)
    count = parser.parse_args().trainings
    recipe = load_recipe(ENV)
    trainings, agents = [], []
    for seed in range(count):
        run = Run(f"seed-{seed}", Path("runs/scores"))
        trainings.append(train(ENV, run, recipe=recipe, seed=seed))
        agents.append(evaluate(str(trainings[-1].policy), ENV, name=f"PPO, seed {seed}"))
    lqr = evaluate("lqr", ENV, name="LQR")
    reference = evaluate("lqr", ENV, VALIDATION_SEEDS).mean("return")
    draw(DOCS / "images" / "scores.png", trainings, reference)
    (DOCS / "scores.md").write_text(page(trainings, agents, lqr, run), encoding="utf-8")
    print(comparison_table([*agents, lqr]))
    print(f"wrote {DOCS / 'scores.md'}")


if __name__ == "__main__":
    main()
