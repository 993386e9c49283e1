"""Searches for better hyperparameters of a recipe with Optuna.

If you stop a search, the same command continues it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from rodgym.cli.arguments import add_env, add_run, env_keywords, key_value, positive, seeds

SUMMARY = "search for the hyperparameters of a recipe"
EXAMPLES = """
rodgym tune --env rodgym/PendulumBalance-v0 --trials 40
rodgym tune --algorithm SAC --steps 30000 --train-seeds 1000:1002
rodgym tune --space mine.yml --set n_envs=256
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_env(parser)
    parser.add_argument(
        "--algorithm", metavar="NAME", default="PPO", help="learning algorithm (default PPO)"
    )
    parser.add_argument(
        "--trials", type=positive, default=30, metavar="N", help="trials in all (default 30)"
    )
    parser.add_argument(
        "--train-seeds",
        type=seeds,
        default=range(1000, 1003),
        metavar="N|FIRST:END",
        help="training seeds of every trial (default 1000:1003, which no table uses)",
    )
    parser.add_argument(
        "--steps", type=positive, metavar="N", help="environment steps (default: the recipe's)"
    )
    parser.add_argument(
        "--recipe", type=Path, metavar="FILE", help="YAML file of recipes to begin with"
    )
    parser.add_argument(
        "--set",
        type=key_value,
        action="append",
        default=[],
        dest="changes",
        metavar="NAME=VALUE",
        help="change a value of the recipe to begin with; may be repeated",
    )
    parser.add_argument(
        "--space",
        type=Path,
        metavar="FILE",
        help="YAML file that says what to search: for each hyperparameter a list of choices, or "
        "{low: , high: , log: true} (default: a space for the algorithm's kind)",
    )
    add_run(parser)


def run(args: argparse.Namespace) -> int:
    from rodgym.cli.commands.train import recipe_of
    from rodgym.cli.needs import TRAINING, need, of_algorithm, of_env
    from rodgym.runs import Run, default_name

    need("optuna", *TRAINING, *of_algorithm(args.algorithm), *of_env(args.env))
    from rodgym.training import tuning

    folder = Run(args.name or default_name("tune", args.env), args.runs)
    space = None if args.space is None else tuning.load_space(args.space)
    tuning.tune(
        args.env,
        folder,
        recipe_of(args),
        trials=args.trials,
        seeds=args.train_seeds,
        space=space,
        env_kwargs=env_keywords(args.env, args.env_arg),
    )
    print(
        f"recipe: {folder.path / 'recipe.yml'}   (rodgym train --recipe {folder.path}/recipe.yml)"
    )
    return 0
