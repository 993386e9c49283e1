"""One bench from start to end: measures, judges, writes."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import rodgym._native
from rodgym.bench import facts, ours, precision, report
from rodgym.bench.measure import Case, Ratio, Timing, measure, ratio
from rodgym.bench.peers import BEST_MUJOCO, peers
from rodgym.extras import installed, missing
from rodgym.runs import Run

DEFAULT = "PendulumSwingUp, n = 1024"
TWO_THREADS = "PendulumSwingUp, n = 1024, 2 threads"
THESIS = "thesis (backward Euler 0.1 ms), n = 1024"
#: Rods beside the default: name, keywords, environment steps/s to reach (None: only stated).
OTHERS: tuple[tuple[str, dict[str, Any], float | None], ...] = (
    ("21 nodes", {"nodes": 21}, 200_000.0),
    ("31 nodes", {"nodes": 31}, 100_000.0),
    ("101 nodes", {"nodes": 101}, 30_000.0),
    ("1e9 Pa", {"youngs_modulus": 1e9}, None),
    ("1e9 Pa, no damping", {"youngs_modulus": 1e9, "bending_damping": 0.0}, None),
    ("steel, 2e11 Pa", {"youngs_modulus": 2e11}, None),
)
SINGLE = "PendulumSwingUp, env.unwrapped.step"
WRAPPED = "PendulumSwingUp, env.step of gym.make"
#: Environment steps/s that the default pendulum should reach, by instruction set.
WANTED = {"avx512": 1_900_000.0, "avx2": 900_000.0}


@dataclass(frozen=True)
class Extent:
    """How much is measured: rounds of turns, and CPU seconds of a turn."""

    rounds: int
    seconds: float
    sizes: Sequence[int]
    threads: Sequence[int]
    sweep_rounds: int
    rollouts: int


QUICK = Extent(7, 0.02, (1, 64, 1024), (1,), 3, 1)
FULL = Extent(21, 0.05, (1, 8, 64, 1024, 8192), (1, 2), 5, 3)


def bench(run: Run, extent: Extent) -> str:
    """Measures everything, writes tables and plot into the run's folder, returns the page."""
    began = time.monotonic()
    run.facts |= machine()

    def say(what: str) -> None:
        print(f"[{time.monotonic() - began:5.0f} s] {what} ...", flush=True)

    if said := missing(["matplotlib"]):
        print(f"no picture of error against cost: {said}", flush=True)
    say("headline cases and other simulators")
    headline = measure(headline_cases(), extent.rounds, extent.seconds)
    found = {timing.name: timing for timing in headline}
    report.write_timings(run, "peers.csv", headline)
    say("instruction sets, memory")
    sets = facts.instruction_sets(extent.sweep_rounds)
    built = facts.in_new_process("construction")
    training = None
    if all(installed(module) for module in ("stable_baselines3", "yaml")):
        say("share of a training")
        training = facts.training_share(extent.rollouts)
    say("work and precision")
    points = precision.points(extent.sweep_rounds, extent.seconds)
    precision_table = report.write_precision(run, points)
    sweep = {}
    for name, env_id, kwargs in ours.machines():
        say(f"batches of {name}")
        sweep[name] = throughput(name, env_id, kwargs, extent)
    report.write_timings(
        run, "throughput.csv", [timing for row in sweep.values() for timing in row.values()]
    )
    targets = judge(found, sets, built, training, points)
    page = write_page(run, targets, headline, sets, precision_table, sweep)
    run.facts |= {"instruction_sets": sets, "construction": built, "training": training}
    run.write_facts()
    say("done")
    return page


def machine() -> dict[str, object]:
    """The processor, what is used of it, and how busy it was when the bench began."""
    name = platform.processor()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        name = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    return {
        "processor": name,
        "instruction_set": rodgym._native.instruction_set(),
        "load_average": round(load, 1),
    }


def headline_cases() -> list[Case]:
    """What the targets speak of, and all peers."""
    cases = [
        ours.batch(DEFAULT, ours.SWING_UP, 1024),
        ours.batch(TWO_THREADS, ours.SWING_UP, 1024, threads=2),
        ours.batch(THESIS, ours.SWING_UP, 1024, thesis=True),
        *(
            ours.batch(f"{name}, n = 1024", ours.SWING_UP, 1024, **kwargs)
            for name, kwargs, _ in OTHERS
        ),
        *ours.layer_cases(1024),
        ours.single(SINGLE, ours.SWING_UP, wrapped=False),
        ours.single(WRAPPED, ours.SWING_UP, wrapped=True),
        ours.batch(FIN_CASE, ours.FIN, 1024),
    ]
    return [*cases, *peers()]


FIN_CASE = "FinThrust (40 ms a step), n = 1024"


def throughput(
    name: str, env_id: str, kwargs: Mapping[str, object], extent: Extent
) -> dict[tuple[int, int], Timing]:
    """One machine in batches of every size, by (number of environments, threads).

    The single environment of ``gym.make``, unwrapped, goes as size ``report.SINGLE``.
    """
    keys = [(n, t) for n in extent.sizes for t in extent.threads]
    cases = [ours.batch(f"{name}; n={n}; threads={t}", env_id, n, t, **kwargs) for n, t in keys]
    keys.append((report.SINGLE, 1))
    cases.append(ours.single(f"{name}; single", env_id, wrapped=False, **kwargs))
    timings = measure(cases, extent.sweep_rounds, 0.5 * extent.seconds)
    return dict(zip(keys, timings, strict=True))


