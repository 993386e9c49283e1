"""Promise: no fault of the network, of a peer or of the server changes a trajectory, stops the
server for others, or ends without saying why."""

from __future__ import annotations

import os
import random
import signal
import socket
import struct
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import RANDOM, SWING_UP, actions_for, assert_same
from remote_helpers import Proxy, counter, need_server, serving, until

need_server()

import rodgym.remote  # noqa: E402
import zmq  # noqa: E402
from rodgym.remote import RemoteTimeoutError, SessionLostError, VersionError  # noqa: E402
from rodgym.remote.connection import Address, Connection  # noqa: E402
from rodgym.remote.wire import pack, unpack  # noqa: E402
from rodgym.vector import RodVectorEnv  # noqa: E402

STEPS = 12


@pytest.fixture(scope="module")
def server():
    with serving() as server:
        yield server


@pytest.fixture(scope="module")
def undisturbed():
    """Actions and results of a local batch."""
    env = RodVectorEnv(SWING_UP, 2, max_episode_steps=5, **RANDOM)
    actions = actions_for(np.random.default_rng(1), STEPS, 2)
    return actions, [env.reset(seed=8), *(env.step(action) for action in actions)]


def play(address: str, actions: np.ndarray, between=lambda step: None, **arguments):
    env = rodgym.remote.connect(address, SWING_UP, 2, max_episode_steps=5, **RANDOM, **arguments)
    results = [env.reset(seed=8)]
    for i, action in enumerate(actions):
        between(i)
        results.append(env.step(action))
    native = env._batch.native
    env.close()
    return results, native


def host(server) -> tuple[str, int]:
    name, port = server.address.removeprefix("tcp://").rsplit(":", 1)
    return name, int(port)


@pytest.mark.parametrize("direction", ["up", "down"])
def test_a_connection_cut_at_any_byte_leaves_the_trajectory_unchanged(
    server, undisturbed, direction
):
    actions, expected = undisturbed
    # Handshake, make, reset and steps take 2 kB up and 8 kB down: cuts fall everywhere in them.
    longest = 600 if direction == "up" else 2500
    draw = random.Random(direction)
    cuts = 0
    for first in range(0, 600, 37):
        budgets = iter([first, *(draw.randrange(40, longest) for _ in range(6))])
        proxy = Proxy(server.address, budgets, direction)
        results, _ = play(proxy.address, actions)
        assert_same(results, expected)
        cuts += proxy.cuts
        proxy.close()
    assert cuts > 60


def test_kill_and_restart_with_recovery_goes_on_unchanged(undisturbed):
    actions, expected = undisturbed
    with serving() as server:

        def between(step: int) -> None:
            if step in (3, 8):
                server.kill()
                server.start()

        results, native = play(server.address, actions, between, recover="restart")
        assert_same(results, expected)
        assert native.recoveries == 2


def test_recovery_from_a_snapshot_equals_recovery_from_the_start(undisturbed, monkeypatch):
    import rodgym.remote.session

    monkeypatch.setattr(rodgym.remote.session, "SNAPSHOT_EVERY", 4)
    restored, restore = [], rodgym.remote.session.Session._restore

    def restoring(session) -> None:
        restored.append(session._progress)
        restore(session)

    monkeypatch.setattr(rodgym.remote.session.Session, "_restore", restoring)
    actions, expected = undisturbed
    with serving() as server:

        def between(step: int) -> None:
            if step == 9:
                server.kill()
                server.start()

        results, native = play(server.address, actions, between, recover="restart")
        assert_same(results, expected)
        assert native.recoveries == len(restored) == 1
        assert restored[0].snapshot is not None and len(restored[0].since) < 4


def test_kill_and_restart_without_recovery_says_that_the_session_is_lost():
    with serving() as server:
        env = rodgym.remote.connect(server.address, SWING_UP)
        env.reset(seed=0)
        epoch = env._batch.native.connection.epoch
        server.kill()
        server.start()
        with pytest.raises(SessionLostError, match="restarted"):
            env.step(np.zeros((1, 1)))
        assert env._batch.native.connection.epoch != epoch


def test_a_stopped_server_is_waited_for(undisturbed):
    actions, expected = undisturbed
    with serving() as server:

        def between(step: int) -> None:
            if step == 4:
                server.send(signal.SIGSTOP)
                threading.Timer(10.0, server.send, (signal.SIGCONT,)).start()

        began = time.monotonic()
        results, native = play(server.address, actions, between)
        assert_same(results, expected)
        assert 9.0 < time.monotonic() - began < 25.0
        assert native.connection.resent > 0


