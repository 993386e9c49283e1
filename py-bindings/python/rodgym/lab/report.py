"""The report of a fit: its pictures and its page; the words stand in ``pages/fit.html``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from rodgym.lab.result import Fit, Interval
from rodgym.report import html
from rodgym.report.style import COLOURS, FAINT, INK, styled
from rodgym.runs import Run

#: Frames of which the shape is drawn.
SHAPES = 8


def write_report(run: Run, fit: Fit, film: str, on_film: Path | None = None) -> Path:
    """Writes ``report.html`` with its pictures into the run's folder.

    Parameters
    ----------
    on_film: a picture of the model on frames of the film
    """
    model, _ = fit.film.predict(fit.estimate.x)
    overlay(run.file("overlay.png"), fit, model)
    signals(run.file("signals.png"), fit, model)
    residuals(run.file("residuals.png"), fit, model)
    rows = [(name, *shown(i)) for name, i in (*fit.identified.items(), *fit.together.items())]
    rows += [(name, "not identifiable", "", "") for name in fit.not_identifiable]
    levels = [*([fit.twin] if fit.twin else []), *fit.levels]
    return html.write(
        run,
        "fit.html",
        title="A rod from its film",
        subject=film,
        verdict=verdict({**fit.identified, **fit.together}, fit.not_identifiable),
        rows=rows,
        camera=[(name, *shown(i)) for name, i in fit.camera.items()],
        on_film=on_film,
        names=list(fit.parameters),
        levels=[
            (
                level.nodes,
                *(f"{v:.5g}" for v in level.parameters.values()),
                f"{1e3 * level.sigma:.3f}",
            )
            for level in levels
        ],
        fit=fit,
        fixed=[(name, f"{value:g}", name in fit.known) for name, value in fit.fixed.items()],
    )


def verdict(found: Mapping[str, Interval], unknown: Iterable[str]) -> str:
    """What was found, in one sentence."""
    parts = [
        f"{name} = {i.value:.4g} (95 %: {i.low:.4g} to {i.high:.4g})" for name, i in found.items()
    ]
    vague = [f"{name} is not identifiable from this film" for name in unknown]
    return "; ".join([*parts, *vague]) + "."


def shown(interval: Interval) -> tuple[str, str, str]:
    """A value and its interval as text."""
    return f"{interval.value:.5g}", f"{interval.low:.5g}", f"{interval.high:.5g}"


def overlay(path: Path, fit: Fit, model: np.ndarray) -> None:
    """Markers as filmed, and the model's rod through them, in some frames."""
    tracks = fit.film.tracks
    chosen = np.linspace(0, len(tracks.times) - 1, SHAPES).astype(int)
    with styled():
        figure, axes = plt.subplots(figsize=(7, 4.6))
        shades = plt.colormaps["viridis"](np.linspace(0.0, 0.85, SHAPES))
        for frame, shade in zip(chosen, shades, strict=True):
            axes.plot(*(1e3 * model[frame].T), color=shade, lw=1.4)
            label = f"{tracks.times[frame]:.2f} s"
            axes.plot(*(1e3 * tracks.points[frame].T), "o", ms=4, color=shade, label=label)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("x [mm]")
        axes.set_ylabel("y [mm]")
        axes.set_title("Markers (dots) and model (lines)")
        axes.legend(fontsize=8, loc="best")
        figure.savefig(path)
        plt.close(figure)


def signals(path: Path, fit: Fit, model: np.ndarray) -> None:
    """The tip over time, filmed and modelled, and what is between them."""
    tracks = fit.film.tracks
    with styled():
        figure, (above, below) = plt.subplots(
            2, 1, figsize=(8, 4.6), sharex=True, gridspec_kw={"height_ratios": [3, 2]}
        )
        for axis, colour in enumerate(COLOURS[:2]):
            tip = 1e3 * tracks.points[:, -1, axis]
            above.plot(tracks.times, 1e3 * model[:, -1, axis], color=colour, lw=1.2)
            above.plot(tracks.times, tip, ".", ms=4, color=colour, label=f"tip {'xy'[axis]}")
            gap = 1e3 * model[:, -1, axis] - tip
            below.plot(tracks.times, gap, ".", ms=4, color=colour)
        below.axhline(0.0, color=FAINT, lw=1)
        above.set_ylabel("position [mm]")
        below.set_ylabel("model less film [mm]")
        below.set_xlabel("t [s]")
        above.set_title("The last marker")
        above.legend(ncols=2, fontsize=8)
        figure.savefig(path)
        plt.close(figure)


def residuals(path: Path, fit: Fit, model: np.ndarray) -> None:
    """How residuals are spread, and how large they are at each marker."""
    gaps = 1e3 * (model - fit.film.tracks.points)
    sigma = 1e3 * fit.estimate.sigma
    near = gaps[np.abs(gaps) < 6 * sigma]
    with styled():
        figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.2))
        left.hist(near, bins=40, density=True, color=COLOURS[5])
        at = np.linspace(-4 * sigma, 4 * sigma, 200)
        bell = np.exp(-((at / sigma) ** 2) / 2) / (sigma * np.sqrt(2 * np.pi))
        left.plot(at, bell, color=INK, lw=1.2, label=f"normal, {sigma:.3f} mm")
        left.set_xlabel("model less film [mm]")
        left.set_title("All residuals")
        left.legend(fontsize=8)
        rms = np.sqrt(np.nanmedian(gaps**2, axis=0) / 0.4549)
        for axis, colour in enumerate(COLOURS[:2]):
            right.plot(
                np.arange(1, len(rms) + 1), rms[:, axis], "o-", color=colour, label="xy"[axis]
            )
        right.set_ylim(0.0, 1.25 * right.get_ylim()[1])
        right.set_xlabel("marker, from the base")
        right.set_ylabel("deviation [mm]")
        right.set_title("By marker")
        right.legend(fontsize=8)
        figure.savefig(path)
        plt.close(figure)
