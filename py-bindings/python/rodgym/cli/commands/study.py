"""Runs a grid of cases, keeps what is finished, and draws the table.

Give a study of your own as a YAML file, or one of ours by name. A study that was stopped goes on
where it was: run the same command again.
"""

from __future__ import annotations

import argparse

from rodgym.cli.arguments import positive

SUMMARY = "run a sweep of policies, parameters or start states"
EXAMPLES = """
rodgym study attraction
rodgym study my_sweep.yml --workers 2 --name sweep
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from rodgym.study.spec import plans

    parser.add_argument("study", help=f"a YAML file, or one of {', '.join(plans())}")
    parser.add_argument(
        "--workers", type=positive, default=1, metavar="N", help="processes (default 1)"
    )
    parser.add_argument("--name", default=None, help="name of the run (default: study-NAME)")
    parser.add_argument(
        "--runs", default="runs", metavar="DIR", help="folder of all runs (default runs)"
    )


def run(args: argparse.Namespace) -> int:
    from pathlib import Path

    from rodgym.runs import Run
    from rodgym.study import local, read, run_study
    from rodgym.training.progress import Bar

    study = read(args.study)
    folder = Run(args.name or f"study-{Path(args.study).stem}", args.runs)
    folder.facts |= {"study": study.title, "env": study.env, "cases": len(study)}
    folder.write_facts()
    table = folder.file("table.csv")
    with Bar("study", len(study)) as bar:
        rows = run_study(study, table, local(args.workers), lambda done, _: bar.at(done))
    print(f"{len(rows)} cases: {table}")
    if study.plot:
        from rodgym.study.plot import draw

        picture = folder.file("plot.png")
        draw(study, rows, picture)
        print(f"picture: {picture}")
    return 0
