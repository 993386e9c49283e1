"""A study on a Ray cluster of this machine, with one worker and with two: `make bench-ray`.

Two workers should be 1.7 times as fast as one, or more. Where somebody else uses the machine, the
clock says more about him: so the CPU time of the driver and of all processes of the cluster is
printed too. Were both cores free, two workers would be faster by at most
2 x (CPU time with one) / (CPU time with two), and by about the "free cores" figure below, which
also takes the driver's CPU time and one case's as not spread.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import ray  # noqa: F401  (brings psutil)
import rodgym.ray
from rodgym.study import run_study
from rodgym.study.spec import parse

import psutil  # isort: skip

#: Rods of 20 edges, 256 episodes a case: 1.6 s of CPU time each where this was written.
CASES = 72


def cpu() -> dict[int, float]:
    """CPU time of this process and of all below it, by process [s]."""
    me = psutil.Process()
    times = {}
    for process in [me, *me.children(recursive=True)]:
        try:
            used = process.cpu_times()
        except psutil.NoSuchProcess:
            continue
        times[process.pid] = used.user + used.system
    return times


def run(workers: int, cases: int, table: Path) -> dict[str, float]:
    """Clock and CPU times of the study [s]."""
    sweep = {"policy": "lqr", "seed": [256 * i for i in range(cases)]}
    content = {"env": "rodgym/PendulumSwingUp-v0", "seeds": 256, "sweep": sweep}
    study = parse({**content, "fixed": {"env.nodes": 21}}, "bench")
    began = time.perf_counter()
    with rodgym.ray.cluster("local", workers):
        start = time.perf_counter() - began
        before, began = cpu(), time.perf_counter()

        def show(done: int, cases: int) -> None:
            print(f"\r{workers} worker(s): {done:3d} of {cases}", end="", flush=True)

        run_study(study, table, rodgym.ray.backend(workers=workers), show)
        clock, after = time.perf_counter() - began, cpu()
    spent = {pid: used - before.get(pid, 0.0) for pid, used in after.items()}
    driver = spent[psutil.Process().pid]
    print(f"  {clock:6.1f} s by the clock, {sum(spent.values()):6.1f} s of CPU time", end="")
    print(f" (driver {driver:.1f} s); the cluster started in {start:.1f} s", flush=True)
    return {"clock": clock, "cpu": sum(spent.values()), "driver": driver}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=CASES, help=f"default {CASES}")
    cases = parser.parse_args().cases
    with tempfile.TemporaryDirectory() as folder:
        tables = [Path(folder) / f"{workers}.csv" for workers in (1, 2)]
        one, two = (run(i, cases, table) for i, table in enumerate(tables, 1))
        assert tables[0].read_bytes() == tables[1].read_bytes()
    spread = (two["cpu"] - two["driver"] - one["cpu"] / cases) / 2
    free = one["cpu"] / (two["driver"] + one["cpu"] / cases + spread)
    print("the two tables are the same, byte for byte")
    print(f"two workers / one worker by the clock: {one['clock'] / two['clock']:.2f} x")
    print(f"by CPU time, at most:                  {2 * one['cpu'] / two['cpu']:.2f} x")
    print(f"by CPU time, free cores:               {free:.2f} x")


if __name__ == "__main__":
    main()