@pytest.mark.parametrize("repeated", [False, True])
def test_a_step_that_timed_out_counts_once(undisturbed, repeated):
    """Whether the caller goes on with the next step or tries the same one again."""
    actions, expected = undisturbed
    with serving() as server:
        env = rodgym.remote.connect(
            server.address, SWING_UP, 2, max_episode_steps=5, **RANDOM, timeout=1.0
        )
        assert_same(env.reset(seed=8), expected[0])
        server.send(signal.SIGSTOP)
        with pytest.raises(RemoteTimeoutError, match="does not answer"):
            env.step(actions[0])
        server.send(signal.SIGCONT)
        for i in range(0 if repeated else 1, STEPS):
            assert_same(env.step(actions[i]), expected[i + 1])
        env.close()


def test_sigterm_drains_and_stops_at_once_when_nothing_is_in_flight():
    with serving() as server:
        env = rodgym.remote.connect(server.address, SWING_UP, 2, timeout=1.0)
        env.reset(seed=0)
        began = time.monotonic()
        server.send(signal.SIGTERM)
        assert server.wait() == 0
        assert time.monotonic() - began < 3.0
        assert "stopped" in server.log


@pytest.mark.parametrize("workers", ["1", "2"])
def test_sigterm_finishes_requests_that_arrived(workers):
    with serving("--workers", workers) as server:
        env = rodgym.remote.connect(server.address, SWING_UP, 1024)
        env.reset(seed=0)
        native = env._batch.native
        connection = native.connection
        # Sixteen heavy steps at once, more than are done when the signal comes.
        action = {"action": np.zeros((1024, 1), dtype="<f4")}
        window = connection.request("make", p={**native._about, "nonce": "1" * 32, "window": 16})
        sid = window.p["sid"]
        connection.request("reset", sid=sid, seq=1, p={"seed": 1})
        for seq in range(2, 18):
            connection._socket.send_multipart(pack("step", seq, sid, seq, {}, action))
        until(lambda: connection._socket.poll(0))
        server.send(signal.SIGTERM)
        for seq in range(2, 18):
            assert connection._socket.poll(12000), f"no reply to step {seq}"
            reply = unpack(connection._socket.recv_multipart())
            assert reply.ok and reply.rid == seq
        assert server.wait() == 0


def test_a_second_sigterm_stops_at_once():
    with serving() as server:
        env = rodgym.remote.connect(server.address, SWING_UP, 4096, timeout=2.0)
        env.reset(seed=0)
        native = env._batch.native
        action = {"action": np.zeros((4096, 1), dtype="<f4")}
        for seq in range(2, 60):
            frames = pack("step", seq, native._sid, seq, {}, action)
            native.connection._socket.send_multipart(frames)
        server.send(signal.SIGTERM)
        time.sleep(0.05)
        assert server.process.poll() is None, "there is work for longer than this"
        server.send(signal.SIGTERM)
        # Ours while it drains, the system's own once it is done.
        assert server.wait(3.0) in (128 + signal.SIGTERM, -signal.SIGTERM)


def test_garbage_on_the_port_harms_nobody(server, undisturbed):
    actions, expected = undisturbed
    frame_of_2_to_the_62 = bytes([0x02]) + struct.pack(">Q", 1 << 62)
    # A ZMTP 3 greeting with mechanism NULL, then what follows in place of a handshake.
    greeting = b"\xff" + bytes(8) + b"\x7f\x03\x01NULL" + bytes(16) + b"\x00" + bytes(31)
    ready = b"\x04\x19\x05READY\x0bSocket-Type\x00\x00\x00\x06DEALER"
    attacks = [
        os.urandom(4096),
        b"GET / HTTP/1.1\r\nHost: x\r\n\r\n",
        frame_of_2_to_the_62 * 4,
        greeting[:20],
        greeting + os.urandom(200),
        greeting + b"\x04\x29\x05READY\x0bSocket-Type\x00\x00\x00\x06DEALER"[:12],
        greeting + ready + frame_of_2_to_the_62 + bytes(100),
    ]
    before = server.memory()
    for attack in attacks:
        with socket.create_connection(host(server)) as peer:
            peer.sendall(attack)
            peer.settimeout(0.2)
            try:
                while peer.recv(4096):
                    pass
            except OSError:
                pass
    results, _ = play(server.address, actions)
    assert_same(results, expected)
    assert server.memory() - before < 50 << 20


