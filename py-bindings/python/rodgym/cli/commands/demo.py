"""The tour: from nothing to a report in a few minutes.

Trains a PPO agent to swing up the flexible pendulum, plays it and the LQR on the same 100 seeds,
and writes runs/demo/report.html.
"""

from __future__ import annotations

import argparse

from rodgym.cli.commands import compare

SUMMARY = "the tour: train an agent, compare it with the LQR, write a report"
EXAMPLES = """
rodgym demo
rodgym demo --steps 200000 --name quick
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    compare.add_arguments(parser, words="default demo")


def run(args: argparse.Namespace) -> int:
    args.name = args.name or "demo"
    return compare.run(args)
