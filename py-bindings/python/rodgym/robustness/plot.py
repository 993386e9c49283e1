"""A measurement of robustness as one picture."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill

import matplotlib.pyplot as plt

from rodgym.report.style import COLOURS, FAINT, INK, styled
from rodgym.robustness.result import ENOUGH, Robustness

#: Panels side by side.
COLUMNS = 4


def draw(result: Robustness, path: Path) -> None:
    """Success over every quantity, one panel each, a line a policy; the scores as bars."""
    panels = len(result.quantities) + 1
    lines = -(-panels // COLUMNS)
    with styled():
        figure, grid = plt.subplots(
            lines, COLUMNS, figsize=(3.3 * COLUMNS, 2.6 * lines), squeeze=False
        )
        cells = grid.ravel()
        for cell in cells[panels:]:
            cell.set_visible(False)
        for axes, quantity in zip(cells, result.quantities, strict=False):
            values = result.values(quantity.name)
            axes.axvline(quantity.nominal, color=FAINT, lw=1, ls=(0, (5, 3)))
            count = len(result.policies)
            for i in range(count):
                shares = 100 * result.success[i, result.quantities.index(quantity)]
                # Many lines are at 100 %: the later ones are thinner, so that all are seen.
                width = 1.3 + 1.3 * (count - 1 - i)
                axes.plot(values, shares, color=COLOURS[i % len(COLOURS)], lw=width)
            if quantity.logarithmic:
                axes.set_xscale("log", base=2)
                axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
            axes.set_xlabel(quantity.label)
            axes.set_ylim(-4, 104)
        for line in grid:
            line[0].set_ylabel("episodes that succeed [%]")
        _scores(cells[panels - 1], result)
        success = (
            f"success: at least {100 * ENOUGH:g} % of the nominal return"
            if result.column is None
            else f"success: {result.column} at the end"
        )
        figure.suptitle(
            fill(
                f"One quantity at a time leaves its nominal value (dashed); {len(result.seeds)} "
                f"episodes a dot; {success}",
                150,
            ),
            ha="left",
            x=0.01,
            fontsize=10,
            color=INK,
        )
        figure.savefig(path)
        plt.close(figure)


def _scores(axes: plt.Axes, result: Robustness) -> None:
    """Mean of the scores of all quantities, a bar a policy."""
    means = [100 * result.mean(policy) for policy in result.policies]
    places = range(len(means))
    axes.barh(places, means, color=[COLOURS[i % len(COLOURS)] for i in places], height=0.6)
    for place, value in zip(places, means, strict=True):
        inside = value > 25
        axes.annotate(
            f"{value:.0f}",
            (value, place),
            xytext=(-5 if inside else 5, 0),
            textcoords="offset points",
            ha="right" if inside else "left",
            va="center",
            color="white" if inside else INK,
            fontweight="bold",
        )
    axes.set_yticks(places, result.policies)
    axes.invert_yaxis()
    axes.set_xlim(0, 100)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("mean of the scores [%]")
