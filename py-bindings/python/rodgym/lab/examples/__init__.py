"""Small *synthetic* recordings to try things with: a pendulum that swings, a fin in water.

`tests/long/lab_examples.py` has made them; `TRUTH` is what was hidden, `KNOWN` what a ruler and
scales would tell.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rodgym._checks import refused

#: Files by name.
FILES = {
    "pendulum": "pendulum.csv",
    "fin": "fin.csv",
    "fin-bench": "fin-bench.csv",
}
#: The fin is that of the thesis with a tail that is 1 mm thick.
_GEOMETRY: dict[str, Any] = {
    "edge_length": 0.02,
    "height": 0.115,
    "pivot": 2,
    "widths": [0.0, 0.0185, 0.0185, 0.0168, 0.0134, 0.0099, 0.0036, 0.001],
    "areas": [0.0, 2.133e-3, 2.133e-3, 1.933e-3, 1.544e-3, 1.144e-3, 4.14e-4, 1.15e-4],
}
TRUTH: dict[str, dict[str, float]] = {
    "pendulum": {"youngs_modulus": 8.3e6, "bending_damping": 6e-4},
    "fin": {"youngs_modulus": 3e5, "drag_coefficient": 1.5, "added_mass_coefficient": 0.6},
}
KNOWN: dict[str, dict[str, Any]] = {
    "pendulum": {"width": 0.007, "length": 0.3, "density": 1500.0},
    "fin": {"geometry": _GEOMETRY},
}


def path(name: str) -> Path:
    """Where an example lies: `pendulum` and `fin` are tracks, `fin-bench` is pitch and thrust.

    Raises
    ------
    ParameterError: there is no such example
    """
    if name not in FILES:
        raise refused("example", name, f"one of {', '.join(FILES)}")
    return Path(__file__).with_name(FILES[name])
