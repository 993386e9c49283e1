"""Tracks: where each marker was at each time, and the table that holds them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rodgym.runs import write_csv

Array = npt.NDArray[np.float64]

#: Metres of a unit of length.
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
#: Fewer frames or markers tell nothing about a rod.
MIN_FRAMES, MIN_MARKERS = 12, 3
#: Columns of a tidy table; the last one may be left out.
TIDY = ("time", "marker", "x", "y", "confidence")


@dataclass(frozen=True)
class Tracks:
    """Markers of a film, base first.

    Parameters
    ----------
    times: of the frames [s], rising, (frames,)
    points: x to the right and y up [m], NaN where a marker was lost, (frames, markers, 2)
    notes: what was guessed or repaired on the way, for people
    confidence: of each point from 0 to 1, (frames, markers); None where nobody has said
    """

    times: Array
    points: Array
    notes: tuple[str, ...] = field(default=())
    confidence: Array | None = None

    @property
    def markers(self) -> int:
        """Number of markers."""
        return self.points.shape[1]

    @property
    def frame_time(self) -> float:
        """Time from frame to frame [s]; frames that are missing do not change it."""
        return float(np.median(np.diff(self.times)))

    def part(self, first: int, last: int) -> Tracks:
        """The frames `first` to `last`, the latter left out."""
        sure = None if self.confidence is None else self.confidence[first:last]
        return Tracks(self.times[first:last], self.points[first:last], self.notes, sure)

    def write(self, path: Path) -> None:
        """Writes a wide table that `read_tracks` reads: a line for each frame."""
        rows = np.column_stack([self.times, self.points.reshape(len(self.times), -1)])
        cells = [["" if np.isnan(value) else float(value) for value in row] for row in rows]
        write_csv(path, header(self.markers), cells)

    def write_tidy(self, path: Path) -> None:
        """Writes a tidy table that `read_tracks` reads: a line for each marker in each frame.

        Confidence is empty where none is known; what was lost has neither place nor confidence.
        """
        sure = (
            np.full(self.points.shape[:2], np.nan) if self.confidence is None else self.confidence
        )
        cells = [
            [float(time), marker + 1, *("" if np.isnan(v) else float(v) for v in (x, y, one))]
            for time, frame, row in zip(self.times, self.points, sure, strict=True)
            for marker, ((x, y), one) in enumerate(zip(frame, row, strict=True))
        ]
        write_csv(path, TIDY, cells)


def header(markers: int) -> list[str]:
    """Columns of a table: `time`, then x and y of each marker."""
    return ["time", *(f"{axis}{i}" for i in range(1, markers + 1) for axis in "xy")]
