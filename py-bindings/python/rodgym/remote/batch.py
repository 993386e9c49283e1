"""A batch on a server with the face of `rodgym._native.Batch`.

So all above it - seeds, infos, Gymnasium's and Stable-Baselines3's faces - is the local code.
"""

from __future__ import annotations

import contextlib
import secrets
import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from rodgym import _checks as checks
from rodgym._machine import plain
from rodgym._native import Gallery
from rodgym.errors import (
    EnvIndexError,
    ParameterError,
    ResetNeededError,
    RodgymError,
    ShapeError,
)
from rodgym.remote.connection import Address, Connection
from rodgym.remote.errors import RemoteError, RemoteTimeoutError, SessionLostError
from rodgym.remote.wire import Arrays, Reply

#: Bits of the `flags` array.
TERMINATED, TRUNCATED, STEPPED, BEGAN, SOLVER_FAILURE, FINAL = (1 << i for i in range(6))
#: Changing calls between two snapshots with recover="restart".
SNAPSHOT_EVERY = 100
#: Sessions made for one call before giving up: the call itself may be what breaks the server.
RECOVERIES = 3
#: Bytes of snapshots in one request.
SNAPSHOT_BYTES = 8 << 20

_Call = tuple[str, dict[str, Any], Arrays]


class RemoteBatch:
    """Many environments of one kind in a session of a server.

    Arguments:
        address: where the server is.
        recover: `"raise"` a `SessionLostError` when the session is gone, or `"restart"`: make
            another, from our last snapshot, and repeat the calls since. Environments are
            deterministic, so the trajectory goes on as if nothing had happened.
        env_id, num_envs, kwargs, autoreset_mode, max_episode_steps: as for `_native.Batch`.
    """

    def __init__(
        self,
        address: Address,
        recover: str,
        env_id: str,
        num_envs: int,
        kwargs: dict[str, Any],
        autoreset_mode: str,
        max_episode_steps: int | None,
    ) -> None:
        if recover not in ("raise", "restart"):
            raise checks.refused("recover", recover, "'raise' or 'restart'")
        self.connection = Connection(address)
        self._recover = recover == "restart"
        self._arguments = (
            address, recover, env_id, num_envs, kwargs, autoreset_mode, max_episode_steps,
        )  # fmt: skip
        self._about = {
            "id": env_id,
            "num_envs": num_envs,
            "kwargs": plain(kwargs),
            "autoreset_mode": autoreset_mode,
            "max_episode_steps": max_episode_steps,
            # One call at a time needs one remembered reply; a second costs little.
            "window": 2,
        }
        #: Sessions made after the first.
        self.recoveries = 0
        self._snapshot: list[bytes] | None = None
        self._since: list[_Call] = []
        #: A call that may have been carried out without our knowing it.
        self._unsettled: _Call | None = None
        self._sid: str | None = None
        self._gallery = Gallery()
        #: What must be given back when this object is forgotten; the session in it changes.
        self._held: dict[str, str] = {}
        self._release = weakref.finalize(self, _release, self.connection, self._held)
        try:
            self._open()
        except BaseException:
            self.connection.close()
            raise

    def _open(self) -> None:
        reply = self.connection.request("make", p={**self._about, "nonce": secrets.token_hex(16)})
        self._sid, self._seq = reply.p["sid"], 0
        self._held["sid"] = reply.p["sid"]
        self.spec: dict[str, Any] = reply.p["spec"]
        self.num_envs: int = reply.p["num_envs"]
        self.autoreset_mode: str = reply.p["autoreset_mode"]
        self.max_episode_steps: int | None = reply.p["max_episode_steps"]
        self._widths = (
            len(self.spec["observation"]["low"]),
            len(self.spec["reward_terms"]) + len(self.spec["metrics"]),
            len(self.spec["parameters"]),
        )

    def close(self) -> None:
        """Gives the session back, if the server can be reached at once, and closes the socket."""
        self._sid = None
        self._release()

    @property
    def num_threads(self) -> int:
        """Threads of a step are the server's business."""
        return 1

    @num_threads.setter
    def num_threads(self, threads: int) -> None:
        raise ParameterError(f"num_threads = {threads} is not allowed: the server decides")

    def reset(
        self,
        seeds: int | Sequence[int | None] | None = None,
        mask: npt.NDArray[np.bool_] | None = None,
        options: dict[str, Any] | None = None,
        out: npt.NDArray[np.float32] | None = None,
    ) -> tuple[npt.NDArray[Any], ...]:
        """Starts episodes; see `_native.Batch.reset`."""
        p: dict[str, Any] = {}
        arrays: Arrays = {}
        if isinstance(seeds, int):
            p["seed"] = checks.seed(seeds)
        elif seeds is not None:
            arrays["seeds"] = np.array([checks.seed(s or 0) for s in seeds], dtype=np.uint64)
            arrays["seeded"] = np.array([s is not None for s in seeds], dtype=np.bool_)
        if mask is not None:
            arrays["mask"] = mask
        if options:
            p["options"], arrays = _split_state(options, arrays)
        reply = self._change("reset", p, arrays)
        return self._results(reply, out)

    def step(
        self, actions: Any, out: npt.NDArray[np.float32] | None = None
    ) -> tuple[npt.NDArray[Any], ...]:
        """One control step; see `_native.Batch.step`."""
        array = np.asarray(actions)
        expected = (self.num_envs, len(self.spec["action"]["low"]))
        if array.shape != expected or array.dtype.kind not in "fiub":
            raise ShapeError(
                f"actions has shape {array.shape} and type {array.dtype}, "
                f"but {expected} numbers are needed"
            )
        # A copy: the caller may overwrite its array before we need to send it again.
        reply = self._change("step", {}, {"action": array.astype("<f4")})
        return self._results(reply, out)

    def reset_single(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[npt.NDArray[np.float32], dict[str, Any]]:
        """`reset` of the one environment of mode Single."""
        result = self.reset(None if seed is None else [seed], None, options)
        return result[0][0], {"parameters": self._named("parameters", result[6][0])}

    def step_single(
        self, action: Any
    ) -> tuple[npt.NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """`step` of the one environment of mode Single."""
        array = np.asarray(action)
        expected = (len(self.spec["action"]["low"]),)
        if array.shape != expected:
            raise ShapeError(f"the action has shape {array.shape}, but {expected} is needed")
        result = self.step(array[np.newaxis])
        terms, count = result[5][0].tolist(), len(self.spec["reward_terms"])
        info: dict[str, Any] = dict(zip(self.spec["metrics"], terms[count:], strict=True))
        info["reward_terms"] = dict(zip(self.spec["reward_terms"], terms, strict=False))
        if result[9][0]:
            info["solver_failure"] = True
        return result[0][0], float(result[1][0]), bool(result[2][0]), bool(result[3][0]), info

    def get_state(self, index: int) -> bytes:
        """Snapshot of environment `index`."""
        return self.get_states(index, 1)[0]

    def get_states(self, first: int, count: int) -> list[bytes]:
        """Snapshots of environments `first` to `first + count`, in as few requests as fit."""
        states: list[bytes] = []
        part = count
        while len(states) < count:
            p = {"first": first + len(states), "count": min(part, count - len(states))}
            try:
                reply = self._ask("get_state", p)
            except RemoteError as error:
                if error.code != "limit" or p["count"] == 1:
                    raise
                part = p["count"] // 2
                continue
            data, place = reply.arrays["data"].tobytes(), 0
            for size in reply.arrays["sizes"].tolist():
                states.append(data[place : place + size])
                place += size
        return states

    def set_state(self, index: int, state: bytes) -> None:
        """Puts a snapshot in place of environment `index`."""
        self.set_states(index, [state])

    def set_states(self, first: int, states: list[bytes]) -> None:
        """Puts snapshots in place from `first` on; each request takes all of its own or none."""
        done = 0
        while done < len(states):
            count, total = 0, 0
            for state in states[done:]:
                if count and total + len(state) > SNAPSHOT_BYTES:
                    break
                count, total = count + 1, total + len(state)
            part = states[done : done + count]
            arrays: Arrays = {
                "sizes": np.array([len(state) for state in part], dtype=np.uint32),
                "data": np.frombuffer(b"".join(part), dtype=np.uint8),
            }
            self._change("set_state", {"first": first + done}, arrays)
            done += count

    def observe(self, index: int) -> npt.NDArray[np.float32]:
        """The last observation of environment `index`."""
        return self.observe_all(index, 1)[0]

    def observe_all(self, first: int, count: int) -> npt.NDArray[np.float32]:
        """The last observations of environments `first` to `first + count`."""
        return self._ask("observe", {"first": first, "count": count}).arrays["obs"].copy()

    def parameters(self, index: int) -> dict[str, float]:
        """Physical parameters in force in environment `index`, by name."""
        reply = self._ask("observe", {"first": index, "count": 1})
        return self._named("parameters", reply.arrays["parameters"][0])

    def nodes(self, index: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Positions [m] and velocities [m/s] of the nodes of environment `index`."""
        arrays = self._ask("nodes", {"index": index}).arrays
        return arrays["positions"].copy(), arrays["velocities"].copy()

    def scene(self, index: int) -> dict[str, Any]:
        """What there is to draw of environment `index`."""
        reply = self._ask("render", {"index": index})
        scene: dict[str, Any] = {**reply.p["scene"], "arrows": {}}
        for name, array in reply.arrays.items():
            if name.startswith("arrow:"):
                scene["arrows"][name.removeprefix("arrow:")] = array.tolist()
            else:
                scene[name] = array.tolist()
        return scene

    def render(
        self, index: int, width: int | None = None, height: int | None = None
    ) -> npt.NDArray[np.uint8]:
        """A picture of environment `index`, drawn here from the server's scene."""
        return self._gallery.render(index, self.scene(index), width, height)

    def svg(self, index: int, width: int | None = None, height: int | None = None) -> str:
        """The same picture as an SVG document."""
        return self._gallery.svg(index, self.scene(index), width, height)

    def _named(self, group: str, values: npt.NDArray[np.float64]) -> dict[str, float]:
        names = [parameter["name"] for parameter in self.spec[group]]
        return dict(zip(names, values.tolist(), strict=True))

    def _results(
        self, reply: Reply, out: npt.NDArray[np.float32] | None
    ) -> tuple[npt.NDArray[Any], ...]:
        """The ten arrays of `_native.Batch.step`."""
        n, (d, k, p), arrays = self.num_envs, self._widths, reply.arrays
        flags = arrays["flags"]
        if out is None:
            observation = arrays["obs"].astype(np.float32)
        else:
            observation = out
            observation[...] = arrays["obs"]
        final = np.zeros((n, d), dtype=np.float32)
        if "final_obs" in arrays:
            final[flags & FINAL != 0] = arrays["final_obs"]
        began = flags & BEGAN != 0
        parameters = np.zeros((n, p))
        if "parameters" in arrays:
            parameters[began] = arrays["parameters"]
        stepped = "reward" in arrays
        return (
            observation,
            arrays["reward"].astype(np.float64) if stepped else np.zeros(n),
            flags & TERMINATED != 0,
            flags & TRUNCATED != 0,
            final,
            arrays["terms"].astype(np.float64) if stepped else np.zeros((n, k)),
            parameters,
            flags & STEPPED != 0,
            began,
            flags & SOLVER_FAILURE != 0,
        )

    def _ask(self, op: str, p: dict[str, Any]) -> Reply:
        """A request that changes nothing."""
        self._check_index(p)
        return self._again(lambda: self.connection.request(op, sid=self._session(), p=p))

    def _change(self, op: str, p: dict[str, Any], arrays: Arrays) -> Reply:
        """A numbered call: carried out once, however often it must be sent."""
        self._check_index(p)
        call = (op, p, arrays)
        before = self._unsettled
        if before is not None and not _equal(before, call):
            # After Ctrl-C or a timeout: that call counts, as an interrupted local one does. (The
            # same call once more is its repetition.)
            try:
                self._carry_out(before)
            except RemoteError:
                raise
            except RodgymError:
                pass  # The environment refused it: it has changed nothing.
        return self._carry_out(call)

    def _carry_out(self, call: _Call) -> Reply:
        op, p, arrays = self._unsettled = call

        def send() -> Reply:
            sid, seq = self._session(), self._seq + 1
            reply = self.connection.request(op, sid=sid, seq=seq, p=p, arrays=arrays)
            self._seq = seq
            return reply

        try:
            reply = self._again(send)
        except RemoteTimeoutError:
            raise
        except RodgymError:
            # Refused: nothing has happened.
            self._unsettled = None
            raise
        self._unsettled = None
        if self._recover:
            self._since.append(call)
            if len(self._since) >= SNAPSHOT_EVERY:
                self._save()
        return reply

    def _again(self, send: Any) -> Reply:
        """Sends; if the session is lost, makes another and sends again."""
        made = self.recoveries
        while True:
            try:
                return send()
            except SessionLostError:
                tried = self.recoveries - made
                if not self._recover or self._sid is None or tried == RECOVERIES:
                    raise
            self._restore()

    def _save(self) -> None:
        try:
            self._snapshot = self.get_states(0, self.num_envs)
        except (ResetNeededError, RemoteTimeoutError):
            # Some environments were never reset: the calls are all there is to remember. Or the
            # server is slow: another time.
            return
        self._since.clear()

    def _restore(self) -> None:
        """A new session in the state of the lost one."""
        self.recoveries += 1
        calls, self._since, self._recover = self._since, [], False
        unsettled, self._unsettled = self._unsettled, None
        try:
            self._open()
            if self._snapshot is not None:
                self.set_states(0, self._snapshot)
            for op, p, arrays in calls:
                self._change(op, p, arrays)
        finally:
            self._since, self._recover, self._unsettled = calls, True, unsettled

    def _session(self) -> str:
        if self._sid is None:
            raise RemoteError("this environment was closed")
        return self._sid

    def _check_index(self, p: dict[str, Any]) -> None:
        index = p.get("index", p.get("first", 0))
        if not 0 <= index < self.num_envs:
            raise EnvIndexError(
                f"environment {index} does not exist: the batch has {self.num_envs}"
            )

    def __reduce__(self) -> tuple[Any, ...]:
        try:
            states = self.get_states(0, self.num_envs)
        except ResetNeededError:
            states = []
        return RemoteBatch, self._arguments, states

    def __setstate__(self, states: list[bytes]) -> None:
        if states:
            self.set_states(0, states)


def _equal(one: _Call, other: _Call) -> bool:
    (op, p, arrays), (other_op, other_p, others) = one, other
    same = op == other_op and p == other_p and arrays.keys() == others.keys()
    return same and all(np.array_equal(arrays[name], others[name]) for name in arrays)


def _release(connection: Connection, held: dict[str, str]) -> None:
    # At the interpreter's end the socket library may be gone already.
    with contextlib.suppress(Exception):
        if "sid" in held:
            connection.send_last("close", held["sid"])
    connection.close()


def _split_state(options: dict[str, Any], arrays: Arrays) -> tuple[dict[str, Any], Arrays]:
    """Exact starts travel as arrays: those of long rods do not fit into a header."""
    options = plain(options)
    state = options.get("state")
    if isinstance(state, dict) and state:
        options = {key: value for key, value in options.items() if key != "state"}
        try:
            numbers = {
                f"state:{name}": np.asarray(value, dtype=np.float64)
                for name, value in state.items()
            }
        except (TypeError, ValueError) as error:
            raise ParameterError(f"options['state'] must hold lists of numbers: {error}") from error
        arrays = {**arrays, **numbers}
    return options, arrays
