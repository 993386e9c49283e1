"""Teaches a student, which sees less, to act like a teacher, which sees everything.

The method is DAgger. In each round the student drives, the teacher says what it would have done,
and the student learns that. Ctrl-C ends the teaching and keeps the student of the best round;
--resume continues after the last whole round.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rodgym.cli.arguments import (
    UsageError,
    add_env,
    add_run,
    env_keywords,
    key_value,
    positive,
    seed,
)  # fmt: skip

if TYPE_CHECKING:
    from rodgym.runs import Run

SUMMARY = "teach a student to act like a controller that sees more"
EXAMPLES = """
rodgym distil
rodgym distil --recipe unknown-e --seed 3 --name soft-or-stiff
rodgym distil --set net=gru --rounds 20
rodgym distil --fine-tune ppo --from runs/soft-or-stiff
rodgym distil --env-arg actuator_delay=0.01 --set lost_samples=0.25
"""

ENV = "rodgym/PendulumSwingUpBase-v0"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_env(parser, default=ENV)
    parser.add_argument(
        "--teacher",
        metavar="POLICY",
        help="a controller, 'zoo' or a policy's file (default: the recipe's)",
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
        "--fine-tune",
        choices=["ppo"],
        help="then improve the student by PPO, in a run of the same name with -ppo added",
    )
    parser.add_argument(
        "--from",
        dest="student",
        metavar="POLICY",
        help="fine-tune this student instead of teaching one",
    )
    parser.add_argument(
        "--steps",
        type=positive,
        metavar="N",
        help="environment steps of PPO (default: the recipe's)",
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
        help="change a value of the recipe, such as frames=40; may be repeated",
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument(
        "--force", action="store_true", help="replace the policy of an earlier run of this name"
    )
    how.add_argument(
        "--resume", action="store_true", help="continue the interrupted run of this name"
    )
    add_run(parser)


def run(args: argparse.Namespace) -> int:
    from rodgym.cli.needs import need, of_env
    from rodgym.runs import Run, default_name

    if not args.fine_tune and (args.student or args.steps):
        raise UsageError("--from and --steps are for --fine-tune ppo")
    need("stable_baselines3" if args.fine_tune else "torch", "yaml", *of_env(args.env))
    name = args.name or default_name("distil", args.env)
    made: str | None = args.student
    tuned = Run(f"{name}-ppo", args.runs)
    if args.fine_tune and not args.force:
        tuned.keep_policy()
    if made is None:
        made = teach(args, Run(name, args.runs))
    if args.fine_tune and made is not None:
        from rodgym.distil.fine_tune import fine_tune
        from rodgym.evaluation.policies import of_zoo
        from rodgym.zoo import is_zoo

        if is_zoo(made):
            made = str(of_zoo(made, args.env))
        result = fine_tune(made, tuned, steps=args.steps, seed=args.seed)
        tuned.facts |= {"student": made, "seed": result.seed}
        tuned.write_facts()
        last = "interrupted after" if result.interrupted else "fine-tuned for"
        print(
            f"{last} {result.steps:,} steps in {result.seconds:.0f} s; that of step "
            f"{result.best_steps:,} is kept"
        )
        print(f"policy: {result.policy}   (rodgym evaluate {result.policy})")
    return 0


def teach(args: argparse.Namespace, folder: Run) -> str | None:
    """Teaches a student; returns its file, or None where Ctrl-C ended it early."""
    from rodgym.distil import distil, load_recipe

    changes = dict(args.changes)
    changes |= {name: value for name in ("teacher", "rounds") if (value := getattr(args, name))}
    made = distil(
        args.env,
        folder,
        recipe=load_recipe(args.env, args.recipe).with_changes(changes),
        seed=args.seed,
        env_kwargs=env_keywords(args.env, args.env_arg),
        resume=args.resume,
        force=args.force,
    )
    folder.facts |= {"env": args.env, "seed": made.seed, "recipe": made.recipe.as_dict()}
    folder.write_facts()
    last = "interrupted after" if made.interrupted else "taught for"
    print(
        f"{last} {made.rounds} rounds, {made.steps:,} steps in {made.seconds:.0f} s; "
        f"round {made.best_round} is kept"
    )
    print(f"policy: {made.policy}   (rodgym evaluate {made.policy})")
    return None if made.interrupted else str(made.policy)
