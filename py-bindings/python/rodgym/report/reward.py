"""The reward as the environment's own page has it: one table, kept in one place."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rodgym import machines

HEADING = "## Rewards"


@dataclass(frozen=True)
class Reward:
    """Terms of a task: name, value and range; and what the symbols mean."""

    symbols: str
    terms: tuple[tuple[str, str, str], ...]


def reward_of(spec: Mapping[str, Any]) -> Reward | None:
    """The reward of an environment, from the docstring of its class; None where that has none."""
    kind = machines.load(machines.of(spec).environment)
    page = inspect.getdoc(kind) or ""
    if HEADING not in page:
        return None
    section = page.partition(HEADING)[2].partition("\n## ")[0].strip()
    before, _, rest = section.partition("\n|")
    rows = [line.strip().strip("|").split(" | ") for line in rest.split("\n\n")[0].splitlines()[2:]]
    task, terms = "", []
    for cells in rows:
        name, term, value, span = (cell.strip().strip("`") for cell in cells)
        task = name or task
        if task.lower() == str(spec["task"]).replace("_", ""):
            terms.append((term, value, span))
    if {term for term, _, _ in terms} != set(spec["reward_terms"]):
        return None
    return Reward(" ".join(before.replace("`", "").split()), tuple(terms))
