"""Soak: 32 clients for 30 minutes, some over connections that keep breaking.

Each client steps a local twin beside its remote batch and compares every array to the bit, so a
lost or repeated step cannot hide. Memory and descriptors of the server must be flat after the
first tenth.

`make soak` or `python tests/long/remote_soak.py --minutes 30`.
"""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
import random
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "python"))

import rodgym.remote
from remote_helpers import Proxy, serving
from rodgym.vector import RodVectorEnv

ENV = "rodgym/PendulumSwingUp-v0"
ENVS = 4


def clients(address: str, first: int, count: int, end: float, results) -> None:
    """`count` clients in one process; every fourth loses its connection again and again."""
    draw = random.Random(first)
    steps = made = resent = 0
    pairs = []

    def start(number: int):
        target = address
        if number % 4 == 0:
            budgets = (draw.randrange(500, 60_000) for _ in itertools.count())
            target = Proxy(address, budgets, draw.choice(["up", "down"])).address
        remote = rodgym.remote.connect(target, ENV, ENVS, max_episode_steps=50)
        local = RodVectorEnv(ENV, ENVS, max_episode_steps=50, num_threads=1)
        assert np.array_equal(remote.reset(seed=number)[0], local.reset(seed=number)[0])
        return remote, local

    for number in range(first, first + count):
        pairs.append(start(number))
        made += 1
    generator = np.random.default_rng(first)
    while time.time() < end:
        for i, (remote, local) in enumerate(pairs):
            action = generator.uniform(-1, 1, size=(ENVS, 1)).astype(np.float32)
            for ours, theirs in zip(remote.step(action)[:4], local.step(action)[:4], strict=True):
                assert np.array_equal(ours, theirs), f"client {first + i} after {steps} steps"
            steps += 1
            if draw.random() < 1e-4:
                resent += remote._batch.native.connection.resent
                remote.close()
                pairs[i] = start(first + i)
                made += 1
    for remote, _ in pairs:
        resent += remote._batch.native.connection.resent
        remote.close()
    results.put((steps, made, resent))


def main() -> None:
    """Runs the soak and prints what was seen; fails by assertion."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--clients", type=int, default=32)
    arguments = parser.parse_args()
    with serving("--max-user-sessions", "64") as server:
        end = time.time() + 60 * arguments.minutes
        context = multiprocessing.get_context("spawn")
        results = context.Queue()
        share = arguments.clients // 4
        processes = [
            context.Process(target=clients, args=(server.address, i * share, share, end, results))
            for i in range(4)
        ]
        for process in processes:
            process.start()
        seen: list[tuple[int, int]] = []
        while time.time() < end:
            time.sleep(max(1.0, arguments.minutes))
            seen.append((server.memory(), server.descriptors()))
        outcome = [results.get(timeout=120) for _ in processes]
        for process in processes:
            process.join()
            assert process.exitcode == 0
        steps, made, resent = (sum(column) for column in zip(*outcome, strict=True))
        start = seen[len(seen) // 10]
        print(
            f"{steps} steps by {arguments.clients} clients in {made} sessions, {resent} sent again"
        )
        print(
            f"memory {start[0] >> 20} -> {seen[-1][0] >> 20} MiB, "
            f"descriptors {start[1]} -> {seen[-1][1]}"
        )
        assert seen[-1][0] < 1.1 * start[0] + (4 << 20), "memory grew"
        assert seen[-1][1] < start[1] + 40, "descriptors grew"
        about = rodgym.remote.ping(server.address)
        assert about["user"] == "local"


if __name__ == "__main__":
    main()
