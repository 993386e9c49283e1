"""How much may go wrong: `make robustness`, or `python tests/long/robustness.py --seeds 10`.

Measures the regulators and the trained policy of the swing-up, and writes figure and table of
docs/robustness.md. What was stopped goes on where it was (runs/robustness/table.csv).
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from rodgym.cli.arguments import positive
from rodgym.progress import Bar
from rodgym.robustness import Candidate, Robustness, measure
from rodgym.robustness.plot import draw
from rodgym.runs import Run

DOCS = Path(__file__).parents[2] / "docs"
SWING_UP = "rodgym/PendulumSwingUp-v0"
CANDIDATES = (
    Candidate("LQR", "lqr", SWING_UP),
    Candidate("hybrid LQR", "lqr-hybrid", SWING_UP),
    Candidate("LQG", "lqg", "rodgym/PendulumSwingUpBase-v0"),
    Candidate("PPO", "zoo", SWING_UP),
)


def held(result: Robustness, policy: str, quantity: str) -> str:
    """Where a policy holds, in words."""
    ends = result.holds(policy, quantity)
    return "nowhere" if ends is None else f"{ends[0]:.3g} to {ends[1]:.3g}"


def table(result: Robustness, run: Run) -> str:
    """The part of the page that is measured."""
    versions = ", ".join(f"{name} {value}" for name, value in run.facts["versions"].items())
    header = "".join(f" {name} | holds |" for name in result.policies)
    lines = [f"| quantity |{header}", "|---|" + "---|---|" * len(result.policies)]
    for quantity in result.quantities:
        cells = "".join(
            f" {100 * result.score(policy, quantity.name):.0f} % "
            f"| {held(result, policy, quantity.name)} |"
            for policy in result.policies
        )
        lines.append(f"| {quantity.label} |{cells}")
    means = "".join(f" **{100 * result.mean(policy):.0f} %** | |" for policy in result.policies)
    lines.append(f"| **mean** |{means}")
    return (
        f"Written by `make robustness` on {run.facts['date']} ({run.facts['machine']}; "
        f"{versions}): "
        f"{len(result.seeds)} episodes, seeds {result.seeds.start} to {result.seeds.stop - 1}, at "
        f"each of {result.success.shape[2]} values.\n\n" + "\n".join(lines)
    )


def written(page: str, part: str) -> str:
    """The page with its measured part replaced."""
    pattern = r"(<!-- measured -->\n).*?(<!-- end -->)"
    text, count = re.subn(pattern, lambda m: f"{m[1]}\n{part}\n\n{m[2]}", page, flags=re.DOTALL)
    assert count == 1, "the page has no place for the table"
    return text


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=positive, default=10)
    parser.add_argument("--workers", type=positive, default=1)
    parser.add_argument("--runs", default="runs")
    args = parser.parse_args()
    run = Run("robustness", args.runs)
    with Bar("robustness", 1) as bar:

        def on_row(done: int, values: int) -> None:
            bar.at(done, values)
            if done % 21 == 0:
                bar.say(f"{done} of {values} values")

        result = measure(
            CANDIDATES,
            seeds=args.seeds,
            table=run.path / "table.csv",
            workers=args.workers,
            on_row=on_row,
        )
    run.write_facts()
    result.write_csv(run.file("scores.csv"))
    draw(result, DOCS / "images" / "robustness.png")
    page = DOCS / "robustness.md"
    page.write_text(written(page.read_text(encoding="utf-8"), table(result, run)), encoding="utf-8")
    print(result.table())
    return 0


if __name__ == "__main__":
    sys.exit(main())
