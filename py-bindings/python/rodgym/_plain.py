"""Values in types that JSON knows."""

from __future__ import annotations

from enum import Enum
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """The value in types that JSON knows: enums by value, NumPy's types as Python's."""
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(plain(item) for item in value)
    return value
