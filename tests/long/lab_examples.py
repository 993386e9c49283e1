"""Makes the small recordings that rodgym ships: hidden rods before a camera with flaws."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from rodgym.lab import examples
from rodgym.lab.bench import Bench, Flaws, record
from rodgym.lab.fin_bench import FinBench, record_fin
from rodgym.lab.tracks import Tracks, header


def pendulum() -> Tracks:
    """A film of a rod that was let go bent."""
    camera = Flaws(noise=5e-4, tilt=0.04, scale=1.03, dropped=0.05, lost=0.02)
    (film,) = record([Bench(rod=examples.TRUTH["pendulum"], flaws=camera)], seeds=[7])
    return film


def write(path: Path, head: list[str], rows: np.ndarray, digits: list[int]) -> None:
    """A table with as many digits as a camera and a cell have."""
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(head)
        for row in rows:
            cells = zip(row, digits, strict=True)
            writer.writerow(["" if np.isnan(v) else f"{v:.{n}f}" for v, n in cells])


def write_tracks(path: Path, tracks: Tracks) -> None:
    """Places to hundredths of a millimetre."""
    rows = np.column_stack([tracks.times, tracks.points.reshape(len(tracks.times), -1)])
    write(path, header(tracks.markers), rows, [5] * rows.shape[1])


def main() -> None:
    """Writes the files."""
    write_tracks(examples.path("pendulum"), pendulum())
    fin = {**examples.TRUTH["fin"], **examples.KNOWN["fin"]}
    camera = Flaws(tilt=0.02, scale=1.02, base=(0.01, -0.005), clock=0.013)
    bench = FinBench(
        fin=fin, periods=6.0, sampling=150.0, substeps=48, flaws=camera, gain=1.01, bias=0.02,
        clamp=0.01,
    )  # fmt: skip
    recording = record_fin(bench, 8)
    write_tracks(examples.path("fin"), recording.tracks)
    pitch, thrust = np.degrees(recording.pitch), 1e3 * recording.loads["thrust"]
    rows = np.column_stack([recording.times, pitch, thrust])
    head = ["time [s]", "pitch [deg]", "thrust [mN]"]
    write(examples.path("fin-bench"), head, rows, [5, 4, 1])


if __name__ == "__main__":
    main()
