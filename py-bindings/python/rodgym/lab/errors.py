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
