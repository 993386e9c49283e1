"""Trains an agent, lets it and classical controllers play the same seeds, and writes a report.

With --policy it trains nothing and compares the given policies.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rodgym.cli.arguments import (
    UsageError,
    add_band,
    add_designs,
    add_env,
    add_normalize,
    add_run,
    add_seeds,
    add_trajectories,
    designs,
    env_keywords,
)
from rodgym.cli.commands.train import add_training, options

if TYPE_CHECKING:
    from rodgym.report import Entrant
    from rodgym.robustness import Robustness
    from rodgym.runs import Run

SUMMARY = "train an agent, compare it with controllers on the same seeds, write a report"
EXAMPLES = """
rodgym compare
rodgym compare --env rodgym/PendulumSwingUpBase-v0 --controller lqg,thesis-lqg
rodgym compare --policy lqr --controller lqr-hybrid
rodgym compare --policy zoo --band starts --robustness
rodgym compare --train-seeds 10
rodgym compare --policy runs/ten --controller lqr
rodgym compare --policy zoo,runs/demo/policy.zip --controller lqr --env-arg width=0.0081
"""


def add_arguments(parser: argparse.ArgumentParser, **run: str) -> None:
    """`run` goes to `add_run`."""
    add_env(parser)
    parser.add_argument(
        "--controller",
        action="extend",
        type=names,
        metavar="NAME,...",
        help="controllers to compare with, named by 'rodgym list' "
        "(default: lqr, lqg or gait, whichever fits the environment)",
    )
    parser.add_argument(
        "--policy",
        action="extend",
        type=some_names,
        metavar="FILE,...",
        help="policies to compare instead of training one: files, 'zoo' for the one that comes "
        "with rodgym, controllers, classes of yours (mine.py:Class), or the folder of several "
        "trainings (rodgym train --train-seeds), which become one row",
    )
    add_band(parser)
    add_designs(parser)
    add_normalize(parser)
    add_seeds(parser)
    add_trajectories(parser)
    parser.add_argument(
        "--robustness",
        action="store_true",
        help="also measure how much may go wrong before each policy fails, as 'rodgym robustness' "
        "does, and show it in the report; takes minutes",
    )
    add_training(parser)
    add_run(parser, **run)


def names(text: str) -> list[str]:
    """A list separated by commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def some_names(text: str) -> list[str]:
    """The same with at least one name."""
    if not names(text):
        raise argparse.ArgumentTypeError(f"{text!r} names no policy")
    return names(text)


def given(value: object) -> bool:
    """Whether an argument was given, the seed 0 included."""
    return value is not None and value is not False and value != []


#: Arguments that concern a training.
TRAINING = ("algorithm", "steps", "seed", "train_seeds", "recipe", "changes")


def run(args: argparse.Namespace) -> int:
    from rodgym import machines
    from rodgym.cli.entrants import new_run, rows_of, trained
    from rodgym.cli.needs import REPORT, need, of_data, of_env, of_policy
    from rodgym.cli.needs import TRAINING as TRAINS
    from rodgym.evaluation import band_keywords
    from rodgym.evaluation.conditions import make_batch
    from rodgym.evaluation.policies import ready
    from rodgym.runs import default_name

    asked = [name for name in TRAINING if given(getattr(args, name))]
    if args.policy and asked:
        raise UsageError(f"{options(asked)}: nothing is trained where --policy is given")
    policies = of_policy(*args.policy) if args.policy else TRAINS
    need(*policies, *REPORT, *of_env(args.env), *of_data(args.trajectories, None))
    from rodgym.report import Entrant  # It draws, so that it needs what was asked for above.

    # A training is of the environment as it is named; a band is for playing.
    keywords = env_keywords(args.env, args.env_arg)
    keywords = band_keywords(args.band, args.env, keywords)
    env = make_batch(args.env, 1, keywords)
    try:
        spec = machines.spec_of(env)
        usual = machines.of(spec).controllers(spec)
        controllers = list(usual) if args.controller is None else args.controller
        if not controllers and not args.policy:
            raise UsageError("nothing to compare: give --controller or --policy")
        rows = [
            row
            for source in [*(args.policy or []), *controllers]
            for row in rows_of(source, spec, designs(args.design))
        ]
        # A wrong name is said now, not after minutes of training.
        entrants = []
        for row in rows:
            statistics = None if row.design else args.normalize
            first, *others = trained(row.policy)
            for policy in (first, *others):
                ready(policy, env, args.env, row.design, statistics)
            entrants.append(Entrant(row.name, first, row.design, statistics, tuple(others)))
    finally:
        env.close()
    folder = new_run(args.name or default_name("compare", args.env), args.runs, args.force)
    folder.folder()
    return report(args, entrants, folder, keywords)


