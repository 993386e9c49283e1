"""What the thesis says, what we find, and the page that sets them side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rodgym.report import html
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
    return html.write(
        run,
        "findings.html",
        title=title,
        subject="Burch 2019",
        verdict=summary(findings),
        findings=findings,
    )


def summary(findings: Sequence[Finding]) -> str:
    """How many claims agree, and which of the others do not, and why, in a clause each."""
    agreed = sum(f.verdict.startswith("agrees") for f in findings)
    others = [
        f"{f.where} {f.verdict.rstrip('.')}" for f in findings if not f.verdict.startswith("agrees")
    ]
    told = f"{agreed} of {len(findings)} claims agree."
    return told + (f" Of the others: {'; '.join(others)}." if others else "")
