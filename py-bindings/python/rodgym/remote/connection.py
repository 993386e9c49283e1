"""One connection to a server: a request gets its reply, whatever happens to the wire.

A DEALER socket that is closed, opened again and given the same request when no reply comes (the
"lazy pirate"). The server answers a repeated request from memory, so nothing happens twice.
"""

from __future__ import annotations

import itertools
import os
import random
import secrets
import time
from dataclasses import dataclass
from typing import Any

import zmq
from zmq.utils.monitor import parse_monitor_message

from rodgym.remote.errors import (
    AuthenticationError,
    LimitError,
    RemoteError,
    RemoteTimeoutError,
    SessionLostError,
    VersionError,
    local_error,
)
from rodgym.remote.keys import key_pair, public_key
from rodgym.remote.wire import Arrays, Reply, pack, unpack

#: Time for one attempt before the socket is opened anew; doubles up to the second [s].
ATTEMPT_SECONDS = (2.0, 8.0)
#: Pause before a request is sent again over a connection that broke; doubles up to the second [s].
PAUSE_SECONDS = (0.01, 0.5)
#: Time between looks at what happened on the wire, and the precision of a deadline [ms].
EVENTS_MILLISECONDS = 100
#: Largest frame that is accepted.
MAX_MESSAGE = 256 << 20

_CLASSES: dict[str, type[RemoteError]] = {
    "version": VersionError,
    "denied": AuthenticationError,
    "limit": LimitError,
    "busy": LimitError,
    "no_session": SessionLostError,
    "internal": SessionLostError,
}

#: What the socket saw, in words for people.
_EVENTS: dict[int, str] = {
    zmq.EVENT_CONNECTED: "connected, but no handshake yet: is it a rodgym server, with these keys?",
    zmq.EVENT_CONNECT_DELAYED: "connecting",
    zmq.EVENT_CONNECT_RETRIED: "nothing listens there",
    zmq.EVENT_CLOSED: "nothing listens there",
    zmq.EVENT_DISCONNECTED: "the server closed the connection",
    zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL: "the handshake failed: one side uses keys and the other "
    "does not, or the server's public key is not this one",
    zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL: "the handshake failed: the other side uses other keys or "
    "another protocol",
    zmq.EVENT_HANDSHAKE_FAILED_AUTH: "the server refused our key",
    zmq.EVENT_HANDSHAKE_SUCCEEDED: "connected, the server does not answer: busy, or stopped",
}
_BROKEN = (zmq.EVENT_DISCONNECTED, zmq.EVENT_CLOSED)


@dataclass(frozen=True)
class Address:
    """Where a server is and how to reach it."""

    #: `tcp://host:port` or `ipc://path`.
    server: str
    #: Directory with our `secret.key`; None: without encryption.
    keys: str | None = None
    #: The server's public key or the path of its `public.key`.
    server_key: str | None = None
    #: Most time for one request, retries included [s].
    timeout: float = 60.0


