"""Policies as ONNX files, which other programs and languages run (extra ``export``)."""

from rodgym.export.write import export

__all__ = ["export"]
