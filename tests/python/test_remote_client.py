"""Promise: a remote environment is the local one in its time limit, in what threads may do with it,
and in saying at once what is wrong with an address, a timeout or a server's reply."""

from __future__ import annotations

import contextlib
import random
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import gymnasium as gym
import msgpack
import numpy as np
import pytest
from conftest import BALANCE, SWING_UP, assert_same
from remote_helpers import need_server, serving

need_server()

import rodgym.remote  # noqa: E402
from rodgym.errors import ParameterError, RodgymError  # noqa: E402
from rodgym.remote import RemoteError, RemoteTimeoutError  # noqa: E402
from rodgym.remote.connection import Connection  # noqa: E402
from rodgym.remote.wire import unpack  # noqa: E402
from rodgym.vector import RodVectorEnv  # noqa: E402

REMOTE = "rodgym/Remote-v0"


@pytest.fixture(scope="module")
def server():
    with serving("--max-user-sessions", "256") as server:
        yield server


def lengths(env, steps: int = 1100) -> list[int]:
    """Steps at which single environment `env` is truncated within so many."""
    ends, count = [], 0
    env.reset(seed=0)
    for step in range(1, steps + 1):
        _, _, terminated, truncated, _ = env.step(np.zeros(1, dtype=np.float32))
        assert not terminated
        if truncated:
            ends.append(step)
            env.reset()
            count += 1
    return ends


@pytest.mark.parametrize("limit", [None, 7, 700, -1])
def test_a_single_environment_has_the_local_time_limit(server, limit):
    asked = {} if limit is None else {"max_episode_steps": limit}
    local = gym.make(SWING_UP, **asked)
    remote = gym.make(REMOTE, server=server.address, env_id=SWING_UP, **asked)
    again = gym.make(remote.spec)
    assert local.spec is not None
    for env in (remote, again):
        assert env.spec is not None
        assert env.spec.max_episode_steps == local.spec.max_episode_steps
        assert lengths(env) == lengths(local)
        env.close()


def test_time_limits_of_several_environments(server):
    vec_env = pytest.importorskip("stable_baselines3.common.env_util")
    where = {"server": server.address, "env_id": BALANCE}
    oracle = gym.make_vec(BALANCE, num_envs=2, vectorization_mode="sync")
    ours = gym.make_vec(REMOTE, num_envs=2, vectorization_mode="sync", **where)
    native = gym.make_vec(REMOTE, num_envs=2, **where)
    assert [env.spec.max_episode_steps for env in ours.envs] == [1000, 1000]
    assert native.max_episode_steps == 1000
    stable = vec_env.make_vec_env(REMOTE, 2, env_kwargs=where)
    assert [spec.max_episode_steps for spec in stable.get_attr("spec")] == [1000, 1000]
    assert_same(ours.reset(seed=3)[0], oracle.reset(seed=3)[0])
    action = np.zeros((2, 1), dtype=np.float32)
    assert_same(ours.step(action), oracle.step(action))
    for env in (ours, native, stable):
        env.close()


def test_two_threads_share_one_environment_as_a_local_one(server):
    """Steps, snapshots, pictures and closing, all at once; libzmq would abort the process."""
    remote = rodgym.remote.connect(
        server.address, SWING_UP, 4, max_episode_steps=-1, render_mode="rgb_array"
    )
    twin = RodVectorEnv(SWING_UP, 4, max_episode_steps=-1)
    action = np.full((4, 1), 0.5, dtype=np.float32)
    remote.reset(seed=1), twin.reset(seed=1)
    seen = []

    def step() -> None:
        for _ in range(50):
            remote.step(action)

    def look() -> None:
        for _ in range(20):
            seen.append(remote.get_state())
            remote.members[1].scene()
            remote.get_attr("parameters")

    with ThreadPoolExecutor(4) as pool:
        for task in [pool.submit(call) for call in (step, look, step, look)]:
            task.result(60)
    states = []
    for _ in range(100):
        states.append(twin.get_state())
        twin.step(action)
    states.append(twin.get_state())
    assert remote.get_state() == twin.get_state()
    assert all(state in states for state in seen), "all environments at one moment"
    outcomes = []

    def until_closed() -> None:
        try:
            while True:
                remote.step(action)
        except RemoteError as error:
            outcomes.append(error.code)

    threads = [threading.Thread(target=until_closed) for _ in range(3)]
    for thread in threads:
        thread.start()
    time.sleep(0.05)
    remote.close()
    for thread in threads:
        thread.join(20)
    assert outcomes == ["closed"] * 3


