"""The checkerboard of a calibration, and its corners in a picture."""

from __future__ import annotations

import re
from dataclasses import dataclass

import cv2
import numpy as np

from rodgym._checks import refused
from rodgym.lab.tracks import UNITS, Array
from rodgym.lab.vision.films import Grey

#: Corners are looked for where cells have at least so many pixels: pictures are enlarged for it.
SHARP = 18.0
FORM = re.compile(r"^\s*(\d+)\s*x\s*(\d+)\s*:\s*([0-9.eE+-]+)\s*(m|cm|mm)\s*$")


@dataclass(frozen=True)
class Board:
    """A checkerboard.

    Parameters
    ----------
    columns, rows: of cells; corners are where four cells meet, one less each way
    cell: side of a cell [m]
    """

    columns: int
    rows: int
    cell: float

    @classmethod
    def parse(cls, text: str) -> Board:
        """`10x7:7.34mm`: ten by seven cells of 7.34 mm.

        Raises
        ------
        ParameterError: text of another form, or a board that is too small
        """
        form = "COLUMNSxROWS:SIDE with a unit, such as 10x7:7.34mm (cells, not corners)"
        found = FORM.match(text)
        try:
            columns, rows, side = int(found[1]), int(found[2]), float(found[3])  # type: ignore[index]
        except (TypeError, ValueError):
            raise refused("board", text, form) from None
        cell = side * UNITS[found[4]]  # type: ignore[index]
        if not (3 <= rows <= 50 and 3 <= columns <= 50 and 1e-4 <= cell <= 1.0):
            raise refused("board", text, f"{form}, 3 to 50 cells each way of 0.1 mm to 1 m")
        return cls(columns, rows, cell)

    @property
    def inner(self) -> tuple[int, int]:
        """Corners in a row and in a column."""
        return self.columns - 1, self.rows - 1

    @property
    def corners(self) -> Array:
        """Places of the corners on the board [m], (corners, 3)."""
        across, down = self.inner
        grid = np.mgrid[0:across, 0:down].T.reshape(-1, 2) * self.cell
        return np.column_stack([grid, np.zeros(len(grid))])

    def find(self, picture: Grey) -> Array | None:
        """The corners in a picture [pixel], (corners, 2); None where it is not seen whole."""
        for over in (1, 2):
            # Cells of ten pixels are found in a larger picture only.
            large = picture if over == 1 else cv2.resize(picture, None, fx=over, fy=over)
            # A quick look first: without a board it takes a tenth of the time.
            quick = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_FAST_CHECK
            seen, corners = cv2.findChessboardCorners(large, self.inner, flags=quick)
            if not seen:
                continue
            rough = (np.asarray(corners, np.float64).reshape(-1, 2) - 0.5 * (over - 1)) / over
            return self._exact(picture, rough)
        return None

    def _exact(self, picture: Grey, rough: Array) -> Array:
        """Corners to hundredths of a pixel, from where they are roughly."""
        grid = rough.reshape(self.inner[1], self.inner[0], 2)
        cell = min(float(np.linalg.norm(np.diff(grid, axis=i), axis=2).min()) for i in (0, 1))
        margin = 3 * int(np.ceil(cell))
        low = np.maximum(np.floor(rough.min(axis=0)).astype(int) - margin, 0)
        high = np.ceil(rough.max(axis=0)).astype(int) + margin
        part = picture[low[1] : high[1], low[0] : high[0]]
        over = int(np.clip(np.ceil(SHARP / cell), 1, 4))
        large = cv2.resize(part, None, fx=over, fy=over, interpolation=cv2.INTER_CUBIC)
        how = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
        seen, corners = cv2.findChessboardCornersSB(large, self.inner, flags=how)
        if seen:
            exact = np.asarray(corners, np.float64).reshape(-1, 2)
        else:
            # The window of a corner must not reach the next one.
            half = int(np.clip(0.4 * cell * over, 2, 11))
            stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-4)
            start = ((rough - low) * over + 0.5 * (over - 1)).astype(np.float32)
            exact = np.asarray(
                cv2.cornerSubPix(large, start, (half, half), (-1, -1), stop), np.float64
            )
        return (exact - 0.5 * (over - 1)) / over + low
