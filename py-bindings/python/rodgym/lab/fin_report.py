"""The report of a fin's fit: its pictures and its page (``pages/fin_fit.html``)."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from rodgym.lab.fin_model import Recording
from rodgym.lab.fin_result import FinFit
from rodgym.lab.report import shown, verdict
from rodgym.lab.samples import cubic
from rodgym.lab.tracks import Array
from rodgym.report import html
from rodgym.report.style import COLOURS, FAINT, styled
from rodgym.runs import Run

#: Frames of which the shape is drawn, and the time of signals that is drawn, at the end [s].
SHAPES, SHOWN = 7, 2.5
#: Words and units of loads.
WORDS = {"thrust": ("thrust", "mN", 1e3), "torque": ("torque", "mN m", 1e3)}


def write_report(run: Run, fit: FinFit, film: str, on_film: Path | None = None) -> Path:
    """Writes ``report.html`` with its pictures into the run's folder.

    Parameters
    ----------
    on_film: a picture of the model on frames of the film
    """
    models = fit.predictions()
    overlay(run.file("overlay.png"), fit, models)
    signals(run.file("signals.png"), fit, models)
    residuals(run.file("residuals.png"), fit, models)
    rows = [(name, *shown(i)) for name, i in fit.identified.items()]
    rows += [(name, "not identifiable", "", "") for name in fit.not_identifiable]
    return html.write(
        run,
        "fin_fit.html",
        title="A fin from its film",
        subject=film,
        verdict=verdict(fit.identified, fit.not_identifiable),
        rows=rows,
        bench=[(name, *shown(i)) for name, i in {**fit.camera, **fit.cells, **fit.servo}.items()],
        on_film=on_film,
        names=list(fit.parameters),
        levels=[
            (
                level.nodes,
                *(f"{v:.5g}" for v in level.parameters.values()),
                f"{1e3 * level.sigma:.3f}",
            )
            for level in fit.levels
        ],
        errors=[f"{1e3 * error:.3f}" for error in fit.errors],
        left=[(WORDS[name][0], f"{1e3 * v:.3g} {WORDS[name][1]}") for name, v in fit.left.items()],
        fit=fit,
        fixed=[(name, f"{value:g}", name in fit.known) for name, value in fit.fixed.items()],
    )


def last(one: Recording) -> tuple[float, float]:
    """The end of a recording that is drawn."""
    end = float(min(one.times[-1], one.tracks.times[-1]))
    return max(end - SHOWN, float(one.times[0])), end


def overlay(path: Path, fit: FinFit, models: list[dict[str, Array]]) -> None:
    """Markers as filmed, and the model's fin through them, in some frames of half a beat."""
    one, model = fit.model.recordings[0], models[0]["film"]
    # From the last time that the tail is farthest to one side to the other.
    tail = model[:, -1, 1]
    end = int(np.argmax(tail[len(tail) // 2 :])) + len(tail) // 2
    start = max(end - 1, 0)
    while start > 0 and tail[start - 1] < tail[start]:
        start -= 1
    chosen = np.unique(np.linspace(start, end, SHAPES).astype(int))
    with styled():
        figure, axes = plt.subplots(figsize=(7, 4.6))
        shades = plt.colormaps["viridis"](np.linspace(0.0, 0.85, len(chosen)))
        for frame, shade in zip(chosen, shades, strict=True):
            axes.plot(*(1e3 * model[frame].T), color=shade, lw=1.4)
            label = f"{one.tracks.times[frame]:.2f} s"
            axes.plot(*(1e3 * one.tracks.points[frame].T), "o", ms=4, color=shade, label=label)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("x, downstream [mm]")
        axes.set_ylabel("y [mm]")
        axes.set_title("Markers (dots) and model (lines), half a beat")
        axes.legend(fontsize=8, loc="best")
        figure.savefig(path)
        plt.close(figure)


def signals(path: Path, fit: FinFit, models: list[dict[str, Array]]) -> None:
    """Pitch, tail and loads over the end of the first recording, recorded and modelled."""
    one, model = fit.model.recordings[0], models[0]
    loads = [name for name in WORDS if name in one.loads]
    first, end = last(one)
    with styled():
        figure, rows = plt.subplots(
            2 + len(loads), 1, figsize=(8, 2.0 * (2 + len(loads)) + 0.8), sharex=True
        )
        rows[0].plot(one.times, np.degrees(one.pitch), color=COLOURS[5], lw=1.2)
        rows[0].set_ylabel("pitch [deg]")
        frames = one.tracks.times
        rows[1].plot(frames, 1e3 * one.tracks.points[:, -1, 1], ".", ms=5, color=COLOURS[0])
        fine = np.linspace(first, end, 600)
        tail = cubic(frames, 1e3 * model["film"][:, -1, 1], fine)
        rows[1].plot(fine, tail, color=COLOURS[0], lw=1.2)
        rows[1].set_ylabel("tail y [mm]")
        for axes, name, colour in zip(rows[2:], loads, COLOURS[1:], strict=False):
            word, unit, times = WORDS[name]
            axes.plot(one.times, times * one.loads[name], ".", ms=2, color=colour, alpha=0.5)
            axes.plot(one.times, times * model[name], color=colour, lw=1.4)
            axes.set_ylabel(f"{word} [{unit}]")
        for axes in rows:
            axes.axhline(0.0, color=FAINT, lw=1, zorder=0)
        rows[0].set_xlim(first, end)
        rows[-1].set_xlabel("t [s]")
        rows[0].set_title("The drive; recorded (dots) and modelled (lines)")
        figure.savefig(path)
        plt.close(figure)


def residuals(path: Path, fit: FinFit, models: list[dict[str, Array]]) -> None:
    """What is left over: by marker, and of loads over time."""
    loads = [name for name in WORDS if name in fit.left]
    with styled():
        figure, panels = plt.subplots(1, 1 + len(loads), figsize=(4.2 * (1 + len(loads)), 3.2))
        panels = np.atleast_1d(panels)
        gaps = 1e3 * np.concatenate(
            [
                m["film"] - one.tracks.points
                for one, m in zip(fit.model.recordings, models, strict=True)
            ]
        )
        for axis in (0, 1):
            there = np.isfinite(gaps[..., axis])
            if there.any():
                rms = np.sqrt(np.nanmedian(gaps[..., axis] ** 2, axis=0) / 0.4549)
                places = np.arange(1, len(rms) + 1)
                panels[0].plot(places, rms, "o-", color=COLOURS[axis], label="xy"[axis])
        panels[0].set_ylim(0.0, 1.25 * panels[0].get_ylim()[1])
        panels[0].set_xlabel("marker, from the nose")
        panels[0].set_ylabel("deviation [mm]")
        panels[0].set_title("Places by marker")
        panels[0].legend(fontsize=8)
        for axes, name, colour in zip(panels[1:], loads, COLOURS[1:], strict=False):
            word, unit, times = WORDS[name]
            for one, m in zip(fit.model.recordings, models, strict=True):
                if name in one.loads:
                    gap = times * (m[name] - one.loads[name])
                    axes.plot(one.times, gap, ".", ms=2, color=colour, alpha=0.5)
            axes.axhline(0.0, color=FAINT, lw=1)
            axes.set_xlabel("t [s]")
            axes.set_ylabel(f"model less cell [{unit}]")
            axes.set_title(word.capitalize())
        figure.savefig(path)
        plt.close(figure)
