"""Every learner and every controller on every task: `make benchmark`.

Each plays the seeds 0 to 99 in the three bands, and its robustness is measured. Trainings are those
of the recipes that come with rodgym, on seeds that were not used to find them. Writes the tables of
docs/benchmark.md, a task at a time. What was stopped goes on where it was (runs/benchmark*).
"""

from __future__ import annotations

import argparse
import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rodgym
from rodgym.baselines import CONTROLLERS
from rodgym.cli.entrants import title
from rodgym.errors import RodgymError
from rodgym.evaluation import band_keywords, evaluate, statistics
from rodgym.evaluation.bands import BANDS
from rodgym.evaluation.conditions import spec_for
from rodgym.evaluation.design import usual_designs
from rodgym.robustness import Candidate, measure
from rodgym.runs import Run
from rodgym.training import load_recipe, train_seeds
from rodgym.zoo import ZOO

DOCS = Path(__file__).parents[2] / "docs"
SEEDS = range(100)
#: Training seeds: not those with which the recipes were looked for.
FIRST = 20
#: A task's part of the page.
TASK = re.compile(r"### `([^`]+)`\n.*?(?=\n### `|\Z)", flags=re.DOTALL)
#: Controllers that take too long for the values of robustness.
SLOW = {"mpc"}
#: Tasks whose recipe of an algorithm is known to fail; the pages say how.
FAILS = {("PPO", "PendulumSwingUpBase")}


@dataclass(frozen=True)
class Entry:
    """A row of a task's table: a name, the policies behind it, and whether it was trained."""

    name: str
    policies: tuple[str, ...]
    trained: bool = False


def short(env_id: str) -> str:
    return env_id.partition("/")[2].partition("-v")[0]


def controllers(env_id: str) -> list[Entry]:
    """All that can play the environment."""
    spec = dict(spec_for(env_id, {}))
    found = []
    for name in CONTROLLERS:
        try:
            CONTROLLERS[name](spec)
        except RodgymError:
            continue
        found.append(Entry(title(name), (name,)))
    return found


def trainings(env_id: str, counts: dict[str, int]) -> list[Entry]:
    """The agents of every recipe, trained where they are not there yet."""
    found = []
    for algorithm, count in counts.items():
        file = ZOO / f"{algorithm.lower()}.yml"
        known = f"\n{env_id}:" in file.read_text(encoding="utf-8")
        if not (known and count) or (algorithm, short(env_id)) in FAILS:
            continue
        suffix = "" if algorithm == "PPO" else f"-{algorithm.lower()}"
        run = Run(f"benchmark-{short(env_id).lower()}{suffix}")
        done = train_seeds(
            env_id, run, range(FIRST, FIRST + count), recipe=load_recipe(env_id, algorithm)
        )
        if done[-1].interrupted:
            raise SystemExit("interrupted; called again, it goes on")
        name = f"{algorithm}, {count} training seeds"
        found.append(Entry(name, tuple(str(t.policy) for t in done), trained=True))
    return found


def shipped(env_id: str) -> list[Entry]:
    """The policies that come with rodgym."""
    name = env_id.partition("/")[2]
    found = []
    for file in sorted(ZOO.glob(f"{name}*.zip")):
        extra = file.stem.removeprefix(name).removeprefix(".")
        source = f"zoo:{extra}" if extra else "zoo"
        found.append(Entry(f"`{source}`", (source,), trained=True))
    return found


