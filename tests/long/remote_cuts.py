"""Cuts a connection at every single byte, in both directions: each time the trajectory must be the
undisturbed one, to the bit.

A conversation is handshake, make, reset, steps over an episode's end, and a snapshot put back. Its
first connection breaks after k bytes, for each k up to its length; the client goes on over another.

`make soak` or `PYTHONPATH=tests/python python tests/long/remote_cuts.py`.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from collections.abc import Iterator

import numpy as np
import rodgym.remote
from conftest import SWING_UP, assert_same
from remote_helpers import Proxy, counter, serving, until
from rodgym.vector import RodVectorEnv

STEPS = 4
WHOLE = 1 << 40


def play(env: RodVectorEnv) -> list:
    """All that a conversation returns."""
    actions = np.random.default_rng(1).uniform(-1, 1, (STEPS, 1, 1)).astype(np.float32)
    results: list = [env.reset(seed=8)]
    results += [env.step(action) for action in actions]
    results.append(env.set_state(env.get_state()))
    results.append(env.step(actions[0]))
    return results


class Cutter:
    """A proxy whose next connection ends after `first` bytes; those after it are whole."""

    def __init__(self, address: str, direction: str) -> None:
        self.first = WHOLE
        self.proxy = Proxy(address, self._budgets(), direction)

    def _budgets(self) -> Iterator[int]:
        while True:
            first, self.first = self.first, WHOLE
            yield first

    def play(self, cut: int) -> list:
        self.first = cut
        env = rodgym.remote.connect(self.proxy.address, SWING_UP, 1, max_episode_steps=3)
        results = play(env)
        env.close()
        return results


def cut_at(offset: int, every: int) -> tuple[dict[str, tuple[int, int, int]], int]:
    """Cuts after `offset`, `offset + every`, ... bytes of a server of its own.

    Returns, by direction, connections cut, conversations and bytes of a whole one; and the calls
    that the server answered from memory.
    """
    expected = play(RodVectorEnv(SWING_UP, 1, max_episode_steps=3))
    found = {}
    with serving("--http", "127.0.0.1:0") as server:
        for direction in ("up", "down"):
            cutter = Cutter(server.address, direction)
            assert_same(cutter.play(WHOLE), expected)
            until(lambda passed=cutter.proxy.passed, way=direction: passed[way] > 0)
            places = range(offset, cutter.proxy.passed[direction], every)
            for cut in places:
                assert_same(cutter.play(cut), expected)
            found[direction] = cutter.proxy.cuts, len(places), places.stop
            cutter.proxy.close()
        return found, counter(server, "replayed_total")


def main() -> None:
    """Cuts everywhere and prints what was done; fails by assertion."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--every", type=int, default=1, help="cut at every so many bytes")
    parser.add_argument("--jobs", type=int, default=4, help="servers and clients side by side")
    arguments = parser.parse_args()
    began = time.monotonic()
    jobs = range(arguments.jobs)
    work = [(job * arguments.every, arguments.every * len(jobs)) for job in jobs]
    with multiprocessing.get_context("spawn").Pool(len(jobs)) as pool:
        done = pool.starmap(cut_at, work)
    for direction in ("up", "down"):
        cuts, conversations, length = zip(*(found[direction] for found, _ in done), strict=True)
        print(
            f"{sum(conversations)} conversations of {length[0]} bytes {direction}, "
            f"{sum(cuts)} of them cut: all trajectories equal"
        )
        # Cuts within the last message, the close, may come too late.
        assert sum(cuts) >= sum(conversations) - 60
    again = sum(replayed for _, replayed in done)
    print(f"{again} calls answered from memory; {time.monotonic() - began:.0f} s")
    assert again > 0, "some replies must have been lost after their call was carried out"


if __name__ == "__main__":
    main()
