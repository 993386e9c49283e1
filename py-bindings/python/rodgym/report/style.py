"""Looks of every plot. The colours are Okabe and Ito's: colour-blind readers tell them apart."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: In the order in which policies are drawn: blue, vermilion, green, purple, orange, sky.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
INK = "#1f2933"
FAINT = "#9aa5b1"
GRID = "#e4e7eb"

_SETTINGS: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelcolor": INK,
    "axes.edgecolor": FAINT,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "lines.linewidth": 1.8,
    "savefig.dpi": 160,
    "figure.constrained_layout.use": True,
}


@contextmanager
def styled() -> Iterator[None]:
    """Inside, figures have the project's looks and need no display."""
    import matplotlib

    matplotlib.use("agg", force=False)
    with matplotlib.rc_context(_SETTINGS):
        yield


def level(axes: Axes, y: float, text: str, colour: str) -> None:
    """A horizontal line with its name at the left end, above it."""
    axes.axhline(y, color=colour, linestyle=(0, (5, 3)), linewidth=1.6)
    axes.annotate(
        text,
        (0.0, y),
        xycoords=("axes fraction", "data"),
        xytext=(4, 3),
        textcoords="offset points",
        ha="left",
        va="bottom",
        color=colour,
        fontweight="bold",
    )
