"""The model of a fit drawn into frames of the film that it was fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from rodgym.lab.errors import FilmError
from rodgym.lab.tracks import Array, Tracks
from rodgym.lab.vision.films import Film, Grey
from rodgym.lab.vision.view import View

#: Colours (blue, green, red) of the model and of tracked markers.
MODEL, MARKERS = (40, 120, 250), (90, 220, 90)
#: Frames that are shown, and how many stand side by side.
SHOWN, ACROSS = 6, 3
#: Room about all that moves [pixel], and width of a picture of the sheet [pixel].
ROOM, WIDTH = 30, 480


def chosen(tracks: Tracks, count: int = SHOWN) -> list[int]:
    """Frames that are worth a look, evenly over the recording."""
    last = len(tracks.times) - 1
    return sorted(set(np.linspace(0, last, count + 2)[1:-1].astype(int).tolist()))


def write_sheet(
    path: Path, film: Path, view: View, tracks: Tracks, model: Array, frames: Sequence[int]
) -> None:
    """A sheet of pictures: the model as a line, tracked markers as circles.

    Parameters
    ----------
    model: outline of the rod in the tracks' coordinates at these frames [m], (frames, points, 2)

    Raises
    ------
    FilmError: the film does not reach so far, or has another size than the camera
    """
    source = Film(film, view.rate)
    if source.size != view.plane.camera.size:
        raise FilmError(
            f"{film.name} has {source.size} pixels, its camera {view.plane.camera.size}: is it the "
            "film that was tracked?"
        )
    wanted = {view.frame(float(tracks.times[i])): k for k, i in enumerate(frames)}
    pictures = dict[int, Grey]()
    for number, picture in source.frames(min(wanted)):
        if number in wanted:
            pictures[wanted[number]] = picture
        if number >= max(wanted):
            break
    if len(pictures) < len(frames):
        raise FilmError(f"{film.name} ends before the tracks do: is it the film that was tracked?")
    lines = [view.plane.pixels(outline) for outline in model]
    every = np.concatenate(lines)
    low = np.maximum(np.floor(every.min(axis=0)).astype(int) - ROOM, 0)
    high = np.minimum(np.ceil(every.max(axis=0)).astype(int) + ROOM, source.size)
    scale = WIDTH / int(high[0] - low[0])
    tiles = []
    for k, i in enumerate(frames):
        part = pictures[k][low[1] : high[1], low[0] : high[0]]
        large = cv2.resize(part, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        tile = cv2.cvtColor(large, cv2.COLOR_GRAY2BGR)
        seen = tracks.points[i][np.isfinite(tracks.points[i]).all(axis=1)]
        for place in view.plane.pixels(seen):
            centre = sixteenths(scale * (place - low + 0.5) - 0.5)
            cv2.circle(tile, tuple(centre.tolist()), 16 * 9, MARKERS, 1, cv2.LINE_AA, 4)
        line = sixteenths(scale * (lines[k] - low + 0.5) - 0.5).reshape(-1, 1, 2)
        cv2.polylines(tile, [line], False, MODEL, 2, cv2.LINE_AA, 4)
        cv2.putText(
            tile, f"{tracks.times[i]:.2f} s", (10, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.65,
            (255, 255, 255), 1, cv2.LINE_AA,
        )  # fmt: skip
        tiles.append(cv2.copyMakeBorder(tile, 3, 3, 3, 3, cv2.BORDER_CONSTANT, value=(255,) * 3))
    while len(tiles) % ACROSS:
        tiles.append(np.full_like(tiles[0], 255))
    rows = [np.hstack(tiles[i : i + ACROSS]) for i in range(0, len(tiles), ACROSS)]
    cv2.imwrite(str(path), np.vstack(rows))


def sixteenths(points: Array) -> np.ndarray:
    """Pixels as OpenCV draws parts of them."""
    return np.rint(16 * points).astype(np.int32)
