"""What is not a rate: memory, time to make a batch, instruction sets, share of a training."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import rodgym._native
from rodgym.bench.measure import measure
from rodgym.bench.ours import SWING_UP, batch

MANY = 8192


def in_new_process(fact: str, **environment: str) -> dict[str, float]:
    """Runs a function of this module in a fresh interpreter: memory and settings are its own."""
    code = f"import json, rodgym.bench.facts as f; print(json.dumps(f.{fact}()))"
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    result: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return result


def instruction_sets(rounds: int) -> dict[str, float]:
    """CPU rate of the default pendulum, 1024 environments on one thread, by instruction set."""
    rates: dict[str, list[float]] = {name: [] for name in rodgym._native.INSTRUCTION_SETS}
    for _ in range(rounds):
        for name, found in rates.items():
            found.append(in_new_process("rate", RODGYM_ISA=name)["rate"])
    return {name: float(np.median(found)) for name, found in rates.items()}


def rate() -> dict[str, float]:
    """Environment steps a CPU second of the default pendulum with this process' settings."""
    timing = measure([batch("default", SWING_UP, 1024)], rounds=3, seconds=0.05)[0]
    return {"rate": timing.cpu_rate}


def construction() -> dict[str, float]:
    """Seconds of `gym.make_vec`, and bytes an environment after a first reset and step."""
    gym.make_vec(SWING_UP, num_envs=8).reset(seed=0)  # imports, first-use tables
    before = memory()
    began, work = time.perf_counter(), time.process_time()
    env = gym.make_vec(SWING_UP, num_envs=MANY, num_threads=1)
    wall, cpu = time.perf_counter() - began, time.process_time() - work
    env.reset(seed=0)
    env.step(np.zeros((MANY, 1), dtype=np.float32))
    return {"wall": wall, "cpu": cpu, "bytes": (memory() - before) / MANY}


def memory() -> int:
    """Resident memory of this process [bytes]: now, or its peak where the system tells no other."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        unit = 1 if sys.platform == "darwin" else 1024
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    return pages * resource.getpagesize()


def training_share(rollouts: int) -> dict[str, float]:
    """Share of PPO's wall time spent in `step`, with the recipe of rodgym, and steps a second."""
    import stable_baselines3
    import torch

    from rodgym.sb3 import RodVecEnv
    from rodgym.training import load_recipe

    class Timed(RodVecEnv):
        seconds = 0.0

        def step_wait(self) -> Any:
            began = time.perf_counter()
            result = super().step_wait()
            self.seconds += time.perf_counter() - began
            return result

    torch.set_num_threads(1)
    recipe = load_recipe(SWING_UP, "PPO", None)
    keywords = recipe.keywords()
    env = Timed(SWING_UP, recipe.n_envs, num_threads=1)
    model = stable_baselines3.PPO(recipe.policy, env, seed=0, device="cpu", **keywords)
    steps = rollouts * recipe.n_envs * model.n_steps
    began = time.perf_counter()
    model.learn(steps)
    wall = time.perf_counter() - began
    return {"share": env.seconds / wall, "rate": steps / wall, "n_envs": recipe.n_envs}
