"""Promise: threads of a batch sleep while nothing is stepped, and go with the batch."""

from __future__ import annotations

import gc
import sys
import threading
import time
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from conftest import SWING_UP

TASKS = Path("/proc/self/task")


def stepped(threads: int) -> gym.vector.VectorEnv:
    env = gym.make_vec(SWING_UP, num_envs=256, num_threads=threads)
    env.reset(seed=0)
    env.step(np.zeros((256, 1), dtype=np.float32))
    return env


def test_an_idle_pool_takes_no_cpu_time():
    env = stepped(4)
    time.sleep(0.1)
    before = time.process_time()
    time.sleep(1.0)
    # Four waiting threads that spun would take up to all cores for that second.
    assert time.process_time() - before < 0.05
    assert env.num_threads == 4


@pytest.mark.skipif(not TASKS.exists(), reason="threads are counted through /proc")
def test_threads_are_made_at_the_first_step_and_end_with_the_batch():
    def ours() -> int:
        names = [(task / "comm").read_text() for task in TASKS.iterdir()]
        return sum(name.startswith("rodgym-") for name in names)

    gc.collect()
    before = ours()
    env = gym.make_vec(SWING_UP, num_envs=256, num_threads=3)
    env.reset(seed=0)
    assert ours() == before
    env.step(np.zeros((256, 1), dtype=np.float32))
    # The stepping thread works, too.
    assert ours() == before + 2
    del env
    gc.collect()
    assert ours() == before


def test_a_small_batch_makes_no_threads():
    before = threading.active_count(), len(list(TASKS.iterdir())) if TASKS.exists() else 0
    env = gym.make_vec(SWING_UP, num_envs=8, num_threads=4)
    env.reset(seed=0)
    env.step(np.zeros((8, 1), dtype=np.float32))
    after = threading.active_count(), len(list(TASKS.iterdir())) if TASKS.exists() else 0
    assert after == before


def test_step_releases_the_interpreter_lock():
    """A Python thread counts on while a long step runs."""
    env = gym.make_vec(SWING_UP, num_envs=4096, num_threads=1, thesis=True)
    env.reset(seed=0)
    switch = sys.getswitchinterval()
    sys.setswitchinterval(10.0)  # only a released lock lets the other thread run
    ticks, stop = [], threading.Event()

    def count() -> None:
        while not stop.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.002)

    thread = threading.Thread(target=count)
    thread.start()
    try:
        began = time.perf_counter()
        env.step(np.zeros((4096, 1), dtype=np.float32))
        ended = time.perf_counter()
    finally:
        stop.set()
        thread.join()
        sys.setswitchinterval(switch)
    assert sum(began < tick < ended for tick in ticks) >= 3
