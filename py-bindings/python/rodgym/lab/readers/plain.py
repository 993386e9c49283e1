"""Plain tables, as CSV or Parquet: wide (`time,x1,y1,...`), or tidy (`time,marker,x,y`)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rodgym.lab.errors import CellError, FramesError, HeaderError, UnitsError
from rodgym.lab.readers.source import Source, Text
from rodgym.lab.tracks import MIN_MARKERS, TIDY, Array, header

#: Seconds of a unit of time.
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}
#: Units of lengths that a header may name.
LENGTHS = ("m", "cm", "mm", "px")
#: A name, and perhaps its unit: `x1`, `x1 [mm]`, `x1 (mm)`, `x1_mm`.
COLUMN = re.compile(r"^\s*([a-z]+[0-9]*)\s*(?:[\[(]\s*([a-zµ]+)\s*[\])]|_([a-zµ]+))?\s*$")


class Column(NamedTuple):
    """A column of a header."""

    name: str
    #: Empty where the header names none.
    unit: str


def is_tidy(names: list[str]) -> bool:
    """Whether a header is that of a tidy table."""
    return {"marker", "x", "y"} <= {column(name).name for name in names}


def column(text: str) -> Column:
    """A header's cell."""
    found = COLUMN.match(text.lower())
    if found is None:
        return Column(text.strip().lower(), "")
    return Column(found[1], found[2] or found[3] or "")


def read_wide(text: Text) -> Source:
    """A table with a line for each frame."""
    names = [column(cell) for cell in text.rows[0]]
    markers = count(text.name, text.rows[0], names)
    unit = length_unit(text.name, names[1:])
    table = text.numbers(1, [column.name for column in names])
    return Source(
        text.name,
        "a plain table",
        times(text.name, names[0], table[:, 0]),
        table[:, 0],
        table[:, 1:].reshape(len(table), markers, 2),
        tuple(str(i + 1) for i in range(markers)),
        unit=unit,
        lines=tuple(text.lines[1:]),
    )


def read_tidy(text: Text) -> Source:
    """A table with a line for each marker in each frame, as `rodgym track` writes it."""
    names = [column(cell) for cell in text.rows[0]]
    known = [name.name for name in names]
    for name in known:
        if name not in (*TIDY, "frame"):
            raise HeaderError(
                f"{text.name}: column {name!r} is none of a tidy table: {', '.join(TIDY)}"
            )
    if "time" not in known and "frame" not in known:
        raise HeaderError(f"{text.name}: a tidy table has a column time or frame")
    clock = known.index("time" if "time" in known else "frame")
    body = text.body(1, len(names))
    cells = {
        name: [text.number(row[i], line, name) for line, row in body]
        for i, name in enumerate(known)
        if name != "marker"
    }
    labels = [row[known.index("marker")].strip() for _, row in body]
    markers = list(dict.fromkeys(labels))
    if len(markers) < MIN_MARKERS:
        raise HeaderError(
            f"{text.name} has {len(markers)} markers; at least {MIN_MARKERS} are needed"
        )
    frames, place = np.unique(np.array(cells[known[clock]]), return_inverse=True)
    if np.isnan(frames).any():
        raise FramesError(f"{text.name}: a line has no {known[clock]}")
    points = np.full((len(frames), len(markers), 2), np.nan)
    sure = np.full((len(frames), len(markers)), np.nan)
    seen = set[tuple[int, int]]()
    for row, (frame, label) in enumerate(zip(place.tolist(), labels, strict=True)):
        at = (frame, markers.index(label))
        if at in seen:
            raise CellError(
                f"{text.name}, line {body[row][0]}: marker {label} is there twice at "
                f"{known[clock]} {frames[frame]:g}"
            )
        seen.add(at)
        points[at] = cells["x"][row], cells["y"][row]
        sure[at] = cells["confidence"][row] if "confidence" in cells else np.nan
    return Source(
        text.name,
        "a tidy table",
        times(text.name, names[clock], frames),
        frames,
        points,
        tuple(markers),
        confidence=sure if "confidence" in cells else None,
        unit=length_unit(text.name, [n for n in names if n.name in ("x", "y")]),
    )


def read_parquet(path: Path) -> Source:
    """A wide or tidy table in Parquet."""
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(path)
    columns = [table.column(i).to_pylist() for i in range(table.num_columns)]
    rows = [
        ["" if cell is None else str(cell) for cell in row] for row in zip(*columns, strict=True)
    ]
    names = list(table.column_names)
    text = Text(path.name, [names, *rows], list(range(1, len(rows) + 2)), ",")
    return read_tidy(text) if is_tidy(names) else read_wide(text)


def count(file: str, given: list[str], names: list[Column]) -> int:
    """Number of markers that a header names.

    Raises
    ------
    HeaderError: it is not time,x1,y1,...
    """
    markers = (len(names) - 1) // 2
    right = header(markers)
    found = [name.name for name in names]
    if found and found[0] == "frame":
        right[0] = "frame"
    if found != right:
        pairs = zip(found, right, strict=False)
        differs = [i for i, (name, wanted) in enumerate(pairs) if name != wanted]
        where = f"column {differs[0] + 1} is {given[differs[0]]!r}" if differs else "one is missing"
        raise HeaderError(
            f"{file}: the header must be time,x1,y1,x2,y2,... (s and m, base first), but {where}"
        )
    if markers < MIN_MARKERS:
        raise HeaderError(f"{file} has {markers} markers; at least {MIN_MARKERS} are needed")
    return markers


def times(file: str, clock: Column, values: Array) -> Array | None:
    """Times in seconds; None where frames are counted.

    Raises
    ------
    UnitsError: no unit of time
    """
    if clock.name == "frame":
        return None
    if clock.unit and clock.unit.replace("µ", "u") not in SECONDS:
        raise UnitsError(
            f"{file}: time is in {clock.unit!r}; there are {', '.join(SECONDS)} (or a column frame)"
        )
    return values * SECONDS[clock.unit.replace("µ", "u") or "s"]


def length_unit(file: str, columns: list[Column]) -> str | None:
    """The unit of all positions, where the header names one.

    Raises
    ------
    UnitsError: no unit of length, or two different ones
    """
    units = {column.unit for column in columns}
    if len(units) > 1:
        raise UnitsError(f"{file}: positions are in {' and '.join(sorted(map(repr, units)))}")
    unit = units.pop()
    if unit and unit not in LENGTHS:
        raise UnitsError(f"{file}: positions are in {unit!r}; there are {', '.join(LENGTHS)}")
    return unit or None
