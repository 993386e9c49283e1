"""Promises of `rodgym fit --machine fin` on synthetic recordings: cases, and what came out."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from rodgym import lab
from rodgym.lab.bench import Flaws
from rodgym.lab.fin_bench import FinBench, record_fin
from rodgym.sim import Fin

FIELDS = ("case", "seed", "parameter", "truth", "error", "sd", "named", "refused", "holdout",
          "cpu_s")  # fmt: skip
#: Amplitudes [deg] of sixteen experiments in air.
AMPLITUDES = (4.0, 6.0, 8.0, 10.0)


@dataclass(frozen=True)
class Case:
    """A kind of recordings."""

    title: str
    films: int
    free: tuple[str, ...]
    #: Of the drive in air [Hz].
    frequencies: tuple[float, ...] = ()


AIR = (
    "in air, {} 16 experiments of 4 s at 30 Hz with 0.5 mm noise, E 0.25 MPa; a continuous one by "
    "backward Euler at 0.07 ms; camera calibrated to 0.2 %"
)
CASES = {
    "water": Case(
        "in water, ten periods, camera at 30 Hz with 0.5 mm noise, thrust at 300 Hz with 5 mN "
        "noise; a continuous one by backward Euler at 0.07 ms; scale, tilt, clamp, clock, gain and "
        "bias unknown",
        100,
        ("youngs_modulus", "drag_coefficient", "added_mass_coefficient"),
    ),
    "air": Case(
        AIR.format("the thesis' frequencies of 0.5, 1, 1.5 and 2 Hz:"),
        20,
        ("youngs_modulus", "damping"),
        (0.5, 1.0, 1.5, 2.0),
    ),
    "faster": Case(
        AIR.format("frequencies of 1, 2, 3 and 4 Hz:"),
        20,
        ("youngs_modulus", "damping"),
        (1.0, 2.0, 3.0, 4.0),
    ),
}

HEADS = {"water": "fin in water", "air": "fin in air", "faster": "fin in air, pitched faster"}


def geometry() -> dict[str, object]:
    """The thesis' fin with a tail that is 1 mm thick."""
    shape = Fin().config["geometry"]
    shape["widths"][-1], shape["areas"][-1] = 1e-3, 1e-3 * shape["height"]
    return shape


def fitted(name: str, seed: int) -> list[dict[str, object]]:
    """One fin, fitted: a line for each parameter."""
    random, shape = np.random.default_rng(seed), geometry()
    flaws = Flaws(
        scale=random.uniform(0.95, 1.05),
        tilt=random.uniform(-0.05, 0.05),
        base=tuple(random.uniform(-0.02, 0.02, 2)),
        clock=random.normal(0.0, 0.01),
    )
    if name == "water":
        truth = {
            "youngs_modulus": 3.5e5 * float(np.exp(random.uniform(-0.5, 0.5))),
            "drag_coefficient": random.uniform(1.0, 2.0),
            "added_mass_coefficient": random.uniform(0.4, 0.8),
        }
        bench = FinBench(
            fin={**truth, "geometry": shape},
            amplitude=random.uniform(0.12, 0.18),
            frequency=random.uniform(1.2, 1.8),
            flaws=flaws,
            gain=random.normal(1.0, 0.02),
            bias=random.normal(0.0, 0.03),
            clamp=random.normal(0.0, 0.01),
        )
        recordings, known, scale = [record_fin(bench, seed)], {"geometry": shape}, 0.1
    else:
        truth = {"youngs_modulus": 2.5e5, "damping": 0.1238}
        air = {"hydrodynamics": "air", "geometry": shape}
        calibrated = Flaws(
            scale=random.normal(1.0, 0.002), tilt=flaws.tilt, base=flaws.base, clock=flaws.clock
        )
        clamp = random.normal(0.0, 0.01)
        benches = [
            FinBench(
                fin={**truth, **air},
                amplitude=float(np.radians(a)),
                frequency=f,
                periods=4.0 * f,
                flaws=calibrated,
                noise={},
                clamp=clamp,
            )
            for a in AMPLITUDES
            for f in CASES[name].frequencies
        ]
        recordings = [record_fin(bench, 100 * seed + i) for i, bench in enumerate(benches)]
        known, scale = air, 0.002
    began = time.process_time()
    line: dict[str, object] = {"case": name, "seed": seed}
    try:
        fit = lab.fit_fin(recordings, known=known, scale=scale)
    except lab.RecordingError as error:
        return [{**line, "refused": type(error).__name__, "cpu_s": time.process_time() - began}]
    line |= {"cpu_s": time.process_time() - began, "holdout": fit.holdout.passed}
    deviations = np.sqrt(np.diag(fit.covariance))
    return [
        {
            **line,
            "parameter": parameter,
            "truth": truth[parameter],
            "error": found.value / truth[parameter] - 1,
            "sd": deviation,
            "named": parameter in fit.not_identifiable,
        }
        for (parameter, found), deviation in zip(fit.parameters.items(), deviations, strict=True)
    ]


def section(name: str, lines: list[dict[str, str]]) -> list[str]:
    """What came out of a kind of recordings."""
    case, count = CASES[name], len({line["seed"] for line in lines})
    text = [f"## {HEADS[name]}", "", f"A fin {case.title}. Number of fins: {count}."]
    if count < case.films:
        text[-1] += f" (`make lab` goes on to {case.films}.)"
    if refused := [line["refused"] for line in lines if line["refused"]]:
        text.append(f"{len(refused)} refused: {', '.join(sorted(set(refused)))}.")
    lines = [line for line in lines if not line["refused"]]
    text += [
        "",
        "| | median error | largest | deviation of the fit | in the 95 % interval "
        "| rms of error / sd |",
        "|---|---|---|---|---|---|",
    ]
    for parameter in case.free:
        own = [line for line in lines if line["parameter"] == parameter]
        error = np.array([float(line["error"]) for line in own])
        deviation = np.array([float(line["sd"]) for line in own])
        pull = np.log1p(error) / deviation
        numbers = (np.median(np.abs(error)), np.abs(error).max(), np.median(deviation))
        cells = " | ".join(f"{100 * value:.2g} %" for value in numbers)
        inside, rms = 100 * np.mean(np.abs(pull) < 1.96), np.sqrt(np.mean(pull**2))
        text.append(f"| {parameter} | {cells} | {inside:.0f} % | {rms:.2f} |")
    each = {line["seed"]: line for line in lines}.values()
    passed = sum(line["holdout"] == "True" for line in each)
    cpu = np.median([float(line["cpu_s"]) for line in each])
    text += [
        "",
        f"Hold-out passed in {passed} of {len(each)}. CPU time of a fit: median {cpu:.0f} s.",
    ]
    return [*text, ""]
