"""Replays the best known actions of rodgym's tasks and checks that they return what they should."""

from __future__ import annotations

import argparse

from rodgym.cli.arguments import env_id

SUMMARY = "replay the best known actions of every task"
EXAMPLES = """
rodgym best-known
rodgym best-known --env PendulumSwingUp
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--env", type=env_id, metavar="ID", help="only this environment (default: all)"
    )


def run(args: argparse.Namespace) -> int:
    from rodgym.optimal import kept, replay

    different = count = 0
    for episode in kept(args.env):
        total = replay(episode)
        count += 1
        keywords = " ".join(f"{name}={value}" for name, value in episode.config.items())
        same = total == episode.total
        different += not same
        print(
            f"{episode.id} {keywords}".rstrip()
            + f", seed {episode.seed}, {episode.side}: {total!r}"
            + ("" if same else f", but {episode.total!r} is kept")
        )
    print(f"{count - different} of {count} episodes return what is kept")
    return 1 if different else 0
