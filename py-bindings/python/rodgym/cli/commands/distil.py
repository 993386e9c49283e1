"""Teaches a student that sees less what a controller or policy that sees everything does.

Rounds of DAgger: the student drives, the teacher says what it would have done, the student learns
that. Ctrl-C keeps the best round, and --resume goes on after the last whole one.
"""

from __future__ import annotations

import argparse

from rodgym.cli.arguments import add_env, add_run, env_keywords, key_value, positive, seed

SUMMARY = "teach a student what a controller does that sees more"
EXAMPLES = """
rodgym distil
rodgym distil --recipe unknown-e --seed 3 --name soft-or-stiff
rodgym distil --set net=gru --set frames=1 --set batch_size=32 --set batches=60
rodgym distil --env-arg actuator_delay=0.01 --set lost_samples=0.25
"""

ENV = "rodgym/PendulumSwingUpBase-v0"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_env(parser, default=ENV)
    parser.add_argument(
        "--teacher", metavar="POLICY", help="a controller, 'zoo' or a file (default: the recipe's)"
    )
    parser.add_argument(
        "--recipe",
        metavar="NAME|FILE",
        help="one of rodgym's recipes for this environment, such as unknown-e, or a YAML file",
    )
    parser.add_argument(
        "--rounds", type=positive, metavar="N", help="rounds of lessons (default: the recipe's)"
    )
    parser.add_argument(
        "--seed", type=seed, default=0, metavar="N", help="seed of the student (default 0)"
    )
    parser.add_argument(
        "--set",
        type=key_value,
        action="append",
        default=[],
        dest="changes",
        metavar="NAME=VALUE",
        help="changes a value of the recipe, such as frames=40; may be repeated",
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument(
        "--force", action="store_true", help="replace the policy of an earlier run of this name"
    )
    how.add_argument(
        "--resume", action="store_true", help="go on with the interrupted run of this name"
    )
    add_run(parser)


def run(args: argparse.Namespace) -> int:
    from rodgym.cli.needs import need, of_env
    from rodgym.runs import Run, default_name

    need("torch", "yaml", *of_env(args.env))
    from rodgym.distil import distil, load_recipe

    folder = Run(args.name or default_name("distil", args.env), args.runs)
    if not args.force and not args.resume:
        folder.keep_policy()
    changes = dict(args.changes)
    changes |= {name: value for name in ("teacher", "rounds") if (value := getattr(args, name))}
    made = distil(
        args.env,
        folder,
        recipe=load_recipe(args.env, args.recipe).with_changes(changes),
        seed=args.seed,
        env_kwargs=env_keywords(args.env, args.env_arg),
        resume=args.resume,
    )
    folder.facts |= {"env": args.env, "seed": made.seed, "recipe": made.recipe.as_dict()}
    folder.write_facts()
    last = "interrupted after" if made.interrupted else "taught for"
    print(
        f"{last} {made.rounds} rounds, {made.steps:,} steps in {made.seconds:.0f} s; "
        f"round {made.best_round} is kept"
    )
    print(f"policy: {made.policy}   (rodgym evaluate {made.policy})")
    return 0
