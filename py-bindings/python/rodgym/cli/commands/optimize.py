"""Searches for the actions that earn the most in one episode, and keeps them.

The result is a local optimum: the best that the search found. Better actions may exist.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from rodgym.cli.arguments import UsageError, add_env, env_keywords, positive, seed

SUMMARY = "search for the best actions of one episode"
EXAMPLES = """
rodgym optimize
rodgym optimize --env-arg width=0.009 --seed 3 --starts 8 --time-limit 60
rodgym optimize --steps 200 --out actions.npy
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_env(parser)
    parser.add_argument(
        "--seed", type=seed, default=0, metavar="N", help="seed of the episode (default 0)"
    )
    parser.add_argument(
        "--steps", type=positive, metavar="N", help="control steps (default: the time limit)"
    )
    parser.add_argument(
        "--starts", type=positive, default=2, metavar="N", help="starts of the search (default 2)"
    )
    parser.add_argument(
        "--time-limit", type=float, default=60.0, metavar="S",
        help="seconds for all starts together (default 60)",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="where the actions go, as an array of NumPy"
    )


def run(args: argparse.Namespace) -> int:
    import gymnasium as gym
    import numpy as np

    import rodgym
    from rodgym.progress import Bar

    if not 0 <= args.time_limit < 1e9:
        raise UsageError(f"--time-limit {args.time_limit:g}: it must be at least 0 s")
    env: Any = gym.make(args.env, **env_keywords(args.env, args.env_arg))
    env.reset(seed=args.seed)
    last = [-1, 0]
    with Bar("optimize", args.starts) as bar:

        def progress(start: int, at: dict[str, Any]) -> None:
            if [start, at["horizon"]] != last or at["done"]:
                bar.at(start + at["done"])
                bar.say(
                    f"start {start + 1} of {args.starts}: {at['horizon']} steps, "
                    f"{at['iterations']} iterations, loss {at['loss']:.3f}"
                )
            last[:] = [start, at["horizon"]]

        found = rodgym.optimize(
            env, args.steps, starts=args.starts, time_limit=args.time_limit, progress=progress
        )
    for number, one in enumerate(found.attempts, 1):
        end = "" if one.done else ", stopped by the time limit"
        print(
            f"start {number}: {one.total:.4f} in {one.horizon} steps, {one.iterations} iterations, "
            f"{one.seconds:.1f} s{end}"
        )
    print(f"best: {found.total:.4f}")
    if args.out:
        np.save(args.out, found.actions)
        print(f"actions: {args.out}")
    return 0