class Cells:
    """Results that are kept on disk as they come."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.kept: dict[str, Any] = json.loads(path.read_text()) if path.is_file() else {}

    def get(self, key: str, make: Callable[[], Any]) -> Any:
        if key not in self.kept:
            print(key, flush=True)
            self.kept[key] = make()
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.path.write_text(json.dumps(self.kept))
        return self.kept[key]


def play(entry: Entry, env_id: str, band: str, design: Any) -> Callable[[], dict[str, Any]]:
    """Finds returns (policies, episodes), and the share of success where the task has one."""

    def found() -> dict[str, Any]:
        keywords = band_keywords(band, env_id, {})
        ended = [
            evaluate(policy, env_id, SEEDS, env_kwargs=keywords, design=design)
            for policy in entry.policies
        ]
        column = next((c.name for c in ended[0].described if c.success), None)
        success = None if column is None else float(np.mean([one.mean(column) for one in ended]))
        return {"returns": [one.columns["return"].tolist() for one in ended], "success": success}

    return found


def share(of_one: float) -> str:
    """A share in percent; a dash where it was not measured."""
    return "-" if math.isnan(of_one) else f"{100 * of_one:.0f} %"


def told(cell: dict[str, Any]) -> str:
    """A cell of the table."""
    about = statistics.interval(cell["returns"], statistics.mean)
    success = "" if cell["success"] is None else f", {100 * cell['success']:.0f} %"
    return f"{about.value:.1f} [{about.low:.1f}, {about.high:.1f}]{success}"


def task(env_id: str, counts: dict[str, int], cells: Cells, seeds: int) -> str:
    """The table of a task."""
    entries = [*shipped(env_id), *trainings(env_id, counts), *controllers(env_id)]
    lines = [
        "| | " + " | ".join(BANDS) + " | robustness |",
        "|---|" + "---|" * (len(BANDS) + 1),
    ]
    drawn = spec_for(env_id, band_keywords("rods", env_id, {}))
    for entry in entries:
        robust = math.nan
        if entry.policies[0] not in SLOW:
            robust = cells.get(
                f"{env_id} {entry.name} robustness",
                lambda one=entry: measure(
                    [Candidate(one.name, one.policies[0], env_id)], seeds=seeds
                ).mean(one.name),
            )
        # The best informed design comes last: a controller that is told each rod has a line of its
        # own.
        designs = [None] if entry.trained else [*reversed(usual_designs(entry.policies[0], drawn))]
        row = [
            told(cells.get(f"{env_id} {entry.name} {band}", play(entry, env_id, band, design)))
            for band, design in zip(BANDS, (None, None, designs[0]), strict=True)
        ]
        lines.append("| " + " | ".join([entry.name, *row, share(robust)]) + " |")
        for design in designs[1:]:
            key = f"{env_id} {entry.name} rods {design}"
            cell = told(cells.get(key, play(entry, env_id, "rods", design)))
            lines.append(f"| {entry.name}, told each rod | | | {cell} | |")
    best = evaluate("zero", env_id, range(1)).best_known
    if best is not None:
        lines.append(f"\nBest known return (nominal): {best:.1f}.")
    return "\n".join(lines)


def written(page: str, tables: dict[str, str]) -> str:
    """The page with new tables in place of a task's earlier one; the tables of other tasks stay."""
    place = re.compile(r"(<!-- measured -->\n)(.*?)(<!-- end -->)", flags=re.DOTALL)
    found = place.search(page)
    assert found is not None, "the page has no place for the tables"
    kept = {part[1]: part[0].strip() for part in TASK.finditer(found[2])} | tables
    parts = [kept[env_id] for env_id in rodgym.ENVIRONMENTS if env_id in kept]
    return place.sub(lambda m: m[1] + "\n" + "\n\n".join(parts) + "\n\n" + m[3], page)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--task", action="append", help="an environment's id (default: all)")
    parser.add_argument("--ppo", type=int, default=10, help="training seeds of PPO (0: none)")
    parser.add_argument("--sac", type=int, default=3, help="training seeds of SAC (0: none)")
    parser.add_argument("--seeds", type=int, default=10, help="episodes a value of robustness")
    args = parser.parse_args()
    for env_id in args.task or ():
        if env_id not in rodgym.ENVIRONMENTS:
            parser.error(f"--task {env_id}: one of {', '.join(rodgym.ENVIRONMENTS)}")
    run = Run("benchmark")
    cells = Cells(run.path / "cells.json")
    counts = {"PPO": args.ppo, "SAC": args.sac}
    versions = ", ".join(f"{name} {value}" for name, value in run.facts["versions"].items())
    made = (
        f"Written by `make benchmark` on {run.facts['date']} ({run.facts['machine']}; {versions})"
    )
    page = DOCS / "benchmark.md"
    for env_id in args.task or rodgym.ENVIRONMENTS:
        table = task(env_id, counts, cells, args.seeds)
        how = f"{made}, {args.seeds} episodes at each value of robustness."
        table = f"### `{env_id}`\n\n{how}\n\n{table}"
        text = written(page.read_text(encoding="utf-8"), {env_id: table})
        page.write_text(text, encoding="utf-8")
        print(f"wrote the table of {env_id} to {page}")


if __name__ == "__main__":
    main()
