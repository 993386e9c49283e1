"""cosseratbench's planar cases by rodgym and by the solvers that it brings: `make cosseratbench`.

Writes docs/performance/cosseratbench.md. The cases, the references and the errors are
cosseratbench's; every solver has the number of elements that a case asks for. rodgym also runs with
four times as many.
"""

from __future__ import annotations

import argparse
import datetime
import os
import time
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from cosseratbench import registry
from cosseratbench.experiment import Experiment, Result, run
from rodgym.bench.cosserat import RodgymSolver
from rodgym.bench.session import machine

PAGE = Path(__file__).parents[2] / "docs" / "performance" / "cosseratbench.md"
#: Experiments with what is judged in them, and the words of the page.
CASES: Mapping[str, Mapping[str, str]] = {
    "cantilever": {"tip_deflection_error": "error of the tip's deflection"},
    "catenary": {
        "shape_error": "distance from the reference, in lengths",
        "sag_error": "error of the sag",
    },
    "pendulum": {"period_error": "error of the period", "amplitude_change": "growth of the swing"},
}
#: Names of the columns: solver, and factor of the elements.
COLUMNS = {
    "rodgym": ("rodgym", 1),
    "rodgym, 4 times the elements": ("rodgym", 4),
    "PyElastica": ("pyelastica", 1),
    "MuJoCo cable": ("mujoco", 1),
}


class Timed:
    """A solver whose last run's CPU time is kept, which other programs of the machine disturb
    least.
    """

    def __init__(self, solver: Any) -> None:
        self._solver = solver
        self.seconds = 0.0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._solver, name)

    def run(self, scenario: Any, **sizes: int) -> Any:
        """The solver's own."""
        began = time.process_time()
        try:
            return self._solver.run(scenario, **sizes)
        finally:
            self.seconds = time.process_time() - began


def solver(name: str) -> Any:
    """A solver by its name; rodgym also where it is not installed but found by its path."""
    return RodgymSolver() if name == "rodgym" else registry.load_solver(name)


def variants(experiment: Experiment) -> Iterator[tuple[str, dict[str, float]]]:
    """The ordinary case, then each other value of each parameter, with a name."""
    yield "as it is", {}
    for parameter in experiment.parameters:
        for value in parameter.values:
            if value != parameter.default:
                words = parameter.name.replace("_", " ").replace("youngs", "Young's")
                yield f"{words} {value:g} {parameter.unit}", {parameter.name: value}


def attempt(name: str, column: str, values: Mapping[str, float]) -> tuple[Result, float]:
    """One run, and its CPU time."""
    who, factor = COLUMNS[column]
    experiment = registry.load_experiment(name)
    timed = Timed(solver(who))
    result = run(experiment, timed, values=values, n_elements=factor * experiment.n_elements)
    return result, timed.seconds


def number(value: float) -> str:
    """Two digits."""
    return f"{value:.1e}" if abs(value) < 0.01 else f"{value:.2g}"


def rows() -> Iterator[str]:
    """The tables."""
    for name, metrics in CASES.items():
        experiment = registry.load_experiment(name)
        yield f"\n## {name.capitalize()}\n\n{experiment.description}"
        yield f"{experiment.n_elements} elements.\n"
        yield f"| case | number | {' | '.join(COLUMNS)} |"
        yield "|---|---|" + "---|" * len(COLUMNS)
        for case, values in variants(experiment):
            tried = [attempt(name, column, values) for column in COLUMNS]
            for result, seconds in tried:
                told = {m: number(v) for m, v in result.metrics.items()}
                print(name, case, result.solver, result.outcome, told, f"{seconds:.2g} s CPU")
            for metric, words in metrics.items():
                cells = [
                    number(result.metrics[metric]) if result.metrics else result.outcome
                    for result, _ in tried
                ]
                yield f"| {case} | {words} | {' | '.join(cells)} |"
                case = ""
            yield f"| | CPU time [s] | {' | '.join(number(s) for _, s in tried)} |"


def page() -> str:
    """The whole page."""
    date = datetime.datetime.now(datetime.timezone.utc)
    packages = ("cosseratbench", "pyelastica", "mujoco")
    versions = ", ".join(f"{package} {version(package)}" for package in packages)
    tables = "\n".join(rows())
    return f"""# rodgym in cosseratbench

Written by `make cosseratbench` (`tests/long/cosserat.py`) on {date:%Y-%m-%d}: {versions},
one thread of {machine()["processor"]}.

[cosseratbench](https://github.com/jakeryderv/cosseratbench) compares solvers of elastic rods. It
defines cases, references and errors; a solver only says where the nodes are. rodgym takes part in
the three cases that stay in a plane, and answers that the others (twist, capstan, crossing, pile)
are outside its model. `pip install rodgym cosseratbench` is enough for
`cosseratbench run -s rodgym`.

Three things to know before you compare:

* In *cantilever* and *catenary* only the equilibrium counts. rodgym finds it by Newton's method,
  from the forces and the stiffness of its rod. The others let the rod move under friction until it
  rests, which takes longer.
* In *pendulum* all solvers integrate the motion.
* The references are theories of thin rods. Those of *cantilever* and *pendulum* are linear, which
  alone is worth an error of up to 1e-3 of the deflection and of 2e-5 of the period. That of
  *catenary* has no bending stiffness: a slack cable of 0.6 m span hangs up to 1 % beside it. Where
  an error is near these limits, smaller is not better.
{tables}

## How the rods are made

cosseratbench's rods are round, rodgym's are square. A square of side r sqrt(3) with modulus and
density times pi/3 has the same stretching stiffness, bending stiffness and mass. The clamp of
*cantilever* is a spring between the clamp's direction and the first edge, of stiffness 2 EI over
the edge's length, because the middle of the edge is half an edge away from the clamp. With it
rodgym's error falls with the square of the number of elements. The other two hold the whole first
element rigid, and theirs falls linearly.
"""


def main() -> None:
    """See the file's docstring."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.parse_args()
    if os.environ.get("OMP_NUM_THREADS") != "1":
        parser.error("set OMP_NUM_THREADS=1: CPU times of one thread are compared")
    PAGE.write_text(page(), encoding="utf-8")
    print(f"wrote {PAGE}")


if __name__ == "__main__":
    main()
