"""Promise: Ctrl-C ends a long step soon, and that step was then never made: what comes next is to
the bit what would have come without it, in every environment of a batch. Remote calls have
`test_remote_interrupts.py`.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from conftest import FINS, SWING_UP, assert_same
from rodgym.envs import RodEnv
from rodgym.vector import RodVectorEnv

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="signals as POSIX has them")

#: Sensors, actuator and steppers remember something of every step.
NOISE = {"sensor_noise": {"angle": 1e-3, "rate": 1e-2}}
LONG: dict[str, tuple[str, dict[str, Any]]] = {
    "verlet": (
        SWING_UP,
        {
            **NOISE, "nodes": 31, "stepper": "verlet", "physics_dt": 2e-6, "control_dt": 1.0,
            "randomize": {"density": (1400.0, 1600.0)},
            "torque_disturbance": 0.001, "actuator_delay": 0.5,
        },
    ),
    "implicit": (
        SWING_UP,
        {
            **NOISE, "nodes": 101, "stepper": "implicit", "physics_dt": 5e-5, "control_dt": 1.0,
            "randomize": {"width": (0.006, 0.009)},
            "torque_disturbance": 0.001, "actuator_delay": 0.5,
        },
    ),
    "fin": (
        FINS[1],
        {**NOISE, "physics_dt": 5e-6, "control_dt": 1.0, "actuator_delay": 0.5},
    ),
}  # fmt: skip


@pytest.fixture(autouse=True)
def ctrl_c_is_heard() -> Iterator[None]:
    """A shell starts what runs in its background with Ctrl-C ignored, and Python keeps that."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@contextmanager
def interrupted(seconds: float) -> Iterator[list[float]]:
    """Sends Ctrl-C after a while; the list has the time it took to act."""
    sent: list[float] = []

    def send() -> None:
        sent.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(seconds, send)
    took: list[float] = []
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            yield took
    finally:
        timer.cancel()
        timer.join()
    took.append(time.perf_counter() - sent[0])


@pytest.mark.parametrize("case", LONG)
def test_an_interrupted_step_was_never_made(case):
    env_id, kwargs = LONG[case]
    kwargs = {**kwargs, "physics_dt": kwargs["physics_dt"] / 2}
    env, twin = RodEnv(env_id, **kwargs), RodEnv(env_id, **kwargs)
    for one in (env, twin):
        one.reset(seed=3)
    # (The second is interrupted where the time of a step is known.)
    for action in (0.7, -0.4):
        before, seen = env.get_state(), env._batch.observe(0)
        began = time.perf_counter()
        expected = twin.step(np.array([action]))
        alone = time.perf_counter() - began
        with interrupted(0.2 * alone) as took:
            env.step(np.array([0.9]))
        assert took[0] < 0.25, f"of {alone} s"
        assert env.get_state() == before
        assert env._batch.observe(0).tobytes() == seen.tobytes()
        assert_same(env.step(np.array([action])), expected)
        assert env.get_state() == twin.get_state()
    assert alone > 0.1, "too short to be interrupted"


@pytest.mark.parametrize("case", LONG)
@pytest.mark.parametrize("threads", [1, 2])
def test_an_interrupted_step_of_a_batch_was_never_made(case, threads):
    env_id, kwargs = LONG[case]
    kwargs = {**kwargs, "control_dt": 0.5 / threads, "actuator_delay": 0.1}
    n = 16 if threads == 1 else 64

    def make() -> RodVectorEnv:
        batch = RodVectorEnv(
            env_id,
            n,
            num_threads=threads,
            copy=False,
            autoreset_mode="SameStep",
            max_episode_steps=2,
            **kwargs,
        )
        batch.reset(seed=5)
        return batch

    env, twin = make(), make()
    actions = np.linspace(-1.0, 1.0, n)[:, np.newaxis]
    # The second step begins episodes.
    for _ in range(3):
        before, out = env.get_state(), env._out.copy()
        with interrupted(0.1) as took:
            env.step(-actions)
        assert took[0] < 0.25
        assert env.get_state() == before
        assert env._out.tobytes() == out.tobytes()
        expected = twin.step(actions)
        assert_same(env.step(actions), expected)
        assert env.get_state() == twin.get_state()


def handled(handler: Callable[..., Any], step: Callable[[], Any]) -> Any:
    before = signal.signal(signal.SIGALRM, handler)
    signal.setitimer(signal.ITIMER_REAL, 0.05, 0.02)
    try:
        return step()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def test_a_signal_that_raises_nothing_leaves_the_step_alone():
    env_id, kwargs = LONG["implicit"]
    env, twin = RodEnv(env_id, **kwargs), RodEnv(env_id, **kwargs)
    for one in (env, twin):
        one.reset(seed=3)
    calls: list[int] = []
    ours = handled(lambda *_: calls.append(1), lambda: env.step([0.5]))
    assert len(calls) > 3
    assert_same(ours, twin.step([0.5]))

    def late(*_: Any) -> None:
        raise TimeoutError("late")

    before = env.get_state()
    with pytest.raises(TimeoutError, match="late"):
        handled(late, lambda: env.step([0.5]))
    assert env.get_state() == before


def test_a_long_step_in_a_thread_of_its_own_is_as_any_other():
    env_id, kwargs = LONG["verlet"]
    env, twin = RodEnv(env_id, **kwargs), RodEnv(env_id, **kwargs)
    for one in (env, twin):
        one.reset(seed=3)
    results: list[Any] = []
    thread = threading.Thread(target=lambda: results.append(env.step([0.5])))
    thread.start()
    thread.join()
    assert_same(results[0], twin.step([0.5]))
