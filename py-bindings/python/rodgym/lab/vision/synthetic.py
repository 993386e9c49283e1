"""A synthetic film: a hidden rod and a checkerboard before a camera, as a lens would show them.

The rod is drawn by our renderer; markers and boards are projected exactly, by the camera's own
formula, at twice the resolution. Then come exposure, blur, noise and a compressed film.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from rodgym import _native
from rodgym.lab.bench import Bench, Flaws, record
from rodgym.lab.swings import ENVIRONMENT
from rodgym.lab.tracks import Array, Tracks
from rodgym.lab.vision.board import Board
from rodgym.lab.vision.camera import Camera

#: The thesis' camera in air (its appendix A), and its board.
THESIS = Camera(
    (1280, 720),
    np.array([[801.17, 0.0, 605.94], [0.0, 789.65, 358.89], [0.0, 0.0, 1.0]]),
    np.array([-0.2770, 0.0660, 0.0, 0.0, 0.0]),
    0.0,
    (0.0, 0.0, 0.0, 0.0),
    0,
)
BOARD = Board(10, 7, 7.34e-3)
#: Where a corner of the board is laid on the plane of motion [m].
LAID = ((-0.27, -0.12), (0.2, -0.16), (-0.03, -0.27))
#: Points of the rod that are drawn, and samples of motion in a frame; an exposure is from one to
#: the next, of so many looks.
DRAWN, FINE, LOOKS = 61, 16, 5
#: Resolution of what is drawn over the camera's.
OVER = 2
#: Width of our renderer's picture [pixel], and what it shows over the rod's length, either way.
TEXTURE, REACH = 1200, 1.16


@dataclass(frozen=True)
class Optics:
    """The camera, where it stands, and what it does to a picture.

    Parameters
    ----------
    camera: the true one
    place: of the camera, from the hinge: right, up and towards the viewer [m]
    turns: of the camera: about its vertical, its horizontal, and its line of sight [rad]
    marker: diameter [m]
    blur: deviation [pixel]
    noise: deviation [grey levels of 255]
    """

    camera: Camera = field(default_factory=lambda: THESIS)
    place: tuple[float, float, float] = (0.05, -0.25, 0.6)
    turns: tuple[float, float, float] = (0.05, -0.2, 0.02)
    marker: float = 9e-3
    blur: float = 0.7
    noise: float = 2.0
    poses: int = 20

    @property
    def pose(self) -> tuple[Array, Array]:
        """Rotation and translation from the plane of motion to the camera."""
        yaw, pitch, roll = self.turns
        # (A camera looks along z, with y down.)
        facing = np.diag([1.0, -1.0, -1.0])
        rotation = _turn(roll, 2) @ _turn(pitch, 0) @ _turn(yaw, 1) @ facing
        return rotation, -rotation @ np.array(self.place)


@dataclass(frozen=True)
class Truth:
    """What the film shows: markers in the middle of each exposure, camera and pose."""

    tracks: Tracks
    optics: Optics
    #: Number of the first frame of the recording.
    first: int


def film(
    path: Path | str,
    bench: Bench,
    seed: int,
    optics: Optics | None = None,
    board: Board = BOARD,
) -> Truth:
    """Films a hidden rod: the board from many sides, on the plane of motion, then the swing."""
    optics, random = optics or Optics(), np.random.default_rng(seed)
    moving = replace(bench, rate=bench.rate * FINE, markers=DRAWN, flaws=Flaws(noise=0.0))
    (motion,) = record([moving], [0])
    frames = round(bench.seconds * bench.rate)
    rods = motion.points.reshape(frames, FINE, DRAWN, 2)
    places = np.linspace(0, DRAWN - 1, bench.markers)
    writer = cv2.VideoWriter(
        str(path), cv2.VideoWriter.fourcc(*"mp4v"), bench.rate, optics.camera.size
    )

    def show(picture: Array, times: int = 1) -> None:
        for _ in range(times):
            noisy = picture + random.normal(0.0, optics.noise, picture.shape)
            grey = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
            writer.write(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR))

    held = round(0.2 * bench.rate)
    backdrop = Backdrop(optics, bench)
    empty = backdrop.picture(rods[0, 0])
    for rotation, translation in poses(optics, board, random):
        show(blurred(drawn_board(empty, board, optics.camera, rotation, translation), optics), held)
    rotation, translation = optics.pose
    for x, y in LAID:
        lying = translation + rotation @ np.array([x, y, 0.0])
        on_plane = drawn_board(empty, board, optics.camera, rotation, lying)
        show(blurred(on_plane, optics), 4 * held)
    show(blurred(empty, optics), held)
    first = (optics.poses + 4 * len(LAID) + 1) * held
    for rod in rods:
        background = backdrop.picture(0.5 * (rod[0] + rod[1]))
        share = np.linspace(0.0, 1.0, LOOKS)
        looks = [
            marked(background, _along((1 - u) * rod[0] + u * rod[1], places), optics) for u in share
        ]
        show(blurred(np.mean(looks, axis=0), optics))
    writer.release()
    points = np.array([_along(0.5 * (rod[0] + rod[1]), places) for rod in rods])
    return Truth(Tracks(np.arange(frames) / bench.rate, points), optics, first)


class Backdrop:
    """The rod without markers: our renderer's picture as the camera sees it, in dim light."""

    def __init__(self, optics: Optics, bench: Bench) -> None:
        rod = {name: value for name, value in bench.keywords().items() if name != "nodes"}
        self._length = rod["length"]
        self._batch = _native.Batch(
            ENVIRONMENT, 1, {**rod, "nodes": DRAWN, "physics_dt": 1e-4}, "Disabled", None, 1
        )
        width, height = optics.camera.size
        across, down = np.meshgrid(
            np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64)
        )
        pixels = np.column_stack([across.ravel(), down.ravel()]).astype(np.float64)
        rotation, translation = optics.pose
        toward = np.column_stack([optics.camera.rays(pixels), np.ones(len(pixels))])
        normal = rotation[:, 2]
        reach = (normal @ translation) / (toward @ normal)
        places = (reach[:, np.newaxis] * toward - translation) @ rotation
        scale = TEXTURE / (2 * REACH * self._length)
        x = TEXTURE / 2 - 0.5 + scale * places[:, 0]
        y = TEXTURE / 2 - 0.5 - scale * places[:, 1]
        self._map = [part.reshape(height, width).astype(np.float32) for part in (x, y)]

    def picture(self, rod: Array) -> Array:
        """Grey levels at the camera's resolution; the points of the rod are (DRAWN, 2)."""
        ways = np.diff(rod, axis=0)
        angles = np.unwrap(np.arctan2(ways[:, 0], -ways[:, 1]))
        state = {"angles": angles.tolist(), "rates": np.zeros(len(angles)).tolist()}
        self._batch.reset([0], None, {"state": state})
        rendered = self._batch.render(0, TEXTURE, TEXTURE)
        grey = cv2.cvtColor(np.ascontiguousarray(rendered), cv2.COLOR_RGB2GRAY)
        seen = cv2.remap(
            grey,
            self._map[0],
            self._map[1],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=245,
        )
        light = np.linspace(0.30, 0.42, seen.shape[1])
        return np.asarray(seen * light)


