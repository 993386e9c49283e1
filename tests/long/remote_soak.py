"""Soak: 32 clients for 30 minutes, a fourth of them over connections that keep breaking.

Each client steps a local twin beside its remote batch and compares every array to the bit, so a
lost or repeated step cannot hide; and the server's own count of steps must be that of the clients.
Memory and descriptors of the server must be flat after the first tenth.

`make soak` or `PYTHONPATH=tests/python python tests/long/remote_soak.py --minutes 30`.
"""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
import random
import time

import numpy as np
import rodgym.remote
from remote_helpers import Proxy, counter, serving
from rodgym.vector import RodVectorEnv

ENV = "rodgym/PendulumSwingUp-v0"
ENVS = 4
#: Processes that the clients share.
WORKERS = 4


def clients(address: str, first: int, count: int, seconds: float, barrier, results) -> None:
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
    barrier.wait()
    end = time.time() + seconds
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


def soak(minutes: float, count: int) -> str:
    """Runs `count` clients, 4 or more; what was seen, in two lines. Fails by assertion."""
    context = multiprocessing.get_context("spawn")
    results, barrier = context.Queue(), context.Barrier(WORKERS + 1)
    share = count // WORKERS
    with serving("--max-user-sessions", "64", "--http", "127.0.0.1:0") as server:
        processes = [
            context.Process(
                target=clients,
                args=(server.address, i * share, share, 60 * minutes, barrier, results),
            )
            for i in range(WORKERS)
        ]
        for process in processes:
            process.start()
        barrier.wait(300)
        end = time.time() + 60 * minutes
        seen = []
        pause = max(0.5, 60 * minutes / 200)
        while time.time() + pause < end:
            time.sleep(pause)
            seen.append((server.memory(), server.descriptors()))
        outcome = [results.get(timeout=120) for _ in processes]
        for process in processes:
            process.join()
            assert process.exitcode == 0
        steps, made, resent = (sum(column) for column in zip(*outcome, strict=True))
        done = counter(server, "env_steps_total")
        undelivered = counter(server, "undelivered_total")
    early, late = seen[len(seen) // 10 : len(seen) // 3], seen[2 * len(seen) // 3 :]
    memory = [max(m for m, _ in part) / 2**20 for part in (early, late)]
    descriptors = [max(d for _, d in part) for part in (early, late)]
    text = (
        f"{steps} steps by {WORKERS * share} clients in {made} sessions, every array equal to a "
        f"local twin's; the server counts {done // ENVS}; {resent} requests sent again, "
        f"{undelivered} replies undelivered\n"
        f"most memory early and late: {memory[0]:.1f}, {memory[1]:.1f} MiB; "
        f"most descriptors: {descriptors[0]}, {descriptors[1]}"
    )
    assert steps > 100 * count, f"too few steps to tell anything: {text}"
    # Where a connection broke, our calls were repeated: the server must not have.
    assert done == ENVS * steps, f"lost or repeated: {text}"
    assert memory[1] < 1.05 * memory[0] + 2, f"memory grew: {text}"
    assert descriptors[1] <= descriptors[0] + 8, f"descriptors grew: {text}"
    return text


def main() -> None:
    """Runs the soak and prints what was seen."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--clients", type=int, default=32)
    arguments = parser.parse_args()
    print(soak(arguments.minutes, arguments.clients))


if __name__ == "__main__":
    main()
