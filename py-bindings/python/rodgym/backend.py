"""Where a batch is computed: here or on a server, behind one small protocol.

The faces of a batch (`rodgym.envs`, `rodgym.vector`, `rodgym.sb3`) take the backend as an argument
and know no other difference. `LOCAL` is the Rust core in this process, `rodgym.remote.Server` one
in another; a third is a class with these two methods.
"""

from __future__ import annotations

import warnings
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from rodgym import _native
from rodgym._registration import ENVIRONMENTS
from rodgym.errors import AccuracyWarning

Arrays = tuple[npt.NDArray[Any], ...]


class Batch(Protocol):
    """Many environments of one kind, as `rodgym._native.Batch` describes them."""

    @property
    def spec(self) -> dict[str, Any]: ...
    @property
    def num_envs(self) -> int: ...
    @property
    def max_episode_steps(self) -> int | None: ...
    @property
    def num_threads(self) -> int: ...
    @num_threads.setter
    def num_threads(self, threads: int) -> None: ...
    def reset(
        self,
        seeds: int | list[int | None] | None = None,
        mask: npt.NDArray[np.bool_] | None = None,
        options: dict[str, Any] | None = None,
        out: npt.NDArray[np.float32] | None = None,
    ) -> Arrays: ...
    def step(self, actions: Any, out: npt.NDArray[np.float32] | None = None) -> Arrays: ...
    def reset_single(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[npt.NDArray[np.float32], dict[str, Any]]: ...
    def step_single(
        self, action: Any
    ) -> tuple[npt.NDArray[np.float32], float, bool, bool, dict[str, Any]]: ...
    def get_state(self, index: int) -> bytes: ...
    def get_states(self, first: int, count: int) -> list[bytes]: ...
    def set_state(self, index: int, state: bytes) -> None: ...
    def configure(
        self, first: int, count: int, parameters: dict[str, Any], randomize: dict[str, Any]
    ) -> None: ...
    def observe(self, index: int) -> npt.NDArray[np.float32]: ...
    def parameters(self, index: int) -> dict[str, float]: ...
    def nodes(self, index: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]: ...
    def step_jacobian(
        self, index: int, action: Any, parameters: list[str]
    ) -> dict[str, npt.NDArray[np.float64]]: ...
    def rollout_gradient(
        self, index: int, actions: Any, parameters: list[str]
    ) -> dict[str, npt.NDArray[np.float64]]: ...
    def step_jacobians(
        self, actions: Any, parameters: list[str]
    ) -> dict[str, npt.NDArray[np.float64]]: ...
    def rollout_gradients(
        self, actions: Any, parameters: list[str]
    ) -> dict[str, npt.NDArray[np.float64]]: ...
    def simulation(self, index: int) -> _native.Simulation: ...
    def scene(self, index: int) -> dict[str, Any]: ...
    def render(
        self, index: int, width: int | None = None, height: int | None = None
    ) -> npt.NDArray[np.uint8]: ...
    def svg(self, index: int, width: int | None = None, height: int | None = None) -> str: ...
    def close(self) -> None: ...


class Backend(Protocol):
    """What makes batches."""

    def open(
        self,
        env_id: str,
        num_envs: int,
        kwargs: dict[str, Any],
        autoreset_mode: str,
        max_episode_steps: int | None,
        num_threads: int | None,
    ) -> Batch:
        """A batch; `max_episode_steps` None: as the environment is registered, -1: no limit."""

    def registered(self, env_id: str, kwargs: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        """Id and keywords by which `gym.make` makes one such environment."""


class Local:
    """The Rust core in this process."""

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
        if max_episode_steps is None and env_id in ENVIRONMENTS:
            max_episode_steps = ENVIRONMENTS[env_id].max_episode_steps
        limit = None if max_episode_steps == -1 else max_episode_steps
        if autoreset_mode == "Single":
            num_threads = 1
        batch = _native.Batch(env_id, num_envs, kwargs, autoreset_mode, limit, num_threads)
        if warning := batch.spec["warning"]:
            warnings.warn(f"{env_id}: {warning}", AccuracyWarning, stacklevel=5)
        return batch

    def registered(self, env_id: str, kwargs: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        """See `Backend.registered`."""
        return env_id, kwargs


LOCAL = Local()
