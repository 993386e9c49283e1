"""Trains an agent with Stable-Baselines3 on the native batch.

Ctrl-C ends the training and keeps what the agent has learnt. --resume continues it, also after a
kill, and gives the same agent as a training that was not interrupted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rodgym._registration import REMOTE
from rodgym.cli.arguments import (
    UsageError,
    add_env,
    add_force,
    add_run,
    env_keywords,
    key_value,
    positive,
    seed,
    seeds,
)

if TYPE_CHECKING:
    from rodgym.runs import Run
    from rodgym.training import Recipe, Training

SUMMARY = "train an agent, or several that differ in their seeds"
EXAMPLES = """
rodgym train
rodgym train --env rodgym/PendulumBalance-v0 --steps 300000 --name balance
rodgym train --set learning_rate=0.0005 --set n_envs=128 --seed 3
rodgym train --algorithm SAC --name sac --tensorboard
rodgym train --name sac --resume
rodgym train --train-seeds 10 --name ten
"""

#: What the arguments of `add_training` mean where they are left out.
ALGORITHM, SEED = "PPO", 0
#: Arguments that say what a training is; one that is resumed has them already.
DECIDED = ("algorithm", "steps", "seed", "recipe", "changes", "train_seeds", "force")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_env(parser)
    add_training(parser)
    parser.add_argument(
        "--resume",
        action="store_true",
        help="continue the training of this name that was interrupted or killed",
    )
    parser.add_argument(
        "--tensorboard",
        action="store_true",
        help="write events for 'tensorboard --logdir runs'",
    )
    parser.add_argument(
        "--stages", action="store_true", help="keep the agent of every validation (25 files)"
    )
    add_run(parser)


def add_training(parser: argparse.ArgumentParser) -> None:
    """Arguments of every command that trains."""
    from rodgym.zoo.algorithms import ALGORITHMS

    parser.add_argument(
        "--algorithm",
        metavar="NAME",
        help=f"{', '.join(ALGORITHMS[:-1])} or {ALGORITHMS[-1]} (default {ALGORITHM})",
    )
    parser.add_argument(
        "--steps", type=positive, metavar="N", help="environment steps (default: the recipe's)"
    )
    parser.add_argument(
        "--seed", type=seed, metavar="N", help=f"seed of the training (default {SEED})"
    )
    parser.add_argument(
        "--train-seeds",
        type=seeds,
        metavar="N|FIRST:END",
        help="train once with each of these seeds, in a folder each; finished trainings are kept, "
        "and interrupted ones continue",
    )
    parser.add_argument(
        "--recipe",
        type=Path,
        metavar="FILE",
        help="YAML file of recipes in the format of rl-baselines3-zoo (default: rodgym's)",
    )
    parser.add_argument(
        "--set",
        type=key_value,
        action="append",
        default=[],
        dest="changes",
        metavar="NAME=VALUE",
        help="change a value of the recipe, such as n_envs=128; may be repeated",
    )
    add_force(parser)


def options(names: Iterable[str]) -> str:
    """Arguments by the names that people type."""
    return ", ".join("--set" if n == "changes" else f"--{n.replace('_', '-')}" for n in names)


def run(args: argparse.Namespace) -> int:
    from rodgym.cli.needs import TRAINING, need, of_algorithm, of_env
    from rodgym.runs import Run, default_name

    need(*TRAINING, *of_algorithm(args.algorithm), *of_env(args.env))
    folder = Run(args.name or default_name("train", args.env), args.runs)
    if args.resume:
        trainings = [resume(args, folder)]
    else:
        trainings = train_all(args, folder, tensorboard=args.tensorboard, stages=args.stages)
    for training in trainings:
        last = "interrupted after" if training.interrupted else "trained for"
        print(f"{last} {training.steps:,} steps in {training.seconds:.0f} s")
        print(f"policy: {training.policy}   (rodgym evaluate {training.policy})")
    if trainings[-1].interrupted:
        again = "the same command" if args.train_seeds else f"rodgym train --resume{where(args)}"
        print(f"{again} goes on")
    return 0


def where(args: argparse.Namespace) -> str:
    """The arguments that name the run, as the user typed them."""
    name = f" --name {args.name}" if args.name else f" --env {args.env}"
    return name + (f" --runs {args.runs}" if args.runs != "runs" else "")


def resume(args: argparse.Namespace, folder: Run) -> Training:
    """Goes on with the training of a folder.

    Raises:
        UsageError: arguments that would make it another training.
    """
    from rodgym import training

    given = [name for name in DECIDED if getattr(args, name) not in (None, [], False)]
    if given:
        raise UsageError(
            f"{options(given)}: --resume goes on with what the training was started with"
        )
    return training.resume(folder)


def train(args: argparse.Namespace, folder: Run) -> Training:
    """Trains one agent as the arguments of `add_training` say."""
    return train_all(args, folder)[0]


def train_all(args: argparse.Namespace, folder: Run, **kept: Any) -> list[Training]:
    """Trains one agent, or one a seed of --train-seeds; `kept` goes to `rodgym.training.train`.

    Raises:
        UsageError: a seed beside --train-seeds.
        RunError: a training that is there and would be replaced.
    """
    from rodgym import training

    keywords = env_keywords(args.env, args.env_arg)
    if args.train_seeds is not None:
        if args.seed is not None:
            raise UsageError("--seed: --train-seeds names the seeds")
        if kept.pop("stages", False):
            raise UsageError("--stages: one training alone keeps its stages")
        return training.train_seeds(
            args.env, folder, args.train_seeds, recipe=recipe_of(args), env_kwargs=keywords,
            fresh=args.force, **kept,
        )  # fmt: skip
    if not args.force:
        folder.keep_policy()
        training.keep_unfinished(folder)
    one = SEED if args.seed is None else args.seed
    return [
        training.train(
            args.env, folder, recipe=recipe_of(args), seed=one, env_kwargs=keywords, **kept
        )
    ]


def recipe_of(args: argparse.Namespace) -> Recipe:
    """The recipe that the arguments ask for; says so where none was made for the environment.

    An environment of a server has the recipe of the one that the server plays.
    """
    from rodgym import training

    env_id = args.env
    if env_id == REMOTE:
        env_id = str(env_keywords(env_id, args.env_arg).get("env_id", env_id))
    recipe = training.load_recipe(env_id, args.algorithm or ALGORITHM, args.recipe)
    if args.recipe is None and not training.has_recipe(env_id, recipe.algorithm):
        print(
            f"no recipe for {recipe.algorithm} in {env_id}: the defaults of Stable-Baselines3 "
            f"and {recipe.n_envs} environments (--set and --recipe change them)",
            file=sys.stderr,
        )
    changes = dict(args.changes)
    if args.steps is not None:
        changes["n_timesteps"] = args.steps
    return recipe.with_changes(changes)