def test_oversize_and_deeply_nested_headers_are_refused_and_the_connection_lives(server):
    peer = zmq.Context.instance().socket(zmq.DEALER)
    peer.linger = 0
    peer.connect(server.address)
    opening = b"\x82\xa1v\x01\xa1p"
    for header in (
        pack("ping", 1, None, None, {"x": "y" * 5000}, {})[0],
        opening + b"\x81\xa0" * 2000,
        opening + b"\x91" * 4000,
        opening + b"\xdf\xff\xff\xff\xff",
    ):
        peer.send(header)
        assert peer.poll(3000)
        reply = unpack(peer.recv_multipart())
        assert reply.err is not None and reply.err["code"] == "bad_header"
    peer.send_multipart(pack("ping", 2, None, None, {}, {}))
    assert peer.poll(3000) and unpack(peer.recv_multipart()).ok
    peer.close()


def test_an_oversize_frame_costs_its_sender_the_connection():
    with serving("--max-message-mib", "1") as server:
        env = rodgym.remote.connect(server.address, SWING_UP)
        env.reset(seed=0)
        before = server.memory()
        peer = zmq.Context.instance().socket(zmq.DEALER)
        peer.linger = 0
        peer.connect(server.address)
        monitor = peer.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        peer.send_multipart([b"x", bytes(8 << 20)])
        assert monitor.poll(5000), "the server hangs up"
        peer.disable_monitor()
        monitor.close()
        peer.close()
        env.step(np.zeros((1, 1)))
        assert server.memory() - before < 30 << 20


def test_a_thousand_silent_connections_do_not_keep_others_out():
    with serving() as server:
        before = server.descriptors()
        silent = [socket.create_connection(host(server)) for _ in range(1000)]
        env = rodgym.remote.connect(server.address, SWING_UP, timeout=20.0)
        env.reset(seed=0)
        observation = env.step(np.zeros((1, 1)))[0]
        assert np.isfinite(observation).all()
        # The handshake's time limit (2 s) clears them away.
        until(lambda: server.descriptors() < before + 50, 15.0)
        for peer in silent:
            peer.close()


def test_a_flood_without_reading_is_bounded_and_others_go_on():
    with serving() as server:
        env = rodgym.remote.connect(server.address, SWING_UP)
        env.reset(seed=0)
        flood = zmq.Context.instance().socket(zmq.DEALER)
        flood.linger, flood.sndhwm, flood.rcvhwm, flood.rcvbuf = 0, 100_000, 1, 4096
        flood.connect(server.address)
        before = server.memory()
        frames = pack("hello", 1, None, None, {}, {})
        for _ in range(50_000):
            flood.send_multipart(frames)
        for _ in range(20):
            env.step(np.zeros((1, 1)))
        time.sleep(1.0)
        assert server.memory() - before < 40 << 20
        flood.close()
        env.step(np.zeros((1, 1)))


def test_two_clients_with_one_routing_id_do_not_lock_each_other_for_good(server):
    sockets = []
    for _ in range(2):
        peer = zmq.Context.instance().socket(zmq.DEALER)
        peer.linger, peer.routing_id = 0, b"the same"
        peer.connect(server.address)
        time.sleep(0.2)
        sockets.append(peer)
    frames = pack("ping", 7, None, None, {}, {})
    for peer in sockets:
        peer.send_multipart(frames)
    # libzmq mutes the second; the first is served, and so is the second when it comes anew.
    assert sockets[0].poll(2000) and not sockets[1].poll(300)
    for peer in sockets:
        peer.close()
    time.sleep(0.2)
    assert rodgym.remote.ping(server.address)["user"] == "local"


def test_a_session_number_does_not_depend_on_the_connection(server):
    env = rodgym.remote.connect(server.address, SWING_UP)
    env.reset(seed=0)
    other = Connection(Address(server.address))
    assert other.request("info", sid=env._batch.native._sid).p["num_envs"] == 1
    other.close()
    env.close()


def test_a_guessed_session_number_is_unknown(server):
    connection = Connection(Address(server.address))
    with pytest.raises(SessionLostError):
        connection.request("step", sid="0" * 32, seq=1)
    connection.close()


def test_a_request_socket_works_too(server):
    peer = zmq.Context.instance().socket(zmq.REQ)
    peer.linger = 0
    peer.connect(server.address)
    peer.send_multipart(pack("ping", 3, None, None, {}, {}))
    assert peer.poll(3000)
    assert unpack(peer.recv_multipart()).rid == 3
    peer.close()


def test_version_skew_is_told_with_both_ranges(server, monkeypatch):
    import rodgym.remote.wire

    monkeypatch.setattr(rodgym.remote.wire, "VERSION", 9)
    connection = Connection(Address(server.address, timeout=5.0))
    with pytest.raises(VersionError, match=r"\[9, 9\].*\[1, 1\]"):
        connection.request("hello")
    connection.close()


