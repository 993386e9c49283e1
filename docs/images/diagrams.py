"""Draws the diagrams of the documentation: `python docs/images/diagrams.py`. Needs nothing."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

HERE = Path(__file__).parent
INK, FAINT, ROD, FORCE, WATER = "#1f2937", "#9ca3af", "#ea580c", "#7c3aed", "#2563eb"
Point = tuple[float, float]


class Sheet:
    """Shapes on white paper, written as SVG."""

    def __init__(self, width: int, height: int) -> None:
        self.size = (width, height)
        self.shapes: list[str] = []

    def line(self, points: list[Point], color: str = INK, width: float = 2, dash: str = "") -> None:
        """A line through points."""
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        self.shapes.append(
            f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="{width}"'
            f' stroke-linecap="round" stroke-linejoin="round"{dashed}/>'
        )

    def arrow(self, points: list[Point], color: str = INK, width: float = 2) -> None:
        """A line with a head at its last point."""
        self.line(points, color, width)
        (x0, y0), (x1, y1) = points[-2:]
        way = math.atan2(y1 - y0, x1 - x0)
        head = [
            (x1 - 11 * math.cos(way + turn), y1 - 11 * math.sin(way + turn)) for turn in (-0.4, 0.4)
        ]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in [(x1, y1), *head])
        self.shapes.append(f'<polygon points="{path}" fill="{color}"/>')

    def disc(self, at: Point, radius: float, fill: str = "white", color: str = INK) -> None:
        """A disc with a rim."""
        self.shapes.append(
            f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{radius}" fill="{fill}"'
            f' stroke="{color}" stroke-width="2"/>'
        )

    def text(
        self, at: Point, words: str, color: str = INK, size: int = 17, anchor: str = ""
    ) -> None:
        """Words that begin at a point, or end or stand in the middle there."""
        placed = f' text-anchor="{anchor}"' if anchor else ""
        self.shapes.append(
            f'<text x="{at[0]:.1f}" y="{at[1]:.1f}" fill="{color}" font-size="{size}"{placed}>'
            f"{words}</text>"
        )

    def box(self, at: Point, size: Point, title: str, lines: list[str], fill: str) -> None:
        """A titled box."""
        (x, y), (width, height) = at, size
        self.shapes.append(
            f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="10" fill="{fill}"'
            f' stroke="{INK}" stroke-width="1.5"/>'
        )
        self.shapes.append(
            f'<text x="{x + width / 2}" y="{y + 27}" fill="{INK}" font-size="18"'
            f' font-weight="bold" text-anchor="middle">{title}</text>'
        )
        for i, line in enumerate(lines):
            self.text((x + width / 2, y + 50 + 21 * i), line, size=15, anchor="middle")

    def write(self, name: str, title: str) -> None:
        """Writes the file."""
        width, height = self.size
        (HERE / name).write_text(
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}"'
            f' width="{width}" height="{height}" role="img" font-family="sans-serif">\n'
            f"<title>{title}</title>\n"
            f'<rect width="{width}" height="{height}" fill="white"/>\n'
            + "\n".join(self.shapes)
            + "\n</svg>\n",
            encoding="utf-8",
        )


def arc(center: Point, radius: float, start: float, end: float) -> list[Point]:
    """Points of a circle, angles in degrees, counter-clockwise from the right."""
    (x, y), steps = center, 40
    turns = [math.radians(start + (end - start) * i / steps) for i in range(steps + 1)]
    return [(x + radius * math.cos(t), y - radius * math.sin(t)) for t in turns]


def chain(base: Point, length: float, angles: list[float]) -> Iterator[Point]:
    """Nodes of a rod whose edges have these angles [rad], counter-clockwise from hanging."""
    x, y = base
    yield base
    for angle in angles:
        x, y = x + length * math.sin(angle), y + length * math.cos(angle)
        yield (x, y)


def pendulum() -> None:
    """Hinge, torque, edge angles, axes."""
    sheet, base, edge = Sheet(600, 440), (270.0, 90.0), 52.0
    angles = [0.45, 0.62, 0.80, 0.96, 1.08, 1.16]
    nodes = list(chain(base, edge, angles))
    sheet.line([base, (base[0], 410)], FAINT, 1.5, "6 6")
    sheet.text((base[0] - 8, 408), "hanging: theta = 0", FAINT, 15, "end")
    sheet.line([base, (base[0], 26)], FAINT, 1.5, "6 6")
    sheet.text((base[0] - 8, 34), "upright: theta = pi", FAINT, 15, "end")
    sheet.line(nodes, ROD, 9)
    for node in nodes[1:]:
        sheet.disc(node, 6)
    start = nodes[4]
    sheet.line([start, (start[0], start[1] + 80)], FAINT, 1.5, "6 6")
    sheet.arrow(arc(start, 52, -90, -90 + math.degrees(angles[4])), INK, 1.8)
    sheet.text((start[0] + 18, start[1] + 78), "theta of edge 5")
    sheet.arrow(arc(base, 34, 150, 385), FORCE, 3)
    sheet.text((base[0] + 42, base[1] - 18), "torque at action &gt; 0", FORCE)
    sheet.disc(base, 9, INK)
    sheet.text((base[0] - 44, base[1] + 34), "hinge: node 1", INK, 15, "end")
    tip = nodes[-1]
    sheet.text((tip[0] + 14, tip[1] + 2), "tip: node 7 (x, y)")
    sheet.arrow([(60, 250), (60, 190)])
    sheet.arrow([(60, 250), (120, 250)])
    sheet.text((54, 180), "y")
    sheet.text((128, 255), "x")
    sheet.arrow([(90, 300), (90, 350)], WATER)
    sheet.text((100, 332), "gravity", WATER, 15)
    sheet.write("pendulum-coordinates.svg", "Coordinates of the pendulum")


def fin() -> None:
    """Nose, pivot, driven edge, flow, thrust, axes; seen from above."""
    sheet = Sheet(720, 330)
    pitch, edge, pivot = 0.22, 62.0, (250.0, 165.0)
    bends = [pitch, 0.17, 0.08, -0.05, -0.2]
    nodes = [pivot]
    for angle in bends:
        x, y = nodes[-1]
        nodes.append((x + edge * math.cos(angle), y - edge * math.sin(angle)))
    front = [
        (pivot[0] - k * edge * math.cos(pitch), pivot[1] + k * edge * math.sin(pitch))
        for k in (2, 1)
    ]
    nodes = [*front, *nodes]
    for i, (a, b) in enumerate(pairwise(nodes)):
        sheet.line([a, b], ROD, 16 - 1.8 * i)
    for node in nodes:
        sheet.disc(node, 5)
    sheet.line([(110, 165), (640, 165)], FAINT, 1.5, "6 6")
    sheet.arrow(arc(pivot, 150, 0, math.degrees(pitch)), FORCE, 2.4)
    sheet.text((406, 122), "pitch &gt; 0", FORCE)
    sheet.disc(pivot, 8, INK)
    sheet.text((pivot[0] - 18, pivot[1] - 34), "pivot: node 3", INK, 15, "middle")
    sheet.text((nodes[0][0], nodes[0][1] + 32), "nose: node 1", INK, 15, "middle")
    sheet.text((nodes[-1][0] + 14, nodes[-1][1] + 4), "tail: node 8", INK, 15)
    for y in (40, 262, 290):
        sheet.arrow([(30, y), (100, y)], WATER, 2)
    sheet.text((110, 46), "water, flow_speed &gt; 0", WATER)
    sheet.arrow([(560, 280), (470, 280)], ROD, 5)
    sheet.text((570, 286), "thrust &gt; 0", ROD)
    sheet.arrow([(620, 90), (620, 40)])
    sheet.arrow([(620, 90), (672, 90)])
    sheet.text((614, 30), "y")
    sheet.text((680, 95), "x")
    sheet.write("fin-coordinates.svg", "Coordinates of the fin, seen from above")


def architecture() -> None:
    """Who calls whom."""
    sheet, left = Sheet(880, 430), 150
    program = "your program: Gymnasium, Stable-Baselines3, RLlib, the command line"
    sheet.text((left + 350, 32), program, INK, 16, "middle")
    sheet.arrow([(left + 350, 42), (left + 350, 66)])
    python = [
        "environments and batches, evaluation, training, reports",
        "translates; computes no physics",
    ]
    sheet.box((left, 68), (700, 92), "Python package", python, "#fef3c7")
    for x, name, lines, fill in (
        (left, "server", ["protocol, sessions,", "keys, limits"], "#dbeafe"),
        (left + 240, "controllers", ["regulators, filters,", "Riccati equations"], "#ede9fe"),
        (left + 480, "pictures", ["raster and SVG,", "no display needed"], "#dcfce7"),
    ):
        sheet.arrow([(x + 110, 160), (x + 110, 192)])
        sheet.box((x, 194), (220, 92), name, lines, fill)
        sheet.arrow([(x + 110, 286), (x + 110, 318)])
    core = [
        "rods, water, time steps, machines, tasks, batches in vector lanes and threads",
        "knows neither Python nor the network",
    ]
    sheet.box((left, 320), (700, 92), "core", core, "#ffedd5")
    sheet.text((8, 236), "clients in")
    sheet.text((8, 258), "any language")
    sheet.arrow([(112, 246), (146, 246)])
    sheet.write(
        "architecture.svg", "Python calls the extension in Rust; dependencies point down only"
    )


if __name__ == "__main__":
    pendulum()
    fin()
    architecture()
