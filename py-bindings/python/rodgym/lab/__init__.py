"""From a rod on the bench to its parameters: tracks of a film, and a fit of the model to them."""

from rodgym.lab.errors import (
    AxisError,
    CalibrationError,
    CellError,
    ChoiceError,
    FilmError,
    FormatError,
    FramesError,
    HeaderError,
    MarkersError,
    MisfitError,
    OrderError,
    RecordingError,
    UnitsError,
)
from rodgym.lab.fitting import fit
from rodgym.lab.readers import read_tracks
from rodgym.lab.result import Fit, Holdout, Interval
from rodgym.lab.tracks import Tracks
from rodgym.lab.twin import keywords

__all__ = [
    "AxisError",
    "CalibrationError",
    "CellError",
    "ChoiceError",
    "FilmError",
    "Fit",
    "FormatError",
    "FramesError",
    "HeaderError",
    "Holdout",
    "Interval",
    "MarkersError",
    "MisfitError",
    "OrderError",
    "RecordingError",
    "Tracks",
    "UnitsError",
    "fit",
    "keywords",
    "read_tracks",
]