def report(
    args: argparse.Namespace, entrants: list[Entrant], folder: Run, keywords: dict[str, Any]
) -> int:
    """The work of ``compare`` and ``demo``."""
    from rodgym.cli.commands.train import train_all
    from rodgym.evaluation import comparison_table
    from rodgym.report import Entrant, compare, write_page

    trainings = []
    if args.policy and entrants[0].others:
        from rodgym.training import load_training

        # Several trainings of one recipe: their curves are beside them.
        paths = (entrants[0].policy, *entrants[0].others)
        trainings = [load_training(Path(str(path)).parent) for path in paths]
    elif not args.policy:
        trainings = train_all(args, folder)
        first, *others = (str(training.policy) for training in trainings)
        name = trainings[0].recipe.algorithm
        entrants = [Entrant(name, first, others=tuple(others)), *entrants]
    print("evaluating and drawing ...", flush=True)
    comparison = compare(
        unique(entrants),
        args.env,
        folder,
        seeds=args.seeds,
        env_kwargs=keywords,
        trainings=trainings,
        trajectories=args.trajectories,
    )
    if args.robustness:
        comparison = replace(comparison, robustness=robustness(args, entrants, folder))
    folder.facts |= {
        "env": args.env,
        "env_kwargs": keywords,
        "band": args.band,
        "seeds": str(args.seeds),
        "designs": {e.policy: e.design for e in comparison.evaluations},
    }
    if trainings:
        folder.facts |= {
            "training_seeds": [training.seed for training in trainings],
            "training_seconds": [round(training.seconds, 1) for training in trainings],
            "recipe": trainings[0].recipe.as_dict(),
        }
    folder.write_facts()
    page = write_page(folder, comparison)
    print()
    print(comparison_table(comparison.evaluations))
    print()
    for line in comparison.statistics:
        print(line)
    if comparison.robustness is not None:
        print(comparison.robustness.table())
    print(f"report: {page}")
    return 0


def robustness(args: argparse.Namespace, entrants: list[Entrant], folder: Run) -> Robustness:
    """How much may go wrong, from the environment as it is named, without a band.

    Controllers are designed for the nominal machine, so that their designs are one row; of several
    trainings the first stands for all.
    """
    from rodgym.cli.entrants import title
    from rodgym.progress import Bar
    from rodgym.report import Entrant
    from rodgym.robustness import Candidate, measure
    from rodgym.robustness.plot import draw

    keywords = env_keywords(args.env, args.env_arg)
    policies = dict.fromkeys(str(entrant.policy) for entrant in entrants)
    named = unique([Entrant(title(policy), policy) for policy in policies])
    with Bar("robustness", 1) as bar:
        result = measure(
            [Candidate(one.name, str(one.policy), args.env, keywords) for one in named],
            table=folder.file("robustness-values.csv"),
            on_row=bar.at,
        )
    result.write_csv(folder.file("robustness.csv"))
    draw(result, folder.file("robustness.png"))
    return result


def unique(entrants: list[Entrant]) -> list[Entrant]:
    """Numbers entrants of one name, so that tables can tell them apart."""
    count: dict[str, int] = {}
    result = []
    for entrant in entrants:
        count[entrant.name] = count.get(entrant.name, 0) + 1
        number = count[entrant.name]
        name = entrant.name if number == 1 else f"{entrant.name} {number}"
        result.append(replace(entrant, name=name))
    return result
