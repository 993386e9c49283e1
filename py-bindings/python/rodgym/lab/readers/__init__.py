"""Readers of tracks: plain tables, DeepLabCut, DLTdv8, SLEAP and Tracker.

Each reader gives a `Source`, what the file says; `place` makes metres, seconds and an order of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rodgym.extras import missing
from rodgym.lab.errors import FormatError
from rodgym.lab.readers import deeplabcut, dltdv, plain, sleap, tracker
from rodgym.lab.readers.place import placed
from rodgym.lab.readers.source import Source, read_text
from rodgym.lab.tracks import Tracks

__all__ = ["Source", "read_source", "read_tracks"]

HDF5 = (".h5", ".hdf5", ".hdf")
#: How a file of HDF5 begins.
MAGIC = b"\x89HDF\r\n\x1a\n"


def read_tracks(
    path: Path | str,
    unit: str | None = None,
    scale: float | None = None,
    y: str | None = None,
    rate: float | None = None,
    markers: Sequence[str] | None = None,
    origin: tuple[float, float] | None = None,
    axis: float = 0.0,
    confidence: float = 0.6,
    animal: str | None = None,
    camera: str | None = None,
) -> Tracks:
    """Reads tracks; the format is told from the content.

    Formats: CSV and Parquet with `time,x1,y1,...,xN,yN` or `time,marker,x,y`, DeepLabCut's CSV and
    H5, DLTdv8's `xypts.csv`, SLEAP's analysis H5 and CSV, Tracker's exported text.

    Parameters
    ----------
    unit: of the positions: `m`, `cm`, `mm`; left out: as header or format say, else `m`
    scale: metres of one unit of the table, in place of `unit`: for pixels
    y: where y points, `up` or `down`; left out: as the format has it, else `up`
    rate: frames a second, of files that have no times
    markers: names from base to tip; left out: in the file's order
    origin: point of the table that becomes (0, 0), in the table's units and axes
    axis: direction of the new x axis, counter-clockwise from the table's x as it is seen [degrees]
    confidence: points that are less sure are taken for lost, where the file says how sure they are
    animal, camera: which one, of files with several

    Raises
    ------
    FormatError, HeaderError, CellError, ChoiceError: what is wrong with the file, and where
    UnitsError, FramesError, OrderError: what must be said beside it
    """
    source = read_source(Path(path), animal, camera)
    return placed(source, unit, scale, y, rate, markers, origin, axis, confidence)


def read_source(path: Path, animal: str | None = None, camera: str | None = None) -> Source:
    """What a file of tracks says."""
    try:
        with path.open("rb") as stream:
            first = stream.read(len(MAGIC))
    except OSError as error:
        raise FormatError(f"{path}: {error.strerror}") from error
    if first == MAGIC:
        _need(path, "h5py")
        import h5py

        with h5py.File(path, "r") as file:
            ours = "tracks" in file
        if ours:
            return sleap.read_h5(path, animal)
        _need(path, "pandas", "tables")
        return deeplabcut.read_h5(path, animal)
    if path.suffix.lower() in HDF5:
        raise FormatError(f"{path.name} is no HDF5 file")
    if first[:4] == b"PAR1":
        _need(path, "pyarrow")
        return plain.read_parquet(path)
    text = read_text(path)
    if deeplabcut.is_deeplabcut(text):
        return deeplabcut.read_csv(text, animal)
    if dltdv.is_dltdv(text):
        return dltdv.read(text, camera)
    if sleap.is_sleap(text):
        return sleap.read_csv(text, animal)
    if tracker.is_tracker(text):
        return tracker.read(text)
    return plain.read_tidy(text) if plain.is_tidy(text.rows[0]) else plain.read_wide(text)


def _need(path: Path, *modules: str) -> None:
    """Refuses a file that other packages read.

    Raises
    ------
    FormatError: they are not installed
    """
    if said := missing(modules):
        raise FormatError(f"{path.name}: {said}")
