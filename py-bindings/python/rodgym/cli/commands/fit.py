"""Fits the parameters of a pendulum or a fin to films of it: from tables of marker positions to
`rod.yml`, with intervals, and a report.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from rodgym.cli.arguments import UsageError, key_value
from rodgym.cli.reading import add_reading, names, reading

SUMMARY = "fit a rod's parameters to a film of it"
EXAMPLES = """
rodgym fit example:pendulum --known width=0.007 --known length=0.3
rodgym fit film.csv --known width=0.007 --known length=0.3
rodgym fit film.csv --free youngs_modulus,bending_damping --known density=1180 --out fit
rodgym fit film.csv --unit mm --y down --start youngs_modulus=2e6
rodgym fit film.csv --bench torque.csv --free youngs_modulus,density,bending_damping
rodgym fit filmDLC_resnet50.csv --rate 120 --scale 4.1e-4 --markers base,m1,m2,m3,tip
rodgym fit track/tracks.csv --on film.mp4 --known width=0.007 --known length=0.3
rodgym fit fin.csv --machine fin --bench bench.csv --known flow_speed=0.05
rodgym fit slow.csv fast.csv --machine fin --bench slow-bench.csv fast-bench.csv
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "film",
        type=table,
        nargs="+",
        help="tracks: CSV or Parquet with time,x1,y1,...,xN,yN (seconds and metres, base or nose "
        "first, y up; an empty cell is a lost marker), or a file of 'rodgym track', DeepLabCut, "
        "DLTdv8, SLEAP or Tracker; of a fin several; example:pendulum and example:fin are "
        "synthetic ones to try with",
    )
    parser.add_argument(
        "--machine",
        choices=tuple(MACHINES),
        default=next(iter(MACHINES)),
        help="what was filmed (default pendulum)",
    )
    parser.add_argument(
        "--bench",
        type=table,
        nargs="+",
        default=[],
        metavar="FILE",
        help="what drove it, by the film's clock: CSV with 'time,torque [Nm]' of a pendulum's "
        "base; of a fin, one for each film, 'time,pitch [deg],thrust [N],torque [Nm]', where the "
        "last two may be left out (example:fin-bench); 'command [deg]' tells its servo, too",
    )
    parser.add_argument(
        "--on",
        type=Path,
        metavar="FILM",
        help="the film that 'rodgym track' has tracked: the report shows the model on its frames",
    )
    parser.add_argument(
        "--view",
        type=Path,
        metavar="FILE",
        help="its camera.yml (default: beside the tracks)",
    )
    parser.add_argument(
        "--free",
        type=names,
        metavar="NAME,...",
        help="parameters to find (default: of a pendulum youngs_modulus,bending_damping; of a fin "
        "youngs_modulus,drag_coefficient,added_mass_coefficient, in air youngs_modulus,damping)",
    )
    for name, text in (
        ("known", "a parameter's value, such as width=0.007 (default: that of the environments); "
         "nodes=7 says that the rod itself is one of seven nodes; of a fin also hydrodynamics=air"),
        ("start", "where the fit of a free parameter starts"),
    ):  # fmt: skip
        parser.add_argument(
            f"--{name}",
            type=key_value if name == "known" else value,
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
        help="nodes of the environment that a pendulum's equivalent parameters are for (default 7)",
    )
    parser.add_argument(
        "--places",
        type=numbers,
        metavar="S1,...,SN",
        help="places of the markers along the rod [m], of a fin as shares of its length (default: "
        "evenly from end to end)",
    )
    parser.add_argument(
        "--settle",
        type=float,
        default=0.0,
        metavar="S",
        help="of a fin: time from the start that is not fitted [s], where it does not begin at "
        "rest",
    )
    parser.add_argument(
        "--camera-scale",
        type=float,
        default=0.1,
        metavar="SHARE",
        help="of a fin: how well the camera's scale is known, a deviation as a share (default 0.1; "
        "of a calibrated camera 0.002)",
    )
    add_reading(parser)
    parser.add_argument(
        "--out", type=Path, default=Path("fit"), metavar="DIR", help="folder of the results"
    )


def table(text: str) -> Path:
    """A file's path; ``example:pendulum`` is one that comes with rodgym."""
    start, _, name = text.partition(":")
    if start != "example":
        return Path(text)
    from rodgym.errors import ParameterError
    from rodgym.lab import examples

    try:
        return examples.path(name)
    except ParameterError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


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

    need(*REPORT, "yaml", *(["scipy"] if args.bench else []), *(["cv2"] if args.on else []))
    from rodgym import lab
    from rodgym.runs import Run

    view = seen(args)
    films = [lab.read_tracks(film, **reading(args)) for film in args.film]
    machine = MACHINES[args.machine]
    found = machine.fit(args, films)
    folder = Run(args.out.name, args.out.parent)
    found.write(folder.file("rod.yml"))
    folder.facts |= {
        "film": ", ".join(map(str, args.film)),
        "bench": ", ".join(map(str, args.bench)) or None,
        "machine": args.machine,
    }
    folder.write_facts()
    subject = ", ".join(film.name for film in args.film)
    sheet = None if view is None else on_film(folder.file("on-film.png"), args.on, view, found)
    import_module(machine.report).write_report(folder, found, subject, sheet)
    machine.tell(found, print)
    print(f"rod: {folder.file('rod.yml')}   report: {folder.file('report.html')}")
    return 0


