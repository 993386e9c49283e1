"""Arguments as Python gives them: what is of the wrong kind is refused like what is out of range.

A `ParameterError` or `ShapeError` (both are `ValueError`) names the argument, the value and what is
allowed. Python's own `TypeError` is left to calls with missing, unknown or too many arguments.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping, Set
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode

from rodgym.errors import ParameterError, ShapeError

Array = npt.NDArray[np.float64]

#: Seeds are below this.
SEEDS = 2**64
#: Characters of a value in an error.
SHOWN = 300


def shown(value: Any) -> str:
    """A value in an error: its `repr`, cut where long; its type where it has none."""
    try:
        text = repr(value)
    except Exception:
        text = f"<{type(value).__name__}>"
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."


def refused(name: str, value: Any, allowed: str) -> ParameterError:
    """The error for a value that is not allowed."""
    return ParameterError(f"{name} = {shown(value)} is not allowed: it must be {allowed}")


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


def _in_order(value: Any) -> list[Any] | None:
    """The items of a sequence, array or iterator; None for what has none, or none in an order that
    somebody meant.
    """
    if isinstance(value, str | bytes | bytearray | Mapping | Set):
        return None
    try:
        return list(value)
    except TypeError:  # An array of no dimension is called iterable, too.
        return None


def seeds(value: Any) -> list[int]:
    """At least one seed, each a whole number."""
    given = _in_order(value)
    if given is None:
        raise refused("seeds", value, "a sequence of whole numbers such as range(100)")
    allowed = "a whole number from 0 to 2^64 - 1"
    result = [whole("seed", one, 0, SEEDS - 1, allowed) for one in given]
    if not result:
        raise refused("seeds", value, "at least one whole number")
    return result


def batch_seeds(value: Any, num_envs: int) -> int | list[int | None] | None:
    """What the reset of a batch takes: one seed, of whatever integer type, one an environment, or
    None.
    """
    if value is None or isinstance(value, int):
        return seed(value)
    given = _in_order(value)
    if given is None:
        return seed(value)
    if len(given) != num_envs:
        raise ShapeError(f"seed is a list of {len(given)}, but {num_envs} are needed")
    return [seed(one) for one in given]


def autoreset_mode(value: Any) -> AutoresetMode:
    """Gymnasium's mode, or its value."""
    try:
        return AutoresetMode(value)
    except ValueError as error:
        allowed = f"one of {[mode.value for mode in AutoresetMode]}"
        raise refused("autoreset_mode", value, allowed) from error


def episode_steps(value: Any) -> int | None:
    """The time limit of episodes that are played to their end."""
    if value is None:
        return None
    allowed = "a whole number of at least 1, or None, where episodes are played to their end"
    return whole("max_episode_steps", value, 1, None, allowed)


def snapshot(name: str, value: Any) -> bytes:
    """Bytes, of whatever type."""
    if not isinstance(value, bytes | bytearray | memoryview):
        raise refused(name, value, "the bytes that get_state returned")
    return bytes(value)


def numbers(name: str, values: npt.ArrayLike, dtype: Any = np.float64) -> npt.NDArray[Any]:
    """An array of real numbers, see `as_array`."""
    try:
        array = as_array(values)
        if array.dtype.kind not in "fiubO":
            raise TypeError(f"numbers of type {array.dtype}")
        return array.astype(dtype, copy=False)
    except (TypeError, ValueError, RuntimeError) as error:
        raise ShapeError(f"{name} must be an array of numbers, but is {shown(values)}") from error


def as_array(values: Any) -> npt.NDArray[Any]:
    """What is given as an array of NumPy, by value.

    That includes what NumPy refuses or does not know: tensors that carry gradients (an environment
    has none), are on another device, or of a type such as bfloat16.
    """
    try:
        array = np.asarray(values)
    except (TypeError, RuntimeError):
        if not hasattr(values, "tolist"):
            raise
        array = np.asarray(values.tolist())
    # A number's type that another package has taught NumPy.
    foreign = array.dtype.kind == "V" and array.dtype.type is not np.void
    return array.astype(np.float64) if foreign else array


def actions(values: Any) -> npt.NDArray[Any]:
    """Actions as an array of real numbers; shape and finiteness are checked elsewhere."""
    try:
        array = as_array(values)
    except (TypeError, ValueError, RuntimeError) as error:
        raise ShapeError(f"actions must be numbers, but are {shown(values)}") from error
    if array.dtype.kind not in "fiub":
        raise ShapeError(f"actions must be numbers, but are {shown(values)}")
    return array


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
