"""Trains an agent with Stable-Baselines3 on the native batch. Ctrl-C keeps what it has learnt."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rodgym.cli.arguments import (
    add_env,
    add_force,
    add_run,
    env_keywords,
    key_value,
    positive,
    seed,
)

if TYPE_CHECKING:
    from rodgym.runs import Run
    from rodgym.training import Training

SUMMARY = "train an agent"
EXAMPLES = """
rodgym train
rodgym train --env rodgym/PendulumBalance-v0 --steps 300000 --name balance
rodgym train --set learning_rate=0.0005 --set n_envs=128 --seed 3
rodgym train --algorithm SAC --name sac
"""

#: What the arguments of :func:`add_training` mean where they are left out.
ALGORITHM, SEED = "PPO", 0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_env(parser)
    add_training(parser)
    add_run(parser)


def add_training(parser: argparse.ArgumentParser) -> None:
    """Arguments of every command that trains."""
    parser.add_argument(
        "--algorithm",
        type=str.upper,
        metavar="NAME",
        help=f"PPO, SAC, TD3, DDPG or A2C (default {ALGORITHM})",
    )
    parser.add_argument(
        "--steps", type=positive, metavar="N", help="environment steps (default: the recipe's)"
    )
    parser.add_argument(
        "--seed", type=seed, metavar="N", help=f"seed of the training (default {SEED})"
    )
    parser.add_argument(
        "--recipe", type=Path, metavar="FILE", help="YAML of recipes (default: those of rodgym)"
    )
    parser.add_argument(
        "--set",
        type=key_value,
        action="append",
        default=[],
        dest="changes",
        metavar="NAME=VALUE",
        help="changes a value of the recipe, such as n_envs=128; may be repeated",
    )
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    from rodgym.cli.needs import TRAINING, need, of_env
    from rodgym.runs import Run, default_name

    need(*TRAINING, *of_env(args.env))
    folder = Run(args.name or default_name("train", args.env), args.runs)
    training = train(args, folder)
    folder.facts |= {"env": args.env, "seed": training.seed, "recipe": training.recipe.as_dict()}
    folder.write_facts()
    last = "interrupted after" if training.interrupted else "trained for"
    print(f"{last} {training.steps:,} steps in {training.seconds:.0f} s")
    print(f"policy: {training.policy}   (rodgym evaluate {training.policy})")
    return 0


def train(args: argparse.Namespace, folder: Run) -> Training:
    """Trains as the arguments of :func:`add_training` say."""
    from rodgym import training

    if not args.force:
        folder.keep_policy()
    recipe = training.load_recipe(args.env, args.algorithm or ALGORITHM, args.recipe)
    if args.recipe is None and not training.has_recipe(args.env, recipe.algorithm):
        print(
            f"no recipe for {recipe.algorithm} in {args.env}: the defaults of Stable-Baselines3 "
            f"and {recipe.n_envs} environments (--set and --recipe change them)",
            file=sys.stderr,
        )
    changes = dict(args.changes)
    if args.steps is not None:
        changes["n_timesteps"] = args.steps
    return training.train(
        args.env,
        folder,
        recipe=recipe.with_changes(changes),
        seed=SEED if args.seed is None else args.seed,
        env_kwargs=env_keywords(args.env, args.env_arg),
    )
