"""From a film to a policy: `rodgym track`, `fit` and `distil`, as a user calls them, and what the
student does with the rod that was filmed.

The film is *synthetic*: a rod of 241 nodes through the thesis' lens. The student learns on the
fitted twin, of as many nodes as it needs, and is judged on the true rod with more nodes than that.
"""

from __future__ import annotations

import csv
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from rodgym.lab.bench import Bench
from rodgym.lab.vision import synthetic

FIELDS = ("case", "seed", "E", "beta", "E_error", "E_sd", "beta_error", "beta_sd", "named",
          "holdout", "track_s", "fit_s", "distil_s", "wall_s", "upright", "worst")  # fmt: skip
#: Nodes of the twin and of the true rod that the student is judged on; episodes. (The torque bends
#: the rod just beside the hinge: the first edge of few nodes does not turn as the rod does there.)
TWIN, TRUE, EPISODES = 25, 49, 100
SENSORS = {"sensor_noise": {"angle": 1e-3, "rate": 1e-2}}


@dataclass(frozen=True)
class Case:
    """Films of a kind; of the first ones a student is taught."""

    films: int
    students: int


CASES = {"film": Case(20, 3)}


def called(folder: Path, *words: object) -> tuple[float, str]:
    """CPU time of a command and what it says."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    line = [sys.executable, "-m", "rodgym", *map(str, words)]
    done = subprocess.run(line, cwd=folder, check=True, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout


def fitted(name: str, seed: int, first: int, runs: Path) -> list[dict[str, object]]:
    """One film, tracked and fitted; of the first ones a student."""
    random = np.random.default_rng(seed)
    rod = {
        "youngs_modulus": 1e7 * float(np.exp(random.uniform(-0.3, 0.3))),
        "bending_damping": 6e-4 * float(np.exp(random.uniform(-0.7, 0.7))),
    }
    folder = runs / "lab" / f"{name}-{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    bench = Bench(
        rod=rod,
        angle=random.uniform(0.9, 1.3),
        bend=random.choice([-1, 1]) * random.uniform(0.4, 0.8),
    )
    synthetic.film(folder / "film.mp4", bench, seed=seed)
    known = [
        f"--known={k}={v}" for k, v in {"width": 0.007, "length": 0.3, "density": 1500}.items()
    ]
    began = time.monotonic()
    line: dict[str, object] = {"case": name, "seed": seed}
    line |= {"E": rod["youngs_modulus"], "beta": rod["bending_damping"]}
    line["track_s"], _ = called(folder, "track", "film.mp4", "--board", "10x7:7.34mm")
    fit = ["fit", "track/tracks.csv", *known, "--nodes", TWIN, "--out", "fit"]
    line["fit_s"], _ = called(folder, *fit)
    found = yaml.safe_load((folder / "fit" / "rod.yml").read_text(encoding="utf-8"))
    for short, parameter in (("E", "youngs_modulus"), ("beta", "bending_damping")):
        best = found["parameters"].get(parameter)
        if best:
            line[f"{short}_error"] = best["value"] / rod[parameter] - 1
            line[f"{short}_sd"] = float(np.log(best["high"] / best["low"])) / (2 * 1.96)
    line |= {"named": " ".join(found["not_identifiable"]), "holdout": found["holdout"]["passed"]}
    if seed < first + CASES[name].students:
        line["distil_s"], _ = called(
            folder, "distil", "--rod", "fit/rod.yml", "--name", "mine", "--force"
        )
        line["wall_s"] = time.monotonic() - began
        true = [f"--env-arg={k}={v}" for k, v in {"nodes": TRUE, **rod, **SENSORS}.items()]
        called(folder, "evaluate", "runs/mine/policy.zip", "--env", "PendulumSwingUpBase", *true,
               "--seeds", EPISODES, "--name", "true")  # fmt: skip
        with (folder / "runs" / "true" / "scores.csv").open(encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
        line["upright"] = sum(float(row["upright"]) > 0.5 for row in rows)
        line["worst"] = min(float(row["return"]) for row in rows)
    (folder / "film.mp4").unlink()
    return [line]


def section(name: str, lines: list[dict[str, str]]) -> list[str]:
    """What came out of films, and of the students."""
    case = CASES[name]
    text = [
        "## film to policy",
        "",
        f"Films of a continuous rod through the thesis' lens: `rodgym track`, then `rodgym fit "
        f"--nodes {TWIN}`; of {case.students} of them `rodgym distil --rod fit/rod.yml`, too. "
        f"Number of films: {len(lines)}.",
    ]
    if len(lines) < case.films:
        text[-1] += f" (`make lab` goes on to {case.films}.)"
    text += ["", "| | median error | largest | in the 95 % interval | rms of error / sd |"]
    text += ["|---|---|---|---|---|"]
    told = [line for line in lines if not line["named"]]
    for short, title in (("E", "E"), ("beta", "bending damping")):
        error = np.array([float(line[f"{short}_error"]) for line in told])
        pull = np.log1p(error) / [float(line[f"{short}_sd"]) for line in told]
        size, inside = 100 * np.abs(error), 100 * np.mean(np.abs(pull) < 1.96)
        cells = f"{np.median(size):.2g} % | {size.max():.2g} % | {inside:.0f} %"
        text.append(f"| {title} | {cells} | {np.sqrt(np.mean(pull**2)):.2f} |")
    passed = sum(line["holdout"] == "True" for line in lines)
    track, fit = (
        np.median([float(line[f"{what}_s"]) for line in lines]) for what in ("track", "fit")
    )
    text += [
        "",
        f"Hold-out passed in {passed} of {len(lines)}. CPU time, median: track {track:.0f} s,",
    ]
    text += [f"fit {fit:.0f} s."]
    if taught := [line for line in lines if line["upright"]]:
        text += ["", f"The true rod, of {TRUE} nodes, with sensor noise, from hanging:", ""]
        text += ["| E | upright | worst return | CPU time of all three | wall time |"]
        text += ["|---|---|---|---|---|"]
    for line in taught:
        cpu = sum(float(line[f"{what}_s"]) for what in ("track", "fit", "distil"))
        text.append(
            f"| {1e-6 * float(line['E']):.2f} MPa | {line['upright']} of {EPISODES} "
            f"| {float(line['worst']):.0f} | {cpu:.0f} s | {float(line['wall_s']):.0f} s |"
        )
    return [*text, ""]
