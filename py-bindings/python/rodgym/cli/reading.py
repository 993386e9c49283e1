"""Arguments that say how a file of tracks is to be read."""

from __future__ import annotations

import argparse
from typing import Any


def add_reading(parser: argparse.ArgumentParser) -> None:
    """``--unit``, ``--scale``, ``--y``, ``--rate``, ``--markers`` and the others."""
    group = parser.add_argument_group("how the tracks are read")
    group.add_argument(
        "--unit",
        choices=("m", "cm", "mm"),
        help="unit of the positions (default: the file's, or m)",
    )
    group.add_argument(
        "--scale",
        type=float,
        metavar="M",
        help="metres that one unit of the table is, for tables in pixels",
    )
    group.add_argument(
        "--y", choices=("up", "down"), help="where y points (default: as the format has it, or up)"
    )
    group.add_argument(
        "--rate", type=float, metavar="HZ", help="frames a second, for files without times"
    )
    group.add_argument(
        "--markers", type=names, metavar="NAME,...", help="names of the markers, from base to tip"
    )
    group.add_argument(
        "--origin", type=pair, metavar="X,Y", help="point of the table that becomes 0,0"
    )
    group.add_argument(
        "--axis",
        type=float,
        default=0.0,
        metavar="DEG",
        help="direction of the x axis, counter-clockwise from the table's",
    )
    group.add_argument(
        "--confidence",
        type=float,
        default=0.6,
        metavar="P",
        help="points with less confidence count as lost (default 0.6)",
    )
    group.add_argument("--animal", metavar="NAME", help="which animal, if the file has several")
    group.add_argument("--camera", metavar="N", help="which camera, if the file has several")


def reading(args: argparse.Namespace) -> dict[str, Any]:
    """The arguments of `read_tracks`."""
    words = ("unit", "scale", "y", "rate", "markers", "origin", "axis", "confidence", "animal")
    return {name: getattr(args, name) for name in (*words, "camera")}


def names(text: str) -> tuple[str, ...]:
    """``youngs_modulus,bending_damping``."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def pair(text: str) -> tuple[float, float]:
    """``0.1,-0.2``."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form X,Y") from None
    return x, y
