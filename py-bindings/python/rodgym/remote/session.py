"""A session of a server: numbered calls that are carried out once, whatever interrupts them.

All that the client knows of its session is one `Progress`, replaced by one assignment. So an
exception at any point, Ctrl-C included, finds the record of before or that of after:

* before a call has its number, it was not made;
* from then on it is pending: the server may have carried it out or not. Whatever is asked next
  settles it first, by asking again under its number;
* once its result is handed over it is no longer pending.
"""

from __future__ import annotations

import contextlib
import secrets
import threading
import weakref
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from rodgym.errors import EnvIndexError, ResetNeededError, RodgymError
from rodgym.remote.connection import Connection, refusal
from rodgym.remote.errors import (
    RemoteError,
    RemoteTimeoutError,
    SessionLostError,
    UnsendableError,
)
from rodgym.remote.wire import Arrays, Reply, damaged, reading

#: Changing calls between two snapshots with recover="restart".
SNAPSHOT_EVERY = 100
#: Sessions made for one call before giving up: the call itself may be what breaks the server.
RECOVERIES = 3
#: Bytes of snapshots in one request, at most; less where the server takes less.
SNAPSHOT_BYTES = 8 << 20
#: Bytes of a request beside its snapshots.
HEADER_BYTES = 4096
#: Bytes of a request that a server takes that does not say.
MESSAGE_BYTES = 16 << 20

Result = TypeVar("Result")


class Call(NamedTuple):
    """A call that changes the session."""

    op: str
    p: dict[str, Any]
    arrays: Arrays

    def same(self, other: Call) -> bool:
        """Whether the content is the same."""
        same = self.op == other.op and self.p == other.p
        return same and self.arrays.keys() == other.arrays.keys() and all(
            np.array_equal(self.arrays[name], other.arrays[name]) for name in self.arrays
        )  # fmt: skip


class Progress(NamedTuple):
    """What is known of a session."""

    sid: str
    #: Number of the last call that is known to be carried out.
    seq: int = 0
    #: A call that has a number, and whose result was not handed over.
    pending: Call | None = None
    #: Its reply; None while nobody knows whether it was carried out.
    reply: Reply | None = None
    #: Snapshots of all environments, to recover from; None: from the start.
    snapshot: tuple[bytes, ...] | None = None
    #: Calls since.
    since: tuple[Call, ...] = ()
    #: Replies to calls whose results were never handed over, oldest first.
    missed: tuple[Reply, ...] = ()


