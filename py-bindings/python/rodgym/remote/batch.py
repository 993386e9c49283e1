"""A batch on a server with the face of `rodgym._native.Batch`.

So all above it - seeds, infos, Gymnasium's and Stable-Baselines3's faces - is the local code.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from rodgym import _checks as checks
from rodgym import _native
from rodgym.errors import ParameterError, ResetNeededError, ShapeError
from rodgym.remote.address import Address
from rodgym.remote.connection import Connection
from rodgym.remote.errors import RemoteError
from rodgym.remote.options import split_options
from rodgym.remote.session import Session, in_parts
from rodgym.remote.wire import Arrays, Reply, damaged, own, reading, split_lists

#: Longest list of numbers that travels in a header.
IN_HEADER = 16
#: Bits of the `flags` array.
#: A row each: terminated, truncated, stepped, began, solver failure, final observation.
BITS = np.array([[1 << i] for i in range(6)], dtype=np.uint8)


class RemoteBatch(Session):
    """Many environments of one kind in a session of a server.

    Arguments:
        address: where the server is.
        recover: `"raise"` a `SessionLostError` when the session is gone, or `"restart"`: go on in
            another one, see `Session`.
        env_id, num_envs, kwargs, autoreset_mode: as for `_native.Batch`.
        max_episode_steps: None: what the server has for the environment; -1: no limit.
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
        num_envs = checks.whole("num_envs", num_envs, 1, None, "an integer of at least 1")
        if max_episode_steps not in (None, -1):
            allowed = "an integer of at least 1, None or -1"
            max_episode_steps = checks.whole(
                "max_episode_steps", max_episode_steps, 1, None, allowed
            )
        self._arguments = (
            address, recover, env_id, num_envs, kwargs, autoreset_mode, max_episode_steps,
        )  # fmt: skip
        # Checked by the code that checks them locally: JSON would turn some into other values.
        kwargs, lists = split_lists(_native.plain_values(kwargs))
        about = {
            "id": env_id,
            "num_envs": num_envs,
            "kwargs": kwargs,
            "autoreset_mode": autoreset_mode,
            # One call at a time needs one remembered reply; a second costs little.
            "window": 2,
        }
        if max_episode_steps is not None:
            about["max_episode_steps"] = None if max_episode_steps == -1 else max_episode_steps
        self._gallery = _native.Gallery()
        super().__init__(Connection(address), about, lists, recover == "restart")

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
            # A copy: the caller may overwrite its array before we need to send it again.
            arrays["mask"] = mask.copy()
        if options:
            p["options"], state = split_options(options)
            arrays |= state
        return self._change("reset", p, arrays, lambda reply: self._results(reply, out))

    def step(
        self, actions: Any, out: npt.NDArray[np.float32] | None = None
    ) -> tuple[npt.NDArray[Any], ...]:
        """One control step; see `_native.Batch.step`."""
        array = checks.actions(actions)
        expected = (self.num_envs, len(self.spec["action"]["low"]))
        if array.shape != expected:
            raise _shape(array, expected)
        arrays = {"action": _single(array)}
        return self._change("step", {}, arrays, lambda reply: self._results(reply, out))

    def reset_single(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[npt.NDArray[np.float32], dict[str, Any]]:
        """`reset` of the one environment of mode Single."""
        result = self.reset(None if seed is None else [seed], None, options)
        return result[0][0], {"parameters": self._parameters(result[6][0])}

    def step_single(
        self, action: Any
    ) -> tuple[npt.NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """`step` of the one environment of mode Single."""
        array = checks.actions(action)
        expected = (len(self.spec["action"]["low"]),)
        if array.shape != expected:
            raise _shape(array, expected)
        result = self.step(array[np.newaxis])
        terms, count = result[5][0].tolist(), len(self.spec["reward_terms"])
        info: dict[str, Any] = dict(zip(self.spec["metrics"], terms[count:], strict=True))
        info["reward_terms"] = dict(zip(self.spec["reward_terms"], terms, strict=False))
        info["solver_failure"] = bool(result[9][0])
        return result[0][0], float(result[1][0]), bool(result[2][0]), bool(result[3][0]), info

    def get_state(self, index: int) -> bytes:
        """Snapshot of environment `index`."""
        return self.get_states(index, 1)[0]

    def get_states(self, first: int, count: int) -> list[bytes]:
        """Snapshots of environments `first` to `first + count`, in as few requests as fit."""
        states: list[bytes] = []
        part = count
        with self._turn:
            while len(states) < count:
                wanted = min(part, count - len(states))
                try:
                    reply = self._ask("get_state", {"first": first + len(states), "count": wanted})
                except RemoteError as error:
                    if error.code != "limit" or wanted == 1:
                        raise
                    part = wanted // 2
                    continue
                sizes = reply.array("sizes", "<u4", wanted).tolist()
                data, place = reply.array("data", "|u1", sum(sizes)).tobytes(), 0
                for size in sizes:
                    states.append(data[place : place + size])
                    place += size
        return states

    def set_state(self, index: int, state: bytes) -> None:
        """Puts a snapshot in place of environment `index`."""
        self.set_states(index, [state])

    def set_states(self, first: int, states: list[bytes]) -> None:
        """Puts snapshots in place from `first` on, in as few requests as fit."""
        with self._turn:
            for call in in_parts(first, states, self.message_bytes):
                self._change(*call, lambda reply: None)

    def configure(
        self, first: int, count: int, parameters: dict[str, Any], randomize: dict[str, Any]
    ) -> None:
        """Changes how parameters are drawn; see `_native.Batch.configure`."""
        p: dict[str, Any] = {"first": first, "count": count}
        p["randomize"] = _native.plain_values(randomize)
        parameters = _native.plain_values(parameters)
        # A header has no room for long lists.
        long = {
            name: value
            for name, value in parameters.items()
            if isinstance(value, list) and len(value) > IN_HEADER
        }
        p["parameters"] = {k: value for k, value in parameters.items() if k not in long}
        arrays = {f"parameters:{k}": np.array(value, np.float64) for k, value in long.items()}
        self._change("set_parameters", p, arrays, lambda reply: None)

    def observe(self, index: int) -> npt.NDArray[np.float32]:
        """The last observation of environment `index`."""
        reply = self._ask("observe", {"first": index, "count": 1})
        return reply.array("obs", "<f4", 1, self._widths[0])[0].copy()

    def parameters(self, index: int) -> dict[str, float]:
        """Physical parameters in force in environment `index`, by name."""
        reply = self._ask("observe", {"first": index, "count": 1})
        return self._parameters(reply.array("parameters", "<f8", 1, self._widths[2])[0])

    def nodes(self, index: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Positions [m] and velocities [m/s] of the nodes of environment `index`."""
        reply = self._ask("nodes", {"index": index})
        positions, velocities = (
            reply.array(name, "<f8", None, 2).copy() for name in ("positions", "velocities")
        )
        return positions, velocities

    def simulation(self, index: int) -> _native.Simulation:
        """An exact copy, here, of what runs in environment `index`."""
        return self.twin(index).simulation(0)

    def step_jacobian(
        self, index: int, action: Any, parameters: list[str]
    ) -> dict[str, npt.NDArray[np.float64]]:
        """Derivatives of a step, computed here; see `_native.Batch.step_jacobian`."""
        return self.twin(index).step_jacobian(0, action, parameters)

    def rollout_gradient(
        self, index: int, actions: Any, parameters: list[str]
    ) -> dict[str, npt.NDArray[np.float64]]:
        """Gradients of a sum of rewards, computed here; see `_native.Batch.rollout_gradient`."""
        return self.twin(index).rollout_gradient(0, actions, parameters)

    def step_jacobians(
        self, actions: Any, parameters: list[str]
    ) -> dict[str, npt.NDArray[np.float64]]:
        """Derivatives of a step of each, computed here one after the other."""
        each = enumerate(actions)
        return _stacked([self.step_jacobian(i, row, parameters) for i, row in each])

    def rollout_gradients(
        self, actions: Any, parameters: list[str]
    ) -> dict[str, npt.NDArray[np.float64]]:
        """Gradients of a sum of rewards of each, computed here one after the other."""
        each = enumerate(actions)
        return _stacked([self.rollout_gradient(i, row, parameters) for i, row in each])

    def twin(self, index: int) -> _native.Batch:
        """Environment `index` as it is now, alone in a batch of this process."""
        twin = _native.Batch(self.spec["id"], 1, self._arguments[4], "Disabled", None, 1)
        twin.set_state(0, self.get_state(index))
        return twin

    def scene(self, index: int) -> dict[str, Any]:
        """What there is to draw of environment `index`."""
        reply = self._ask("render", {"index": index})
        with reading():
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

    def _parameters(self, values: npt.NDArray[np.float64]) -> dict[str, float]:
        names = [parameter["name"] for parameter in self.spec["parameters"]]
        return dict(zip(names, values.tolist(), strict=True))

    def _results(
        self, reply: Reply, out: npt.NDArray[np.float32] | None
    ) -> tuple[npt.NDArray[Any], ...]:
        """The ten arrays of `_native.Batch.step`."""
        n, (d, k, p) = self.num_envs, self._widths
        flags = (reply.array("flags", "|u1", n) & BITS) != 0
        terminated, truncated, stepped, began, failed, ended = flags
        observation = reply.array("obs", "<f4", n, d)
        reward = reply.maybe("reward", "<f8", n)
        terms = reply.maybe("terms", "<f8", n, k)
        if (reward is None) != (terms is None):
            raise damaged("it has one of reward and terms only")
        final = np.zeros((n, d), dtype=np.float32)
        if ended.any():
            final[ended] = reply.array("final_obs", "<f4", int(ended.sum()), d)
        parameters = np.zeros((n, p))
        if began.any():
            parameters[began] = reply.array("parameters", "<f8", int(began.sum()), p)
        if out is None:
            out = own(observation)
        else:
            out[...] = observation
        return (
            out,
            np.zeros(n) if reward is None else own(reward),
            terminated,
            truncated,
            final,
            np.zeros((n, k)) if terms is None else own(terms),
            parameters,
            stepped,
            began,
            failed,
        )

    @property
    def pending(self) -> bool:
        """Whether the server may have carried out a call whose result was not handed over."""
        progress = self._progress
        return progress is not None and progress.pending is not None

    def missed(self) -> list[tuple[npt.NDArray[np.bool_], npt.NDArray[np.float64]]]:
        """What calls began whose results were never handed over, and never will be, oldest first:
        in which environments (n), and the parameters of all (n, p), 0 elsewhere. Told once.
        """
        with self._turn:
            now = self._open()
            if not now.missed:
                return []
            told = []
            for reply in now.missed:
                try:
                    with reading():
                        result = self._results(reply, None)
                    told.append((result[8], result[6]))
                except RemoteError:  # noqa: PERF203
                    # Nobody can tell what it began: the server is asked how things are now.
                    rows = [list(self.parameters(i).values()) for i in range(self.num_envs)]
                    told.append((np.ones(self.num_envs, dtype=np.bool_), np.array(rows)))
            self._progress = self._open()._replace(missed=())
        return told

    def __reduce__(self) -> tuple[Any, ...]:
        try:
            states = self.get_states(0, self.num_envs)
        except ResetNeededError:
            states = []
        return RemoteBatch, self._arguments, states

    def __setstate__(self, states: list[bytes]) -> None:
        if states:
            self.set_states(0, states)


def _single(array: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """A copy in single precision; finite numbers beyond its range stay finite, as locally."""
    if array.dtype != np.float32:
        most = np.finfo(np.float32).max
        array = np.where(np.isfinite(array), np.clip(array, -most, most), array)
    return array.astype("<f4")


def _shape(array: npt.NDArray[Any], expected: tuple[int, ...]) -> ShapeError:
    """The error of a local batch, in its words."""
    return ShapeError(f"action has shape {list(array.shape)}, but {list(expected)} is needed")


def _stacked(each: list[dict[str, npt.NDArray[np.float64]]]) -> dict[str, npt.NDArray[np.float64]]:
    """The same arrays of several environments with a first axis of as many."""
    return {name: np.stack([found[name] for found in each]) for name in each[0]}
