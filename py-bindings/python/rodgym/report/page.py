"""The report of a comparison; its words stand in ``pages/comparison.html``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rodgym import machines
from rodgym.evaluation import Column, Evaluation
from rodgym.evaluation.table import cell, notes, shows_designs
from rodgym.report import html
from rodgym.report.comparison import Comparison
from rodgym.report.players import words
from rodgym.report.plots import learned
from rodgym.report.reward import reward_of
from rodgym.report.style import COLOURS
from rodgym.runs import Run


def write_page(run: Run, comparison: Comparison) -> Path:
    """Writes ``report.html`` from the files that the comparison has left in the run's folder."""
    evaluations = comparison.evaluations
    first = comparison.records[0]
    about = machines.of(first.spec)
    return html.write(
        run,
        "comparison.html",
        title=together([e.policy for e in evaluations]),
        subject=comparison.env_id,
        verdict=about.verdict(evaluations),
        about=about,
        seed=first.seed,
        learned=bool(learned(comparison.records)),
        seeds=tuple(dict.fromkeys(evaluations[0].seeds)),
        columns=evaluations[0].described,
        rows=_rows(evaluations),
        designs=shows_designs(evaluations),
        notes=notes(evaluations),
        trainings=comparison.trainings,
        statistics=comparison.statistics,
        players=comparison.players,
        robustness=comparison.robustness,
        reward=reward_of(first.spec),
        how=_how(run, comparison),
        files=sorted(path.name for path in run.path.iterdir() if path.is_file()),
    )


def together(names: list[str]) -> str:
    """One; one and two; one, two and three."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def _best(column: Column, values: list[float]) -> float:
    """The best of the values as shown, or NaN where there is no better."""
    shown = [round(column.scale * v, column.digits) for v in values if not math.isnan(v)]
    if not column.better or len(set(shown)) < 2:
        return math.nan
    return max(shown) if column.better == "high" else min(shown)


def _rows(evaluations: Sequence[Evaluation]) -> list[dict[str, Any]]:
    """The table: each cell's text, and whether it is the best of its column."""
    described = evaluations[0].described
    best = {c.name: _best(c, [e.mean(c.name) for e in evaluations]) for c in described}

    def shown(column: Column, value: float) -> tuple[str, bool]:
        rounded = round(column.scale * value, column.digits)
        return cell(column, value), rounded == best[column.name]

    return [
        {
            "policy": evaluation.policy,
            "design": evaluation.design or "-",
            "colour": COLOURS[i % len(COLOURS)],
            "cells": [shown(column, evaluation.mean(column.name)) for column in described],
        }
        for i, evaluation in enumerate(evaluations)
    ]


def _how(run: Run, comparison: Comparison) -> dict[str, Any]:
    """What makes the page again."""
    keywords = dict(comparison.env_kwargs)
    facts = run.facts
    how = {
        "environment": comparison.env_id,
        "keywords": words(keywords) if keywords else "defaults",
        "machine": facts["machine"],
        "versions": ", ".join(f"{k} {v}" for k, v in facts["versions"].items()),
    }
    if facts.get("commit"):
        how["commit"] = facts["commit"]
    if comparison.trainings:
        seeds = [str(training.seed) for training in comparison.trainings]
        how["training seed" if len(seeds) == 1 else "training seeds"] = ", ".join(seeds)
    return how
