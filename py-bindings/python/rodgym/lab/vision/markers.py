"""Markers in a picture: bright or dark spots, to fractions of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from rodgym._checks import refused
from rodgym.lab.tracks import Array
from rodgym.lab.vision.films import Grey

#: A spot must stand out from what is around it by so much of the grey scale.
LEAST = 25.0
#: Spots whose area is so many times off the usual one are none, either way.
ODD = 3.0
#: The part of a spot above this share of its height is what its centroid is taken of.
FOOT = 0.35
#: A marker that moves is smeared: it may stand out by so much less than the usual one.
FAINT = 0.25


@dataclass(frozen=True)
class Look:
    """What markers look like.

    Parameters
    ----------
    light: brighter than what is around them; else darker
    largest: width of the largest one [pixel]
    region: left, top, right and bottom of the part of the picture that is looked at [pixel]
    """

    light: bool = True
    largest: int = 25
    region: tuple[int, int, int, int] | None = None

    def __post_init__(self) -> None:
        if not 3 <= self.largest <= 400:
            raise refused("largest", self.largest, "3 to 400 pixels")
        if self.region is not None:
            left, top, right, bottom = self.region
            if not (0 <= left < right and 0 <= top < bottom):
                raise refused("region", self.region, "left < right and top < bottom, in pixels")


@dataclass(frozen=True)
class Spots:
    """Spots of a picture.

    Parameters
    ----------
    places: of the centroids [pixel], (n, 2)
    areas: [pixel^2], (n,)
    heights: how far each stands out [0 to 255], (n,)
    """

    places: Array
    areas: Array
    heights: Array

    def some(self, keep: npt.NDArray[np.bool_]) -> Spots:
        """Those that are chosen."""
        return Spots(self.places[keep], self.areas[keep], self.heights[keep])


def spots(picture: Grey, look: Look) -> Spots:
    """The spots that stand out, each by its own centroid.

    A centroid is that of the part above a share of the height, weighted with how far above it is:
    noise around a spot, and a background that is brighter on one side, hardly move it.
    """
    left, top = 0, 0
    if look.region is not None:
        left, top, right, bottom = look.region
        picture = picture[top:bottom, left:right]
    smooth = cv2.GaussianBlur(picture, (3, 3), 0.8)
    if not look.light:
        smooth = 255 - smooth
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (look.largest, look.largest))
    hat = cv2.morphologyEx(smooth, cv2.MORPH_TOPHAT, kernel).astype(np.float64)
    rough = max(LEAST, 0.35 * float(np.percentile(hat, 99.99)))
    count, labels, stats, _ = cv2.connectedComponentsWithStats((hat > rough).astype(np.uint8))
    places, areas, heights = [], [], []
    for label in range(1, count):
        x, y, wide, high, area = stats[label]
        if area < 4 or wide > look.largest or high > look.largest:
            continue
        part = (slice(max(y - 2, 0), y + high + 2), slice(max(x - 2, 0), x + wide + 2))
        own = np.isin(labels[part], (0, label))
        height = float(np.percentile(hat[part][labels[part] == label], 90))
        over = np.clip(hat[part] - FOOT * height, 0.0, None) * own
        total = over.sum()
        if total <= 0:
            continue
        rows, columns = np.mgrid[part[0].start : part[0].start + over.shape[0],
                                 part[1].start : part[1].start + over.shape[1]]  # fmt: skip
        places.append([left + (over * columns).sum() / total, top + (over * rows).sum() / total])
        areas.append(float((over > 0).sum()))
        heights.append(height)
    return Spots(np.array(places).reshape(-1, 2), np.array(areas), np.array(heights))


def alike(found: Spots, area: float, height: float) -> Spots:
    """The spots that are about as large and as bright as markers are."""
    ratio = found.areas / area
    return found.some((ratio > 1 / ODD) & (ratio < ODD) & (found.heights > FAINT * height))