def marked(background: Array, places: Array, optics: Optics) -> Array:
    """The picture with white discs at these places of the plane."""
    rotation, translation = optics.pose
    around = np.linspace(0.0, 2 * np.pi, 48, endpoint=False)
    rim = 0.5 * optics.marker * np.column_stack([np.cos(around), np.sin(around)])
    discs = [np.column_stack([place + rim, np.zeros(len(rim))]) for place in places]
    return _filled(background, discs, [240.0] * len(discs), optics.camera, rotation, translation)


def drawn_board(
    background: Array, board: Board, camera: Camera, rotation: Array, translation: Array
) -> Array:
    """The picture with a white board on it whose outer corner is the origin of this pose."""
    cell, margin = board.cell, 0.9 * board.cell
    sheet = _rectangle(-margin, -margin, board.columns * cell + margin, board.rows * cell + margin)
    cells = [
        _rectangle(i * cell, j * cell, (i + 1) * cell, (j + 1) * cell)
        for i in range(board.columns)
        for j in range(board.rows)
        if (i + j) % 2 == 0
    ]
    greys = [215.0] + [25.0] * len(cells)
    return _filled(background, [sheet, *cells], greys, camera, rotation, translation)


def poses(optics: Optics, board: Board, random: np.random.Generator) -> list[tuple[Array, Array]]:
    """Poses of a board that is shown from many sides, whole in the picture."""
    width, height = optics.camera.size
    size = np.array([board.columns * board.cell, board.rows * board.cell, 0.0])
    rim = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]) * size
    found = list[tuple[Array, Array]]()
    while len(found) < optics.poses:
        about = random.uniform(-0.6, 0.6, 2)
        rotation = _turn(random.uniform(-0.4, 0.4), 2) @ _turn(about[0], 0) @ _turn(about[1], 1)
        away = random.uniform(0.14, 0.36)
        middle = np.array([random.uniform(-0.7, 0.7), random.uniform(-0.4, 0.4), 1.0]) * away
        translation = middle - rotation @ (0.5 * size)
        pixels = project(optics.camera, rim, rotation, translation)
        if (pixels > 25).all() and (pixels < np.array([width, height]) - 25).all():
            found.append((rotation, translation))
    return found


