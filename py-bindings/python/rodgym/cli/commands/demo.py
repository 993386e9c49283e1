"""The tour: from nothing to a report in a few minutes.

Trains PPO three times with different seeds to swing up the flexible pendulum, lets the agents and
the LQR play the same 100 seeds, and writes runs/demo/report.html.
"""

from __future__ import annotations

import argparse

from rodgym.cli.commands import compare

SUMMARY = "take the tour: train agents, compare them with the LQR, write a report"
#: Training seeds of the tour: enough to see that they differ.
SEEDS = range(3)
EXAMPLES = """
rodgym demo
rodgym demo --steps 200000 --name quick
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    compare.add_arguments(parser, words="default demo")


def run(args: argparse.Namespace) -> int:
    args.name = args.name or "demo"
    if args.seed is None and args.train_seeds is None and not args.policy:
        args.train_seeds = SEEDS
    return compare.run(args)
