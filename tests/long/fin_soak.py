"""A million random steps of every fin: `make soak-fin` writes docs/fin-soak.md.

Stiffness log-uniform in [3e4, 1e7] Pa and flow in [0, 0.3] m/s, drawn anew each episode. Half of
the fins are told a random angle at every step, a quarter the largest angles back and forth at
random, a quarter follow sinusoids of any frequency up to half of the control rate. Counted: steps,
solver failures, numbers that are not finite or out of bounds, and how much the process grows.
"""

from __future__ import annotations

import argparse
import gc
import itertools
import os
import platform
import time
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import rodgym
import rodgym.sim

FINS = tuple(
    i for i, entry in rodgym.ENVIRONMENTS.items() if entry.machine == rodgym.sim.Fin.machine
)
STEPPERS = ("bdf2", "backward_euler")
#: Cut-off of the command's low-pass [Hz]: as usual, and none, which is rougher.
CUTOFFS = (3.0, None)
STIFFNESS = {"youngs_modulus": ("log_uniform", 3e4, 1e7)}
FLOW = {"flow_speed": (0.0, 0.3)}
PAGE = Path(__file__).parents[2] / "docs" / "fin-soak.md"
STATUS = Path("/proc/self/statm")


@dataclass
class Tally:
    """What a soak found."""

    steps: int = 0
    episodes: int = 0
    failures: int = 0
    not_finite: int = 0
    out_of_bounds: int = 0
    growth: int = 0
    seconds: float = 0.0


def resident() -> int:
    """Memory of this process in bytes (Linux)."""
    return int(STATUS.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def commands(num_envs: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Random angles, random largest angles, sinusoids: endlessly."""
    frequency = rng.uniform(0.5, 12.5, num_envs)
    phase, size = rng.uniform(0, 2 * np.pi, num_envs), rng.uniform(0, 1, num_envs)
    kind = np.arange(num_envs) % 4
    step = 0
    while True:
        sine = size * np.sin(2 * np.pi * 0.04 * frequency * step + phase)
        uniform = rng.uniform(-1, 1, num_envs)
        action = np.where(kind == 3, sine, np.where(kind == 2, np.sign(uniform), uniform))
        yield action[:, None].astype(np.float32)
        step += 1


def soak(env_id: str, steps: int, num_envs: int, seed: int = 0, **kwargs: Any) -> Tally:
    """Steps a batch `steps` times in all; memory is compared with that after a fifth of them."""
    parameters = {p["name"]: p for p in gym.make(env_id).unwrapped.core_spec["parameters"]}
    # A free swimmer's water is at rest.
    flows = {name: FLOW[name] for name in FLOW if parameters[name]["high"] > 0}
    env = gym.make_vec(
        env_id,
        num_envs=num_envs,
        autoreset_mode="SameStep",
        randomize=STIFFNESS | flows,
        **kwargs,
    )
    space, tally = env.single_observation_space, Tally()
    env.reset(seed=seed)
    began, before = time.perf_counter(), 0
    turns = -(-steps // num_envs)
    told = commands(num_envs, np.random.default_rng(seed))
    for turn in range(turns):
        if turn == turns // 5:
            gc.collect()
            before = resident()
        observation, reward, _, truncated, infos = env.step(next(told))
        tally.steps += num_envs
        tally.episodes += int(truncated.sum())
        final = infos.get("final_info", {})
        for found in (infos, final):
            tally.failures += int(np.sum(found.get("solver_failure", False)))
        # (An info of a reset has no metrics: the ended step's stand in `final_info`.)
        stepped = {
            name: v for name, v in infos.items() if not name.startswith("_") and is_number(v)
        }
        for name, value in final.items():
            if name in stepped:
                stepped[name] = np.where(truncated, value, stepped[name])
        numbers = [observation, reward, *stepped.values()]
        tally.not_finite += sum(int((~np.isfinite(n)).sum()) for n in numbers)
        outside = (observation < space.low) | (observation > space.high)
        tally.out_of_bounds += int(outside.sum())
    gc.collect()
    tally.growth, tally.seconds = resident() - before, time.perf_counter() - began
    env.close()
    return tally


def is_number(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype == np.float64


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--num-envs", type=int, default=1000)
    args = parser.parse_args()
    found = {}
    for stepper, cutoff, env_id in itertools.product(STEPPERS, CUTOFFS, FINS):
        tally = soak(env_id, args.steps, args.num_envs, stepper=stepper, command_cutoff=cutoff)
        found[env_id, stepper, cutoff] = tally
        print(env_id, stepper, cutoff, tally, flush=True)
    PAGE.write_text(page(found), encoding="utf-8")


def page(found: dict[tuple[str, str, float | None], Tally]) -> str:
    """The result in Markdown."""
    names = [field.name for field in fields(Tally)]
    titles = ["steps", "episodes", "solver failures", "not finite", "out of bounds"]
    rows = []
    for (env_id, stepper, cutoff), tally in found.items():
        *counts, growth, seconds = (getattr(tally, name) for name in names)
        low_pass = f"{cutoff:g} Hz" if cutoff else "none"
        cells = [f"`{env_id}`", stepper, low_pass, *(f"{c:,}" for c in counts)]
        rows.append([*cells, f"{growth / 1e6:+.1f} MB", f"{seconds:.0f} s"])
    head = ["environment", "stepper", "low-pass", *titles, "memory", "time"]
    table = [head, ["---"] * len(head), *rows]
    lines = "\n".join("| " + " | ".join(row) + " |" for row in table)
    when = time.strftime("%Y-%m-%d", time.gmtime())
    machine = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, shared"
    return f"""<!-- Written by tests/long/fin_soak.py. -->

# A million random steps of every fin

{when}, {machine}, rodgym {rodgym.__version__}. Stiffness log-uniform in [3e4, 1e7] Pa and
flow uniform in [0, 0.3] m/s, drawn anew each episode (FinSwim: water at rest). Half of
the fins are told a random angle at every step, a quarter the largest angles back and forth at
random, a quarter sinusoids up to 12.5 Hz; with the low-pass of the command and without.

{lines}

Memory is that of the process at the end beside that after a fifth of the steps. `make soak-fin`
repeats it; `make test` runs a fifteenth of it.
"""


if __name__ == "__main__":
    main()
