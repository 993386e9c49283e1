"""Shows what rodgym finds on this machine, for reports of problems, and what would be faster."""

from __future__ import annotations

import argparse
import os
import platform
import sys
from importlib import metadata

SUMMARY = "show versions, processor, threads, extras, and what would be faster"
EXAMPLES = """
rodgym doctor
rodgym doctor --speed
"""
#: Packages whose versions a report of a problem needs.
PACKAGES = ("gymnasium", "numpy", "stable-baselines3", "torch", "ray", "pyzmq")
#: Environments of the batch that `--speed` steps, and how long [s].
BATCH, SECONDS = 1024, 1.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--speed",
        action="store_true",
        help=f"also step {BATCH} pendulums for a second and say how fast",
    )


def run(args: argparse.Namespace) -> int:
    from rodgym import __version__, _native
    from rodgym.cli.commands.list import table
    from rodgym.extras import EXTRAS, installed

    cores = usable_cores()
    rows = [
        ("rodgym", f"{__version__}, {_native.__file__}"),
        ("Python", f"{platform.python_version()}, {sys.executable}"),
        ("system", f"{platform.system()} {platform.machine()}, {cores} of {os.cpu_count()} cores"),
        (
            "instruction set",
            f"{_native.instruction_set()}, of {', '.join(_native.INSTRUCTION_SETS)}",
        ),
        ("network server", "inside" if hasattr(_native, "serve") else "not in this build"),
        *((name, version(name)) for name in PACKAGES),
    ]
    print(f"this machine\n{table(rows)}\n")
    extras = []
    for extra, modules in EXTRAS.items():
        lacking = [module for module in modules if not installed(module)]
        extras.append((extra, f"lacks {', '.join(lacking)}" if lacking else "installed"))
    print(f"extras (pip install 'rodgym[NAME]')\n{table(extras)}\n")
    found = advice(cores)
    if args.speed:
        found.append(
            f"{steps_per_second():,.0f} steps of the default pendulum a second".replace(",", " ")
        )
    print("advice\n" + "\n".join(f"  {line}" for line in found or ["nothing to change"]))
    return 0


def usable_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def version(name: str) -> str:
    """The version of an installed package; nothing is imported."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


def advice(cores: int) -> list[str]:
    """What would be quicker, or work at all."""
    from rodgym import _native
    from rodgym.extras import installed

    found = []
    best = _native.INSTRUCTION_SETS[-1]
    if _native.instruction_set() != best:
        found.append(
            f"RODGYM_ISA={os.environ.get('RODGYM_ISA')} holds the physics back: unset it for {best}"
        )
    if installed("torch") and cores > 1 and os.environ.get("OMP_NUM_THREADS") != "1":
        found.append(
            "in training programs of your own call torch.set_num_threads(1), or set "
            "OMP_NUM_THREADS=1: small networks are fastest on one thread "
            "(rodgym train does this itself)"
        )
    if cores < (os.cpu_count() or 1):
        found.append(
            f"this process may use {cores} of {os.cpu_count()} cores: "
            "a container or taskset limits it"
        )
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    if load > cores:
        found.append(
            f"the load average is {load:.1f} on {cores} cores: "
            "others are at work, times will be longer"
        )
    if not hasattr(_native, "serve"):
        found.append(
            "rodgym serve needs a build with the server: a wheel, or make server in a clone"
        )
    return found


def steps_per_second() -> float:
    """Environment steps of a batch in a second of wall clock."""
    import time

    import gymnasium as gym
    import numpy as np

    envs = gym.make_vec("rodgym/PendulumSwingUp-v0", num_envs=BATCH)
    envs.reset(seed=0)
    actions = np.zeros((BATCH, 1), np.float32)
    envs.step(actions)
    steps, began = 0, time.perf_counter()
    while time.perf_counter() - began < SECONDS:
        envs.step(actions)
        steps += BATCH
    return steps / (time.perf_counter() - began)
