"""What the thesis says, what we find, and the page that sets them side by side."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from string import Template

from rodgym.runs import Run, write_csv


@dataclass(frozen=True)
class Finding:
    """A claim of the thesis beside our result.

    Parameters
    ----------
    where: figure, section or equation
    claim: what the thesis says
    result: what we find, with numbers
    verdict: "agrees", "partly" or "differs", and why
    picture: file name of the figure in the run's folder
    """

    where: str
    claim: str
    result: str
    verdict: str
    picture: str


def write_findings(run: Run, title: str, findings: Sequence[Finding]) -> Path:
    """Writes `findings.csv` and `report.html`, which holds every picture."""
    rows = [(f.where, f.claim, f.result, f.verdict) for f in findings]
    header = ("where", "thesis", "found", "verdict")
    write_csv(run.file("findings.csv"), header, rows)
    sections = []
    for finding in findings:
        data = base64.b64encode(run.file(finding.picture).read_bytes()).decode()
        sections.append(
            f"<section>\n<h2>{html.escape(finding.where)}</h2>\n"
            f"<p><b>Thesis:</b> {html.escape(finding.claim)}</p>\n"
            f"<p><b>Found:</b> {html.escape(finding.result)}</p>\n"
            f"<p><b>Verdict:</b> {html.escape(finding.verdict)}</p>\n"
            f'<img src="data:image/png;base64,{data}" alt="{html.escape(finding.where)}">\n'
            "</section>"
        )
    template = resources.files("rodgym.report").joinpath("page.html").read_text(encoding="utf-8")
    agreed = sum(f.verdict.startswith("agrees") for f in findings)
    text = Template(template).substitute(
        title=html.escape(title),
        env_id="Burch 2019",
        date=html.escape(str(run.facts["date"])),
        verdict=f"{agreed} of {len(findings)} claims agree; each difference says why.",
        sections="\n".join(sections),
    )
    path = run.file("report.html")
    path.write_text(text, encoding="utf-8")
    return path
