"""The plots of a comparison. Each function draws one figure and writes one PNG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from rodgym.evaluation import Evaluation, Record
from rodgym.report.style import COLOURS, FAINT, GRID, INK, level, styled

#: Traces of an episode, where the machine reports them: metric, axis label, factor to its unit.
TRACES = (
    ("torque", "torque [mN m]", 1e3),
    ("tip_height", "tip height / L", 1.0),
    ("pitch", "pitch [rad]", 1.0),
    ("thrust", "thrust [mN]", 1e3),
    ("power", "power [mW]", 1e3),
    ("hull_speed", "hull speed [mm/s]", 1e3),
)
#: Seconds of a fin's episode that are drawn.
FIN_SECONDS = 3.0


def learning_curve(
    path: Path,
    curve: Sequence[Sequence[float]],
    header: Sequence[str],
    name: str,
    levels: Mapping[str, float],
    best_steps: int,
) -> None:
    """Return on the validation seeds against environment steps, with other policies as lines."""
    column = {key: np.array([row[i] for row in curve]) for i, key in enumerate(header)}
    steps = column["steps"]
    with styled():
        figure, axes = plt.subplots(figsize=(8.4, 4.2))
        axes.fill_between(
            steps, column["return_low"], column["return_high"], color=COLOURS[0], alpha=0.15, lw=0
        )
        axes.plot(steps, column["return"], color=COLOURS[0], marker="o", markersize=3.5)
        for i, (label, value) in enumerate(levels.items(), start=1):
            level(axes, value, label, COLOURS[i % len(COLOURS)])
        kept = int(np.argmin(np.abs(steps - best_steps)))
        axes.plot(
            steps[kept], column["return"][kept], "o", markersize=10, mfc="none", mec=INK, mew=1.4
        )
        axes.annotate(
            "kept",
            (steps[kept], column["return"][kept]),
            xytext=(0, -16),
            textcoords="offset points",
            ha="center",
            color=INK,
        )
        axes.set_title(f"{name} on the validation seeds: mean, worst and best")
        axes.set_xlabel("environment steps")
        axes.set_ylabel("return of an episode")
        axes.set_xlim(0, max(steps[-1], 1))
        axes.xaxis.set_major_formatter(FuncFormatter(_thousands))
        _wall_time_axis(axes, steps, column["seconds"])
        figure.savefig(path)
        plt.close(figure)


def _thousands(value: float, _position: int = 0) -> str:
    return f"{value / 1e6:g} M" if value >= 1e6 else f"{value / 1e3:g} k" if value else "0"


def _wall_time_axis(axes: Axes, steps: np.ndarray, seconds: np.ndarray) -> None:
    """Says below the curve how long the training took."""
    axes.annotate(
        f"{seconds[-1]:.0f} s of wall time",
        (1.0, 0.02),
        xycoords="axes fraction",
        ha="right",
        va="bottom",
        color=FAINT,
    )


def episodes(path: Path, records: Sequence[Record]) -> None:
    """Angles of all edges, then action and machine traces; one column a policy, one seed.

    A fin beats too fast for whole episodes: its first seconds are shown.
    """
    shown = [trace for trace in TRACES if all(trace[0] in r.metrics for r in records)]
    rows = 1 + max(1, len(shown))
    with styled():
        figure, grid = plt.subplots(
            rows,
            len(records),
            figsize=(4.2 * len(records), 1.9 * rows + 0.6),
            sharex=True,
            sharey="row",
            squeeze=False,
            gridspec_kw={"height_ratios": [1.6, *[1.0] * (rows - 1)]},
        )
        for i, record in enumerate(records):
            colour = COLOURS[i % len(COLOURS)]
            _angles(grid[0, i], record)
            grid[0, i].set_title(record.policy, color=colour)
            for axes, (key, _, factor) in zip(grid[1:, i], shown, strict=False):
                axes.plot(record.time, factor * record.metrics[key], color=colour, lw=1.4)
            if not shown:
                grid[1, i].plot(record.time, record.actions[:, 0], color=colour, lw=1.4)
            grid[-1, i].set_xlabel("time [s]")
            if "pitch" in record.metrics:
                grid[-1, i].set_xlim(0.0, min(FIN_SECONDS, record.time[-1]))
        grid[0, 0].set_ylabel("edge angles [deg]")
        for axes, (_, label, _) in zip(grid[1:, 0], shown, strict=False):
            axes.set_ylabel(label)
        if not shown:
            grid[1, 0].set_ylabel("action")
        figure.savefig(path)
        plt.close(figure)


def _angles(axes: Axes, record: Record) -> None:
    """Every edge's angle, dark at base or nose and light at tip or tail, with up as a line."""
    # Angles are known up to whole turns: follow each through the episode without jumps.
    angles = np.degrees(np.unwrap(record.angles, axis=0))
    shades = plt.colormaps["viridis"](np.linspace(0.0, 0.85, max(angles.shape[1], 1)))
    for edge in range(angles.shape[1]):
        ends = (
            ("nose edge", "tail edge") if "pitch" in record.metrics else ("base edge", "tip edge")
        )
        label = {0: ends[0], angles.shape[1] - 1: ends[1]}.get(edge)
        axes.plot(record.time, angles[:, edge], color=shades[edge], lw=1.2, label=label)
    if angles.size and np.abs(angles).max() > 150:
        for turn in (-180, 180):
            if angles.min() - 60 < turn < angles.max() + 60:
                axes.axhline(turn, color=FAINT, lw=1, ls=(0, (5, 3)))
                axes.annotate("up", (record.time[0], turn), color=FAINT, va="bottom", fontsize=9)
    axes.legend(loc="best", fontsize=8)


def distributions(path: Path, evaluations: Sequence[Evaluation]) -> None:
    """Each episode as a dot, each measure in its own panel, means as bars."""
    described = [c for c in evaluations[0].described if c.better and c.name != "upright"]
    rng = np.random.default_rng(0)
    # Room for the names below the dots.
    wide = max(2.6, 0.11 * sum(2 + len(e.policy) for e in evaluations))
    with styled():
        figure, grid = plt.subplots(
            1, len(described), figsize=(wide * len(described), 3.4), squeeze=False
        )
        for axes, column in zip(grid[0], described, strict=True):
            for i, evaluation in enumerate(evaluations):
                values = column.scale * evaluation.columns[column.name]
                x = i + rng.uniform(-0.22, 0.22, len(values))
                colour = COLOURS[i % len(COLOURS)]
                axes.plot(x, values, "o", ms=3.5, color=colour, alpha=0.45, mew=0)
                mean = column.scale * evaluation.mean(column.name)
                axes.plot([i - 0.32, i + 0.32], [mean, mean], color=colour, lw=2.6)
            axes.set_title(column.title)
            axes.set_ylabel(column.unit)
            axes.set_xticks(
                range(len(evaluations)), [e.policy.replace(" ", "\n") for e in evaluations]
            )
            axes.set_xlim(-0.6, len(evaluations) - 0.4)
            axes.grid(axis="x", visible=False)
            axes.margins(y=0.15)
            axes.annotate(
                {"high": "higher is better", "low": "lower is better"}[column.better],
                (0.5, -0.22),
                xycoords="axes fraction",
                ha="center",
                va="top",
                fontsize=8,
                color=FAINT,
            )
        figure.savefig(path, facecolor="white", edgecolor=GRID)
        plt.close(figure)
