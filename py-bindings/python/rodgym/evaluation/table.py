"""Evaluations as a table for the terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rodgym.evaluation.design import DRAWN, EACH, NOMINAL
from rodgym.evaluation.episodes import Evaluation
from rodgym.evaluation.score import Column


def cell(column: Column, value: float) -> str:
    """A number in the column's unit for people; a dash where it is not defined."""
    return "-" if math.isnan(value) else f"{column.scale * value:.{column.digits}f}"


def comparison_table(evaluations: Sequence[Evaluation]) -> str:
    """Means over the episodes: one row a policy, one column a measure, the unit below its name."""
    described = evaluations[0].described
    designs = shows_designs(evaluations)
    rows = [
        ["policy", *(["made for"] if designs else []), *(c.title for c in described)],
        ["", *([""] if designs else []), *(c.unit for c in described)],
    ]
    rows += [
        [
            evaluation.policy,
            *([evaluation.design or "-"] if designs else []),
            *(cell(c, evaluation.mean(c.name)) for c in described),
        ]
        for evaluation in evaluations
    ]
    words = 2 if designs else 1
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]

    def line(row: list[str]) -> str:
        cells = list(zip(row, widths, strict=True))
        left = [text.ljust(width) for text, width in cells[:words]]
        return "  ".join([*left, *(text.rjust(width) for text, width in cells[words:])])

    rule = "-" * (sum(widths) + 2 * (len(widths) - 1))
    # Several trainings in one row have every seed several times.
    seeds, env_id = tuple(dict.fromkeys(evaluations[0].seeds)), evaluations[0].env_id
    count = f"mean of {len(seeds)} episodes, seeds {seeds[0]} to {seeds[-1]}, {env_id}"
    lines = [line(row) for row in rows]
    return "\n".join([*lines[:2], rule, *lines[2:], count, *notes(evaluations)])


def shows_designs(evaluations: Sequence[Evaluation]) -> bool:
    """Whether what the policies were made for is more than the environment as it is."""
    return any(evaluation.design not in ("", NOMINAL) for evaluation in evaluations)


def notes(evaluations: Sequence[Evaluation]) -> list[str]:
    """What the designs in a table mean, in a sentence each."""
    designs = {evaluation.design for evaluation in evaluations}
    drawn = [evaluation for evaluation in evaluations if evaluation.parameters]
    told = []
    if EACH in designs:
        told.append(
            "each: designed for every episode's own parameters (privileged: nobody else is told "
            "them)"
        )
    if NOMINAL in designs and drawn:
        told.append("nominal: designed for the environment's own parameters, whatever is drawn")
    if DRAWN in designs:
        told.append("drawn: found by playing episodes whose parameters are drawn as here")
    if (best := evaluations[0].best_known) is not None:
        told.append(f"best known return here: {best:.1f}")
    if any(design.startswith("trained:") for design in designs):
        told.append("trained: what was otherwise in its training than it is here")
    return told
