"""Pictures of a study's table: a map over two keys, or lines over one."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import MaxNLocator

from rodgym.report.style import COLOURS, styled
from rodgym.study.spec import Study, StudyError, columns_of

Rows = list[dict[str, str]]


def draw(study: Study, rows: Rows, path: Path) -> None:
    """Draws what the study's `plot` asks for: `value` over `x` and `y` as a map, or over `x` as a
    line for every `line`; one panel for every `panel`. Where a sweep has more keys than the plot,
    the mean is drawn, and lines get a band from the least value to the greatest.
    """
    asked = dict(study.plot)
    if not {"x", "value"} <= asked.keys():
        raise StudyError("plot needs x and value")
    for role, column in asked.items():
        if column not in rows[0]:
            raise StudyError(
                f"plot: {role} = {column!r} is no column; there are {', '.join(rows[0])}"
            )
    panels = _distinct(rows, asked.get("panel"))
    with styled():
        figure, axes = plt.subplots(
            1, len(panels), figsize=(1.2 + 4.2 * len(panels), 3.9), squeeze=False, sharey=True
        )
        figure.suptitle(fill(study.title, 40 + 45 * (len(panels) - 1)), fontweight="bold")
        drawn: Any = None
        measured = columns_of(study.env).get(asked["value"])
        share = measured is not None and measured.success
        limits = (0.0, 1.0) if share else _limits(rows, asked["value"])
        for axis, panel in zip(axes[0], panels, strict=True):
            part = [row for row in rows if panel is None or row[asked["panel"]] == panel]
            axis.set(title=panel or "", xlabel=asked["x"])
            if "y" in asked:
                drawn = _map(axis, part, asked, limits)
            else:
                _lines(axis, part, asked)
                if share:
                    axis.set_ylim(-0.03, 1.03)
            axis.xaxis.set_major_locator(MaxNLocator(6))
        axes[0][0].set_ylabel(asked.get("y", asked["value"]))
        if drawn is not None:
            figure.colorbar(drawn, ax=list(axes[0]), label=asked["value"])
        figure.savefig(path)
        plt.close(figure)


def _distinct(rows: Rows, column: str | None) -> list[str | None]:
    return list(dict.fromkeys(row[column] for row in rows)) if column else [None]


def _number(text: str) -> float:
    return float(text) if text else float("nan")


def _limits(rows: Rows, value: str) -> tuple[float, float]:
    """One scale for all panels."""
    numbers = [x for x in (_number(row[value]) for row in rows) if x == x]
    return (min(numbers), max(numbers)) if numbers else (0.0, 1.0)


def _map(axis: Any, rows: Rows, asked: dict[str, str], limits: tuple[float, float]) -> Any:
    x = sorted({_number(row[asked["x"]]) for row in rows})
    y = sorted({_number(row[asked["y"]]) for row in rows})
    values = np.full((len(y), len(x)), np.nan)
    for (column, line), found in _gathered(rows, asked, ("x", "y")).items():
        values[y.index(line), x.index(column)] = np.mean(found)
    axis.grid(False)
    # Where no value is defined (a rod that never stood), the ground shows.
    axis.set_facecolor(COLOURS[1])
    low, high = limits
    return axis.pcolormesh(x, y, values, shading="nearest", cmap="cividis", vmin=low, vmax=high)


def _gathered(
    rows: Rows, asked: dict[str, str], roles: tuple[str, ...]
) -> dict[tuple[float, ...], list[float]]:
    """The defined values at each point of the picture, or one NaN."""
    points: dict[tuple[float, ...], list[float]] = {}
    for row in rows:
        found = points.setdefault(tuple(_number(row[asked[role]]) for role in roles), [])
        if row[asked["value"]]:
            found.append(_number(row[asked["value"]]))
    return {at: found or [float("nan")] for at, found in points.items()}


def _lines(axis: Any, rows: Rows, asked: dict[str, str]) -> None:
    for i, line in enumerate(_distinct(rows, asked.get("line"))):
        part = [row for row in rows if line is None or row[asked["line"]] == line]
        points = sorted(_gathered(part, asked, ("x",)).items())
        x = [at for (at,), _ in points]
        colour = COLOURS[i % len(COLOURS)]
        axis.plot(x, [np.mean(found) for _, found in points], "o-", color=colour, label=line)
        if any(len(found) > 1 for _, found in points):
            low, high = ([end(found) for _, found in points] for end in (min, max))
            axis.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0)
    axis.locator_params(axis="x", nbins=6)
    if "line" in asked:
        axis.legend(title=asked["line"])