def judge(
    found: Mapping[str, Timing],
    sets: Mapping[str, float],
    built: Mapping[str, float],
    training: Mapping[str, float] | None,
    points: Sequence[precision.Point],
) -> list[report.Target]:
    """What was promised against what came out."""
    rate = "environment steps/s (CPU), n = 1024, one thread"
    targets = [
        report.at_least(f"default pendulum, {name}: {rate}", sets[name], wanted)
        for name, wanted in WANTED.items()
        if name in sets
    ]
    targets.append(report.at_least(f"thesis mode: {rate}", found[THESIS].cpu_rate, 80_000))
    targets += [
        report.at_least(f"{name}: {rate}", found[f"{name}, n = 1024"].cpu_rate, wanted)
        for name, _, wanted in OTHERS
        if wanted is not None
    ]
    if FIN_CASE in found:
        fin = found[FIN_CASE].cpu_rate
        targets += [
            report.at_least(f"fin: {rate}", fin, 126_000),
            report.at_least("fin: real-time factor", 0.04 * fin, 800),
        ]
    if BEST_MUJOCO in found:
        times = ratio(found[BEST_MUJOCO], found[DEFAULT])
        spread = f" ({times.low:.3g} to {times.high:.3g})"
        targets.append(
            report.at_least("default pendulum over MuJoCo's best", times.median, 30, spread)
        )
        error = {(p.family, p.dt): 1e3 * p.error for p in points}
        own, best = error["rodgym Verlet", 5e-4], error["MuJoCo chain RK4", 5e-3]
        targets.append(report.at_most("its error beside MuJoCo's", own, best, " mm"))
    two = ratio(found[DEFAULT], found[TWO_THREADS])
    spread = f" ({two.low:.3g} to {two.high:.3g})"
    targets.append(report.at_least("two threads over one (wall clock)", two.median, 1.85, spread))
    short, long = (found[case] for case in LAYER)
    share = 100.0 * ours.layer_share(short.cpu, long.cpu)
    low, median, high = np.percentile(share, [25, 50, 75])
    spread = f" ({low:.3g} to {high:.3g})"
    targets += [
        report.at_most("batch layer over bare physics, n = 1024", median, 15, " %", spread),
        report.at_most("env.unwrapped.step", 1e6 * found[SINGLE].cost, 5.5, " us"),
        report.at_most("make_vec of 8192 environments (CPU)", built["cpu"], 0.2, " s"),
        report.at_most("memory an environment", built["bytes"] / 1024, 4, " KiB"),
    ]
    if training is not None:
        value = 100.0 * training["share"]
        targets.append(
            report.at_most("share of PPO's wall time in the environment", value, 10, " %")
        )
    return targets


LAYER = [f"PendulumSwingUp, step of {1e3 * dt:g} ms" for dt in (ours.SHORT, ours.LONG)]


def write_page(
    run: Run,
    targets: Sequence[report.Target],
    headline: Sequence[Timing],
    sets: Mapping[str, float],
    precision_table: str,
    sweep: Mapping[str, Mapping[tuple[int, int], Timing]],
) -> str:
    """``bench.md``: all tables, and how they were made."""
    best = next((t for t in headline if t.name == BEST_MUJOCO), None)
    ratios: dict[str, Ratio] = {}
    if best is not None:
        ratios = {t.name: ratio(best, t) for t in headline if same_step(t.name)}
    facts_line = "; ".join(
        f"{key.replace('_', ' ')} {run.facts[key]}"
        for key in ("processor", "machine", "instruction_set", "load_average", "date")
    )
    parts = [
        "# Measured speed",
        f"`{run.facts['command']}`: {facts_line}.",
        "Medians of rounds in which all cases take turns; ratios are taken round by round, with "
        "quartiles in brackets. CPU time is that of the stepping thread. A load average near the "
        "number of cores means that others were at work: trust CPU time and ratios then.",
        "## Targets",
        report.targets_table(targets),
        "## Beside other simulators",
        f"The ratio says how many times cheaper a step is than that of *{BEST_MUJOCO}*, by CPU "
        "time where both work in one thread. Peers are timed without observation and reward.",
        report.peers_table(headline, ratios),
        "By instruction set, default pendulum, n = 1024, one thread, steps/s of CPU: "
        + ", ".join(f"{name} {report.number(value)}" for name, value in sets.items())
        + ".",
        "## Error against cost",
        *(["![Error against cost](work_precision.png)"] if installed("matplotlib") else []),
        precision_table,
    ]
    for threads in sorted({t for row in sweep.values() for _, t in row}):
        many = "one thread" if threads == 1 else f"{threads} threads"
        parts.append(f"## Environment steps/s, {many}")
        if threads == 1:
            parts += ["Of CPU time:", report.throughput_table(sweep, 1, cpu=True)]
        parts += ["Of wall clock:", report.throughput_table(sweep, threads, cpu=False)]
    page = "\n\n".join(parts) + "\n"
    run.file("bench.md").write_text(page, encoding="utf-8")
    return page


def same_step(name: str) -> bool:
    """Whether a case steps the pendulum of Table 4.1 by 10 ms, so that a ratio says something."""
    others = ("rigid", "40 ms", "Fin")
    return not any(word in name for word in others)