def test_twenty_thousand_damaged_headers_are_all_answered(server):
    peer = zmq.Context.instance().socket(zmq.DEALER)
    peer.linger = 0
    peer.connect(server.address)
    draw = random.Random(5)
    good = pack("hello", 1, "a" * 32, 4, {"x": [1, {"y": None}]}, {"a": np.zeros(3)})
    for _ in range(1000):
        for _ in range(20):
            header = bytearray(good[0])
            for _ in range(draw.randrange(1, 8)):
                header[draw.randrange(len(header))] = draw.randrange(256)
            cut = draw.choice([len(header), draw.randrange(len(header) + 1)])
            peer.send_multipart([bytes(header[:cut]) or b"\xc1", *good[1 : draw.choice([1, 2])]])
        for _ in range(20):
            assert peer.poll(5000)
            unpack(peer.recv_multipart())
    peer.close()


def test_a_slow_reader_gets_every_reply_within_the_window(server):
    env = rodgym.remote.connect(server.address, SWING_UP, 256)
    native = env._batch.native
    make = {**native._about, "nonce": "2" * 32, "window": 16}
    sid = native.connection.request("make", p=make).p["sid"]
    native.connection.request("reset", sid=sid, seq=1, p={"seed": 1})
    socket_ = native.connection._socket
    action = {"action": np.zeros((256, 1), dtype="<f4")}
    for start in range(2, 130, 16):
        for seq in range(start, start + 16):
            socket_.send_multipart(pack("step", seq, sid, seq, {}, action))
        time.sleep(0.1)
        for seq in range(start, start + 16):
            assert socket_.poll(3000)
            reply = unpack(socket_.recv_multipart())
            assert reply.ok and reply.seq == seq
    env.close()


def test_replies_beyond_the_high_water_mark_are_counted_and_can_be_asked_for_again():
    """libzmq drops what a peer does not read; the session goes on from the sequence window."""
    with serving("--http", "127.0.0.1:0") as server:
        env = rodgym.remote.connect(server.address, SWING_UP, 1024)
        local = RodVectorEnv(SWING_UP, 1024)
        action = np.full((1024, 1), 0.3, dtype=np.float32)
        env.reset(seed=4)
        local.reset(seed=4)
        native = env._batch.native
        deaf = zmq.Context.instance().socket(zmq.DEALER)
        deaf.linger, deaf.sndhwm, deaf.rcvhwm, deaf.rcvbuf = 0, 1000, 1, 4096
        deaf.connect(server.address)
        # 64 in the server's queue, one here, 0.1 MB each beyond what sockets hold.
        sent = 200
        for seq in range(2, 2 + sent):
            frames = pack("step", seq, native._sid, seq, {}, {"action": action})
            deaf.send_multipart(frames)
            expected = local.step(action)
        until(lambda: counter(server, "step_seconds_count") == sent, 30.0)
        lost = counter(server, "undelivered_total")
        assert lost > 0
        heard = []
        while deaf.poll(1000):
            heard.append(unpack(deaf.recv_multipart()).rid)
        deaf.close()
        assert len(heard) + lost == sent and heard == sorted(heard)
        # The last step's reply, lost to the deaf one, from memory; then the next step.
        native._progress = native._progress._replace(seq=sent)
        assert_same(env.step(action)[:2], expected[:2])
        assert_same(env.step(action)[:2], local.step(action)[:2])
        env.close()


def test_a_forked_child_is_told_to_connect_anew(server):
    env = rodgym.remote.connect(server.address, SWING_UP)
    env.reset(seed=0)
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            env.step(np.zeros((1, 1)))
            os.write(write, b"it stepped")
        except Exception as error:
            os.write(write, str(error).encode())
        os._exit(0)
    os.waitpid(child, 0)
    assert b"another process" in os.read(read, 1000)
    env.step(np.zeros((1, 1)))
    env.close()


def test_without_keys_only_this_machine_is_served(tmp_path):
    for bind in ("tcp://0.0.0.0:0", "tcp://*:0", "tcp://[::]:0"):
        with pytest.raises(AssertionError, match="keygen"):
            with serving(bind=bind):
                pass
    with serving("--insecure-no-auth", bind="tcp://0.0.0.0:0") as server:
        until(lambda: "everybody who reaches" in server.log)
        port = host(server)[1]
        assert rodgym.remote.ping(f"tcp://127.0.0.1:{port}")["user"] == "local"
    path = Path(tmp_path) / "socket"
    with serving(bind=f"ipc://{path}") as server:
        assert rodgym.remote.ping(f"ipc://{path}")["user"] == "local"
