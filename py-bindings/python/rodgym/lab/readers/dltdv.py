"""DLTdv8's `...xypts.csv`: columns `pt1_cam1_X`, `pt1_cam1_Y`, ..., a line for each frame.

Positions are pixels, the first one is 1; NaN where a point was not digitised. DLTdv8 counts from
the upper left corner, DLTdv5 and Argus from the lower left.
"""

from __future__ import annotations

import re

import numpy as np

from rodgym.lab.errors import HeaderError
from rodgym.lab.readers.choice import chosen
from rodgym.lab.readers.source import Source, Text

COLUMN = re.compile(r"^pt(\d+)_cam(\d+)_([xy])$")


def is_dltdv(text: Text) -> bool:
    """Whether a text is a table of DLTdv."""
    return COLUMN.match(text.rows[0][0].strip().lower()) is not None


def read(text: Text, camera: str | None) -> Source:
    """The points of one camera."""
    found = [COLUMN.match(cell.strip().lower()) for cell in text.rows[0]]
    for i, one in enumerate(found):
        if one is None:
            raise HeaderError(
                f"{text.name}: column {i + 1} is {text.rows[0][i]!r}, not of the form pt1_cam1_X"
            )
    labels = [(one[1], one[2], one[3]) for one in found if one]
    which = chosen(text.name, "camera", sorted({label[1] for label in labels}, key=int), camera)
    points = sorted({point for point, cam, _ in labels if cam == which}, key=int)
    columns = []
    for point in points:
        for axis in "xy":
            if (point, which, axis) not in labels:
                raise HeaderError(f"{text.name}: there is no pt{point}_cam{which}_{axis.upper()}")
            columns.append(labels.index((point, which, axis)))
    table = text.numbers(1, [cell.strip() for cell in text.rows[0]])
    return Source(
        text.name,
        "DLTdv8",
        None,
        np.arange(len(table), dtype=np.float64),
        # (The first pixel is 1 there and 0 elsewhere.)
        table[:, columns].reshape(len(table), len(points), 2) - 1.0,
        tuple(f"pt{point}" for point in points),
        unit="px",
        y="down",
        lines=tuple(text.lines[1:]),
        notes=("taken for DLTdv8's, y from the picture's top; of DLTdv5 and Argus it is --y up",),
    )
