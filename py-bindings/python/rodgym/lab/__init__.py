"""From a rod on the bench to its parameters: tracks of a film, and a fit of the model to them."""

from __future__ import annotations

import importlib
from typing import Any

from rodgym.lab.by_simplex import fit_by_simplex
from rodgym.lab.errors import (
    AxisError,
    CalibrationError,
    CellError,
    ChoiceError,
    ClockError,
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
from rodgym.lab.film import Torque
from rodgym.lab.fin_fit import fit_fin
from rodgym.lab.fin_in_air import Experiment, fit_as_the_thesis
from rodgym.lab.fin_model import Recording
from rodgym.lab.fin_result import FinFit
from rodgym.lab.fitting import fit
from rodgym.lab.readers import read_tracks
from rodgym.lab.result import Fit, Holdout, Interval
from rodgym.lab.servo import fit_servo
from rodgym.lab.tracks import Tracks
from rodgym.lab.twin import keywords

_LATER = {"read_cells": "rodgym.lab.cells", "fluid_force": "rodgym.lab.water"}

__all__ = [
    "AxisError",
    "CalibrationError",
    "CellError",
    "ChoiceError",
    "ClockError",
    "Experiment",
    "FilmError",
    "FinFit",
    "Fit",
    "FormatError",
    "FramesError",
    "HeaderError",
    "Holdout",
    "Interval",
    "MarkersError",
    "MisfitError",
    "OrderError",
    "Recording",
    "RecordingError",
    "Torque",
    "Tracks",
    "UnitsError",
    "fit",
    "fit_as_the_thesis",
    "fit_by_simplex",
    "fit_fin",
    "fit_servo",
    "fluid_force",
    "keywords",
    "read_cells",
    "read_tracks",
]


def __getattr__(name: str) -> Any:
    # What needs SciPy, which a fit does not.
    if name in _LATER:
        return getattr(importlib.import_module(_LATER[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
