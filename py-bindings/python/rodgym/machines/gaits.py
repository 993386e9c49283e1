"""How fins beat: waveforms of one episode, and what came of them in every episode."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter, NullLocator

from rodgym.report.style import COLOURS, styled

if TYPE_CHECKING:
    from rodgym.evaluation import Evaluation, Record

#: Seconds at the end of the episode that are drawn: a few strokes (`fin.GAITS` says so).
SECONDS = 1.2
#: Scores that are drawn over stiffness: column, label.
PANELS = (
    ("beat", "beat [Hz]"),
    ("efficiency", "efficiency [%]"),
    ("return", "return"),
)


def draw(path: Path, records: Sequence[Record], evaluations: Sequence[Evaluation]) -> None:
    """Pitch and thrust of the recorded episodes; beat, efficiency and return over stiffness."""
    with styled():
        figure, panels = plt.subplot_mosaic("PPPTTT;aabbcc", figsize=(10.4, 6.2))
        for key, metric, factor, label in (
            ("P", "pitch", 180 / np.pi, "pitch [deg]"),
            ("T", "thrust", 1e3, "thrust [mN]"),
        ):
            axes = panels[key]
            for record, colour in zip(records, COLOURS, strict=False):
                shown = record.time > record.time[-1] - SECONDS
                values = factor * record.metrics[metric][shown]
                axes.plot(record.time[shown], values, ".-", color=colour, label=record.policy)
            axes.set_xlabel("time [s]")
            axes.set_ylabel(label)
        for key, (name, label) in zip("abc", PANELS, strict=True):
            _over_stiffness(panels[key], evaluations, name, label)
        handles, labels = panels["P"].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=len(labels))
        figure.savefig(path)
        plt.close(figure)


def _over_stiffness(axes: Axes, evaluations: Sequence[Evaluation], name: str, label: str) -> None:
    column = next(c for c in evaluations[0].described if c.name == name)
    for evaluation, colour in zip(evaluations, COLOURS, strict=False):
        modulus = 1e-3 * evaluation.columns["youngs_modulus"]
        values = column.scale * evaluation.columns[name]
        axes.plot(modulus, values, "o", ms=3.5, mew=0, alpha=0.6, color=colour)
    moduli = 1e-3 * np.concatenate([e.columns["youngs_modulus"] for e in evaluations])
    if moduli.max() > 1.5 * moduli.min():
        axes.set_xscale("log")
        low, high = axes.get_xlim()
        ticks = [t * 10**k for k in range(8) for t in (1, 2, 5) if low <= t * 10**k <= high]
        axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("Young's modulus [kPa]")
    axes.set_ylabel(label)
