"""Pages from templates: one HTML file with its pictures inside, to be opened, mailed or kept."""

from __future__ import annotations

import base64
import mimetypes
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from rodgym.runs import Run


def embedded(path: Path) -> str:
    """A picture's bytes as an address that needs no file."""
    kind, _ = mimetypes.guess_type(path.name)
    return f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"


def write(run: Run, template: str, **values: Any) -> Path:
    """Writes ``report.html`` into a run's folder; every value is escaped."""
    pages = Environment(
        loader=PackageLoader("rodgym.report", "pages"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    pages.filters["embedded"] = embedded
    path = run.file("report.html")
    text = pages.get_template(template).render(run=run, date=run.facts["date"], **values)
    path.write_text(text, encoding="utf-8")
    return path
