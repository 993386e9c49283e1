"""Promises of `rodgym fit` on synthetic films, and the page of what came out.

Every film is one line of `runs/lab/films.csv`, every fin some of `fins.csv`; what is there already
is not made again, so that the program may be stopped and started. The seeds are apart from those
that the fit was tuned with.
"""

from __future__ import annotations

import argparse
import csv
import datetime
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import lab_film
import lab_fins
import numpy as np
from rodgym import lab
from rodgym.lab.bench import ROD, Bench, Flaws, record

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "lab-proofs.md"
FIELDS = ("case", "seed", "E", "beta", "E_error", "E_sd", "beta_error", "beta_sd", "named",
          "refused", "misfit", "holdout", "cpu_s")  # fmt: skip
BOTH = ("youngs_modulus", "bending_damping")
#: Seeds of reported films begin here.
FIRST = 60_000


@dataclass(frozen=True)
class Case:
    """A kind of film."""

    title: str
    films: int
    free: tuple[str, ...] = BOTH
    nodes: int | None = None
    #: Flaws on top of noise, scale, tilt and place.
    flaws: Flaws = field(default_factory=Flaws)
    still: bool = False
    #: Parameters that must be named as not identifiable.
    named: tuple[str, ...] = ()


CASES = {
    "continuous": Case("241 nodes, 0.5 mm noise; scale, tilt, hinge and start unknown", 500),
    "seven": Case("the same with 7 nodes, which is known", 500, nodes=7),
    "dirty": Case(
        "continuous, 10 % outliers, 20 % lost frames, two markers swapped for a second", 100,
        flaws=Flaws(outliers=0.1, dropped=0.2, swapped=(3, 5)),
    ),
    "still": Case("a rod that hangs still", 100, nodes=7, still=True, named=BOTH),
    "density": Case(
        "E and density both free", 100, ("youngs_modulus", "density", "bending_damping"), nodes=7,
        named=("youngs_modulus", "density"),
    ),
}  # fmt: skip


def bench(case: Case, seed: int) -> tuple[Bench, dict[str, float]]:
    """A film's hidden rod, and where its fit starts: off by 4 times, up or down."""
    random = np.random.default_rng(seed)
    rod = {
        "youngs_modulus": 1e7 * np.exp(random.uniform(-0.7, 0.7)),
        "bending_damping": 6e-4 * np.exp(random.uniform(-0.7, 0.7)),
    }
    start = {name: value * 4.0 ** random.choice([-1, 1]) for name, value in rod.items()}
    flaws = replace(
        case.flaws,
        scale=random.uniform(0.95, 1.05),
        tilt=random.uniform(-0.1, 0.1),
        base=tuple(random.uniform(-0.02, 0.02, 2)),
    )
    angle, bend = random.uniform(0.6, 1.4), random.choice([-1, 1]) * random.uniform(0.4, 0.8)
    if case.still:
        angle = bend = 0.0
    if case.nodes:
        rod["nodes"] = case.nodes
    return Bench(rod=rod, angle=angle, bend=bend, flaws=flaws), start


def fitted(name: str, seed: int) -> dict[str, object]:
    """One film, fitted: a line of the table."""
    case = CASES[name]
    hidden, start = bench(case, seed)
    (film,) = record([hidden], [seed])
    known = {"width": ROD["width"], "length": ROD["length"]}
    known |= {"nodes": case.nodes} if case.nodes else {}
    line: dict[str, object] = {"case": name, "seed": seed}
    line |= {"E": hidden.rod["youngs_modulus"], "beta": hidden.rod["bending_damping"]}
    began = time.process_time()
    try:
        fit = lab.fit(film, case.free, known, start)
    except lab.RecordingError as error:
        return {**line, "refused": type(error).__name__, "cpu_s": time.process_time() - began}
    line["cpu_s"] = time.process_time() - began
    deviations = dict(zip(fit.parameters, np.sqrt(np.diag(fit.covariance)), strict=True))
    for short, parameter in (("E", BOTH[0]), ("beta", BOTH[1])):
        line[f"{short}_error"] = fit.parameters[parameter].value / hidden.rod[parameter] - 1
        line[f"{short}_sd"] = deviations[parameter]
    named = " ".join(fit.not_identifiable)
    return {**line, "named": named, "misfit": fit.misfit, "holdout": fit.holdout.passed}


