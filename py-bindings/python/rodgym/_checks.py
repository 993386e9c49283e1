"""Arguments as Python gives them: what is of the wrong kind is refused like what is out of range.

A `ParameterError` or `ShapeError` (both are `ValueError`) names the argument, the value and what is
allowed. Python's own `TypeError` is left to calls with missing, unknown or too many arguments.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from rodgym.errors import ParameterError, ShapeError

Array = npt.NDArray[np.float64]

#: Seeds are below this.
SEEDS = 2**64


def refused(name: str, value: Any, allowed: str) -> ParameterError:
    """The error for a value that is not allowed."""
    return ParameterError(f"{name} = {value!r} is not allowed: it must be {allowed}")


def whole(name: str, value: Any, low: int, high: int | None, allowed: str) -> int:
    """An integer of Python or NumPy within [low, high]; True and False are none."""
    try:
        number = operator.index(value)
    except TypeError:
        number = low - 1
    if isinstance(value, bool) or number < low or (high is not None and number > high):
        raise refused(name, value, allowed)
    return number


def number(name: str, value: Any, unit: str) -> float:
    """A finite number, `unit` is for the message."""
    try:
        result = float(value) if np.ndim(value) == 0 and not isinstance(value, str) else math.nan
    except (TypeError, ValueError, OverflowError):
        result = math.nan
    if not math.isfinite(result):
        raise refused(name, value, f"a finite number, in {unit}")
    return result


def text(name: str, value: Any, such_as: str) -> str:
    """A string."""
    if not isinstance(value, str):
        raise refused(name, value, f"a string such as {such_as!r}")
    return value


def env_id(value: Any) -> str:
    """The id of an environment; whether it exists is asked elsewhere."""
    return text("env_id", value, "rodgym/PendulumSwingUp-v0")


def mapping(name: str, value: Any) -> dict[str, Any]:
    """A dictionary, empty for None."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise refused(name, value, "a dictionary, or None")
    return dict(value)


def seed(value: Any) -> int | None:
    """One seed, or None."""
    allowed = "a whole number from 0 to 2^64 - 1"
    return None if value is None else whole("seed", value, 0, SEEDS - 1, allowed)


def seeds(value: Any) -> list[int]:
    """At least one seed, each a whole number."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise refused("seeds", value, "a sequence of whole numbers such as range(100)")
    allowed = "a whole number from 0 to 2^64 - 1"
    result = [whole("seed", one, 0, SEEDS - 1, allowed) for one in value]
    if not result:
        raise refused("seeds", value, "at least one whole number")
    return result


def snapshot(name: str, value: Any) -> bytes:
    """Bytes, of whatever type."""
    if not isinstance(value, bytes | bytearray | memoryview):
        raise refused(name, value, "the bytes that get_state returned")
    return bytes(value)


def numbers(name: str, values: npt.ArrayLike, dtype: Any = np.float64) -> npt.NDArray[Any]:
    """An array of numbers; complex ones are none, instead of losing their imaginary part."""
    try:
        if getattr(getattr(values, "dtype", None), "kind", "") == "c":
            raise TypeError("complex")
        return np.asarray(values, dtype=dtype)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"{name} must be an array of numbers, but is {values!r}") from error


def matrix(name: str, values: npt.ArrayLike) -> Array:
    """Numbers of shape (nodes, 2); the count of nodes is checked elsewhere."""
    array = numbers(name, values)
    if array.ndim != 2 or array.shape[1] != 2:
        raise ShapeError(f"{name} has shape {array.shape}, but (nodes, 2) is needed")
    return array


def vector(name: str, values: npt.ArrayLike) -> list[float]:
    """Numbers in one dimension."""
    array = numbers(name, values)
    if array.ndim != 1:
        raise ShapeError(f"{name} has shape {array.shape}, but one dimension is needed")
    return array.tolist()


def count(n: Any) -> int:
    """Steps to take."""
    return whole("n", n, 0, 2**63 - 1, "a whole number from 0 to 2^63 - 1")
