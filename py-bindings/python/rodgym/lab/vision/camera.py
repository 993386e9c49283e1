"""The camera: focal lengths, principal point and distortion from pictures of a board."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from rodgym.lab.errors import CalibrationError
from rodgym.lab.tracks import Array
from rodgym.lab.vision.board import Board

#: Fewer pictures tell no camera; more than so many tell nothing new.
FEWEST, MOST = 6, 60
#: Two poses differ where a corner has moved so far [pixel].
MOVED = 5.0
#: Deviation of the focal lengths, as a share, beyond which the pictures were too much alike.
VAGUE = 0.02
#: A picture whose error is so many times the median's is left out.
ODD = 2.5
#: Reprojection error beyond which no board was seen [pixel].
WRONG = 2.0


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with radial and tangential distortion.

    Parameters
    ----------
    size: width and height of its pictures [pixel]
    matrix: focal lengths and principal point [pixel], (3, 3)
    distortion: k1, k2, p1, p2, k3, as OpenCV has them
    error: root mean square of the reprojection errors [pixel]
    deviations: of the four numbers of the matrix [pixel]
    views: pictures that were used
    """

    size: tuple[int, int]
    matrix: Array
    distortion: Array
    error: float
    deviations: tuple[float, float, float, float]
    views: int

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers, for a file."""
        return {
            "size": list(self.size),
            "focal_length": [float(self.matrix[0, 0]), float(self.matrix[1, 1])],
            "principal_point": [float(self.matrix[0, 2]), float(self.matrix[1, 2])],
            "distortion": [float(value) for value in self.distortion],
            "reprojection_error": self.error,
            "deviations": list(self.deviations),
            "views": self.views,
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Camera:
        """From what `as_dict` has made.

        Raises
        ------
        CalibrationError: it is none
        """
        try:
            (fx, fy), (cx, cy) = content["focal_length"], content["principal_point"]
            width, height = (int(side) for side in content["size"])
            return cls(
                (width, height),
                np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]], np.float64),
                np.array(content["distortion"], np.float64),
                float(content["reprojection_error"]),
                tuple(float(value) for value in content["deviations"]),  # type: ignore[arg-type]
                int(content["views"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise CalibrationError("the file has no camera of 'rodgym track'") from error

    def rays(self, pixels: Array) -> Array:
        """Directions x / z, y / z of pixels without distortion, (n, 2)."""
        if len(pixels) == 0:
            return np.zeros((0, 2))
        seen = np.ascontiguousarray(pixels, np.float64)
        rays = cv2.undistortPoints(seen.reshape(-1, 1, 2), self.matrix, self.distortion)
        rays = np.asarray(rays, np.float64).reshape(-1, 2)
        focal = self.matrix[[0, 1], [0, 1]]
        # (OpenCV's few rounds leave tenths of a pixel near the border.)
        for _ in range(20):
            rays = rays + (seen - self.pixels(rays)) / focal
        return rays

    def pixels(self, rays: Array) -> Array:
        """Pixels of directions x / z, y / z, (n, 2)."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = rays.T
        r = x * x + y * y
        radial = 1.0 + r * (k1 + r * (k2 + r * k3))
        bent = [
            x * radial + 2 * p1 * x * y + p2 * (r + 2 * x * x),
            y * radial + 2 * p2 * x * y + p1 * (r + 2 * y * y),
        ]
        return np.stack(bent, axis=1) * self.matrix[[0, 1], [0, 1]] + self.matrix[:2, 2]


def calibrate(views: Sequence[Array], board: Board, size: tuple[int, int]) -> Camera:
    """The camera from corners of a board in many poses.

    Raises
    ------
    CalibrationError: too few pictures, poses too much alike, or corners that fit no camera
    """
    views = different(views)
    if len(views) < FEWEST:
        raise CalibrationError(
            f"the board is seen whole in {len(views)} poses; a calibration needs at least "
            f"{FEWEST}, better 20, from many sides (--calibration FILM or pictures, or --camera of "
            "an earlier run)"
        )
    chosen = [views[i] for i in np.unique(np.linspace(0, len(views) - 1, MOST).astype(int))]
    found = _calibrated(chosen, board, size)
    errors = found[1]
    good = errors <= ODD * np.median(errors)
    if not good.all() and good.sum() >= FEWEST:
        chosen = [view for view, keep in zip(chosen, good, strict=True) if keep]
        found = _calibrated(chosen, board, size)
    camera, _ = found
    if camera.error > WRONG:
        raise CalibrationError(
            f"the corners are {camera.error:.1f} pixels off those of any camera: is it the board "
            f"that was named, {board.columns} by {board.rows} cells?"
        )
    focal = (camera.matrix[0, 0], camera.matrix[1, 1])
    vague = max(d / f for d, f in zip(camera.deviations[:2], focal, strict=True))
    if vague > VAGUE:
        raise CalibrationError(
            f"the focal length is known to {100 * vague:.0f} % only: show the board tilted, from "
            "many sides and near the borders of the picture"
        )
    return camera


def different(views: Sequence[Array]) -> list[Array]:
    """Views of different poses: of those that are alike the first."""
    kept = list[Array]()
    for view in views:
        if all(np.abs(view - other).max() > MOVED for other in kept):
            kept.append(view)
    return kept


def _calibrated(
    views: Sequence[Array], board: Board, size: tuple[int, int]
) -> tuple[Camera, Array]:
    """A camera, and the error of each view [pixel]."""
    places = [board.corners.astype(np.float32)] * len(views)
    seen = [view.astype(np.float32).reshape(-1, 1, 2) for view in views]
    error, matrix, distortion, _, _, deviations, _, errors = cv2.calibrateCameraExtended(
        places, seen, size, np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K3
    )
    four = tuple(float(value) for value in np.asarray(deviations).ravel()[:4])
    camera = Camera(
        size,
        np.asarray(matrix, np.float64),
        np.asarray(distortion, np.float64).ravel()[:5],
        float(error),
        four,  # type: ignore[arg-type]
        len(views),
    )
    return camera, np.asarray(errors, np.float64).ravel()
