"""The plots of a comparison. Each function draws one figure and writes one PNG."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from rodgym import machines
from rodgym.evaluation import Evaluation, Record
from rodgym.machines import Description
from rodgym.report.style import COLOURS, FAINT, GRID, INK, level, styled

#: Letters in a line of a policy's name below its dots.
NAME_WIDTH = 10
#: An episode whose edges turn so many times as far as another's has a scale of its own.
SPINNING = 3.0


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
            steps[kept],
            column["return"][kept],
            "o",
            markersize=10,
            mfc="none",
            mec=INK,
            mew=1.4,
            clip_on=False,
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
        axes.xaxis.set_major_formatter(FuncFormatter(thousands))
        _wall_time_axis(axes, steps, column["seconds"])
        figure.savefig(path)
        plt.close(figure)


def thousands(value: float, _position: int = 0) -> str:
    """A number of steps in few letters."""
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
    """Angles of all edges, then the machine's traces or else the action; one column a policy, one
    seed.
    """
    spec = records[0].spec
    about = machines.of(spec)
    shown = about.traces_of(spec["task"])
    rows = 1 + max(1, len(shown))
    with styled():
        figure, grid = plt.subplots(
            rows,
            len(records),
            figsize=(4.2 * len(records), 1.9 * rows + 0.6),
            sharex=True,
            squeeze=False,
            gridspec_kw={"height_ratios": [1.6, *[1.0] * (rows - 1)]},
        )
        # One scale for all, but for the angles where somebody spins and would flatten the others'.
        _share(grid[1:])
        turns = [float(np.ptp(np.unwrap(record.angles, axis=0))) for record in records]
        if max(turns) < SPINNING * max(min(turns), np.pi):
            _share(grid[:1])
        for i, record in enumerate(records):
            colour = COLOURS[i % len(COLOURS)]
            _angles(grid[0, i], record, about)
            grid[0, i].set_title(record.policy, color=colour)
            for axes, trace in zip(grid[1:, i], shown, strict=False):
                values = trace.factor * record.metrics[trace.metric]
                axes.plot(record.time, values, color=colour, lw=1.4)
            if not shown:
                grid[1, i].plot(record.time, record.actions[:, 0], color=colour, lw=1.4)
            grid[-1, i].set_xlabel("time [s]")
            if about.seconds is not None:
                grid[-1, i].set_xlim(0.0, min(about.seconds, record.time[-1]))
        grid[0, 0].set_ylabel("edge angles [deg]")
        for axes, trace in zip(grid[1:, 0], shown, strict=False):
            axes.set_ylabel(trace.label)
        if not shown:
            grid[1, 0].set_ylabel("action")
        figure.savefig(path)
        plt.close(figure)


def learned(records: Sequence[Record]) -> list[tuple[int, str]]:
    """Places of policies, and parameters of the episode that they were to find out."""
    return [
        (i, name)
        for i, record in enumerate(records)
        for name, values in record.estimates.items()
        if name in record.parameters and values[0, 2] > values[0, 1]
    ]


def estimates(path: Path, records: Sequence[Record]) -> None:
    """What policies have found out of the machine, over time, beside the truth."""
    shown = learned(records)
    with styled():
        figure, grid = plt.subplots(
            1, len(shown), figsize=(4.2 * len(shown), 2.6), squeeze=False, layout="constrained"
        )
        for axes, (i, name) in zip(grid[0], shown, strict=True):
            record, colour = records[i], COLOURS[i % len(COLOURS)]
            truth = record.parameters[name]
            value, low, high = 100 * (record.estimates[name].T / truth - 1)
            axes.fill_between(record.time, low, high, color=colour, alpha=0.2, lw=0)
            axes.plot(record.time, value, color=colour, lw=1.4)
            axes.axhline(0.0, color=FAINT, lw=1, ls=(0, (5, 3)))
            # The first samples leave everything open; what comes after is what there is to see.
            reach = max(5.0, 1.5 * np.abs(value[min(50, len(value) - 1) :]).max())
            axes.set_ylim(-reach, reach)
            axes.set_title(f"{record.policy}: {name}", color=colour)
            axes.set_xlabel("time [s]")
        grid[0, 0].set_ylabel("estimate off by [%]")
        figure.savefig(path)
        plt.close(figure)


def _share(rows: np.ndarray) -> None:
    """Gives the panels of each row one vertical scale, written at the left one."""
    for first, *others in rows:
        for axes in others:
            axes.sharey(first)
            axes.tick_params(labelleft=False)


def moment(path: Path, records: Sequence[Record], seconds: float = 1.0) -> None:
    """The second of the episode in which most happens, all policies in one panel a trace."""
    spec = records[0].spec
    shown = machines.of(spec).traces_of(spec["task"])
    begin = busiest(records, seconds)
    count = max(1, len(shown))
    columns = min(count, 2)
    rows = -(-count // columns)
    with styled():
        figure, grid = plt.subplots(
            rows, columns, figsize=(8.4, 0.4 + 2.6 * rows), squeeze=False, sharex=True
        )
        for axes in grid.flat[count:]:
            axes.set_visible(False)
        for record, colour in zip(records, itertools.cycle(COLOURS)):
            part = (record.time >= begin) & (record.time <= begin + seconds)
            for axes, trace in zip(grid.flat, shown, strict=False):
                values = trace.factor * record.metrics[trace.metric][part]
                axes.plot(record.time[part], values, color=colour, label=record.policy)
                axes.set_ylabel(trace.label)
            if not shown:
                grid[0, 0].plot(
                    record.time[part], record.actions[part, 0], color=colour, label=record.policy
                )
                grid[0, 0].set_ylabel("action")
        grid[0, 0].set_xlim(begin, begin + seconds)
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=len(labels))
        figure.savefig(path)
        plt.close(figure)


def busiest(records: Sequence[Record], seconds: float) -> float:
    """When the window begins in which the edges turn most [s], every policy counted alike."""
    dt = float(records[0].spec["control_dt"])
    length = max(len(record.time) for record in records)
    width = min(length, max(1, round(seconds / dt)))
    turned = np.zeros(length)
    for record in records:
        steps = np.abs(np.diff(np.unwrap(record.angles, axis=0), axis=0)).sum(axis=1)
        turned[1 : len(record.time)] += steps / max(steps.sum(), 1e-12)
    inside = np.convolve(turned, np.ones(width), "valid")
    # The first of equals: rounding must not choose.
    return dt * int(np.flatnonzero(inside >= inside.max() - 1e-9)[0])


def _angles(axes: Axes, record: Record, about: Description) -> None:
    """Every edge's angle, dark at the first and light at the last, with named angles as lines."""
    # Angles are known up to whole turns: follow each through the episode without jumps.
    angles = np.degrees(np.unwrap(record.angles, axis=0))
    edges = angles.shape[1]
    shades = plt.colormaps["viridis"](np.linspace(0.0, 0.85, max(edges, 1)))
    names = {0: f"{about.ends[0]} edge", edges - 1: f"{about.ends[1]} edge"}
    for edge in range(edges):
        label = names.get(edge)
        axes.plot(record.time, angles[:, edge], color=shades[edge], lw=1.2, label=label)
    written: set[str] = set()
    for angle, name in about.named_angles.items():
        if angles.size and angles.min() - 30 < angle < angles.max() + 30:
            axes.axhline(angle, color=FAINT, lw=1, ls=(0, (5, 3)))
            if name not in written:
                axes.annotate(name, (record.time[0], angle), color=FAINT, va="bottom", fontsize=9)
            written.add(name)
    axes.legend(loc="best", fontsize=8)


