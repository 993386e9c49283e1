"""Plays policies while one quantity at a time leaves its nominal value: the rod, its sensors, its
motor, a push. The score of a quantity is the share of episodes that succeed over all its values.

Controllers are designed for the nominal machine, and nobody tells them that it has changed. A
policy plays in the environment that it was trained in; 'lqg' plays where only the base is seen.
--env or POLICY@ENVIRONMENT chooses another. If you stop a measurement, the same command
continues it.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rodgym.cli.arguments import add_env, add_run, env_id, positive, seeds

if TYPE_CHECKING:
    from rodgym.robustness import Candidate

SUMMARY = "measure how much may go wrong before a policy fails"
EXAMPLES = """
rodgym robustness lqr zoo
rodgym robustness lqr lqg runs/demo --workers 2 --name all
rodgym robustness lqr --quantity push,actuator_delay --seeds 5
rodgym robustness zoo@FinThrust gait --seeds 200:220
"""


def names(text: str) -> list[str]:
    """A list separated by commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "policy",
        nargs="+",
        help="trained policies' files or run folders, 'zoo' for the one that comes with rodgym, "
        "or controllers ('rodgym list' names them); each may be followed by @ENVIRONMENT",
    )
    add_env(parser, default=None)
    parser.add_argument(
        "--seeds",
        type=seeds,
        default=range(20),
        metavar="N|FIRST:END",
        help="episodes at each value: one per seed (default 20: the seeds 0 to 19)",
    )
    parser.add_argument(
        "--quantity",
        action="extend",
        type=names,
        metavar="NAME,...",
        help="what is varied (default: all that the machine has; docs/robustness.md)",
    )
    parser.add_argument(
        "--points",
        type=positive,
        default=21,
        metavar="N",
        help="values of each quantity, an odd number (default 21)",
    )
    parser.add_argument(
        "--workers", type=positive, default=1, metavar="N", help="processes (default 1)"
    )
    add_run(parser, words="default: robustness-MACHINE, after the first policy's environment")


def run(args: argparse.Namespace) -> int:
    from rodgym.cli.needs import need, of_env, of_policy
    from rodgym.progress import Bar
    from rodgym.robustness import measure
    from rodgym.runs import Run, default_name

    candidates = find(args.policy, args.env, dict(args.env_arg))
    policies = [str(one.policy) for one in candidates]
    need("matplotlib", *of_policy(*policies), *(of_env(candidates[0].env_id)))
    folder = Run(args.name or default_name("robustness", candidates[0].env_id), args.runs)
    folder.facts |= {
        "policies": {one.name: f"{one.policy} in {one.env_id}" for one in candidates},
        "env_kwargs": {one.name: dict(one.env_kwargs) for one in candidates},
        "seeds": f"{args.seeds.start} to {args.seeds.stop - 1}",
        "points": args.points,
    }
    with Bar("robustness", 1) as bar:

        def on_row(done: int, values: int) -> None:
            bar.at(done, values)
            # Ten lines where there is no terminal to draw a bar in.
            if done * 10 // values != (done - 1) * 10 // values:
                bar.say(f"{done} of {values} values")

        result = measure(
            candidates,
            seeds=args.seeds,
            quantities=args.quantity,
            points=args.points,
            table=folder.path / "table.csv",
            workers=args.workers,
            on_row=on_row,
        )
    folder.write_facts()
    result.write_csv(folder.file("scores.csv"))
    from rodgym.robustness.plot import draw

    draw(result, folder.file("plot.png"))
    print(result.table())
    print(f"every value: {folder.file('table.csv')}")
    print(f"scores: {folder.file('scores.csv')}, picture: {folder.file('plot.png')}")
    return 0


def find(
    texts: list[str], everywhere: str | None, env_kwargs: dict[str, object]
) -> list[Candidate]:
    """The policies of the command line, each in its environment, under names of their own."""
    from rodgym.cli.arguments import UsageError, env_keywords
    from rodgym.cli.entrants import title
    from rodgym.robustness import Candidate, usual_env

    found: list[Candidate] = []
    for text in texts:
        policy, at, place = text.rpartition("@")
        # A file may have an @ in its name.
        if not at or Path(text).exists():
            policy, place = text, ""
        try:
            named = env_id(place) if place else everywhere
        except argparse.ArgumentTypeError as error:
            raise UsageError(f"{text}: {error}") from error
        usual, keywords = usual_env(policy)
        if named is not None and named != usual:
            keywords = {}
        env = named or usual
        name, count = title(policy), 1
        while name in [one.name for one in found]:
            count += 1
            name = f"{title(policy)} {count}"
        keywords = env_keywords(env, {**keywords, **env_kwargs})
        found.append(Candidate(name, policy, env, keywords))
    return found
