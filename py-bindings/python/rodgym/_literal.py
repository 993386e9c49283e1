"""Values as people write them: JSON, a literal of Python, or else the text itself."""

from __future__ import annotations

import ast
import json
import warnings
from typing import Any


def literal(text: str) -> Any:
    """``0.5``, ``1e-4``, ``true`` or ``True``, ``null`` or ``None``, ``[1, 2]`` and
    ``{'width': (0.006, 0.009)}`` by value; other text, such as ``implicit``, as it stands.

    Raises:
        ValueError: what begins as a list, tuple or dictionary and is none.
    """
    try:
        return json.loads(text)
    except (json.JSONDecodeError, RecursionError):
        pass
    try:
        with warnings.catch_warnings():
            # What Python thinks of the spelling concerns programs.
            warnings.simplefilter("ignore")
            value = ast.literal_eval(text.strip())
        if not _plain(value):
            raise ValueError("bytes, sets and complex numbers are no values of a keyword")
        return value
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        if text.strip()[:1] in ("[", "(", "{"):
            raise ValueError(f"{text!r} is neither JSON nor a value of Python") from None
        return text


def _plain(value: Any) -> bool:
    """Whether JSON could say it, tuples counted as lists."""
    if isinstance(value, list | tuple):
        return all(_plain(item) for item in value)
    if isinstance(value, dict):
        return all(isinstance(key, str) and _plain(item) for key, item in value.items())
    return value is None or isinstance(value, bool | int | float | str)
