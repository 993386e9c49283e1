"""Policies as ONNX files, which other programs and languages run (extra ``export``).

Writing one needs what trained the policy, too; playing one does not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rodgym.export.write import export

__all__ = ["export"]


def __getattr__(name: str) -> Any:
    if name == "export":
        from rodgym.export.write import export

        return export
    raise AttributeError(f"module 'rodgym.export' has no attribute {name!r}")
