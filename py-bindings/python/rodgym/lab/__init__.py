"""From a rod on the bench to its parameters: tracks of a film, and a fit of the model to them."""

from rodgym.lab.errors import (
    AxisError,
    CellError,
    FramesError,
    HeaderError,
    MisfitError,
    OrderError,
    RecordingError,
    UnitsError,
)
from rodgym.lab.fitting import fit
from rodgym.lab.result import Fit, Holdout, Interval
from rodgym.lab.tracks import Tracks, read_tracks
from rodgym.lab.twin import keywords

__all__ = [
    "AxisError",
    "CellError",
    "Fit",
    "FramesError",
    "HeaderError",
    "Holdout",
    "Interval",
    "MisfitError",
    "OrderError",
    "RecordingError",
    "Tracks",
    "UnitsError",
    "fit",
    "keywords",
    "read_tracks",
]