class Session:
    """Environments on a server, by its protocol's operations; threads take turns.

    Arguments:
        connection: to the server.
        about: parameters of the operation `make`.
        lists: its arrays.
        recover: makes another session, from our last snapshot, when this one is gone, and repeats
            the calls since. Environments are deterministic, so the trajectory goes on as if nothing
            had happened.
    """

    def __init__(
        self, connection: Connection, about: dict[str, Any], lists: Arrays, recover: bool
    ) -> None:
        self.connection = connection
        #: Sessions made after the first.
        self.recoveries = 0
        self._about = about
        self._lists = lists
        self._recover = recover
        self._lock = threading.RLock()
        #: Sessions to give back when this object is forgotten: ours, and half restored ones.
        self._held: list[str] = []
        self._release = weakref.finalize(self, _release, connection, self._lock, self._held)
        self._progress: Progress | None = None
        try:
            made = self._make()
            with reading():
                self._understand(made)
            self._progress = Progress(made.p["sid"])
        except BaseException:
            self._release()
            raise

    def _understand(self, made: Reply) -> None:
        """Takes what `make` tells."""
        spec = made.p["spec"]
        sizes = [
            len(spec[side][bound])
            for side in ("observation", "action")
            for bound in ("low", "high")
        ]
        names = [parameter["name"] for parameter in spec["parameters"]]
        self._widths = sizes[0], len(spec["reward_terms"]) + len(spec["metrics"]), len(names)
        if sizes[0] != sizes[1] or sizes[2] != sizes[3] or not spec["control_dt"] > 0.0:
            raise ValueError(f"spec = {spec!r}")
        self.spec: dict[str, Any] = {**spec, "config": dict(spec["config"])}
        self.num_envs: int = made.p["num_envs"]
        self.autoreset_mode: str = made.p["autoreset_mode"]
        self.max_episode_steps: int | None = made.p["max_episode_steps"]
        #: Bytes of a request that the server takes.
        self.message_bytes: int = made.p.get("message_bytes", MESSAGE_BYTES)
        if not isinstance(self.message_bytes, int) or self.message_bytes <= HEADER_BYTES:
            raise ValueError(f"message_bytes = {self.message_bytes!r}")
        self.connection.message_bytes = self.message_bytes
        if self.num_envs != self._about["num_envs"]:
            raise ValueError(f"num_envs = {self.num_envs!r}")

    def close(self) -> None:
        """Gives the session back, if the server can be reached at once, and closes the socket.

        A thread that waits for the server stops waiting.
        """
        self.connection.stop()
        if self.connection.is_ours:
            with self._lock:
                self._progress = None
                self._release()

    @property
    def _sid(self) -> str | None:
        return None if self._progress is None else self._progress.sid

    @property
    def _turn(self) -> contextlib.AbstractContextManager[Any]:
        """Held for a call; asked for only where the lock cannot be a dead thread's."""
        self.connection.check_process()
        return self._lock

    def _open(self) -> Progress:
        if self._progress is None:
            raise RemoteError("this environment was closed", "closed")
        return self._progress

    def _ask(self, op: str, p: dict[str, Any]) -> Reply:
        """A request that changes nothing; sees what a pending call has done."""
        self._check_index(p)
        with self._turn:
            self._settle_earlier()

            def send() -> Reply:
                return self.connection.request(op, sid=self._open().sid, p=p)

            return self._again(send)

    def _change(
        self, op: str, p: dict[str, Any], arrays: Arrays, read: Callable[[Reply], Result]
    ) -> Result:
        """A numbered call: carried out once, however often it must be sent.

        A pending call counts before this one; the same call once more is its repetition.
        """
        self._check_index(p)
        with self._turn:
            call, pending = Call(op, p, arrays), self._open().pending
            if pending is not None and not pending.same(call):
                self._settle_earlier()
                pending = None
            if pending is None:
                now = self._open()
                missed = now.missed if now.reply is None else (*now.missed, now.reply)
                self._progress = now._replace(pending=call, reply=None, missed=missed)
            reply = self._settle()
            with reading():
                result = read(reply)
            if len(self._open().since) >= SNAPSHOT_EVERY:
                self._save()
            self._progress = self._open()._replace(pending=None, reply=None)
            return result

    def _settle_earlier(self) -> None:
        """Knows what became of a pending call, whose result may still be asked for."""
        if self._open().pending is None:
            return
        try:
            self._settle()
        except RodgymError:
            # Refused for good: it has changed nothing, and its caller is gone.
            if self._open().pending is not None:
                raise

    def _settle(self) -> Reply:
        """The reply of the pending call, asked for until it is known."""

        def send() -> Reply:
            progress = self._open()
            if progress.reply is not None:
                return progress.reply
            call = progress.pending
            assert call is not None
            try:
                reply = self._number(progress, call)
            except UnsendableError:
                self._progress = progress._replace(pending=None)
                raise
            if not reply.ok:
                # What the server will never do it has not done.
                if (reply.err or {}).get("retry", "never") == "never":
                    self._progress = progress._replace(pending=None)
                raise refusal(reply)
            since = (*progress.since, call) if self._recover else ()
            self._progress = progress._replace(seq=progress.seq + 1, reply=reply, since=since)
            return reply

        return self._again(send)

    def _number(self, progress: Progress, call: Call) -> Reply:
        number = progress.seq + 1
        return self.connection.exchange(
            call.op, sid=progress.sid, seq=number, p=call.p, arrays=call.arrays
        )

    def _again(self, send: Callable[[], Reply]) -> Reply:
        """Sends; if the session is lost, makes another and sends again."""
        most, lost = self.recoveries + RECOVERIES, False
        while True:
            try:
                if lost:
                    self._restore()
                return send()
            except SessionLostError:  # noqa: PERF203
                if not self._recover or self.recoveries == most:
                    raise
                self.recoveries += 1
                lost = True

    def _save(self) -> None:
        try:
            states = tuple(self.get_states(0, self.num_envs))
        except (ResetNeededError, RemoteTimeoutError):
            # Some environments were never reset: the calls are all there is to remember. Or the
            # server is slow: another time.
            return
        self._progress = self._open()._replace(snapshot=states, since=())

    def _restore(self) -> None:
        """A new session in the state of the lost one; until it is there the lost one stays ours."""
        lost = self._open()
        fresh = lost._replace(sid=self._make().p["sid"], seq=0)
        snapshot = lost.snapshot or ()
        calls = in_parts(0, snapshot, self.message_bytes)
        for call in (*calls, *lost.since):
            reply = self._number(fresh, call)
            if not reply.ok:
                raise refusal(reply)
            fresh = fresh._replace(seq=fresh.seq + 1)
        self._progress = fresh
        self._held[:] = [fresh.sid]

    def _make(self) -> Reply:
        about = {**self._about, "nonce": secrets.token_hex(16)}
        reply = self.connection.request("make", p=about, arrays=self._lists)
        sid = reply.p.get("sid")
        if not isinstance(sid, str):
            raise damaged(f"sid = {sid!r}")
        self._held.append(sid)
        return reply

    def get_states(self, first: int, count: int) -> list[bytes]:
        """Snapshots of environments `first` to `first + count`, in as few requests as fit."""
        raise NotImplementedError

    def _check_index(self, p: dict[str, Any]) -> None:
        index = p.get("index", p.get("first", 0))
        if not 0 <= index < self.num_envs:
            raise EnvIndexError(
                f"environment {index} does not exist: the batch has {self.num_envs}"
            )


def in_parts(first: int, states: Sequence[bytes], message_bytes: int) -> Iterator[Call]:
    """Calls that put snapshots in place from `first` on; each takes all of its own or none.

    Raises:
        RemoteError: a snapshot that no request has room for.
    """
    room, done = min(SNAPSHOT_BYTES, message_bytes - HEADER_BYTES), 0
    for state in states:
        if len(state) + 4 > message_bytes - HEADER_BYTES:
            raise RemoteError(
                f"a snapshot of {len(state)} bytes does not fit into a request: "
                f"this server takes {message_bytes} bytes",
                "limit",
            )
    while done < len(states):
        count, total = 0, 0
        for state in states[done:]:
            if count and total + len(state) + 4 > room:
                break
            count, total = count + 1, total + len(state) + 4
        part = states[done : done + count]
        sizes = np.array([len(state) for state in part], dtype=np.uint32)
        data = np.frombuffer(b"".join(part), dtype=np.uint8)
        yield Call("set_state", {"first": first + done}, {"sizes": sizes, "data": data})
        done += count


def _release(connection: Connection, lock: Any, held: list[str]) -> None:
    connection.stop()
    # At the interpreter's end a thread may be at work still, and the socket library gone already.
    if connection.is_ours and lock.acquire(timeout=1.0):
        with contextlib.suppress(Exception):
            connection.finish("close", held)
        lock.release()
