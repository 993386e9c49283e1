"""Films and pictures as grey arrays."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from rodgym.lab.errors import FilmError

Grey = npt.NDArray[np.uint8]

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")


class Film:
    """A film on disk; `rate` is frames a second, in place of what the film says.

    Raises
    ------
    FilmError: it cannot be opened, or says no frames a second
    """

    def __init__(self, path: Path | str, rate: float | None = None) -> None:
        self.path = Path(path)
        stream = self._open()
        self.rate = float(stream.get(cv2.CAP_PROP_FPS)) if rate is None else rate
        self.size = (
            int(stream.get(cv2.CAP_PROP_FRAME_WIDTH)),
            int(stream.get(cv2.CAP_PROP_FRAME_HEIGHT)),
        )
        stream.release()
        if not (np.isfinite(self.rate) and self.rate > 0):
            raise FilmError(f"{self.path.name} does not say its frames a second: give --rate")

    def frames(self, first: int = 0, every: int = 1) -> Iterator[tuple[int, Grey]]:
        """Number and grey picture of every so many-th frame from the first on."""
        stream = self._open()
        try:
            number = 0
            # (Frames are counted one by one: seeking in compressed films is not exact.)
            while stream.grab():
                if number >= first and (number - first) % every == 0:
                    good, picture = stream.retrieve()
                    if not good:
                        return
                    yield number, grey(picture)
                number += 1
        finally:
            stream.release()

    def _open(self) -> cv2.VideoCapture:
        if not self.path.is_file():
            raise FilmError(f"there is no film {self.path}")
        stream = cv2.VideoCapture(str(self.path))
        if not stream.isOpened():
            raise FilmError(f"{self.path.name} is no film that OpenCV reads")
        return stream


def grey(picture: Any) -> Grey:
    """A picture in grey."""
    if picture.ndim == 3:
        picture = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    return np.asarray(picture, np.uint8)


def pictures(sources: Sequence[Path | str], every: float = 0.2) -> Iterator[tuple[str, Grey]]:
    """Name and picture of all pictures, of those in folders, and of films every so many seconds."""
    for source in map(Path, sources):
        if source.is_dir():
            inside = sorted(p for p in source.iterdir() if p.suffix.lower() in PICTURES)
            if not inside:
                raise FilmError(f"there is no picture in the folder {source}")
            yield from pictures(inside)
        elif source.suffix.lower() in PICTURES:
            picture = cv2.imread(str(source), cv2.IMREAD_GRAYSCALE)
            if picture is None:
                raise FilmError(f"{source} is no picture that OpenCV reads")
            yield source.name, grey(picture)
        else:
            film = Film(source)
            for number, picture in film.frames(every=max(1, round(every * film.rate))):
                yield f"{source.name}, frame {number}", picture
