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
from typing import Any, NamedTuple

import zmq
from zmq.utils.monitor import parse_monitor_message

from rodgym.remote.address import Address
from rodgym.remote.errors import (
    AuthenticationError,
    LimitError,
    RemoteError,
    RemoteTimeoutError,
    SessionLostError,
    UnsendableError,
    VersionError,
    local_error,
)
from rodgym.remote.keys import key_pair, public_key
from rodgym.remote.wire import Arrays, Reply, pack, unpack

#: Time for one attempt before the socket is opened anew; doubles up to the second [s].
ATTEMPT_SECONDS = (2.0, 8.0)
#: Time for the first connection where nothing listens: a server may just be starting [s].
NOBODY_SECONDS = 5.0
#: Pause before a request is sent again over a connection that broke; doubles up to the second [s].
PAUSE_SECONDS = (0.01, 0.5)
#: Time between looks at what happened on the wire, and the precision of a deadline [ms].
EVENTS_MILLISECONDS = 100
#: Bytes of a request that every server takes, until it has told how many it takes.
LEAST_MESSAGE = 1 << 20
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


class Wire(NamedTuple):
    """A socket and where it tells its events."""

    socket: zmq.Socket[bytes]
    monitor: zmq.Socket[bytes]

    def close(self) -> None:
        """Closes both; may be called again after an interrupt.

        In this order: libzmq waits for ever to tell an event that nobody is there to read.
        """
        if not self.socket.closed:
            self.socket.monitor(None, 0)
            self.socket.close()
        self.monitor.close()