def seen(args: argparse.Namespace) -> Any:
    """How the film shows the tracks; None where no film is to be shown."""
    if args.on is None:
        return None
    from rodgym.lab.vision.view import View

    moved = [name for name in ("unit", "scale", "y", "origin") if getattr(args, name) is not None]
    if moved or args.axis:
        raise UsageError(f"--on needs the tracks as they were written, without --{moved or 'axis'}")
    return View.read(args.view or args.film[0].with_name("camera.yml"))


def on_film(path: Path, film: Path, view: Any, found: Any) -> Path:
    """Writes the model on frames of the film."""
    from rodgym.lab.vision.on_film import chosen, write_sheet

    model = getattr(found, "film", None) or found.model
    tracks = model.tracks if hasattr(model, "tracks") else model.recordings[0].tracks
    frames = chosen(tracks)
    write_sheet(path, film, view, tracks, model.outlines(found.estimate.x)[frames], frames)
    return path


def pendulum(args: argparse.Namespace, films: list[Any]) -> Any:
    """The fit of a pendulum."""
    from rodgym import lab

    if len(films) > 1 or len(args.bench) > 1:
        raise UsageError("a pendulum has one film, and at most one file of its torque")
    driven = {}
    if args.bench:
        from rodgym.lab import drives

        driven["torque"] = drives.torque(lab.read_cells(args.bench[0]))
    return lab.fit(
        films[0],
        free=args.free or ("youngs_modulus", "bending_damping"),
        known=dict(args.known),
        start=dict(args.start),
        places=args.places,
        nodes=args.nodes,
        **driven,
    )


def fin(args: argparse.Namespace, films: list[Any]) -> Any:
    """The fit of a fin."""
    from rodgym import lab

    if len(films) != len(args.bench):
        raise UsageError(
            f"{len(films)} films and {len(args.bench)} files of the bench: a fin needs for each "
            "film one with its pitch (--bench)"
        )
    from rodgym.lab import drives

    benches = [lab.read_cells(path) for path in args.bench]
    return lab.fit_fin(
        [drives.recording(film, bench) for film, bench in zip(films, benches, strict=True)],
        free=args.free,
        known=dict(args.known),
        start=dict(args.start),
        scale=args.camera_scale,
        places=args.places,
        settle=args.settle,
    )


def tell(found: Any, say: Callable[[str], None]) -> None:
    """The result in a few lines."""
    tell_values(found, {**found.identified, **found.together}, say)
    if found.twin:
        same = ", ".join(
            f"{k} = {v:.5g}" for k, v in found.twin.parameters.items() if k in found.identified
        )
        say(f"the same motion with {found.twin.nodes} nodes: {same or 'not identifiable'}")
    say(f"residual {1e3 * found.estimate.sigma:.3f} mm; {found.holdout.words}")
    for note in found.notes:
        say(f"note: {note}")


def tell_fin(found: Any, say: Callable[[str], None]) -> None:
    """The same of a fin."""
    tell_values(found, found.identified, say)
    if len(found.levels) > 1:
        same = ", ".join(
            f"{k} = {v:.5g}" for k, v in found.twin.parameters.items() if k in found.identified
        )
        say(f"the same motion with {found.twin.nodes} nodes: {same or 'not identifiable'}")
    loads = "".join(f", of {name} {left:.3g}" for name, left in found.left.items())
    for name, (best, low, high) in found.servo.items():
        say(f"{name} = {best:.5g}   (95 %: {low:.5g} to {high:.5g})")
    say(f"residual {1e3 * found.sigma:.3f} mm{loads}; {found.holdout.words}")
    for note in found.notes:
        say(f"note: {note}")


def tell_values(found: Any, values: Any, say: Callable[[str], None]) -> None:
    """Values with intervals, and what is not identifiable."""
    for name, (best, low, high) in values.items():
        say(f"{name} = {best:.5g}   (95 %: {low:.5g} to {high:.5g})")
    for name, advice in found.not_identifiable.items():
        say(f"{name} is not identifiable from this film: {advice}")


@dataclass(frozen=True)
class Filmed:
    """What is done with films of a machine: the fit, its words, and the module of its report."""

    fit: Callable[[argparse.Namespace, list[Any]], Any]
    tell: Callable[[Any, Callable[[str], None]], None]
    report: str


#: Machines whose films are understood; the first is the usual one.
MACHINES = {
    "pendulum": Filmed(pendulum, tell, "rodgym.lab.report"),
    "fin": Filmed(fin, tell_fin, "rodgym.lab.fin_report"),
}