def distributions(path: Path, evaluations: Sequence[Evaluation]) -> None:
    """Each episode as a dot, each measure in its own panel, means as bars."""
    described = [c for c in evaluations[0].described if c.better and not c.success]
    rng = np.random.default_rng(0)
    # Room for the names below the dots.
    wide = max(2.6, 0.11 * sum(2 + min(NAME_WIDTH, len(e.policy)) for e in evaluations))
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
                if not np.isfinite(mean):
                    # Nowhere defined: said, where an empty column would look forgotten.
                    axes.annotate(
                        "never",
                        (i, 0.5),
                        xycoords=("data", "axes fraction"),
                        ha="center",
                        color=FAINT,
                        fontsize=9,
                    )
                axes.plot([i - 0.32, i + 0.32], [mean, mean], color=colour, lw=2.6)
            axes.set_title(column.title)
            axes.set_ylabel(column.unit)
            axes.set_xticks(
                range(len(evaluations)), [fill(e.policy, NAME_WIDTH) for e in evaluations]
            )
            # What differs by less than a table shows is no difference.
            low, high = axes.get_ylim()
            least = 4 * 10.0**-column.digits
            if high - low < least:
                middle = (low + high) / 2
                axes.set_ylim(middle - least / 2, middle + least / 2)
            axes.ticklabel_format(axis="y", useOffset=False)
            axes.set_xlim(-0.6, len(evaluations) - 0.4)
            axes.grid(axis="x", visible=False)
            axes.margins(y=0.15)
            axes.set_xlabel(
                {"high": "higher is better", "low": "lower is better"}[column.better],
                fontsize=8,
                color=FAINT,
            )
        figure.savefig(path, facecolor="white", edgecolor=GRID)
        plt.close(figure)
