"""Reports of a run: plots, an animation and one HTML page (extra ``report``)."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rodgym.report.comparison import Entrant, compare
    from rodgym.report.page import write_page

__all__ = ["Entrant", "compare", "write_page"]

#: Loaded when they are asked for: an animation needs neither plots nor pages.
_PARTS = {"Entrant": "comparison", "compare": "comparison", "write_page": "page"}


def __getattr__(name: str) -> Any:
    if name in _PARTS:
        return getattr(importlib.import_module(f"rodgym.report.{_PARTS[name]}"), name)
    raise AttributeError(f"module 'rodgym.report' has no attribute {name!r}")
