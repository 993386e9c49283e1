"""What was tracked, drawn into a frame of the film."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from rodgym.lab.vision.track import Tracking

#: Colours (blue, green, red) of the first marker, of the others, of the way of the last, and of
#: the axes.
FIRST, OTHERS, WAY, AXES = (60, 180, 60), (40, 40, 230), (230, 160, 40), (230, 230, 230)
#: Length of the axes that are drawn [m].
AXIS = 0.05


def write_overlay(path: Path, found: Tracking) -> None:
    """The first frame with every marker, the way of the last marker, and the axes at the origin."""
    picture = cv2.cvtColor(found.sample, cv2.COLOR_GRAY2BGR)
    way = found.pixels[:, -1]
    way = way[np.isfinite(way).all(axis=1)]
    cv2.polylines(picture, [_fine(way)], False, WAY, 1, cv2.LINE_AA, 4)
    ends = found.plane.pixels(np.array([[0.0, 0.0], [AXIS, 0.0], [0.0, AXIS]]))
    for end, name in zip(ends[1:], "xy", strict=True):
        cv2.arrowedLine(picture, _whole(ends[0]), _whole(end), AXES, 1, cv2.LINE_AA)
        cv2.putText(
            picture, name, _whole(end + 4), cv2.FONT_HERSHEY_SIMPLEX, 0.5, AXES, 1, cv2.LINE_AA
        )
    for i, place in enumerate(found.pixels[0]):
        if not np.isfinite(place).all():
            continue
        cv2.circle(picture, _whole(place), 9, FIRST if i == 0 else OTHERS, 1, cv2.LINE_AA)
        spot = _whole(place + np.array([10.0, -8.0]))
        cv2.putText(
            picture, str(i + 1), spot, cv2.FONT_HERSHEY_SIMPLEX, 0.5, OTHERS, 1, cv2.LINE_AA
        )
    cv2.imwrite(str(path), picture)


def _fine(points: np.ndarray) -> np.ndarray:
    return np.rint(points * 16).astype(np.int32).reshape(-1, 1, 2)


def _whole(point: np.ndarray) -> tuple[int, int]:
    return round(float(point[0])), round(float(point[1]))
