"""Thrust over the phase of the drive: the load cell's beside the model's on the measured motion, as
in the thesis' Figs 3.11 and 3.13.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from rodgym.lab.cells import Signals
from rodgym.lab.errors import RecordingError
from rodgym.lab.fin_model import Recording
from rodgym.lab.phases import Phases, period_of, phase_average
from rodgym.lab.samples import cubic
from rodgym.lab.water import WaterForce
from rodgym.report.style import COLOURS, FAINT, INK, styled

#: Bins of a period, and periods at the start that are left out.
BINS, SETTLING = 36, 2


def thrust_over_phase(
    recording: Recording, force: WaterForce, period: float | None = None
) -> tuple[Phases, Phases]:
    """Thrust of the cell, and of the model on the measured motion, averaged over the phase of the
    drive; the phase is 0 where the pitch goes up through 0.

    Parameters
    ----------
    force: of `fluid_force` on the recording's tracks, whose clock is the bench's
    period: of the drive [s]; left out: that of the pitch

    Raises
    ------
    RecordingError: no thrust was measured, or of too few periods
    """
    thrust = recording.loads.get("thrust")
    if thrust is None:
        raise RecordingError("no cell measured the thrust")
    bench = Signals(recording.times, {"pitch": recording.pitch, "thrust": thrust})
    if period is None:
        # (The drive sets in slowly: what comes after tells the period better.)
        late = bench.times >= bench.times[0] + SETTLING * period_of(bench, "pitch")
        settled = Signals(bench.times[late], {"pitch": recording.pitch[late]})
        period = period_of(settled, "pitch")
    first = bench.times[0] + SETTLING * period
    if bench.times[-1] - first < 2 * period:
        raise RecordingError(f"fewer than {SETTLING + 2} periods of {period:.3g} s were recorded")
    start = start_of(recording, period)
    model = Signals(force.times, {"thrust": force.mount_thrust})
    found = []
    for one in (bench, model):
        # (Where the window reaches beyond the film the model knows less.)
        inside = (one.times >= first) & (one.times <= force.times[-1] - 0.1 * period)
        part = Signals(one.times[inside], {"thrust": one.values["thrust"][inside]})
        found.append(phase_average(part, "thrust", period, BINS, start))
    return found[0], found[1]


def start_of(recording: Recording, period: float) -> float:
    """A time at which the pitch goes up through 0 [s]."""
    late = recording.times >= recording.times[0] + SETTLING * period
    turn = np.exp(-2j * np.pi * recording.times[late] / period)
    # A sine has the angle -90 degrees.
    angle = float(np.angle(np.mean(recording.pitch[late] * turn))) + np.pi / 2
    return -angle / (2 * np.pi) * period


def write_force_figure(
    path: Path, recording: Recording, force: WaterForce, period: float | None = None
) -> None:
    """Writes the figure: means, and bands of two deviations.

    The cell's band is that of its samples, the model's what the noise of the tracks makes of it.
    """
    cell, model = thrust_over_phase(recording, force, period)
    unsure = 2 * float(np.median(force.mount_deviation))
    degrees = np.degrees(cell.phase)
    with styled():
        figure, (above, below) = plt.subplots(
            2, 1, figsize=(7.5, 5.4), sharex=True, gridspec_kw={"height_ratios": [1, 3]}
        )
        late = recording.times[0] + SETTLING * cell.period
        fine = late + np.linspace(0.0, cell.period, 200)
        start = start_of(recording, cell.period)
        pitch = cubic(recording.times, np.degrees(recording.pitch), fine)
        phase = np.mod(fine - start, cell.period) / cell.period * 360
        order = np.argsort(phase)
        above.plot(phase[order], pitch[order], color=INK, lw=1.4)
        above.axhline(0.0, color=FAINT, lw=1)
        above.set_ylabel("pitch [deg]")
        above.set_title("Thrust over the phase of the drive")
        for name, one, wide, colour in (
            ("load cell", cell, 2 * cell.deviation, COLOURS[1]),
            ("model on the measured motion", model, np.full(BINS, unsure), COLOURS[0]),
        ):
            middle = 1e3 * one.mean
            below.plot(degrees, middle, color=colour, lw=1.6, label=name)
            below.fill_between(
                degrees, middle - 1e3 * wide, middle + 1e3 * wide, color=colour, alpha=0.18, lw=0
            )
        below.set_xlabel("phase of the drive [deg]")
        below.set_ylabel("thrust [mN]")
        below.set_xlim(0, 360)
        below.set_xticks(np.arange(0, 361, 60))
        below.legend(fontsize=8, loc="best")
        figure.savefig(path)
        plt.close(figure)
