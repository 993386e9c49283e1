"""Tracks: where each marker was at each time, and the table that holds them."""

from __future__ import annotations

import csv
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rodgym.lab.errors import CellError, FramesError, HeaderError
from rodgym.runs import write_csv

Array = npt.NDArray[np.float64]

#: Metres of a unit of length.
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
#: Fewer frames or markers tell nothing about a rod.
MIN_FRAMES, MIN_MARKERS = 12, 3


@dataclass(frozen=True)
class Tracks:
    """Markers of a film, base first.

    Parameters
    ----------
    times: of the frames [s], rising, (frames,)
    points: x to the right and y up [m], NaN where a marker was lost, (frames, markers, 2)
    notes: what was guessed or repaired on the way, for people
    """

    times: Array
    points: Array
    notes: tuple[str, ...] = field(default=())

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
        return Tracks(self.times[first:last], self.points[first:last], self.notes)

    def write(self, path: Path) -> None:
        """Writes the table that `read_tracks` reads."""
        rows = np.column_stack([self.times, self.points.reshape(len(self.times), -1)])
        cells = [["" if np.isnan(value) else float(value) for value in row] for row in rows]
        write_csv(path, header(self.markers), cells)


def header(markers: int) -> list[str]:
    """Columns of a table: `time`, then x and y of each marker."""
    return ["time", *(f"{axis}{i}" for i in range(1, markers + 1) for axis in "xy")]


def read_tracks(
    path: Path | str, unit: str = "m", scale: float | None = None, y: str = "up"
) -> Tracks:
    """Reads a plain table: `time,x1,y1,...,xN,yN`, base first; an empty cell is a lost marker.

    Parameters
    ----------
    unit: of the positions: `m`, `cm` or `mm`
    scale: metres of one unit of the table, in place of `unit`: for pixels
    y: where y points: `up` or `down`

    Raises
    ------
    HeaderError, CellError, FramesError: what is wrong with the table, and in which line
    """
    path = Path(path)
    with path.open(newline="", encoding="utf-8-sig") as stream:
        rows = [row for row in csv.reader(stream) if any(cell.strip() for cell in row)]
    if not rows:
        raise HeaderError(f"{path.name} is empty; the first line must be time,x1,y1,x2,y2,...")
    markers = _markers(path.name, rows[0])
    table = np.array([_numbers(path.name, i, row, rows[0]) for i, row in enumerate(rows[1:], 2)])
    if len(table) < MIN_FRAMES:
        raise FramesError(f"{path.name} has {len(table)} frames; at least {MIN_FRAMES} are needed")
    times = table[:, 0]
    if not np.isfinite(times).all():
        line = int(np.flatnonzero(~np.isfinite(times))[0]) + 2
        raise FramesError(f"{path.name}, line {line}: a frame has no time")
    if (np.diff(times) <= 0).any():
        line = int(np.flatnonzero(np.diff(times) <= 0)[0]) + 3
        raise FramesError(f"{path.name}, line {line}: time does not rise from the line before it")
    points = table[:, 1:].reshape(len(table), markers, 2) * (
        UNITS[unit] if scale is None else scale
    )
    if y == "down":
        points = points * [1.0, -1.0]
    return Tracks(times, points)


def _markers(name: str, first: list[str]) -> int:
    """Number of markers that a header names."""
    names = [cell.strip().lower() for cell in first]
    markers = (len(names) - 1) // 2
    if names != header(markers):
        pairs = zip(names, header(markers), strict=False)
        differs = [i for i, (name, right) in enumerate(pairs) if name != right]
        where = f"column {differs[0] + 1} is {first[differs[0]]!r}" if differs else "one is missing"
        raise HeaderError(
            f"{name}: the header must be time,x1,y1,x2,y2,... (s and m, base first), but {where}"
        )
    if markers < MIN_MARKERS:
        raise HeaderError(f"{name} has {markers} markers; at least {MIN_MARKERS} are needed")
    return markers


def _numbers(name: str, line: int, row: list[str], names: list[str]) -> list[float]:
    """The cells of a line; what is empty or NaN was lost."""
    if len(row) != len(names):
        raise CellError(f"{name}, line {line}: {len(row)} cells where the header has {len(names)}")
    numbers = []
    for cell, column in zip(row, names, strict=True):
        try:
            number = float(cell) if cell.strip() else float("nan")
        except ValueError:
            raise CellError(
                f"{name}, line {line}, column {column}: {cell!r} is no number"
            ) from None
        if np.isinf(number):
            raise CellError(f"{name}, line {line}, column {column}: {cell!r} is not finite")
        numbers.append(number)
    return numbers
