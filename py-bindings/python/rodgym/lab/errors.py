"""What a recording is refused for, each by its own name."""

from __future__ import annotations

from rodgym.errors import RodgymError


class RecordingError(RodgymError, ValueError):
    """A recording that cannot be used as it is."""


class HeaderError(RecordingError):
    """A table without the columns that tracks have."""


class CellError(RecordingError):
    """A cell of a table that is no number."""


class UnitsError(RecordingError):
    """Lengths or times that are not in metres and seconds."""


class AxisError(RecordingError):
    """Coordinates whose y points downwards."""


class OrderError(RecordingError):
    """Markers that do not go from the base to the tip."""


class FramesError(RecordingError):
    """Too few frames, or times that do not rise."""


class MisfitError(RecordingError):
    """No parameters make the model move like the recording."""


class FormatError(RecordingError):
    """A file of tracks that no reader understands."""

    #: What is read, for messages.
    known = (
        "tracks are read from CSV and Parquet, DeepLabCut (CSV, H5), DLTdv8 (xypts.csv), SLEAP "
        "(analysis H5, CSV) and Tracker (text)"
    )


class ChoiceError(RecordingError):
    """A file of several animals or cameras, of which none was chosen."""


class FilmError(RecordingError):
    """A film that cannot be opened, or of which nothing is left to track."""


class CalibrationError(RecordingError):
    """Pictures of a board that do not tell the camera."""


class MarkersError(RecordingError):
    """Markers that are not found, or not the same number of them."""


class ClockError(RecordingError):
    """Two recordings whose clocks cannot be aligned."""