class Connection:
    """Requests and replies over one socket; for one thread at a time, except `stop`."""

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
        #: Whether something ever listened there.
        self._reached = False
        self._stopped = False
        #: Bytes of a request that the server takes. A server hangs up on who sends much more, and
        #: libzmq may end this process when that meets our closing of the socket.
        self.message_bytes = LEAST_MESSAGE
        self._pid = os.getpid()
        #: The socket between two requests. Whoever uses it takes it out and puts it back only when
        #: a whole reply was read: after anything else, an interrupt at any byte included, it is
        #: not used again.
        self._wire: Wire | None = None
        #: All that are not closed yet: an interrupt of their closing is made good by the next one.
        self._open_wires: list[Wire] = []

    @property
    def is_ours(self) -> bool:
        """Whether this process made it: sockets do not survive a fork."""
        return os.getpid() == self._pid

    def check_process(self) -> None:
        """Refuses what a fork left unusable.

        Raises:
            RemoteError: another process made this connection.
        """
        if not self.is_ours:
            raise RemoteError(
                "this connection belongs to another process: connect again after a fork"
            )

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
        reply = self.exchange(op, sid=sid, seq=seq, p=p, arrays=arrays)
        if not reply.ok:
            raise refusal(reply)
        return reply

    def exchange(
        self,
        op: str,
        *,
        sid: str | None = None,
        seq: int | None = None,
        p: dict[str, Any] | None = None,
        arrays: Arrays | None = None,
    ) -> Reply:
        """As `request`, but a refusal is returned."""
        self.check_process()
        rid = next(self._rids)
        frames = pack(op, rid, sid, seq, p or {}, arrays or {})
        size = sum(memoryview(frame).nbytes for frame in frames)
        if size > self.message_bytes:
            raise UnsendableError(
                f"'{op}' would take {size} bytes; this server takes {self.message_bytes}", "limit"
            )
        began = time.monotonic()
        deadline = began + self.address.timeout
        attempt, pause = ATTEMPT_SECONDS[0], PAUSE_SECONDS[0]
        while True:
            until = min(deadline, time.monotonic() + attempt)
            if not self._reached:
                until = min(until, began + NOBODY_SECONDS)
            reply = self._attempt(frames, rid, until)
            if reply is not None:
                self.epoch = reply.epoch
                wait = self._busy(reply, deadline)
                if wait is None:
                    return reply
                time.sleep(wait)
                continue
            now = time.monotonic()
            nobody = not self._reached and self._last_event == _EVENTS[zmq.EVENT_CLOSED]
            if now >= deadline or (nobody and now >= began + NOBODY_SECONDS):
                raise self._timeout(op, now - began)
            self.resent += 1
            attempt = min(2 * attempt, ATTEMPT_SECONDS[1])
            time.sleep(min(pause * random.uniform(0.5, 1.0), max(0.0, deadline - now)))
            pause = min(2 * pause, PAUSE_SECONDS[1])

    def stop(self) -> None:
        """Ends the request that another thread waits for, and refuses all that follow."""
        self._stopped = True

    def finish(self, op: str, sids: list[str]) -> None:
        """Sends last requests, whose outcome no longer matters, and closes; waits 1 s at most."""
        until = time.monotonic() + 1.0
        self._stopped = False
        try:
            for sid in sids:
                rid = next(self._rids)
                if self._attempt(pack(op, rid, sid, None, {}, {}), rid, until) is None:
                    break
        finally:
            self._stopped = True
            self.close()

    def close(self) -> None:
        """Closes the socket; a later request opens another."""
        self._wire = None
        if self.is_ours:
            self._sweep()

    @property
    def _socket(self) -> zmq.Socket[bytes] | None:
        """The socket between two requests."""
        return None if self._wire is None else self._wire.socket

    def _attempt(self, frames: list[Any], rid: int, until: float) -> Reply | None:
        """One sending; None if no reply came or the connection broke."""
        wire, self._wire = self._wire or self._connect(), None
        try:
            reply = self._converse(wire, frames, rid, until)
            if reply is not None:
                self._wire = wire
            else:
                # The socket's queues may hold anything by now: a new one starts empty.
                self._read_events(wire)
        finally:
            if self._wire is None:
                self._sweep()
        return reply

    def _converse(self, wire: Wire, frames: list[Any], rid: int, until: float) -> Reply | None:
        socket = wire.socket
        try:
            socket.send_multipart(frames, zmq.DONTWAIT)
        except zmq.Again:
            return None
        while time.monotonic() < until:
            if self._stopped:
                raise RemoteError("this environment was closed", "closed")
            try:
                reply = unpack(socket.recv_multipart())
            except zmq.Again:
                if self._read_events(wire):
                    return None
                continue
            self._reached = True
            # Zero: the server could not read our number. Others answer requests we gave up.
            if reply.rid in (rid, 0):
                return reply
        return None

    def _connect(self) -> Wire:
        self._sweep()
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context.instance()
        wire = Wire(context.socket(zmq.DEALER), context.socket(zmq.PAIR))
        self._open_wires.append(wire)
        socket = wire.socket
        socket.linger = 0
        socket.rcvtimeo = EVENTS_MILLISECONDS
        socket.sndhwm = socket.rcvhwm = 64
        socket.maxmsgsize = MAX_MESSAGE
        socket.heartbeat_ivl, socket.heartbeat_timeout = 2000, 6000
        socket.reconnect_ivl, socket.reconnect_ivl_max = 50, 1000
        socket.ipv6 = True
        if self._curve is not None:
            socket.curve_publickey, socket.curve_secretkey, socket.curve_serverkey = self._curve
        events = f"inproc://rodgym-{secrets.token_hex(8)}"
        wire.monitor.connect(events)
        socket.monitor(events, zmq.EVENT_ALL)
        try:
            socket.connect(self.address.server)
        except zmq.ZMQError as error:
            raise RemoteError(f"{self.address.server!r} is not an address: {error}") from error
        return wire

    def _sweep(self) -> None:
        """Closes all sockets but the one that waits for the next request."""
        for wire in list(self._open_wires):
            if wire is not self._wire:
                wire.close()
                self._open_wires.remove(wire)

    def _read_events(self, wire: Wire) -> bool:
        """Notes what happened on the wire; True if an established connection broke."""
        broken = False
        while wire.monitor.poll(0):
            event = parse_monitor_message(wire.monitor.recv_multipart())["event"]
            if event == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
                self._last_event = _EVENTS[event]
                raise AuthenticationError(
                    f"the server at {self.address.server} refused our key: it is not among its "
                    "authorized keys",
                    "denied",
                )
            broken |= event == zmq.EVENT_DISCONNECTED
            self._reached |= event == zmq.EVENT_CONNECTED
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
        if reply.ok or error.get("code") not in ("busy", "draining"):
            return None
        after = error.get("after_ms")
        wait = (after if isinstance(after, int) and 0 < after < 60_000 else 20) / 1000
        wait *= random.uniform(1.0, 1.5)
        return wait if time.monotonic() + wait < deadline else None

    def _timeout(self, op: str, seconds: float) -> RemoteTimeoutError:
        mechanism = "CURVE" if self._curve else "no encryption"
        return RemoteTimeoutError(
            f"'{op}' was not answered within {seconds:.3g} s by {self.address.server} "
            f"({mechanism}); last seen: {self._last_event}",
            "timeout",
            "same",
        )


def refusal(reply: Reply) -> Exception:
    """What the server refused, by its code's class."""
    error = reply.err or {}
    code = str(error.get("code", "unknown"))
    message = str(error.get("msg", "the server gave no reason"))
    if code == "env":
        return local_error(str(reply.p.get("kind", "")), message)
    if code == "version":
        message += f" (this client: {reply.p.get('client')}, the server: {reply.p.get('server')})"
    made = _CLASSES.get(code, RemoteError)
    return made(message, code, str(error.get("retry", "never")), error.get("after_ms"))
