"""What a file of tracks holds, before anything is made of its units, axes and order."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rodgym.lab.errors import CellError, FormatError, HeaderError
from rodgym.lab.tracks import Array

#: Delimiters of text tables, in the order in which they are looked for in the header.
DELIMITERS = ("\t", ";", ",")


@dataclass(frozen=True)
class Source:
    """Markers as a file has them.

    Parameters
    ----------
    name: of the file, for errors
    kind: the format, in words
    times: of the frames [s]; None where the file counts frames only
    frames: numbers of the frames, (frames,)
    points: NaN where a marker was lost, (frames, markers, 2)
    markers: names, in the file's order
    confidence: of each point from 0 to 1, (frames, markers); None where the file has none
    unit: of the positions where the file or its format says it; None: not said
    y: where y points by the format; None: not said
    lines: line of the file that each frame came from, for errors; empty where it has no lines
    notes: what was guessed
    """

    name: str
    kind: str
    times: Array | None
    frames: Array
    points: Array
    markers: tuple[str, ...]
    confidence: Array | None = None
    unit: str | None = None
    y: str | None = None
    lines: tuple[int, ...] = ()
    notes: tuple[str, ...] = field(default=())

    def where(self, frame: int) -> str:
        """A frame as errors name it."""
        if self.lines:
            return f"{self.name}, line {self.lines[frame]}"
        return f"{self.name}, frame {self.frames[frame]:g}"


@dataclass(frozen=True)
class Text:
    """Lines of a delimited text, and which delimiter it has."""

    name: str
    rows: list[list[str]]
    #: Number of each line in the file, from 1.
    lines: list[int]
    delimiter: str

    def numbers(self, first: int, columns: Sequence[str]) -> Array:
        """The lines from the `first` on as numbers, (lines, columns); empty or NaN: not there.

        Raises
        ------
        CellError: a cell that is no number, or a line with more or fewer cells
        """
        rows = [
            [self.number(cell, line, name) for cell, name in zip(cells, columns, strict=True)]
            for line, cells in self.body(first, len(columns))
        ]
        return np.array(rows, np.float64).reshape(len(rows), len(columns))

    def body(self, first: int, width: int) -> list[tuple[int, list[str]]]:
        """Lines with their numbers, each of so many cells."""
        found = []
        for line, cells in zip(self.lines[first:], self.rows[first:], strict=True):
            # Tracker and some spreadsheets end every line with a delimiter.
            while len(cells) > width and not cells[-1].strip():
                cells = cells[:-1]
            if len(cells) != width:
                raise CellError(
                    f"{self.name}, line {line}: {len(cells)} cells where the header has {width}"
                )
            found.append((line, cells))
        return found

    def number(self, cell: str, line: int, column: str) -> float:
        """A cell's number; where the comma delimits nothing it may be the decimal point."""
        text = cell.strip()
        if self.delimiter != "," and "," in text and "." not in text:
            text = text.replace(",", ".")
        try:
            number = float(text) if text else float("nan")
        except ValueError:
            raise CellError(
                f"{self.name}, line {line}, column {column}: {cell!r} is no number"
            ) from None
        if np.isinf(number):
            raise CellError(f"{self.name}, line {line}, column {column}: {cell!r} is not finite")
        return number


def read_text(path: Path) -> Text:
    """The lines of a text table.

    Raises
    ------
    FormatError: the file is no text
    HeaderError: it is empty
    """
    try:
        content = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise FormatError(f"{path.name} is no text: {FormatError.known}") from error
    lines = [(i, line) for i, line in enumerate(content.splitlines(), 1) if line.strip(" ,;\t")]
    if not lines:
        raise HeaderError(f"{path.name} is empty; the first line must be time,x1,y1,x2,y2,...")
    head = "\n".join(line for _, line in lines[:3])
    delimiter = next((mark for mark in DELIMITERS if mark in head), ",")
    rows = [next(csv.reader([line], delimiter=delimiter)) for _, line in lines]
    return Text(path.name, rows, [i for i, _ in lines], delimiter)
