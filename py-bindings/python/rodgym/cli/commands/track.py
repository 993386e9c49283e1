"""Tracks the markers in a film: calibrates the camera with a checkerboard and writes a table of
their positions in metres, which `rodgym fit` reads.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from rodgym.cli.arguments import UsageError

SUMMARY = "find the markers in a film, in metres"
EXAMPLES = """
rodgym track film.mp4 --board 10x7:7.34mm
rodgym track swing.mp4 --board 10x7:7.34mm --calibration board.mp4 --plane plane.png
rodgym track swing2.mp4 --board 10x7:7.34mm --camera track/camera.yml --plane plane.png --rate 240
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "film",
        type=Path,
        help="a film that OpenCV reads; it begins with the board seen from many sides, then lying "
        "still in the plane of motion, unless --calibration and --plane are given",
    )
    parser.add_argument(
        "--board",
        required=True,
        metavar="CxR:SIDE",
        help="cells of the checkerboard and their side, such as 10x7:7.34mm",
    )
    parser.add_argument(
        "--calibration",
        type=Path,
        nargs="+",
        default=[],
        metavar="PATH",
        help="pictures, folders or films of the board from many sides",
    )
    parser.add_argument(
        "--camera",
        type=Path,
        metavar="FILE",
        help="camera.yml of an earlier run, instead of a calibration",
    )
    parser.add_argument(
        "--plane",
        type=Path,
        nargs="+",
        default=[],
        metavar="PATH",
        help="pictures of the board in the plane of motion, in one or several places",
    )
    for name, text in (
        ("start", "when the recording begins in the film [s] (default: when the board is gone)"),
        ("end", "when it ends [s]"),
        ("rate", "frames a second (default: as the film says)"),
    ):
        parser.add_argument(f"--{name}", type=float, metavar="X", help=text)
    parser.add_argument("--count", type=int, metavar="N", help="number of markers")
    parser.add_argument("--dark", action="store_true", help="markers are darker than the rod")
    parser.add_argument(
        "--largest",
        type=int,
        default=25,
        metavar="PIXELS",
        help="width of the largest marker (default 25)",
    )
    parser.add_argument(
        "--region",
        type=region,
        metavar="LEFT,TOP,RIGHT,BOTTOM",
        help="part of the picture to look at [pixel]",
    )
    parser.add_argument(
        "--above",
        type=float,
        default=0.0,
        metavar="M",
        help="how much nearer to the camera than the board the markers are [m]",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("track"), metavar="DIR", help="folder of the results"
    )


def region(text: str) -> tuple[int, int, int, int]:
    """``100,50,1200,700``."""
    try:
        left, top, right, bottom = (int(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not LEFT,TOP,RIGHT,BOTTOM") from None
    return left, top, right, bottom


def run(args: argparse.Namespace) -> int:
    from rodgym.cli.needs import need

    need("cv2", "scipy", "yaml")
    import yaml

    from rodgym.lab.vision import Board, Look, track
    from rodgym.lab.vision.overlay import write_overlay
    from rodgym.runs import Run

    if args.camera and args.calibration:
        raise UsageError("give either --camera or --calibration")
    found = track(
        args.film,
        Board.parse(args.board),
        calibration=args.calibration,
        camera=camera(args.camera),
        plane=args.plane,
        start=args.start,
        end=args.end,
        rate=args.rate,
        count=args.count,
        look=Look(not args.dark, args.largest, args.region),
        above=args.above,
    )
    folder = Run(args.out.name, args.out.parent)
    found.tracks.write_tidy(folder.file("tracks.csv"))
    text = yaml.safe_dump(found.as_dict(), sort_keys=False, allow_unicode=True)
    folder.file("camera.yml").write_text(text, encoding="utf-8")
    write_overlay(folder.file("tracks.png"), found)
    folder.facts |= {"film": str(args.film), "board": args.board}
    folder.write_facts()
    lens = found.camera
    print(
        f"camera from {lens.views} pictures, reprojection error {lens.error:.3f} pixels; of the "
        f"plane {found.plane.error:.3f} pixels"
    )
    for note in found.tracks.notes:
        print(f"note: {note}")
    print(
        f"{found.tracks.markers} markers in {len(found.tracks.times)} frames: "
        f"{folder.file('tracks.csv')}   look at {folder.file('tracks.png')}"
    )
    return 0


def camera(path: Path | None) -> Any:
    """The camera of an earlier run."""
    import yaml

    from rodgym.lab.vision import Camera

    if path is None:
        return None
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, yaml.YAMLError) as error:
        raise UsageError(f"--camera {path}: {error}") from error
    return Camera.from_dict(content.get("camera", {}) if isinstance(content, dict) else {})
