"""The options of a reset, checked before they are sent, in the words that a local batch has."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from rodgym import _native
from rodgym.errors import ParameterError
from rodgym.remote.wire import Arrays


def split_options(given: dict[str, Any]) -> tuple[dict[str, Any], Arrays]:
    """Options for the header, and the exact start as arrays: that of a long rod does not fit there.

    Raises:
        ParameterError: an unknown option, or parameters that are no dictionary.
    """
    options = _native.plain_values(given)
    if "reset_mask" in options:
        allowed = "left out here: a mask is for a batch (gym.make_vec) and its reset"
        raise _refused("reset_mask", options["reset_mask"], allowed)
    parameters, state = options.pop("parameters", None), options.pop("state", None)
    if parameters is not None and not isinstance(parameters, dict):
        raise _refused("parameters", parameters, "a dictionary of parameters and their values")
    if options:
        raise ParameterError(
            f"unknown parameter 'options['{min(options)}']'; known parameters: "
            "options['parameters'], options['state'], and of a batch options['reset_mask']"
        )
    header, arrays = {}, {}
    if parameters:
        header["parameters"] = parameters
    if isinstance(state, dict) and state and all(map(_is_table, state.values())):
        arrays = {f"state:{name}": np.array(rows, np.float64) for name, rows in state.items()}
    elif state is not None:
        # The server refuses what is no table of numbers.
        header["state"] = state
    return header, arrays


def _refused(name: str, value: Any, allowed: str) -> ParameterError:
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"))
    return ParameterError(f"options['{name}'] = {text} is not allowed: it must be {allowed}")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_table(rows: Any) -> bool:
    """Whether this is a list of numbers, or a list of such lists of one length."""
    if not isinstance(rows, list):
        return False
    if all(map(_is_number, rows)):
        return True
    return all(isinstance(row, list) and len(row) == len(rows[0]) for row in rows) and all(
        _is_number(one) for row in rows for one in row
    )
