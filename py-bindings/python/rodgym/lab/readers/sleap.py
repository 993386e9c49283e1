"""SLEAP's analysis files: HDF5 (`tracks`, `node_names`, ...) or CSV (`track,frame_idx,...`).

Positions are pixels from the picture's upper left corner, y downwards; frames are counted from 0.
A skeleton of one node that is there several times is read as that many markers.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from rodgym.lab.errors import CellError, FormatError, HeaderError
from rodgym.lab.readers.choice import chosen
from rodgym.lab.readers.source import Source, Text
from rodgym.lab.tracks import Array

#: Columns of a node.
NODE = re.compile(r"^(.+)\.(x|y|score)$")
FIXED = ("track", "frame_idx", "instance.score")


def is_sleap(text: Text) -> bool:
    """Whether a text is SLEAP's analysis."""
    return "frame_idx" in [cell.strip() for cell in text.rows[0]]


def read_h5(path: Path, animal: str | None) -> Source:
    """An analysis file; arrays are stored as Matlab has them: (tracks, 2, nodes, frames)."""
    import h5py

    with h5py.File(path, "r") as file:
        if "tracks" not in file or "node_names" not in file:
            raise FormatError(f"{path.name} has no tracks and node_names, as SLEAP's analysis has")
        cube = np.asarray(file["tracks"], np.float64)
        nodes = [word(name) for name in file["node_names"][:]]
        names = [word(name) for name in file["track_names"][:]] if "track_names" in file else []
        scores = np.asarray(file["point_scores"], np.float64) if "point_scores" in file else None
    if cube.ndim != 4 or cube.shape[1] != 2 or cube.shape[2] != len(nodes):
        raise FormatError(
            f"{path.name}: tracks have the shape {cube.shape}; SLEAP's is (tracks, 2, "
            f"{len(nodes)} nodes, frames)"
        )
    names = names or [f"track_{i}" for i in range(len(cube))]
    sure = None if scores is None or scores.shape != cube[:, 0].shape else scores
    points = np.moveaxis(cube, (0, 1, 2, 3), (0, 3, 2, 1))
    frames = np.arange(points.shape[1], dtype=np.float64)
    return source(
        path.name,
        dict(zip(names, points, strict=True)),
        None if sure is None else dict(zip(names, np.swapaxes(sure, 1, 2), strict=True)),
        nodes,
        frames,
        animal,
    )


def read_csv(text: Text, animal: str | None) -> Source:
    """An analysis table: a line for each animal in each frame."""
    head = [cell.strip() for cell in text.rows[0]]
    nodes = list[str]()
    for i, name in enumerate(head):
        found = NODE.match(name)
        if name in FIXED:
            continue
        if found is None:
            raise HeaderError(f"{text.name}: column {i + 1} is {name!r}, not of the form node.x")
        if found[1] not in nodes:
            nodes.append(found[1])
    for node in nodes:
        if missing := [axis for axis in "xy" if f"{node}.{axis}" not in head]:
            raise HeaderError(f"{text.name}: there is no column {node}.{missing[0]}")
    body = text.body(1, len(head))
    tracks = [row[head.index("track")].strip() if "track" in head else "" for _, row in body]
    numbers = np.array(
        [
            [text.number(cell, line, name) if name != "track" else np.nan
             for cell, name in zip(row, head, strict=True)]
            for line, row in body
        ]
    ).reshape(len(body), len(head))  # fmt: skip
    counted = numbers[:, head.index("frame_idx")]
    frames = np.unique(counted)
    points, scores = dict[str, Array](), dict[str, Array]()
    for i, (name, number) in enumerate(zip(tracks, counted, strict=True)):
        at = int(np.searchsorted(frames, number))
        own = points.setdefault(name, np.full((len(frames), len(nodes), 2), np.nan))
        sure = scores.setdefault(name, np.full((len(frames), len(nodes)), np.nan))
        if not np.isnan(own[at]).all():
            raise CellError(
                f"{text.name}, line {body[i][0]}: {name or 'the animal'} is there twice"
            )
        for k, node in enumerate(nodes):
            own[at, k] = [numbers[i, head.index(f"{node}.{axis}")] for axis in "xy"]
            if f"{node}.score" in head:
                sure[at, k] = numbers[i, head.index(f"{node}.score")]
    return source(text.name, points, scores, nodes, frames, animal)


def source(
    name: str,
    points: dict[str, Array],
    scores: dict[str, Array] | None,
    nodes: list[str],
    frames: Array,
    animal: str | None,
) -> Source:
    """Markers of one animal, or of as many animals of one node."""
    sure: Array | None = None
    if animal is None and len(nodes) == 1 and len(points) > 1:
        markers = list(points)
        cube = np.concatenate([points[one] for one in markers], axis=1)
        if scores is not None:
            sure = np.concatenate([scores[one] for one in markers], axis=1)
    else:
        one = chosen(name, "animal", list(points), animal)
        markers, cube = nodes, points[one]
        sure = None if scores is None else scores[one]
    confidence = None if sure is None or np.isnan(sure).all() else sure
    return Source(
        name, "SLEAP", None, frames, cube, tuple(markers), confidence, unit="px", y="down"
    )


def word(value: Any) -> str:
    """A string of HDF5."""
    return value.decode() if isinstance(value, bytes) else str(value)
