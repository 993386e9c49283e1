"""Promise: an interrupt at any point of a remote call changes nothing but the result of that call:
it was not made, or it counts once, and the environment goes on."""

from __future__ import annotations

import signal
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import RANDOM, SWING_UP, actions_for, assert_same
from remote_helpers import need_server, serving

need_server()

import rodgym.remote  # noqa: E402
import rodgym.remote.session  # noqa: E402
import zmq  # noqa: E402
from rodgym.remote.connection import Connection, Wire  # noqa: E402
from rodgym.vector import RodVectorEnv  # noqa: E402

ARGUMENTS = {"max_episode_steps": 5, **RANDOM}
#: Where interrupts are thrown: our client's files and those of the socket library.
PLACES = tuple(str(Path(module.__file__).parent) for module in (rodgym.remote, zmq))


class Interrupt:
    """Throws KeyboardInterrupt at the k-th line that the client runs."""

    def __init__(self, k: int) -> None:
        self.left = k

    def __enter__(self) -> Interrupt:
        sys.settrace(self._call)
        return self

    def __exit__(self, *_: object) -> None:
        sys.settrace(None)

    @property
    def thrown(self) -> bool:
        return self.left < 0

    def _call(self, frame, event, argument):
        # Python swallows what a destructor throws.
        inside = frame.f_code.co_filename.startswith(PLACES) and frame.f_code.co_name != "__del__"
        return self._line if inside else None

    def _line(self, frame, event, argument):
        if event == "line":
            self.left -= 1
            if self.left < 0:
                sys.settrace(None)
                raise KeyboardInterrupt
        return self._line


def pair(address: str, **arguments):
    """The same batch on the server and here, both begun."""
    remote = rodgym.remote.connect(address, SWING_UP, 2, **ARGUMENTS, **arguments)
    local = RodVectorEnv(SWING_UP, 2, **ARGUMENTS)
    assert_same(remote.reset(seed=8), local.reset(seed=8))
    return remote, local


@pytest.fixture(scope="module")
def server():
    with serving("--max-user-sessions", "256") as server:
        yield server


@pytest.mark.parametrize("recover", ["raise", "restart"])
@pytest.mark.parametrize("then", ["another", "the same", "a look"])
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore:Unclosed socket:ResourceWarning")
def test_a_step_interrupted_at_any_line_was_not_made_or_counts_once(
    server, rng, recover, then, monkeypatch
):
    monkeypatch.setattr(rodgym.remote.session, "SNAPSHOT_EVERY", 3)
    remote, local = pair(server.address, recover=recover)
    native = remote._batch.native
    not_made = made = 0
    for k in range(100_000):
        first, second = actions_for(rng, 2, 2)
        before = native._progress.seq, native._progress.pending
        assert before[1] is None
        with Interrupt(k) as interrupt:
            try:
                result = remote.step(first)
            except KeyboardInterrupt:
                result = None
        if not interrupt.thrown:
            assert_same(result, local.step(first))
            break
        numbered = native._progress.pending is not None or native._progress.seq > before[0]
        given = native._progress.pending is not None
        if numbered:
            made += 1
            expected = local.step(first)
        else:
            not_made += 1
        if then == "a look":
            assert remote.get_state() == local.get_state()
            second = first
        if then == "the same":
            again = remote.step(first)
            assert_same(again, expected if given else local.step(first))
        elif then == "a look" and given:
            assert_same(remote.step(second), expected)
        else:
            assert_same(remote.step(second), local.step(second))
    assert not_made > 3 and made > 30, (not_made, made)
    assert remote.get_state() == local.get_state()
    remote.close()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore:Unclosed socket:ResourceWarning")
def test_a_recovery_interrupted_at_any_line_begins_anew(rng, monkeypatch):
    """A session that is half restored is never played on."""
    monkeypatch.setattr(rodgym.remote.session, "SNAPSHOT_EVERY", 3)
    with serving("--max-user-sessions", "256") as server:
        remote, local = pair(server.address, recover="restart")
        native = remote._batch.native
        for action in actions_for(rng, 4, 2):
            assert_same(remote.step(action), local.step(action))
        made = native.recoveries
        step, handed = native.step, []

        def noting(*arguments):
            result = step(*arguments)
            handed.append(result)
            return result

        monkeypatch.setattr(native, "step", noting)
        for k in range(0, 100_000, 7):
            handed.clear()
            # The session is lost as an idle one is.
            native.connection.request("close", sid=native._sid)
            first, second = actions_for(rng, 2, 2)
            with Interrupt(k) as interrupt:
                try:
                    result = remote.step(first)
                except KeyboardInterrupt:
                    result = None
            if native._progress.pending is not None or handed:
                expected = local.step(first)
            if not interrupt.thrown:
                assert_same(result, expected)
                break
            assert_same(remote.step(second), local.step(second))
        assert native.recoveries > made + 10
        assert remote.get_state() == local.get_state()
        remote.close()