def project(camera: Camera, points: Array, rotation: Array, translation: Array) -> Array:
    """Pixels of points [m] in a pose."""
    turn, _ = cv2.Rodrigues(rotation)
    found, _ = cv2.projectPoints(points, turn, translation, camera.matrix, camera.distortion)
    return np.asarray(found, np.float64).reshape(-1, 2)


def blurred(picture: Array, optics: Optics) -> Array:
    """What the lens leaves of it."""
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), optics.blur))


def _filled(
    background: Array,
    shapes: list[Array],
    greys: list[float],
    camera: Camera,
    rotation: Array,
    translation: Array,
) -> Array:
    """Shapes of a plane over a picture, at a higher resolution and then reduced."""
    outlines = [project(camera, shape, rotation, translation) for shape in shapes]
    picture = background.copy()
    # Only the part of the picture where something is drawn.
    every = np.concatenate(outlines)
    low = np.maximum(np.floor(every.min(axis=0)).astype(int) - 3, 0)
    high = np.minimum(np.ceil(every.max(axis=0)).astype(int) + 4, background.shape[::-1])
    part = (slice(low[1], high[1]), slice(low[0], high[0]))
    width, height = high - low
    if width <= 0 or height <= 0:
        return picture
    large = cv2.resize(
        picture[part].astype(np.float32),
        (OVER * int(width), OVER * int(height)),
        interpolation=cv2.INTER_LINEAR,
    )
    for outline, grey in zip(outlines, greys, strict=True):
        # (Middle of pixel i of the camera: middle of its OVER pixels.)
        fine = OVER * (outline - low) + 0.5 * (OVER - 1)
        points = np.rint(fine * 256).astype(np.int32)
        cv2.fillPoly(large, [points], grey, lineType=cv2.LINE_AA, shift=8)
    picture[part] = cv2.resize(large, (int(width), int(height)), interpolation=cv2.INTER_AREA)
    return picture


def _rectangle(left: float, low: float, right: float, high: float) -> Array:
    """Its outline with points enough to be bent by a lens."""
    share = np.linspace(0.0, 1.0, 8, endpoint=False)
    sides = [
        (left + (right - left) * share, np.full(8, low)),
        (np.full(8, right), low + (high - low) * share),
        (right - (right - left) * share, np.full(8, high)),
        (np.full(8, left), high - (high - low) * share),
    ]
    x, y = (np.concatenate(parts) for parts in zip(*sides, strict=True))
    return np.column_stack([x, y, np.zeros(len(x))])


def _along(rod: Array, places: Array) -> Array:
    """Points of a drawn rod at these places, counted in its points."""
    index = np.arange(len(rod))
    return np.column_stack([np.interp(places, index, rod[:, axis]) for axis in (0, 1)])


def _turn(angle: float, axis: int) -> Array:
    """Rotation about a coordinate axis."""
    vector = np.zeros(3)
    vector[axis] = angle
    matrix, _ = cv2.Rodrigues(vector)
    return np.asarray(matrix, np.float64)
