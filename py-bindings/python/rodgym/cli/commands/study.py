"""Plays all combinations of some settings, keeps finished ones, and draws the table.

Give the YAML file of a study of your own, or the name of one that comes with rodgym. If you stop a
study, the same command continues it.
"""

from __future__ import annotations

import argparse

from rodgym.cli.arguments import positive, rod_file

SUMMARY = "run a sweep of policies, parameters or start states"
EXAMPLES = """
rodgym study attraction
rodgym study my_sweep.yml --workers 2 --name sweep
rodgym study my_sweep.yml --ray local
rodgym study my_sweep.yml --ray ray://head:10001
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from rodgym.study.spec import plans

    parser.add_argument("study", help=f"a YAML file, or one of {', '.join(plans())}")
    parser.add_argument(
        "--rod",
        type=rod_file,
        metavar="FILE",
        help="rod.yml of 'rodgym fit': the environments of all cases get that rod; keywords of the "
        "study override it",
    )
    parser.add_argument(
        "--workers",
        type=positive,
        default=None,
        metavar="N",
        help="cases at a time (default 1; with --ray: the cluster's CPUs)",
    )
    parser.add_argument(
        "--ray",
        default=None,
        metavar="ADDRESS",
        help="run on a Ray cluster: 'local' starts one on this machine; 'auto', HOST:6379 and "
        "ray://HOST:10001 join one (docs/ray.md)",
    )
    parser.add_argument("--name", default=None, help="name of the run (default: study-NAME)")
    parser.add_argument(
        "--runs", default="runs", metavar="DIR", help="folder of all runs (default runs)"
    )


def run(args: argparse.Namespace) -> int:
    from pathlib import Path

    from rodgym.cli.needs import need, of_env, of_policy
    from rodgym.progress import Bar
    from rodgym.runs import Run
    from rodgym.study import Backend, local, read, run_study

    on_ray = () if args.ray is None else ("ray",)
    need("yaml", *on_ray)
    study = read(args.study)
    if args.rod:
        study = study.with_keywords(dict(args.rod))
    # What draws is asked for now: a study may take hours.
    drawn = ("matplotlib",) if study.plot else ()
    need("yaml", *on_ray, *drawn, *of_policy(*study.policies), *of_env(study.env))
    backend: Backend
    if args.ray is None:
        backend = local(args.workers or 1)
    else:
        import rodgym.ray

        backend = rodgym.ray.backend(args.ray, args.workers)
    folder = Run(args.name or f"study-{Path(args.study).stem}", args.runs)
    folder.facts |= {"study": study.title, "env": study.env, "cases": len(study)}
    folder.write_facts()
    table = folder.file("table.csv")
    with Bar("study", len(study)) as bar:

        def on_row(done: int, cases: int) -> None:
            bar.at(done)
            # Ten lines where there is no terminal to draw a bar in.
            if done * 10 // cases != (done - 1) * 10 // cases:
                bar.say(f"{done} of {cases} cases")

        rows = run_study(study, table, backend, on_row)
    print(f"{len(rows)} cases: {table}")
    if study.plot:
        from rodgym.study.plot import draw

        picture = folder.file("plot.png")
        draw(study, rows, picture)
        print(f"picture: {picture}")
    return 0
