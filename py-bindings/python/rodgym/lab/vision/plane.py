"""The plane of motion: from pixels to metres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares

from rodgym.lab.errors import CalibrationError
from rodgym.lab.tracks import Array
from rodgym.lab.vision.board import Board
from rodgym.lab.vision.camera import WRONG, Camera


@dataclass(frozen=True)
class Plane:
    """A plane before a camera, with axes as they are seen: x to the right, y up.

    Parameters
    ----------
    rotation, translation: from the plane's axes to the camera's [m], (3, 3) and (3,)
    error: root mean square of the board's corners [pixel]
    """

    camera: Camera
    rotation: Array
    translation: Array
    error: float

    def metres(self, pixels: Array) -> Array:
        """Places on the plane of pixels [m], (n, 2); NaN stays NaN."""
        places = np.full((len(pixels), 2), np.nan)
        there = np.isfinite(pixels).all(axis=1)
        rays = self.camera.rays(pixels[there])
        # A ray s (x, y, 1) meets the plane where its part along the normal is the plane's own.
        toward = np.column_stack([rays, np.ones(len(rays))])
        normal = self.rotation[:, 2]
        reach = (normal @ self.translation) / (toward @ normal)
        places[there] = ((reach[:, np.newaxis] * toward - self.translation) @ self.rotation)[:, :2]
        return places

    def pixels(self, places: Array) -> Array:
        """Where places on the plane are seen [pixel], (n, 2)."""
        points = np.column_stack([places, np.zeros(len(places))])
        turn, _ = cv2.Rodrigues(self.rotation)
        found, _ = cv2.projectPoints(
            points, turn, self.translation, self.camera.matrix, self.camera.distortion
        )
        return np.asarray(found, np.float64).reshape(-1, 2)

    def moved(self, toward: float) -> Plane:
        """A parallel plane that is nearer to the camera by so many metres."""
        normal = self.rotation[:, 2] * -np.sign(self.rotation[:, 2] @ self.translation)
        return Plane(self.camera, self.rotation, self.translation + toward * normal, self.error)

    def at(self, origin: Array) -> Plane:
        """The same plane with another origin, in its own metres."""
        shift = self.rotation @ np.array([*origin, 0.0])
        return Plane(self.camera, self.rotation, self.translation + shift, self.error)


def plane_of(places: Sequence[Array], board: Board, camera: Camera) -> Plane:
    """The plane that a board lies on in one or several places; its origin is the last one's middle.

    The farther apart the places are, the better the plane is known away from the board.

    Raises
    ------
    CalibrationError: the corners fit no pose, or not one plane
    """
    alone = [_one(corners, board, camera) for corners in places]
    if len(alone) == 1:
        return alone[0]
    own = board.corners[:, :2] - board.corners[:, :2].mean(axis=0)
    last = alone[-1]

    def lain(x: Array) -> tuple[Plane, list[Array]]:
        """A plane, and where the corners of each place are on it."""
        turn, _ = cv2.Rodrigues(x[:3])
        plane = Plane(camera, last.rotation @ np.asarray(turn), last.translation + x[3:6], 0.0)
        rows = [[0.0, 0.0, x[6]], *x[7:].reshape(-1, 3)]
        return plane, [own @ _turn(angle).T + [right, up] for right, up, angle in rows]

    def gaps(x: Array) -> Array:
        plane, lying = lain(x)
        pairs = zip(lying, seen, strict=True)
        return np.concatenate([(plane.pixels(place) - there).ravel() for place, there in pairs])

    # The last place first: the plane's origin is there.
    order = [len(places) - 1, *range(len(places) - 1)]
    seen = [places[i] for i in order]
    start = np.zeros(7 + 3 * (len(places) - 1))
    for k, i in enumerate(order):
        on_last = last.metres(places[i])
        across = on_last[board.inner[0] - 1] - on_last[0]
        angle = float(np.arctan2(across[1], across[0]))
        if k == 0:
            start[6] = angle
        else:
            start[7 + 3 * (k - 1) : 10 + 3 * (k - 1)] = [*on_last.mean(axis=0), angle]
    # (Which way round the board's second axis goes, seen from the camera.)
    down = last.metres(places[-1])
    edge, side = down[board.inner[0] - 1] - down[0], down[-1] - down[board.inner[0] - 1]
    if edge[0] * side[1] - edge[1] * side[0] < 0:
        own = own * [1.0, -1.0]
    found = least_squares(gaps, start, x_scale="jac", loss="soft_l1", f_scale=0.5)
    error = float(np.sqrt(2 * np.mean(gaps(found.x) ** 2)))
    if error > WRONG:
        raise CalibrationError(
            f"{len(places)} places of the board are {error:.1f} pixels off one plane: it must lie "
            "still on the plane of motion only"
        )
    plane, _ = lain(found.x)
    return _upright(Plane(camera, plane.rotation, plane.translation, error))


def _one(corners: Array, board: Board, camera: Camera) -> Plane:
    """The plane of a board in one place."""
    good, turn, translation = cv2.solvePnP(
        board.corners, corners, camera.matrix, camera.distortion, flags=cv2.SOLVEPNP_IPPE
    )
    if good:
        turn, translation = cv2.solvePnPRefineLM(
            board.corners, corners, camera.matrix, camera.distortion, turn, translation
        )
        seen, _ = cv2.projectPoints(
            board.corners, turn, translation, camera.matrix, camera.distortion
        )
        gaps = np.asarray(seen, np.float64).reshape(-1, 2) - corners
        error = float(np.sqrt(np.mean(np.sum(gaps**2, axis=1))))
    if not good or error > WRONG:
        raise CalibrationError("the board on the plane of motion fits no pose of this camera")
    rotation = np.asarray(cv2.Rodrigues(turn)[0], np.float64)
    own = Plane(camera, rotation, np.asarray(translation, np.float64).ravel(), error)
    return _upright(own.at(board.corners.mean(axis=0)[:2]))


def _upright(plane: Plane) -> Plane:
    """The same with axes as they are seen: up is what goes up in the picture, at the origin."""
    centre = plane.pixels(np.zeros((1, 2)))
    up = plane.metres(centre + np.array([[0.0, -1.0]]))[0]
    y = plane.rotation[:, :2] @ (up / np.linalg.norm(up))
    normal = plane.rotation[:, 2] * -np.sign(plane.rotation[:, 2] @ plane.translation)
    axes = np.column_stack([np.cross(y, normal), y, normal])
    return Plane(plane.camera, axes, plane.translation, plane.error)


def _turn(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])
