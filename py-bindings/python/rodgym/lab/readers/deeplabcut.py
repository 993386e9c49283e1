"""DeepLabCut: CSV that begins with `scorer`, perhaps `individuals`, `bodyparts`, `coords`, or HDF5.

Positions are pixels from the picture's upper left corner, y downwards; frames are counted from 0.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rodgym.lab.errors import FormatError, HeaderError
from rodgym.lab.readers.choice import chosen
from rodgym.lab.readers.source import Source, Text
from rodgym.lab.tracks import Array

#: Names of the header's rows.
LEVELS = ("scorer", "individuals", "bodyparts", "coords")
COORDS = ("x", "y", "likelihood")
#: A column: individual (empty where there is one animal), marker and coordinate.
Label = tuple[str, str, str]


def is_deeplabcut(text: Text) -> bool:
    """Whether a text is DeepLabCut's."""
    return text.rows[0][0].strip().lower() == "scorer"


def read_csv(text: Text, animal: str | None) -> Source:
    """A table of `analyze_videos`, or of `create_video_with_all_detections` converted to CSV."""
    levels = dict[str, list[str]]()
    for row in text.rows[: len(LEVELS)]:
        name = row[0].strip().lower()
        if name not in LEVELS:
            break
        levels[name] = [cell.strip() for cell in row[1:]]
    if missing := [name for name in ("scorer", "bodyparts", "coords") if name not in levels]:
        raise HeaderError(f"{text.name}: DeepLabCut's header has no row {missing[0]!r}")
    empty = [""] * len(levels["coords"])
    widths = {name: len(row) for name, row in levels.items()}
    if len(set(widths.values())) > 1:
        raise HeaderError(f"{text.name}: the rows of the header have different lengths: {widths}")
    labels = list(
        zip(levels.get("individuals", empty), levels["bodyparts"], levels["coords"], strict=True)
    )
    words = ["frame", *(" ".join(filter(None, label)) for label in labels)]
    table = text.numbers(len(levels), words)
    return source(text.name, labels, table[:, 0], table[:, 1:], animal, text.lines[len(levels) :])


def read_h5(path: Path, animal: str | None) -> Source:
    """The same as pandas wrote it."""
    import pandas

    try:
        frame = pandas.read_hdf(path)
    except (ValueError, KeyError, TypeError, OSError) as error:
        raise FormatError(f"{path.name} is no table of DeepLabCut: {error}") from error
    names = list(getattr(frame, "columns", pandas.Index([])).names)
    if "bodyparts" not in names or "coords" not in names:
        raise HeaderError(f"{path.name}: columns are {names}; DeepLabCut's have bodyparts, coords")
    level = {name: [str(v) for v in frame.columns.get_level_values(name)] for name in names}
    empty = [""] * frame.shape[1]
    labels = list(
        zip(level.get("individuals", empty), level["bodyparts"], level["coords"], strict=True)
    )
    try:
        numbers, values = frame.index.to_numpy(np.float64), frame.to_numpy(np.float64)
    except (TypeError, ValueError) as error:
        raise HeaderError(f"{path.name}: rows must be frames of one video, counted") from error
    return source(path.name, labels, numbers, values, animal)


def source(
    name: str,
    labels: list[Label],
    frames: Array,
    values: Array,
    animal: str | None,
    lines: list[int] | None = None,
) -> Source:
    """Markers from labelled columns."""
    people = list(dict.fromkeys(individual for individual, _, _ in labels))
    one = chosen(name, "animal", people, animal)
    markers = list(dict.fromkeys(part for who, part, _ in labels if who == one))
    place = {label: i for i, label in enumerate(labels)}
    columns = []
    for part in markers:
        for coord in COORDS:
            if (one, part, coord) not in place and coord != "likelihood":
                raise HeaderError(f"{name}: marker {part!r} has no column {coord!r}")
            columns.append(place.get((one, part, coord)))
    picked = np.full((len(values), len(columns)), np.nan)
    for i, at in enumerate(columns):
        if at is not None:
            picked[:, i] = values[:, at]
    cube = picked.reshape(len(values), len(markers), len(COORDS))
    sure = cube[:, :, 2]
    return Source(
        name,
        "DeepLabCut",
        None,
        frames,
        cube[:, :, :2],
        tuple(markers),
        confidence=None if np.isnan(sure).all() else sure,
        unit="px",
        y="down",
        lines=tuple(lines or ()),
    )