def test_a_port_where_nobody_listens_is_told_within_seconds(monkeypatch):
    monkeypatch.setattr(rodgym.remote.connection, "NOBODY_SECONDS", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    began = time.monotonic()
    with pytest.raises(RemoteTimeoutError, match="nothing listens there") as caught:
        rodgym.remote.connect(f"tcp://127.0.0.1:{port}", SWING_UP, timeout=600.0)
    assert time.monotonic() - began < 60.0
    assert str(port) in str(caught.value)


def test_a_server_that_is_just_starting_is_waited_for():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with contextlib.ExitStack() as stack:
        begin = threading.Timer(
            1.0,
            lambda: stack.enter_context(serving(bind=f"tcp://127.0.0.1:{port}")),
        )
        begin.start()
        assert rodgym.remote.ping(f"tcp://127.0.0.1:{port}", timeout=30.0)["user"] == "local"
        begin.join()


@pytest.mark.parametrize(
    ("server", "missing"),
    [
        ("localhost:5555", "'tcp://' is missing"),
        ("tcp://localhost", "the port is missing"),
        ("tcp://:5555", "no host"),
        ("tcp://*:5555", "no host"),
        ("tcp://localhost:0", "none of 1 to 65535"),
        ("tcp://localhost:65536", "none of 1 to 65535"),
        ("http://localhost:80", "neither 'tcp://' nor 'ipc://'"),
        ("ipc://", "the path is missing"),
        ("", "'tcp://' is missing"),
        (None, "an address such as"),
        (5555, "an address such as"),
    ],
)
def test_what_is_no_address_is_refused_at_once_with_what_is_missing(server, missing):
    calls = (
        lambda: rodgym.remote.connect(server, SWING_UP),
        lambda: rodgym.remote.ping(server),
        lambda: gym.make(REMOTE, server=server, env_id=SWING_UP),
    )
    for call in calls:
        with pytest.raises(ParameterError, match="server = ") as caught:
            call()
        assert missing in str(caught.value)


@pytest.mark.parametrize("timeout", [0, -1.0, float("nan"), float("inf"), None, "60", True, [1.0]])
def test_what_is_no_timeout_is_refused_at_once(timeout):
    for call in (rodgym.remote.ping, lambda a, **k: rodgym.remote.connect(a, SWING_UP, **k)):
        with pytest.raises(ParameterError, match="timeout = "):
            call("tcp://127.0.0.1:1", timeout=timeout)


@pytest.mark.parametrize("server", ["tcp://[::1]:5555", "tcp://my-host.example:1", "ipc:///tmp/x"])
def test_addresses_are_taken(server):
    assert rodgym.remote.Address(server, timeout=np.float32(2)).server == server


def damage(draw: random.Random, value):
    """The value with one thing in it missing or another."""
    if isinstance(value, dict) and value and draw.random() < 0.85:
        key = draw.choice(list(value))
        if draw.random() < 0.3:
            return {k: v for k, v in value.items() if k != key}
        return {**value, key: damage(draw, value[key])}
    if isinstance(value, list) and value and draw.random() < 0.7:
        i = draw.randrange(len(value))
        if draw.random() < 0.3:
            return value[:i] + value[i + 1 :]
        return [*value[:i], damage(draw, value[i]), *value[i + 1 :]]
    return draw.choice([None, -1, 0, 2**40, 1.5, True, "x", [], {}, [None], {"x": 1}])


def test_damaged_replies_are_remote_errors(server, monkeypatch):
    """Every reply of a short life, with something in its header missing or of another type."""
    draw = random.Random(3)
    replies = []
    original = rodgym.remote.connection.unpack

    def damaging(frames):
        if draw.random() < 0.15:
            header = msgpack.unpackb(frames[0])
            rid = header["rid"]
            header = damage(draw, header)
            if isinstance(header, dict) and isinstance(header.get("rid"), int):
                header["rid"] = rid
            replies.append(header)
            frames = [msgpack.packb(header), *frames[1 : draw.choice([1, None])]]
        return original(frames)

    monkeypatch.setattr(rodgym.remote.connection, "unpack", damaging)
    life = (
        lambda env: rodgym.remote.ping(server.address, timeout=0.3),
        lambda env: env.reset(seed=1),
        lambda env: env.step(np.zeros((2, 1))),
        lambda env: env.get_state(),
        lambda env: env.get_attr("positions"),
        lambda env: env.get_attr("parameters"),
        lambda env: env.members[0].scene(),
        lambda env: env.set_state(env.get_state()),
    )
    codes = []
    for _ in range(120):
        env = None
        for call in (
            lambda env: rodgym.remote.connect(server.address, SWING_UP, 2, timeout=0.3),
            *life,
        ):
            try:
                made = call(env)
            except RodgymError as error:
                codes.append(getattr(error, "code", type(error).__name__))
                if env is None:
                    break
                continue
            env = env or made
        if env is not None:
            env.close()
    assert len(replies) > 50 and codes.count("bad_reply") > 30


@pytest.mark.parametrize(
    "header",
    [
        b"",
        b"\xc1",
        b"\x93\x01\x02\x03",
        msgpack.packb({"rid": 1, "ok": True, "p": []}),
        msgpack.packb({"rid": 1, "ok": 1}),
        msgpack.packb({"rid": 1, "ok": True, "arr": [["a", "<f4", [-1]]]}),
        msgpack.packb({"rid": 1, "ok": True, "arr": [["a", ["<f4"], [1]]]}),
        msgpack.packb({"rid": 1, "ok": True, "arr": [[["a"], "<f4", [1]]]}),
        msgpack.packb({"rid": 1, "ok": True, "arr": 5}),
        msgpack.packb({"rid": 1, "ok": False, "err": "no"}),
    ],
)
def test_a_header_that_is_none_is_a_remote_error(header):
    with pytest.raises(RemoteError, match="cannot be read") as caught:
        unpack([header, bytes(4)])
    assert caught.value.code == "bad_reply"


@pytest.mark.parametrize("num_envs", [1, 3, 1000])
def test_results_are_the_callers_own(server, num_envs):
    """Arrays may be written to, and keep what they have when the next results come."""
    env = rodgym.remote.connect(server.address, SWING_UP, num_envs)
    local = RodVectorEnv(SWING_UP, num_envs)
    env.reset(seed=1), local.reset(seed=1)
    action = np.full((num_envs, 1), 0.25, dtype=np.float32)
    kept = env.step(action)
    assert_same(kept, local.step(action))
    before = [np.copy(array) for array in kept[:4]]
    for array in env.step(action)[:4]:
        assert array.flags.carray
        array[...] = 0
    for array, old in zip(kept, before, strict=False):
        np.testing.assert_array_equal(array, old)
    local.step(action)
    assert_same(env.step(action), local.step(action))
    env.close()


def test_a_damaged_reply_leaves_the_call_pending(server, monkeypatch):
    env = rodgym.remote.connect(server.address, SWING_UP, 2)
    local = RodVectorEnv(SWING_UP, 2)
    env.reset(seed=1), local.reset(seed=1)
    action = np.full((2, 1), 0.25, dtype=np.float32)
    converse = Connection._converse

    def without_reward(self, *arguments):
        reply = converse(self, *arguments)
        reply.arrays.pop("reward")
        return reply

    with monkeypatch.context() as patch:
        patch.setattr(Connection, "_converse", without_reward)
        with pytest.raises(RemoteError, match="cannot be read"):
            env.step(action)
    expected = local.step(action)
    assert env.get_state() == local.get_state()
    env.step(-action), local.step(-action)
    assert env.get_state() == local.get_state() and expected is not None
    env.close()


def test_the_rod_of_a_remote_environment_is_an_exact_copy(server):
    where = {"server": server.address, "env_id": SWING_UP}
    remote, local = gym.make(REMOTE, **where), gym.make(SWING_UP)
    for env in (remote, local):
        env.reset(seed=4)
        env.step([0.7])
    ours, theirs = remote.unwrapped.rod, local.unwrapped.rod
    for rod in (ours, theirs):
        rod.step(0.01, n=20)
    assert_same(ours.positions, theirs.positions)
    remote.close()
