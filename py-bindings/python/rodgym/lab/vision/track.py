"""A film tracked: camera, plane of motion and markers in metres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rodgym._checks import refused
from rodgym.lab.errors import CalibrationError, FilmError
from rodgym.lab.tracks import MIN_FRAMES, Array, Tracks
from rodgym.lab.vision.board import Board
from rodgym.lab.vision.camera import Camera, calibrate
from rodgym.lab.vision.films import Film, Grey, pictures
from rodgym.lab.vision.follow import Followed, follow
from rodgym.lab.vision.markers import Look, spots
from rodgym.lab.vision.plane import Plane, plane_of

#: A board is looked for so often [s].
EVERY = 0.2
#: A board lies still where its corners move less than this [pixel].
STILL = 1.0
#: It lies on the plane of motion where that lasts for so many looks.
LYING = 3
#: A board that is seen in this share of the last looks stays in the picture.
STAYS = 0.8


@dataclass(frozen=True)
class Tracking:
    """What was found in a film.

    Parameters
    ----------
    tracks: markers in metres, base first, x to the right and y up as they are seen; the origin is
        the middle place of marker 1
    pixels: the same in the picture, (frames, markers, 2)
    first: number of the first frame that was tracked
    sample: that frame's picture
    """

    tracks: Tracks
    pixels: Array
    camera: Camera
    plane: Plane
    first: int
    sample: Grey

    def as_dict(self) -> dict[str, Any]:
        """Camera and plane for a file."""
        return {
            "camera": self.camera.as_dict(),
            "plane": {
                "rotation": self.plane.rotation.tolist(),
                "translation": self.plane.translation.tolist(),
                "reprojection_error": self.plane.error,
            },
            "first_frame": self.first,
            "rate": 1 / self.tracks.frame_time,
            "markers": self.tracks.markers,
            "notes": list(self.tracks.notes),
        }


def track(
    film: Path | str,
    board: Board,
    calibration: Sequence[Path | str] = (),
    camera: Camera | None = None,
    plane: Sequence[Path | str] = (),
    start: float | None = None,
    end: float | None = None,
    rate: float | None = None,
    count: int | None = None,
    look: Look | None = None,
    above: float = 0.0,
) -> Tracking:
    """Tracks the markers of a film.

    A film alone begins with the board: shown from many sides, never still, then lying still on the
    plane of motion, in one or better in several places for a second each, then taken away. What
    follows is the recording.

    Parameters
    ----------
    calibration: pictures, folders or films of the board, in place of the film's beginning
    camera: of an earlier tracking, in place of a calibration
    plane: pictures or films of the board on the plane of motion, in one or several places
    start, end: of the recording in the film [s]; left out: after the board, and the end
    rate: frames a second; left out: as the film says
    count: number of markers; left out: as most frames show
    look: what markers look like
    above: how much nearer to the camera than the board the markers are [m]

    Raises
    ------
    FilmError, CalibrationError, MarkersError: what is missing, by name
    """
    if rate is not None and not (np.isfinite(rate) and rate > 0):
        raise refused("rate", rate, "frames a second, above 0")
    source = Film(film, rate)
    look, rate = look or Look(), source.rate
    shown = Shown(source, board)
    notes = []
    if camera is None:
        views = _views(calibration, board, source) if calibration else shown.views
        camera = calibrate(views, board, source.size)
    if camera.size != source.size:
        raise CalibrationError(
            f"the camera was calibrated with pictures of {camera.size}, the film has {source.size}"
        )
    on_plane = still(_views(plane, board, source), 1) if plane else shown.still
    if not on_plane:
        raise CalibrationError(
            "the board is nowhere held still on the plane of motion: name pictures of it (--plane)"
        )
    motion = plane_of(on_plane, board, camera).moved(above)
    first = shown.gone if start is None else round(start * rate)
    last = None if end is None else round(end * rate)
    if start is None and first > 0:
        notes.append(f"the recording begins at {first / rate:.2f} s, when the board is gone")
    found, numbers = [], []
    for number, picture in source.frames(first):
        if last is not None and number >= last:
            break
        found.append(spots(picture, look))
        numbers.append(number)
    if len(found) < MIN_FRAMES:
        raise FilmError(
            f"{len(found)} frames are left after {first / rate:.2f} s; at least {MIN_FRAMES} are "
            "needed (--start says where the recording begins)"
        )
    followed = follow(found, count)
    # Before the rod is there and after it has gone nothing is tracked.
    there = np.flatnonzero(np.isfinite(followed.places[..., 0]).mean(axis=1) > 0.5)
    part = slice(int(there[0]), int(there[-1]) + 1)
    if left := len(numbers) - (part.stop - part.start):
        notes.append(f"{left} frames at the ends without the rod were left out")
    followed = Followed(followed.places[part], followed.confidence[part])
    numbers, first = numbers[part], numbers[part.start]
    shape = followed.places.shape
    places = motion.metres(followed.places.reshape(-1, 2)).reshape(shape)
    origin = np.nanmedian(places[:, 0], axis=0)
    notes += [
        f"{shape[1]} markers; the first is the end that moves less",
        "up is what goes up in the picture (--axis of 'rodgym fit' turns it)",
    ]
    if lost := int(np.isnan(places[..., 0]).sum()):
        notes.append(f"{lost} of {shape[0] * shape[1]} positions were lost")
    times = (np.array(numbers) - first) / rate
    tracks = Tracks(times, places - origin, tuple(notes), followed.confidence)
    sample = next(picture for _, picture in source.frames(first))
    return Tracking(tracks, followed.places, camera, motion.at(origin), first, sample)


class Shown:
    """Where in a film the board is seen."""

    def __init__(self, film: Film, board: Board) -> None:
        every = max(1, round(EVERY * film.rate))
        looks = [(number, board.find(picture)) for number, picture in film.frames(every=every)]
        self.views = [corners for _, corners in looks if corners is not None]
        with_board = [i for i, (_, corners) in enumerate(looks) if corners is not None]
        #: The first frame without the board; 0 where it stays in the picture, or was never there.
        self.gone = 0
        if with_board:
            late = looks[len(looks) // 2 :]
            if np.mean([corners is not None for _, corners in late]) < STAYS:
                self.gone = looks[with_board[-1]][0] + every
        #: The corners where the board lay still, one mean for each place.
        self.still = still(self.views, LYING)


def _views(sources: Sequence[Path | str], board: Board, film: Film) -> list[Array]:
    """Corners of the board in pictures.

    Raises
    ------
    CalibrationError: pictures of another size than the film's, or without a board
    """
    views = []
    for name, picture in pictures(sources, EVERY):
        if picture.shape[::-1] != film.size:
            raise CalibrationError(
                f"{name} has {picture.shape[::-1]} pixels, the film {film.size}: one camera with "
                "one setting must have made both"
            )
        corners = board.find(picture)
        if corners is not None:
            views.append(corners)
    if not views:
        raise CalibrationError(
            f"no board of {board.columns} by {board.rows} cells is seen whole in "
            f"{', '.join(str(source) for source in sources)}"
        )
    return views


def still(views: Sequence[Array], looks: int) -> list[Array]:
    """The mean corners of each place where so many views, one after the other, are alike."""
    places, alike = list[Array](), list[Array]()
    for view in views:
        if alike and np.abs(view - alike[0]).max() > STILL:
            if len(alike) >= looks:
                places.append(np.mean(alike, axis=0))
            alike = []
        alike.append(view)
    if len(alike) >= looks:
        places.append(np.mean(alike, axis=0))
    return places