class Half:
    """A socket that throws after so many frames of a reply."""

    def __init__(self, socket, frames: int) -> None:
        self.socket, self.frames = socket, frames

    def recv_multipart(self, **_kwargs):
        for _ in range(self.frames):
            self.socket.recv()
        raise KeyboardInterrupt

    def __getattr__(self, name):
        return getattr(self.socket, name)


@pytest.mark.parametrize("frames", [0, 1, 2, 3])
def test_a_socket_with_half_a_reply_is_not_used_again(server, rng, frames):
    remote, local = pair(server.address)
    connection = remote._batch.native.connection
    used = connection._socket
    for action in actions_for(rng, 3, 2):
        wire = connection._wire
        connection._wire = Wire(Half(wire.socket, frames), wire.monitor)
        connection._open_wires[:] = [connection._wire]
        with pytest.raises(KeyboardInterrupt):
            remote.step(action)
        assert used.closed and connection._socket is None
        assert_same(remote.step(action), local.step(action))
        used = connection._socket
    remote.close()


def test_a_call_that_is_refused_leaves_nothing_pending(server, rng):
    remote, local = pair(server.address)
    for action in actions_for(rng, 3, 2):
        for env in (remote, local):
            with pytest.raises(ValueError, match="finite"):
                env.step(np.full((2, 1), np.nan))
        assert remote._batch.native._progress.pending is None
        assert_same(remote.step(action), local.step(action))
    remote.close()


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs POSIX timers")
def test_ctrl_c_at_random_times(server, rng):
    """Real signals, as Python delivers them."""
    remote, local = pair(server.address)
    native = remote._batch.native
    caught = 0
    for first, second in rng.uniform(-1, 1, size=(150, 2, 2, 1)):
        before = native._progress.seq
        result = None
        previous = signal.signal(signal.SIGALRM, signal.default_int_handler)
        try:
            signal.setitimer(signal.ITIMER_REAL, rng.uniform(2e-5, 6e-4))
            result = remote.step(first)
            time.sleep(1e-3)
        except KeyboardInterrupt:
            caught += 1
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, previous)
        if native._progress.pending is not None or native._progress.seq > before:
            expected = local.step(first)
            if result is not None:
                assert_same(result, expected)
        assert_same(remote.step(second), local.step(second))
    assert caught > 30
    assert remote.get_state() == local.get_state()
    remote.close()


def test_an_environment_closed_while_it_waits_stops_waiting(rng):
    with serving() as server:
        remote, _ = pair(server.address)
        server.send(signal.SIGSTOP)
        told = []

        def step() -> None:
            with pytest.raises(rodgym.remote.RemoteError, match="closed") as caught:
                remote.step(np.zeros((2, 1)))
            told.append(caught.value.code)

        thread = threading.Thread(target=step)
        thread.start()
        while remote._batch.native._progress.pending is None:
            time.sleep(0.01)
        remote.close()
        thread.join(10)
        server.send(signal.SIGCONT)
        assert told == ["closed"]
        with pytest.raises(rodgym.remote.RemoteError, match="closed"):
            remote.step(np.zeros((2, 1)))


@pytest.mark.parametrize("end", ["close", "forget"])
def test_an_interrupted_environment_still_gives_its_session_back(end, monkeypatch):
    with serving("--max-sessions", "1", "--max-user-sessions", "1") as server:
        for _ in range(3):
            env = rodgym.remote.connect(server.address, SWING_UP, timeout=5.0)
            env.reset(seed=0)
            with monkeypatch.context() as patch:
                patch.setattr(Connection, "_converse", interrupted)
                with pytest.raises(KeyboardInterrupt):
                    env.step(np.zeros((1, 1)))
            if end == "close":
                env.close()
            del env


def interrupted(*_: object) -> None:
    raise KeyboardInterrupt
