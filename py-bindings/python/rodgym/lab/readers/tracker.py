"""Tracker (Open Source Physics): exported text, of one track or, after `#multi:`, of several.

::

    #multi:
    <tab>mass A<tab><tab>mass B<tab>
    t<tab>x<tab>y<tab>x<tab>y

Times and positions are in the units of Tracker's own calibration, y upwards; cells are empty where
a track has no point.
"""

from __future__ import annotations

import re

import numpy as np

from rodgym.lab.errors import HeaderError
from rodgym.lab.readers.source import Source, Text
from rodgym.lab.tracks import MIN_MARKERS

MULTI = "#multi:"
#: `x`, `x_{A}`, `xA`: what follows the letter says again which track it is.
AXIS = re.compile(r"^([xy])(?:_?\{?[^{}]*\}?)?$")


def is_tracker(text: Text) -> bool:
    """Whether a text is an export of Tracker."""
    first = text.rows[0][0].strip().lower()
    if first == MULTI:
        return True
    return len(text.rows) > 1 and [cell.strip() for cell in text.rows[1][:2]] == ["t", "x"]


def read(text: Text) -> Source:
    """The tracks of one export."""
    multi = text.rows[0][0].strip().lower() == MULTI
    if len(text.rows) < (3 if multi else 2):
        raise HeaderError(f"{text.name}: an export of Tracker has a line of columns: t, x, y")
    titles = text.rows[1] if multi else [""] + text.rows[0]
    head = [cell.strip() for cell in text.rows[2 if multi else 1]]
    while head and not head[-1]:
        head.pop()
    if not head or head[0] != "t":
        raise HeaderError(f"{text.name}: the first column is {head[:1]}, not t")
    markers, columns = list[str](), list[int]()
    title = ""
    for i, name in enumerate(head[1:], 1):
        title = titles[i].strip() if i < len(titles) and titles[i].strip() else title
        axis = AXIS.match(name)
        if axis is None:
            raise HeaderError(
                f"{text.name}: column {i + 1} is {name!r}; export t, x and y of every track"
            )
        expected = "xy"[len(columns) % 2]
        if axis[1] != expected:
            raise HeaderError(f"{text.name}: column {i + 1} is {name!r} where {expected} must be")
        if expected == "x":
            markers.append(title or f"track {len(markers) + 1}")
        columns.append(i)
    if len(columns) % 2 or len(markers) < MIN_MARKERS:
        raise HeaderError(
            f"{text.name} has {len(columns) // 2} tracks with x and y; at least {MIN_MARKERS} are "
            "needed: choose them all when exporting (Columns)"
        )
    first = 3 if multi else 2
    table = text.numbers(first, head)
    return Source(
        text.name,
        "Tracker",
        table[:, 0],
        np.arange(len(table), dtype=np.float64),
        table[:, 1:].reshape(len(table), len(markers), 2),
        tuple(markers),
        y="up",
        lines=tuple(text.lines[first:]),
    )
