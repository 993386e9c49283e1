"""Evaluations as a table for the terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rodgym.evaluation.episodes import Evaluation
from rodgym.evaluation.score import Column


def cell(column: Column, value: float) -> str:
    """A number in the column's unit for people; a dash where it is not defined."""
    return "-" if math.isnan(value) else f"{column.scale * value:.{column.digits}f}"


def comparison_table(evaluations: Sequence[Evaluation]) -> str:
    """Means over the episodes: one row a policy, one column a measure, the unit below its name."""
    described = evaluations[0].described
    rows = [["policy", *(c.title for c in described)], ["", *(c.unit for c in described)]]
    rows += [
        [evaluation.policy, *(cell(c, evaluation.mean(c.name)) for c in described)]
        for evaluation in evaluations
    ]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]

    def line(row: list[str]) -> str:
        first, *rest = zip(row, widths, strict=True)
        return "  ".join([first[0].ljust(first[1]), *(text.rjust(width) for text, width in rest)])

    rule = "-" * (sum(widths) + 2 * (len(widths) - 1))
    seeds, env_id = evaluations[0].seeds, evaluations[0].env_id
    count = f"mean of {len(seeds)} episodes, seeds {seeds[0]} to {seeds[-1]}, {env_id}"
    lines = [line(row) for row in rows]
    return "\n".join([*lines[:2], rule, *lines[2:], count])
