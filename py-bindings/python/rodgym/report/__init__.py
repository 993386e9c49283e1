"""Reports of a run: plots, an animation and one HTML page (extra ``train``)."""

from rodgym.report.compare import Entrant, compare
from rodgym.report.page import write_page

__all__ = ["Entrant", "compare", "write_page"]
