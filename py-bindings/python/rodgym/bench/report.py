"""What a bench writes: CSV for programs, one page of tables, the work-precision plot."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rodgym.bench.measure import Ratio, Timing
from rodgym.bench.precision import Point
from rodgym.extras import installed
from rodgym.runs import Run, write_csv


@dataclass(frozen=True)
class Target:
    """Something that was promised, what came out, and whether that is enough."""

    what: str
    wanted: str
    found: str
    reached: bool


def at_least(what: str, value: float, bound: float, note: str = "") -> Target:
    """A number that should be no smaller than its bound."""
    return Target(what, f">= {number(bound)}", number(value) + note, value >= bound)


def at_most(what: str, value: float, bound: float, unit: str = "", note: str = "") -> Target:
    """A number that should be no larger than its bound."""
    wanted, found = f"<= {number(bound)}{unit}", f"{number(value)}{unit}{note}"
    return Target(what, wanted, found, value <= bound)


def number(value: float) -> str:
    """Three digits, thousands apart: ``1 040 000``, ``24.8``, ``0.0012``."""
    if not np.isfinite(value):
        return "-"
    if abs(value) >= 1000:
        return f"{float(f'{value:.3g}'):,.0f}".replace(",", " ")
    return f"{value:.3g}"


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table; all columns but the first to the right."""
    rule = ["---", *["---:"] * (len(header) - 1)]
    lines = ["| " + " | ".join(row) + " |" for row in (header, rule, *rows)]
    return "\n".join(lines)


def targets_table(targets: Sequence[Target]) -> str:
    """What was promised against what came out."""
    rows = [(t.what, t.wanted, t.found, "yes" if t.reached else "**no**") for t in targets]
    return table(("target", "wanted", "found", "reached"), rows)


def peers_table(timings: Sequence[Timing], ratios: Mapping[str, Ratio]) -> str:
    """Rates, and how many times cheaper a step is than the reference's, with quartiles."""
    rows = [
        (
            timing.name,
            number(1e6 * timing.cost),
            number(timing.cpu_rate),
            number(timing.rate),
            str(ratios[timing.name]) if timing.name in ratios else "-",
        )
        for timing in timings
    ]
    header = ("simulator", "us a step", "steps/s of CPU", "steps/s of wall clock", "ratio")
    return table(header, rows)


#: Stands for the size of a batch where one environment is stepped without a batch.
SINGLE = 0


def throughput_table(
    rows: Mapping[str, Mapping[tuple[int, int], Timing]], threads: int, *, cpu: bool
) -> str:
    """Environment steps a second: a row a machine, a column a size of batch."""
    sizes = sorted({n for row in rows.values() for n, t in row if t == threads})
    body = [
        [
            name,
            *(
                number(row[n, threads].cpu_rate if cpu else row[n, threads].rate)
                if (n, threads) in row
                else "-"
                for n in sizes
            ),
        ]
        for name, row in rows.items()
    ]
    columns = ("env.unwrapped.step" if n == SINGLE else f"n = {n}" for n in sizes)
    return table(("environment", *columns), body)


TIMING_HEADER = (
    "case",
    "wall_us",
    "wall_us_q25",
    "wall_us_q75",
    "cpu_us",
    "cpu_us_q25",
    "cpu_us_q75",
)


def timing_row(timing: Timing) -> list[object]:
    """Medians and quartiles of microseconds an environment step."""
    row: list[object] = [timing.name]
    for values in (timing.wall, timing.cpu):
        low, median, high = 1e6 * np.percentile(values, [25, 50, 75])
        row += [f"{median:.4g}", f"{low:.4g}", f"{high:.4g}"]
    return row


def write_timings(run: Run, name: str, timings: Iterable[Timing]) -> None:
    """One CSV line a case."""
    write_csv(run.file(name), TIMING_HEADER, [timing_row(timing) for timing in timings])


def write_precision(run: Run, found: Sequence[Point]) -> str:
    """``precision.csv`` and, where matplotlib is, ``work_precision.png``; returns the table."""
    cells = [
        (p.family, f"{1e3 * p.dt:g}", f"{1e6 * p.cost:.4g}", f"{1e3 * p.error:.3g}") for p in found
    ]
    write_csv(run.file("precision.csv"), ("stepper", "dt_ms", "cost_us", "error_mm"), cells)
    if installed("matplotlib"):
        plot_precision(run.file("work_precision.png"), found)
    return table(("stepper", "step [ms]", "us an environment step", "tip error [mm]"), cells)


def plot_precision(path: Path, found: Sequence[Point]) -> None:
    """Error against cost, a line a stepper: down and left is better."""
    import matplotlib.pyplot as plt

    from rodgym.report.style import COLOURS, FAINT, INK, styled

    families = list(dict.fromkeys(point.family for point in found))
    with styled():
        figure, axes = plt.subplots(figsize=(8.4, 5.8))
        ours = theirs = 0
        for family in families:
            line = sorted((p for p in found if p.family == family), key=lambda p: p.dt)
            own = family.startswith("rodgym")
            at = ours if own else theirs
            ours, theirs = ours + own, theirs + (not own)
            axes.loglog(
                [1e6 * p.cost for p in line],
                [1e3 * p.error for p in line],
                color=COLOURS[at % len(COLOURS)] if own else INK,
                alpha=1.0 if own else 0.75,
                ls="-" if own else ("--", ":", "-.", (0, (6, 2)))[at % 4],
                marker="o" if own else ("s", "^", "D", "v")[at % 4],
                ms=6 if own else 5,
                lw=2.2 if own else 1.3,
                label=family,
            )
            # Some lines run close together: labels of one go above it, of the other below.
            below = own or at % 4 == 2
            for point in line:
                axes.annotate(
                    f"{1e3 * point.dt:g} ms",
                    (1e6 * point.cost, 1e3 * point.error),
                    xytext=(-5, -10) if own else (0, -12) if below else (5, 4),
                    ha="right" if own else "center" if below else "left",
                    textcoords="offset points",
                    fontsize=7,
                    color=FAINT if not own else COLOURS[at % len(COLOURS)],
                )
        axes.axhline(3.0, color=FAINT, lw=1, ls=(0, (5, 3)))
        axes.annotate(
            "1 % of the length",
            (1.0, 3.0),
            xycoords=("axes fraction", "data"),
            ha="right",
            va="bottom",
            fontsize=8,
            color=FAINT,
        )
        axes.set_title("Error of a free swing of 1 s against the cost of an environment step")
        axes.set_xlabel("cost of an environment step of 10 ms, one thread [us]")
        axes.set_ylabel("error of the tip after 1 s [mm]")
        figure.legend(loc="outside lower center", fontsize=8, ncols=4)
        axes.margins(0.08)
        figure.savefig(path)
        plt.close(figure)
