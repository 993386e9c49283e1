"""Plays a policy on fixed seeds, one episode each, and measures every episode."""

from __future__ import annotations

import argparse

from rodgym.cli.arguments import (
    DEFAULT_ENV,
    UsageError,
    add_band,
    add_designs,
    add_env,
    add_force,
    add_normalize,
    add_run,
    add_seeds,
    add_trajectories,
    designs,
)

SUMMARY = "play a policy on fixed seeds and measure it"
EXAMPLES = """
rodgym evaluate lqr
rodgym evaluate runs/demo/policy.zip --seeds 100:200
rodgym evaluate zoo --env rodgym/PendulumSwingUp-v0 --env-arg width=0.0081
rodgym evaluate lqr --band starts
rodgym evaluate lqr --env-arg "randomize={'width':(0.006,0.009)}" --design nominal
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "policy",
        help="a trained policy's file or run folder (that of several trainings becomes one row), "
        "'zoo' for the policy that comes with rodgym, a controller such as lqr ('rodgym list' "
        "names them), or a class of yours (mine.py:Class)",
    )
    add_env(parser, default=None)
    add_band(parser)
    add_designs(parser)
    add_normalize(parser)
    add_seeds(parser)
    add_trajectories(parser)
    parser.add_argument(
        "--minari",
        metavar="ID",
        help="also write the episodes as a data set of Minari, such as pendulum/lqr-v0",
    )
    add_run(parser)
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    from rodgym.cli.entrants import new_run, resolve_env, rows_of, trained
    from rodgym.cli.needs import need, of_data, of_env, of_policy
    from rodgym.evaluation import band_keywords, comparison_table, evaluate
    from rodgym.evaluation.conditions import spec_for
    from rodgym.evaluation.pooled import pooled, several
    from rodgym.evaluation.trajectories import write_trajectories
    from rodgym.runs import default_name, write_csv

    env_id, env_kwargs = resolve_env(args.policy, args.env, dict(args.env_arg), DEFAULT_ENV)
    need(*of_policy(args.policy), *of_env(env_id), *of_data(args.trajectories, args.minari))
    env_kwargs = band_keywords(args.band, env_id, env_kwargs)
    asked = designs(args.design)
    rows = rows_of(args.policy, spec_for(env_id, env_kwargs), asked)
    if args.minari and len(rows) > 1:
        raise UsageError("--minari: a data set is of one policy: give one --design")
    policies = trained(args.policy)
    if args.minari and len(policies) > 1:
        raise UsageError(f"--minari: a data set is of one policy; {args.policy} has several")
    kept = bool(args.trajectories or args.minari)
    # Every policy by itself: designs are a row each, all trainings of a recipe are one.
    singles = [
        evaluate(
            policy,
            env_id,
            args.seeds,
            env_kwargs=env_kwargs,
            name=row.name if len(policies) == 1 else f"{row.name}, training {number}",
            design=row.design or (asked[0] if asked else None),
            normalize=args.normalize,
            trajectories=kept,
        )
        for row in rows
        for number, policy in enumerate(policies if len(policies) > 1 else [row.policy], start=1)
    ]
    results = singles
    if len(policies) > 1:
        results = [pooled(singles, several(rows[0].name, len(policies)))]
    folder = new_run(args.name or default_name("evaluate", env_id), args.runs, args.force)
    folder.facts |= {
        "env": env_id,
        "env_kwargs": env_kwargs,
        "policy": args.policy,
        "band": args.band,
        "designs": [result.design for result in results],
    }
    folder.write_facts()
    write_csv(
        folder.file("scores.csv"), singles[0].header, [row for one in singles for row in one.rows()]
    )
    print(comparison_table(results))
    print(f"every episode: {folder.file('scores.csv')}")
    if args.trajectories:
        path = folder.file(f"trajectories.{args.trajectories}")
        write_trajectories(path, results)
        print(f"every step: {path}")
    if args.minari:
        print(f"data set: {results[0].write_minari(args.minari)}")
    return 0
