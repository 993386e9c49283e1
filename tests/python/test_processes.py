"""Promise: environments give the same results in forked and spawned workers and in threads."""

from __future__ import annotations

import gc
import multiprocessing
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import gymnasium as gym
import numpy as np
import pytest
import rodgym
from conftest import RANDOM, SWING_UP, actions_for, assert_same
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv


def digest(threads: int, seed: int = 3) -> list[bytes]:
    """What a batch large enough for two threads returns."""
    env = gym.make_vec("rodgym:" + SWING_UP, num_envs=256, num_threads=threads, **RANDOM)
    out = [env.reset(seed=seed)[0].tobytes()]
    actions = np.random.default_rng(0).uniform(-1, 1, (5, 256, 1))
    return out + [env.step(action)[0].tobytes() for action in actions]


def worker(pipe, inherited=None) -> None:
    pipe.send(digest(2))
    if inherited is not None:
        pipe.send([inherited.step(np.zeros((256, 1)))[0].tobytes()])
    pipe.close()


def use_in_child(use, context) -> str:
    """What `use` ends with in a forked child."""
    ours, theirs = context.Pipe()

    def child() -> None:
        try:
            use()
            gc.collect()
            theirs.send("it worked")
        except Exception as error:
            theirs.send(f"{type(error).__name__}: {error}")

    process = context.Process(target=child)
    process.start()
    assert ours.poll(60), "the child hangs"
    process.join(60)
    assert process.exitcode == 0
    return ours.recv()


@pytest.mark.skipif(sys.platform == "win32", reason="there is no fork on Windows")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.parametrize("threads", [1, 2])
def test_a_batch_that_a_thread_was_stepping_at_the_fork_is_refused_by_name(threads):
    context = multiprocessing.get_context("fork")
    env = gym.make_vec(SWING_UP, num_envs=4096, num_threads=threads, thesis=True)
    rod = rodgym.sim.Pendulum(thesis=True)
    env.reset(seed=0)
    began, stop = threading.Barrier(3), threading.Event()

    def step(call) -> None:
        began.wait(60)
        while not stop.is_set():
            call()

    calls = (lambda: env.step(np.zeros((4096, 1))), lambda: rod.step(n=100_000))
    workers = [threading.Thread(target=step, args=(call,)) for call in calls]
    for worker in workers:
        worker.start()
    began.wait(60)
    try:
        time.sleep(0.1)
        uses = (
            ("batch", lambda: env.step(np.zeros((4096, 1)))),
            ("batch", lambda: env.get_state([3])),
            ("simulation", lambda: rod.positions),
        )
        for name, use in uses:
            # Nearly all of the time is spent in the step.
            told = {use_in_child(use, context) for _ in range(3)}
            assert any(f"RodgymError: this {name} is not usable: another thread" in t for t in told)
    finally:
        stop.set()
        for worker in workers:
            worker.join(60)
    # Where nobody uses it at the fork it works, and the parent's goes on.
    assert use_in_child(lambda: env.step(np.zeros((4096, 1))), context) == "it worked"
    assert use_in_child(lambda: rod.step(n=3), context) == "it worked"
    env.step(np.zeros((4096, 1)))


@pytest.mark.skipif(sys.platform == "win32", reason="there is no fork on Windows")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_child_has_threads_of_its_own():
    expected = digest(2)
    parent = gym.make_vec(SWING_UP, num_envs=256, num_threads=2, **RANDOM)
    parent.reset(seed=0)
    parent.step(np.zeros((256, 1)))
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe()
    child = context.Process(target=worker, args=(theirs, parent))
    child.start()
    assert ours.poll(60), "the child hangs"
    assert ours.recv() == expected
    assert ours.poll(60), "the child hangs on the batch it inherited"
    inherited = ours.recv()
    child.join(60)
    assert child.exitcode == 0
    assert inherited == [parent.step(np.zeros((256, 1)))[0].tobytes()]


def test_a_spawned_child_returns_the_same():
    context = multiprocessing.get_context("spawn")
    with context.Pool(1) as pool:
        assert pool.apply_async(digest, (2,)).get(90) == digest(1)


@pytest.mark.parametrize("context", ["fork", "spawn"])
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_async_vector_env(context, rng):
    def make():
        return gym.make("rodgym:" + SWING_UP, max_episode_steps=6, **RANDOM)

    ours = AsyncVectorEnv([make] * 2, context=context)
    oracle = SyncVectorEnv([make] * 2)
    try:
        assert_same(ours.reset(seed=2), oracle.reset(seed=2))
        for action in actions_for(rng, 15, 2):
            assert_same(ours.step(action), oracle.step(action))
    finally:
        ours.close(timeout=30)


@pytest.mark.parametrize("method", ["fork", "spawn", "forkserver"])
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_subproc_vec_env(method, rng):
    vec_env = pytest.importorskip("stable_baselines3.common.vec_env")

    def make():
        return gym.make("rodgym:" + SWING_UP, max_episode_steps=6, **RANDOM)

    ours = vec_env.SubprocVecEnv([make] * 2, start_method=method)
    oracle = vec_env.DummyVecEnv([make] * 2)
    try:
        ours.seed(2), oracle.seed(2)
        assert_same(ours.reset(), oracle.reset())
        for action in actions_for(rng, 15, 2):
            observation, reward, *rest = ours.step(action)
            # SubprocVecEnv keeps rewards in double precision, DummyVecEnv does not.
            got = (observation, reward.astype(np.float32), *rest)
            assert_same(got, oracle.step(action))
    finally:
        ours.close()


def test_batches_in_python_threads():
    expected = digest(1)
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(digest, [1, 2, 1, 2])) == [expected] * 4


def test_one_batch_shared_by_threads_is_stepped_by_one_at_a_time():
    env = gym.make_vec(SWING_UP, num_envs=64, max_episode_steps=-1)
    env.reset(seed=0)
    action = np.zeros((64, 1), dtype=np.float32)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: env.step(action), range(100)))
    twin = gym.make_vec(SWING_UP, num_envs=64, max_episode_steps=-1)
    twin.reset(seed=0)
    for _ in range(100):
        twin.step(action)
    assert env.get_state() == twin.get_state()