class Connection:
    """Requests and replies over one socket; not for use by two threads at a time."""

    def __init__(self, address: Address) -> None:
        self.address = address
        #: Epoch of the last reply.
        self.epoch = ""
        #: Times that a request was sent again.
        self.resent = 0
        self._rids = itertools.count(secrets.randbits(32))
        self._curve: tuple[bytes, bytes, bytes] | None = None
        if address.keys is not None and address.server_key is not None:
            self._curve = (*key_pair(address.keys), public_key(address.server_key))
        elif address.keys is not None or address.server_key is not None:
            raise AuthenticationError("keys and server_key belong together: one alone is no use")
        self._last_event = "not connected yet"
        self._pid = os.getpid()
        self._socket: zmq.Socket[bytes] | None = None
        self._monitor: zmq.Socket[bytes] | None = None

    def request(
        self,
        op: str,
        *,
        sid: str | None = None,
        seq: int | None = None,
        p: dict[str, Any] | None = None,
        arrays: Arrays | None = None,
    ) -> Reply:
        """Sends a request until it is answered.

        Raises:
            RemoteTimeoutError: no answer within the deadline.
            RemoteError: the server's refusal, by its code's class.
        """
        if os.getpid() != self._pid:
            raise RemoteError(
                "this connection belongs to another process: connect again after a fork"
            )
        rid = next(self._rids)
        frames = pack(op, rid, sid, seq, p or {}, arrays or {})
        deadline = time.monotonic() + self.address.timeout
        attempt, pause = ATTEMPT_SECONDS[0], PAUSE_SECONDS[0]
        while True:
            reply = self._attempt(frames, rid, min(deadline, time.monotonic() + attempt))
            if reply is not None:
                self.epoch = reply.epoch
                if reply.ok:
                    return reply
                wait = self._busy(reply, deadline)
                if wait is None:
                    raise _refusal(reply)
                time.sleep(wait)
                continue
            if time.monotonic() >= deadline:
                self._close_socket()
                raise self._timeout(op)
            # The socket's queues may hold anything by now: a new one starts empty.
            self._close_socket()
            self.resent += 1
            attempt = min(2 * attempt, ATTEMPT_SECONDS[1])
            time.sleep(min(pause * random.uniform(0.5, 1.0), max(0.0, deadline - time.monotonic())))
            pause = min(2 * pause, PAUSE_SECONDS[1])

    def send_last(self, op: str, sid: str) -> None:
        """Sends a request whose outcome no longer matters; waits 1 s at most."""
        if self._socket is not None and os.getpid() == self._pid:
            rid = next(self._rids)
            self._attempt(pack(op, rid, sid, None, {}, {}), rid, time.monotonic() + 1.0)

    def close(self) -> None:
        """Closes the socket; a later request opens it again."""
        self._close_socket()

    def _attempt(self, frames: list[Any], rid: int, until: float) -> Reply | None:
        """One sending; None if no reply came or the connection broke."""
        socket = self._socket or self._open()
        try:
            socket.send_multipart(frames, zmq.DONTWAIT)
        except zmq.Again:
            return None
        while time.monotonic() < until:
            try:
                reply = unpack(socket.recv_multipart())
            except zmq.Again:
                if self._read_events():
                    return None
                continue
            # Zero: the server could not read our number. Others answer requests we gave up.
            if reply.rid in (rid, 0):
                return reply
        return None

    def _open(self) -> zmq.Socket[bytes]:
        socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        socket.linger = 0
        socket.rcvtimeo = EVENTS_MILLISECONDS
        socket.sndhwm = socket.rcvhwm = 64
        socket.maxmsgsize = MAX_MESSAGE
        socket.heartbeat_ivl, socket.heartbeat_timeout = 2000, 6000
        socket.reconnect_ivl, socket.reconnect_ivl_max = 50, 1000
        socket.ipv6 = True
        if self._curve is not None:
            socket.curve_publickey, socket.curve_secretkey, socket.curve_serverkey = self._curve
        monitor = socket.get_monitor_socket()
        try:
            socket.connect(self.address.server)
        except zmq.ZMQError as error:
            _close(socket, monitor)
            raise RemoteError(f"{self.address.server!r} is not an address: {error}") from error
        self._socket, self._monitor = socket, monitor
        return socket

    def _close_socket(self) -> None:
        if self._socket is not None and os.getpid() == self._pid:
            self._read_events()
            _close(self._socket, self._monitor)
        self._socket = self._monitor = None

    def _read_events(self) -> bool:
        """Notes what happened on the wire; True if an established connection broke."""
        broken = False
        while self._monitor is not None and self._monitor.poll(0):
            event = parse_monitor_message(self._monitor.recv_multipart())["event"]
            if event == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
                self._last_event = _EVENTS[event]
                raise AuthenticationError(
                    f"the server at {self.address.server} refused our key: it is not among its "
                    "authorized keys",
                    "denied",
                )
            broken |= event == zmq.EVENT_DISCONNECTED
            # A closed attempt says less than the failure before it.
            failed = self._last_event.startswith("the handshake failed")
            if event in _EVENTS and not (failed and event in (*_BROKEN, zmq.EVENT_CONNECT_RETRIED)):
                self._last_event = _EVENTS[event]
        return broken

    def _busy(self, reply: Reply, deadline: float) -> float | None:
        """How long to wait before asking again; None: do not.

        A draining server's successor may come to the same address.
        """
        error = reply.err or {}
        if error.get("code") not in ("busy", "draining"):
            return None
        wait = float(error.get("after_ms") or 20) / 1000 * random.uniform(1.0, 1.5)
        return wait if time.monotonic() + wait < deadline else None

    def _timeout(self, op: str) -> RemoteTimeoutError:
        mechanism = "CURVE" if self._curve else "no encryption"
        return RemoteTimeoutError(
            f"'{op}' was not answered within {self.address.timeout:g} s by {self.address.server} "
            f"({mechanism}); last seen: {self._last_event}",
            "timeout",
            "same",
        )


def _close(socket: zmq.Socket[bytes], monitor: zmq.Socket[bytes] | None) -> None:
    socket.disable_monitor()
    if monitor is not None:
        monitor.close()
    socket.close()


def _refusal(reply: Reply) -> Exception:
    error = reply.err or {}
    code = str(error.get("code", "unknown"))
    message = str(error.get("msg", "the server gave no reason"))
    if code == "env":
        return local_error(str(reply.p.get("kind", "")), message)
    if code == "version":
        message += f" (this client: {reply.p.get('client')}, the server: {reply.p.get('server')})"
    made = _CLASSES.get(code, RemoteError)
    return made(message, code, str(error.get("retry", "never")), error.get("after_ms"))
