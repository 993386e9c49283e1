"""Measures how fast environments step, beside MuJoCo and other simulators in the same run.

All cases take turns, and ratios are taken round by round. A busy machine therefore disturbs rates
more than ratios. The results have CPU time beside wall-clock time. Other simulators take part if
they are installed (docs/performance/requirements.txt).
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rodgym.cli.arguments import add_run

if TYPE_CHECKING:
    from rodgym.runs import Run

SUMMARY = "measure speed, also of other simulators that are installed"
EXAMPLES = """
rodgym bench --quick
rodgym bench --name laptop
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--quick", action="store_true", help="fewer cases and rounds: about half a minute"
    )
    add_run(parser, default="bench")


def run(args: argparse.Namespace) -> int:
    import warnings

    from rodgym.bench.session import FULL, QUICK, bench
    from rodgym.runs import Run

    folder: Run = Run(args.name, args.runs)
    # A folder that cannot be made is known before anything is measured.
    folder.folder()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of other simulators
        page = bench(folder, QUICK if args.quick else FULL)
    print(page)
    print(f"\nwritten to {folder.path}")
    return 0