def read(path: Path) -> list[dict[str, str]]:
    """The lines that are there."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def section(name: str, lines: list[dict[str, str]]) -> list[str]:
    """What came out of a kind of film."""
    case, count = CASES[name], len(lines)
    text = [f"## {name}", "", f"{case.title[0].upper()}{case.title[1:]}: {count} films."]
    if count < case.films:
        text[-1] += f" (`make lab` goes on to {case.films}.)"
    refused = [line for line in lines if line["refused"]]
    if refused:
        text.append(
            f"{len(refused)} refused: {', '.join(sorted({r['refused'] for r in refused}))}."
        )
    lines = [line for line in lines if not line["refused"]]
    if case.named:
        told = sum(set(case.named) <= set(line["named"].split()) for line in lines)
        text.append(f"{' and '.join(case.named)} named as not identifiable in {told} of {count}.")
        return [*text, ""]
    if vague := [line for line in lines if line["named"]]:
        text.append(f"{len(vague)} say that the film does not tell E or the damping.")
        lines = [line for line in lines if not line["named"]]
    text += [
        "",
        "| | median error | 95th of 100 | largest | in the 95 % interval | rms of error / sd |",
    ]
    text += ["|---|---|---|---|---|---|"]
    for short, title in (("E", "E"), ("beta", "bending damping")):
        error = np.array([float(line[f"{short}_error"]) for line in lines])
        pull = np.log1p(error) / [float(line[f"{short}_sd"]) for line in lines]
        size = 100 * np.abs(error)
        inside = 100 * np.mean(np.abs(pull) < 1.96)
        numbers = (np.median(size), np.percentile(size, 95), size.max())
        cells = " | ".join(f"{value:.2g} %" for value in numbers)
        rms = np.sqrt(np.mean(pull**2))
        text.append(f"| {title} | {cells} | {inside:.1f} % | {rms:.2f} |")
    cpu = np.array([float(line["cpu_s"]) for line in lines])
    passed = sum(line["holdout"] == "True" for line in lines)
    silent = sum(abs(float(line["E_error"])) > 0.05 and not line["named"] for line in lines)
    text += ["", f"Hold-out passed in {passed} of {len(lines)}; E off by more than 5 % without a"]
    text += [f"word in {silent}. CPU time of a fit: median {np.median(cpu):.1f} s."]
    return [*text, ""]


def write_page(
    lines: list[dict[str, str]], fins: list[dict[str, str]], films: list[dict[str, str]]
) -> None:
    """Writes the page."""
    date = datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%d %H:%M UTC")
    text = [
        "# Fits of synthetic films",
        "",
        f"Written by `make lab` on {date}. Every film is *synthetic*: a rod with E from 5 to 20",
        "MPa and bending damping from 0.3 to 1.2 ms, let go bent, 3 s at 30 Hz, 7 markers. Fits",
        f"start off by 4 times in both. Seeds from {FIRST} on, which were not used for any choice.",
        "",
    ]
    for name in CASES:
        mine = [line for line in lines if line["case"] == name]
        text += section(name, mine) if mine else []
    for name in lab_fins.CASES:
        mine = [line for line in fins if line["case"] == name]
        text += lab_fins.section(name, mine) if mine else []
    for name in lab_film.CASES:
        mine = [line for line in films if line["case"] == name]
        text += lab_film.section(name, mine) if mine else []
    PAGE.write_text("\n".join(text), encoding="utf-8")


def main() -> None:
    """Makes the films that are missing, then the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    every = {**CASES, **lab_fins.CASES, **lab_film.CASES}
    parser.add_argument("--cases", nargs="+", choices=every, default=list(every))
    parser.add_argument("--films", type=int, default=10**9, help="at most so many of each case")
    parser.add_argument("--runs", type=Path, default=ROOT / "runs")
    args = parser.parse_args()
    folder = args.runs / "lab"
    folder.mkdir(parents=True, exist_ok=True)
    tables = [folder / f"{name}.csv" for name in ("films", "fins", "policies")]
    films, fins, policies = tables
    there = {(line["case"], int(line["seed"])) for path in tables for line in read(path)}
    for name in args.cases:
        for seed in range(FIRST, FIRST + min(args.films, every[name].films)):
            if (name, seed) in there:
                continue
            if name in CASES:
                write(films, FIELDS, [fitted(name, seed)])
            elif name in lab_fins.CASES:
                write(fins, lab_fins.FIELDS, lab_fins.fitted(name, seed))
            else:
                lines = lab_film.fitted(name, seed, FIRST, args.runs)
                write(policies, lab_film.FIELDS, lines)
    write_page(*(read(path) for path in tables))


def write(path: Path, fields: Sequence[str], lines: Sequence[dict[str, object]]) -> None:
    """Adds lines to a table."""
    with path.open("a", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, fields, lineterminator="\n")
        if stream.tell() == 0:
            writer.writeheader()
        writer.writerows(lines)
    for line in lines:
        print(line, flush=True)


if __name__ == "__main__":
    main()
