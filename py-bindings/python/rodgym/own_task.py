"""Rewards and observations of one's own, as functions over the arrays of a native batch.

```python
>>> import gymnasium as gym, numpy as np, rodgym
>>> def reward(state):
...     return state.positions[:, -1, 1] / 0.3                  # height of the tip, in rod lengths
>>> envs = gym.make_vec("rodgym/PendulumSwingUp-v0", num_envs=4, reward=reward)
>>> _ = envs.reset(seed=0)
>>> rewards = envs.step(np.zeros((4, 1)))[1]
>>> bool((rewards < -0.99).all())                               # they hang
True

```

The physics stays where it is; Python is called once a step for the whole batch. See
docs/how-to/own-task.md.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rodgym.backend import Arrays, Backend, Batch
from rodgym.errors import ParameterError, ShapeError

__all__ = ["Observation", "OwnTask", "Reward", "State"]

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class State:
    """What a function of one's own sees: a row for each of n environments.

    After a reset, and after a snapshot was put in place, no step has been taken: `actions` and
    `terms` are 0, and `metrics` NaN.
    """

    #: (n, nodes, 2), x and y of each node [m].
    positions: Floats
    #: (n, nodes, 2) [m/s].
    velocities: Floats
    #: (n, d), what the environment itself shows, float32.
    observation: npt.NDArray[np.float32]
    #: (n, a), the actions of this step, clipped to the action space.
    actions: Floats
    #: By name, (n,): physical parameters of the episode.
    parameters: Mapping[str, Floats]
    #: By name, (n,): terms of the environment's own reward.
    terms: Mapping[str, Floats]
    #: By name, (n,): the further numbers of `info`.
    metrics: Mapping[str, Floats]
    #: Duration of a control step [s].
    control_dt: float


#: Rewards (n,), or terms by name, (n,) each, which add up to the reward.
Reward = Callable[[State], "npt.ArrayLike | Mapping[str, npt.ArrayLike]"]
#: Observations (n, k). Attributes `low` and `high` of the function (a number, or one for each of
#: the k) are the bounds of the observation space; without them it is unbounded.
Observation = Callable[[State], npt.ArrayLike]


class OwnTask:
    """A backend whose batches pay and show what functions say.

    `gym.make`, `gym.make_vec` and `rodgym.sb3.make_vec_env` make one when they are given `reward=`,
    or a function as `observation=`.

    Arguments:
        inner: where the batch is computed; it must be in this process.
        reward: see `Reward`; None: the environment's own.
        observation: see `Observation`; None: the environment's own.
    """

    def __init__(
        self, inner: Backend, reward: Reward | None = None, observation: Observation | None = None
    ) -> None:
        for name, function in (("reward", reward), ("observation", observation)):
            if function is not None and not callable(function):
                raise ParameterError(f"{name} = {function!r} is not allowed: it must be a function")
        self.inner, self.reward, self.observation = inner, reward, observation

    def open(
        self,
        env_id: str,
        num_envs: int,
        kwargs: dict[str, Any],
        autoreset_mode: str,
        max_episode_steps: int | None,
        num_threads: int | None,
    ) -> Batch:
        """See `Backend.open`."""
        # A step must leave the state that it ended in, for the functions to see.
        mode = "Disabled" if autoreset_mode == "SameStep" else autoreset_mode
        native = self.inner.open(env_id, num_envs, kwargs, mode, max_episode_steps, num_threads)
        if not hasattr(native, "all_nodes"):
            native.close()
            raise ParameterError(
                "reward and observation functions need a batch in this process, not one of a server"
            )
        trial = self.inner.open(env_id, 2, kwargs, "Disabled", -1, 1)
        return OwnBatch(native, trial, self, autoreset_mode)  # type: ignore[return-value]

    def registered(self, env_id: str, kwargs: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        """See `Backend.registered`."""
        return self.inner.registered(env_id, kwargs)


def backend_of(backend: Backend, reward: Any, kwargs: dict[str, Any]) -> Backend:
    """The backend with the functions among these keywords, which are taken out of them."""
    observation = kwargs.pop("observation") if callable(kwargs.get("observation")) else None
    if reward is None and observation is None:
        return backend
    return OwnTask(backend, reward, observation)


class OwnBatch:
    """A batch whose rewards and observations come from functions; the rest is the inner one's."""

    def __init__(self, inner: Any, trial: Any, task: OwnTask, mode: str) -> None:
        self._inner, self._task, self._mode = inner, task, mode
        self._names = [parameter["name"] for parameter in inner.spec["parameters"]]
        self._terms = list(inner.spec["reward_terms"])
        self._metrics = list(inner.spec["metrics"])
        self._parameters = np.zeros((inner.num_envs, len(self._names)))
        self._own_terms: list[str] = []
        self.spec = self._tried(trial)
        self._last = np.zeros((inner.num_envs, len(self.spec["observation"]["low"])), np.float32)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name in ("missed", "pending"):
            raise AttributeError(name)
        return getattr(self._inner, name)

    @property
    def num_threads(self) -> int:
        """Threads of a step."""
        return int(self._inner.num_threads)

    @num_threads.setter
    def num_threads(self, threads: int) -> None:
        self._inner.num_threads = threads

    @property
    def max_episode_steps(self) -> int | None:
        """Steps after which an episode is cut."""
        return self._inner.max_episode_steps  # type: ignore[no-any-return]

    def _tried(self, trial: Any) -> dict[str, Any]:
        """The specification with what the functions return for two environments."""
        spec = dict(trial.spec)
        actions = np.zeros((2, len(spec["action"]["low"])))
        started = trial.reset(0)
        stepped = trial.step(actions)
        # (n, p) of a step are zero where no episode began.
        numbers = started[6]
        state = self._state(trial, stepped[0], actions, stepped[5], numbers)
        start = self._start(trial, started[0], numbers)
        trial.close()
        if self._task.reward is not None:
            paid = self._task.reward(state)
            self._own_terms = list(paid) if isinstance(paid, Mapping) else ["reward"]
            self._paid(state)
            spec["reward_terms"] = self._own_terms
        if self._task.observation is not None:
            shown, width = self._shown(state), self._shown(start).shape[1]
            if shown.shape[1] != width:
                raise ShapeError(
                    f"observation returned {width} numbers after a reset, but {shown.shape[1]} "
                    "after a step"
                )
            spec["observation"] = self._bounds(width)
        return spec

    def _bounds(self, width: int) -> dict[str, Any]:
        """The observation space of the function's numbers."""
        function = self._task.observation
        sides = {"low": -np.inf, "high": np.inf}
        try:
            bounds = {
                side: np.broadcast_to(np.asarray(getattr(function, side, usual), float), (width,))
                for side, usual in sides.items()
            }
        except ValueError as error:
            raise ShapeError(
                f"observation.low and .high must be a number or {width} numbers, as many as the "
                "function returns"
            ) from error
        return {
            **{side: bound.tolist() for side, bound in bounds.items()},
            "names": [f"own observation {i}" for i in range(width)],
        }

    def reset(
        self, seeds: Any = None, mask: Any = None, options: Any = None, out: Any = None
    ) -> Arrays:
        """Starts episodes."""
        result = list(self._inner.reset(seeds, mask, options))
        self._note(result)
        if self._task.observation is not None:
            shown = self._shown(self._start(self._inner, result[0], self._parameters))
            kept = np.zeros_like(shown) if mask is None else self._last
            result[0] = np.where(result[8][:, np.newaxis], shown, kept)
        return self._finished(result, out)

    def step(self, actions: Any, out: Any = None) -> Arrays:
        """One control step of every environment."""
        result = list(self._inner.step(actions))
        before = self._parameters
        self._note(result)
        given = np.clip(np.asarray(actions, np.float64), -1.0, 1.0)
        began, stepped = result[8], result[7]
        state = self._state(self._inner, result[0], given, result[5], self._parameters)
        if self._task.reward is not None:
            # A step that only began an episode (NextStep) pays nothing.
            terms = np.where(stepped[:, np.newaxis], self._paid(state), 0.0)
            result[1] = terms.sum(axis=1)
            result[5] = np.concatenate([terms, result[5][:, len(self._terms) :]], axis=1)
        if self._task.observation is not None:
            result[0] = self._shown(state)
            if began.any():
                plain = self._start(self._inner, state.observation, self._parameters)
                result[0] = np.where(began[:, np.newaxis], self._shown(plain), result[0])
            result[4] = np.zeros_like(result[0])
        ended = result[2] | result[3]
        if self._mode == "SameStep" and ended.any():
            self._parameters = before
            self._begin_again(result, ended)
        return self._finished(result, out)

    def _begin_again(self, result: list[Any], ended: npt.NDArray[np.bool_]) -> None:
        """Autoreset of mode SameStep: the last observations aside, those of the resets in place."""
        rows = ended[:, np.newaxis]
        last = result[0]
        fresh = list(self._inner.reset(None, ended))
        self._note(fresh)
        first = fresh[0]
        if self._task.observation is not None:
            first = self._shown(self._start(self._inner, first, self._parameters))
        result[0] = np.where(rows, first, last)
        result[4] = np.where(rows, last, np.zeros_like(last))
        result[6], result[8] = fresh[6], fresh[8]

    def reset_single(self, seed: Any = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """`reset` of the one environment of mode Single: observation (d,) and info."""
        observation, info = self._inner.reset_single(seed, options)
        self._parameters = np.array([list(info["parameters"].values())])
        if self._task.observation is not None:
            start = self._start(self._inner, observation[np.newaxis], self._parameters)
            observation = self._shown(start)[0]
        return observation, info

    def step_single(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """`step` of the one environment of mode Single."""
        observation, reward, terminated, truncated, info = self._inner.step_single(action)
        given = np.clip(np.asarray(action, np.float64), -1.0, 1.0)[np.newaxis]
        numbers = [info["reward_terms"][name] for name in self._terms]
        numbers += [info[name] for name in self._metrics]
        row, terms = observation[np.newaxis], np.array([numbers])
        state = self._state(self._inner, row, given, terms, self._parameters)
        if self._task.reward is not None:
            paid = self._paid(state)[0].tolist()
            info["reward_terms"] = dict(zip(self._own_terms, paid, strict=True))
            reward = sum(paid)
        if self._task.observation is not None:
            observation = self._shown(state)[0]
        return observation, reward, terminated, truncated, info

    def set_state(self, index: int, state: bytes) -> None:
        """Puts a snapshot in place."""
        self._inner.set_state(index, state)
        self._parameters = self._parameters.copy()
        self._parameters[index] = list(self._inner.parameters(index).values())

    def observe(self, index: int) -> npt.NDArray[np.float32]:
        """The last observation of environment `index`, as after a reset."""
        native = self._inner.observe(index)
        if self._task.observation is None:
            return native  # type: ignore[no-any-return]
        positions, velocities = self._inner.nodes(index)
        numbers = np.array([list(self._inner.parameters(index).values())])
        row = self._view(positions[None], velocities[None], native[None], None, None, numbers)
        return self._shown(row)[0]

    def step_jacobian(self, *_: Any) -> Any:
        """Refused: derivatives know the environment's own reward and observation only."""
        raise ParameterError("derivatives are not there with reward or observation functions")

    # (So does a search for actions, which asks for a `twin` of the environment.)
    step_jacobians = rollout_gradient = rollout_gradients = twin = step_jacobian

    def _note(self, result: list[Any]) -> None:
        """Keeps the parameters of episodes that began."""
        rows = result[8][:, np.newaxis]
        self._parameters = np.where(rows, result[6], self._parameters)

    def _finished(self, result: list[Any], out: Any) -> Arrays:
        self._last = result[0]
        if out is not None:
            out[...] = result[0]
            result[0] = out
        return tuple(result)

    def _start(self, batch: Any, observation: Any, parameters: Floats) -> State:
        """The state before any step."""
        return self._state(batch, observation, None, None, parameters)

    def _state(
        self, batch: Any, observation: Any, actions: Any, terms: Any, parameters: Floats
    ) -> State:
        positions, velocities = batch.all_nodes()
        return self._view(positions, velocities, observation, actions, terms, parameters)

    def _view(
        self,
        positions: Floats,
        velocities: Floats,
        observation: Any,
        actions: Any,
        terms: Any,
        parameters: Floats,
    ) -> State:
        count = len(positions)
        if actions is None:
            actions = np.zeros((count, len(self._inner.spec["action"]["low"])))
        if terms is None:
            terms = np.zeros((count, len(self._terms) + len(self._metrics)))
            terms[:, len(self._terms) :] = np.nan
        columns = dict(zip([*self._terms, *self._metrics], terms.T, strict=True))
        return State(
            positions,
            velocities,
            observation,
            actions,
            dict(zip(self._names, parameters.T, strict=True)),
            {name: columns[name] for name in self._terms},
            {name: columns[name] for name in self._metrics},
            float(self._inner.spec["control_dt"]),
        )

    def _paid(self, state: State) -> Floats:
        """(n, k) own terms of the reward."""
        assert self._task.reward is not None
        paid = self._task.reward(state)
        count = len(state.positions)
        named = paid if isinstance(paid, Mapping) else {"reward": paid}
        if list(named) != self._own_terms:
            raise ShapeError(f"reward returned {list(named)}, but before {self._own_terms}")
        columns = []
        for name, values in named.items():
            column = np.asarray(values, np.float64)
            if column.shape != (count,):
                raise ShapeError(
                    f"reward returned {name} of shape {column.shape}, but ({count},) is needed: "
                    "a number for each environment"
                )
            columns.append(column)
        return np.stack(columns, axis=1)

    def _shown(self, state: State) -> npt.NDArray[np.float32]:
        """(n, k) own observation."""
        assert self._task.observation is not None
        shown = np.asarray(self._task.observation(state), np.float32)
        count = len(state.positions)
        if shown.ndim != 2 or len(shown) != count:
            raise ShapeError(
                f"observation returned shape {shown.shape}, but ({count}, k) is needed: a row for "
                "each environment"
            )
        return shown
