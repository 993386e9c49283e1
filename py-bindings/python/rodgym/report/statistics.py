"""Plots of what several training seeds tell (`rodgym.evaluation.statistics`). Each function draws
one figure and writes one PNG.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from rodgym.evaluation import statistics
from rodgym.evaluation.statistics import Scores
from rodgym.report.plots import thousands
from rodgym.report.style import COLOURS, styled

#: Thresholds of a profile.
POINTS = 201

#: A training's curve: environment steps, seconds, and the score at each, (t,) each.
Curve = tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike]


def profiles(path: Path, scores: Mapping[str, Scores], label: str = "return") -> None:
    """Share of the episodes that score more than each threshold, a line a policy, with 95 % bands.

    `scores` are those of `rodgym.evaluation.statistics`; `label` says what they are.
    """
    values = [np.concatenate([p.ravel() for p in statistics.strata(s)]) for s in scores.values()]
    low, high = min(v.min() for v in values), max(v.max() for v in values)
    room = 0.02 * (high - low) or 1.0
    thresholds = np.linspace(low - room, high + room, POINTS)
    with styled():
        figure, axes = plt.subplots(figsize=(7.2, 3.9))
        for i, (name, given) in enumerate(scores.items()):
            profile = statistics.performance_profile(given, thresholds)
            colour = COLOURS[i % len(COLOURS)]
            axes.fill_between(
                thresholds, 100 * profile.low, 100 * profile.high, color=colour, alpha=0.18, lw=0
            )
            axes.plot(thresholds, 100 * profile.share, color=colour, label=_named(name, given))
        axes.set_xlim(thresholds[0], thresholds[-1])
        axes.set_ylim(0, 102)
        axes.set_xlabel(label)
        axes.set_ylabel("episodes that score more [%]")
        axes.legend(loc="lower left")
        figure.savefig(path)
        plt.close(figure)


def intervals(path: Path, scores: Mapping[str, Scores], label: str = "return") -> None:
    """Interquartile means with their 95 % intervals, a row a policy; mean and median beside."""
    with styled():
        figure, axes = plt.subplots(figsize=(7.2, 0.9 + 0.55 * len(scores)))
        for i, given in enumerate(scores.values()):
            found = statistics.summary(given)
            colour = COLOURS[i % len(COLOURS)]
            bounds = found.interquartile_mean
            axes.plot([bounds.low, bounds.high], [i, i], color=colour, lw=9, alpha=0.35)
            axes.plot(bounds.value, i, "|", color=colour, ms=16, mew=2.4)
            axes.plot(found.mean.value, i, "o", mfc="white", mec=colour, ms=5)
            axes.plot(found.median.value, i, "x", color=colour, ms=5)
        axes.set_yticks(range(len(scores)), [_named(name, s) for name, s in scores.items()])
        axes.invert_yaxis()
        axes.margins(y=0.35)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel(
            f"{label}: interquartile mean (|), its 95 % interval,\nmean (o), median (x)"
        )
        figure.savefig(path)
        plt.close(figure)


def learning_curves(
    path: Path,
    curves: Mapping[str, Sequence[Curve]],
    levels: Mapping[str, float] | None = None,
    label: str = "return of an episode",
) -> None:
    """Learning curves of several training seeds, against steps and against wall time.

    Each algorithm's seeds are one line, their interquartile mean, in a band of 95 %; every single
    training is a thin line. `levels` are scores of others, drawn across.
    """
    with styled():
        figure, (left, right) = plt.subplots(1, 2, figsize=(10.4, 4.0), sharey=True)
        for axes, time in ((left, 0), (right, 1)):
            for i, (name, runs) in enumerate(curves.items()):
                pairs = [(run[time], run[2]) for run in runs]
                _band(axes, pairs, COLOURS[i % len(COLOURS)], f"{name}, {_seeds(len(runs))}")
            for i, (text, value) in enumerate((levels or {}).items(), start=len(curves)):
                # In the legend: levels lie close together where everybody is good.
                colour = COLOURS[i % len(COLOURS)]
                axes.axhline(value, color=colour, ls=(0, (5, 3)), lw=1.6, label=text)
            axes.set_xlim(left=0)
        left.xaxis.set_major_formatter(FuncFormatter(thousands))
        left.set_xlabel("environment steps")
        left.set_ylabel(label)
        right.set_xlabel("wall time [s]")
        left.legend(loc="lower right")
        figure.savefig(path)
        plt.close(figure)


def _band(
    axes: Axes, pairs: Sequence[tuple[npt.ArrayLike, npt.ArrayLike]], colour: str, label: str
) -> None:
    for x, y in pairs if len(pairs) > 1 else ():
        axes.plot(x, y, color=colour, lw=0.6, alpha=0.35)
    band = statistics.curve_band(pairs)
    if len(pairs) > 1:
        axes.fill_between(band.x, band.low, band.high, color=colour, alpha=0.18, lw=0)
    axes.plot(band.x, band.value, color=colour, label=label)


def _named(name: str, scores: Scores) -> str:
    """A policy's name; how often it was trained where that is more than once."""
    trained = min(len(part) for part in statistics.strata(scores))
    told = trained == 1 or _seeds(trained) in name
    return name if told else f"{name} ({_seeds(trained)})"


def _seeds(count: int) -> str:
    return f"{count} training seeds" if count > 1 else "a single training seed"
