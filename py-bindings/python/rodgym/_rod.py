"""The keyword `rod` of every environment: a fitted rod in place of its keywords."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def with_rod(keywords: Mapping[str, Any]) -> dict[str, Any]:
    """The keywords, with those of the rod where one is given.

    Raises
    ------
    RecordingError: the file of the rod cannot be used
    """
    if keywords.get("rod") is None:
        return {name: value for name, value in keywords.items() if name != "rod"}
    from rodgym.lab.twin import expanded

    return expanded(keywords)
