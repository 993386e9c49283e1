"""Plays a policy on fixed seeds, one episode each, and measures every episode."""

from __future__ import annotations

import argparse

from rodgym.cli.arguments import DEFAULT_ENV, add_band, add_env, add_run, add_seeds

SUMMARY = "play a policy on fixed seeds and measure it"
EXAMPLES = """
rodgym evaluate lqr
rodgym evaluate runs/demo/policy.zip --seeds 100:200
rodgym evaluate zoo --env rodgym/PendulumSwingUp-v0 --env-arg width=0.0081
rodgym evaluate lqr --band starts
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "policy",
        help="a trained policy's file or run folder, 'zoo' for the one that comes with rodgym, or "
        "a controller such as lqr ('rodgym list' names them)",
    )
    add_env(parser, default=None)
    add_band(parser)
    add_seeds(parser)
    add_run(parser)


def run(args: argparse.Namespace) -> int:
    from rodgym.cli.entrants import resolve_env
    from rodgym.cli.needs import need, of_env, of_policy
    from rodgym.evaluation import band_keywords, comparison_table, evaluate
    from rodgym.runs import Run, default_name

    env_id, env_kwargs = resolve_env(args.policy, args.env, dict(args.env_arg), DEFAULT_ENV)
    need(*of_policy(args.policy), *of_env(env_id))
    env_kwargs = band_keywords(args.band, env_id, env_kwargs)
    result = evaluate(args.policy, env_id, args.seeds, env_kwargs=env_kwargs)
    folder = Run(args.name or default_name("evaluate", env_id), args.runs)
    folder.facts |= {"env": env_id, "env_kwargs": env_kwargs, "policy": args.policy}
    folder.facts["band"] = args.band
    folder.write_facts()
    result.write_csv(folder.file("scores.csv"))
    print(comparison_table([result]))
    print(f"every episode: {folder.file('scores.csv')}")
    return 0
