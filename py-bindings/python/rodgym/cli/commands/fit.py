"""Fits the parameters of a rod to a film of it: from a table of marker positions to `rod.yml`, with
intervals, and a report.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rodgym.cli.arguments import key_value
from rodgym.cli.reading import add_reading, names, reading

SUMMARY = "fit a rod's parameters to a film of it"
EXAMPLES = """
rodgym fit film.csv --known width=0.007 --known length=0.3
rodgym fit film.csv --free youngs_modulus,bending_damping --known density=1180 --out fit
rodgym fit film.csv --unit mm --y down --start youngs_modulus=2e6
rodgym fit filmDLC_resnet50.csv --rate 120 --scale 4.1e-4 --markers base,m1,m2,m3,tip
"""
#: Machines whose films are understood.
MACHINES = ("pendulum",)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "film",
        type=Path,
        help="tracks: CSV or Parquet with time,x1,y1,...,xN,yN (seconds and metres, base first, y "
        "up; an empty cell is a lost marker), or a file of 'rodgym track', DeepLabCut, DLTdv8, "
        "SLEAP or Tracker",
    )
    parser.add_argument(
        "--machine",
        choices=MACHINES,
        default=MACHINES[0],
        help="what was filmed (default pendulum)",
    )
    parser.add_argument(
        "--free",
        type=names,
        default=("youngs_modulus", "bending_damping"),
        metavar="NAME,...",
        help="parameters to find (default youngs_modulus,bending_damping)",
    )
    for name, text in (
        ("known", "a parameter's value, such as width=0.007 (default: that of the environments); "
         "nodes=7 says that the rod itself is one of seven nodes"),
        ("start", "where the fit of a free parameter starts"),
    ):  # fmt: skip
        parser.add_argument(
            f"--{name}",
            type=value,
            action="append",
            default=[],
            metavar="NAME=VALUE",
            help=f"{text}; may be repeated",
        )
    parser.add_argument(
        "--nodes",
        type=int,
        default=7,
        metavar="N",
        help="nodes of the environment that equivalent parameters are for (default 7)",
    )
    parser.add_argument(
        "--places",
        type=numbers,
        metavar="S1,...,SN",
        help="places of the markers along the rod [m] (default: evenly from base to tip)",
    )
    add_reading(parser)
    parser.add_argument(
        "--out", type=Path, default=Path("fit"), metavar="DIR", help="folder of the results"
    )


def value(text: str) -> tuple[str, Any]:
    """``width=0.007``, a number."""
    name, number = key_value(text)
    if isinstance(number, bool) or not isinstance(number, int | float):
        raise argparse.ArgumentTypeError(f"{text!r}: {name} must be a number")
    return name, number


def numbers(text: str) -> list[float]:
    """``0,0.05,0.1``."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no list of numbers") from None


def run(args: argparse.Namespace) -> int:
    from rodgym.cli.needs import REPORT, need

    need(*REPORT, "yaml")
    from rodgym import lab
    from rodgym.lab.report import write_report
    from rodgym.runs import Run

    tracks = lab.read_tracks(args.film, **reading(args))
    found = lab.fit(
        tracks,
        free=args.free,
        known=dict(args.known),
        start=dict(args.start),
        places=args.places,
        nodes=args.nodes,
    )
    folder = Run(args.out.name, args.out.parent)
    found.write(folder.file("rod.yml"))
    folder.facts |= {"film": str(args.film), "machine": args.machine}
    folder.write_facts()
    write_report(folder, found, args.film.name)
    tell(found, print)
    print(f"rod: {folder.file('rod.yml')}   report: {folder.file('report.html')}")
    return 0


def tell(found: Any, say: Callable[[str], None]) -> None:
    """The result in a few lines."""
    for name, (best, low, high) in found.identified.items():
        say(f"{name} = {best:.5g}   (95 %: {low:.5g} to {high:.5g})")
    for name, (best, low, high) in found.together.items():
        say(f"{name} = {best:.5g}   (95 %: {low:.5g} to {high:.5g})")
    for name, advice in found.not_identifiable.items():
        say(f"{name} is not identifiable from this film: {advice}")
    if found.twin:
        same = ", ".join(
            f"{k} = {v:.5g}" for k, v in found.twin.parameters.items() if k in found.identified
        )
        say(f"the same motion with {found.twin.nodes} nodes: {same or 'not identifiable'}")
    say(f"residual {1e3 * found.estimate.sigma:.3f} mm; {found.holdout.words}")
    for note in found.notes:
        say(f"note: {note}")
