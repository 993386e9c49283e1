"""A batch with seeds completed and results named: what the vector environments share."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from gymnasium.utils import seeding

from rodgym import _checks as checks
from rodgym._plant import Member, picture_size
from rodgym._rod import with_rod
from rodgym.backend import LOCAL, Backend
from rodgym.errors import EnvIndexError, ParameterError, ShapeError

Flags = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]
Observations = npt.NDArray[np.float32]
Seeds = int | list[int | None] | None
#: Where an episode began (n), and its parameters (n, p), call by call.
Missed = list[tuple[Flags, Floats]]


class Result(NamedTuple):
    """Arrays of a step or reset of n environments, zero where they do not apply."""

    observation: Observations
    reward: Floats
    terminated: Flags
    truncated: Flags
    #: (n, d), where an episode ended in mode SameStep.
    final_observation: Observations
    #: (n, k) reward terms, then metrics, where a step was taken.
    terms: Floats
    #: (n, p) where an episode began.
    parameters: Floats
    stepped: Flags
    began: Flags
    solver_failure: Flags


class SeededBatch:
    """A batch that never starts from an unknown random stream.

    Environments that had no seed yet take one from NumPy's generator; afterwards resets without a
    seed continue the streams of the core.
    """

    def __init__(
        self,
        env_id: str,
        num_envs: int,
        kwargs: dict[str, Any],
        autoreset_mode: str,
        max_episode_steps: int | None,
        num_threads: int | None,
        render_mode: str | None = None,
        render_size: tuple[int, int] | None = None,
        backend: Backend = LOCAL,
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ParameterError(
                f"render_mode = {render_mode!r} is not allowed for a batch: "
                "it must be None or 'rgb_array'"
            )
        self.native = backend.open(
            env_id, num_envs, with_rod(kwargs), autoreset_mode, max_episode_steps, num_threads
        )
        self.about = self.native.spec
        self.num_envs = self.native.num_envs
        size = picture_size(render_size)
        #: Environments that were given a state: so may their parameters be. Its members tell it.
        self._changed: set[int] = set()
        #: One light object an environment: its plant, snapshots and picture.
        self.members = [
            Member(self.native, i, render_mode, size, self._changed) for i in range(self.num_envs)
        ]
        #: (n, p) parameters in force, and those before the last call; never changed in place.
        self.parameters = np.zeros((self.num_envs, len(self.about["parameters"])))
        self.before = self.parameters
        #: Environments whose parameters another state had changed before the last call.
        self.refreshed: list[int] = []
        self._unseeded = np.ones(self.num_envs, dtype=np.bool_)
        #: What a server did for calls whose results never came; a local batch makes no such call.
        self._missed: Callable[[], list[tuple[Flags, Floats]]] = getattr(
            self.native, "missed", list
        )

    @property
    def needs_seeds(self) -> bool:
        """Whether some environment never had a seed."""
        return bool(self._unseeded.any())

    def reset(
        self,
        seed: Seeds,
        mask: Flags | None,
        options: dict[str, Any] | None,
        generator: np.random.Generator | None = None,
        out: Observations | None = None,
    ) -> Result:
        """Starts episodes, in all environments or where `mask` is set.

        `generator` gives seeds to environments that never had one (operating-system entropy if
        None).
        """
        seed = checks.batch_seeds(seed, self.num_envs)
        needy = self._unseeded if mask is None else self._unseeded & mask
        if not isinstance(seed, int) and needy.any():
            if generator is None:
                generator, _ = seeding.np_random()
            fresh = generator.integers(2**63, size=self.num_envs).tolist()
            given = [None] * self.num_envs if seed is None else seed
            seed = [fresh[i] if own is None and needy[i] else own for i, own in enumerate(given)]
        self._refresh()
        with self._noting():
            result = Result._make(self.native.reset(seed, mask, options, out))
            self._unseeded &= ~result.began
            self._begun(result)
        return result

    def step(self, actions: Any, out: Observations | None = None) -> Result:
        """One control step of every environment."""
        self._refresh()
        with self._noting():
            result = Result._make(self.native.step(actions, out))
            self._begun(result)
        return result

    @contextlib.contextmanager
    def _noting(self) -> Iterator[None]:
        """After an exception, Ctrl-C for instance, parameters are read again, unless the call may
        be repeated: then they are those of before it.
        """
        try:
            yield
        except BaseException:
            if not getattr(self.native, "pending", False):
                self._changed.update(range(self.num_envs))
            raise

    def _refresh(self) -> None:
        """Reads the parameters of environments that were given a state."""
        self.refreshed = []
        self._catch_up()
        if self._changed:
            changed = sorted(self._changed)
            self.parameters = self.parameters.copy()
            for i in changed:
                self.parameters[i] = list(self.native.parameters(i).values())
            self.refreshed = sorted({*changed, *self.refreshed})

    def _catch_up(self) -> None:
        """Keeps what began in calls whose results were never handed over."""
        for began, parameters in self._missed():
            self.parameters = np.where(began[:, np.newaxis], parameters, self.parameters)
            self.refreshed = sorted({*self.refreshed, *np.flatnonzero(began).tolist()})

    def _begun(self, result: Result) -> None:
        """Keeps the parameters of episodes that began; a call that was refused changes nothing."""
        self._changed.difference_update(self.refreshed)
        self._catch_up()
        self.before = self.parameters
        if np.count_nonzero(result.began):
            rows = result.began[:, np.newaxis]
            self.parameters = np.where(rows, result.parameters, self.parameters)

    def get_state(self, indices: Any = None) -> list[bytes]:
        """Snapshots of all environments, or of those in `indices`."""
        if indices is None:
            return self.native.get_states(0, self.num_envs)
        return [self.native.get_state(i) for i in self._indices(indices)]

    def set_state(self, states: list[bytes], indices: Any = None) -> Observations:
        """Puts snapshots in place, all or none; returns the last observations (n, d)."""
        chosen = self._indices(indices)
        if isinstance(states, bytes) or len(states) != len(chosen):
            count = 1 if isinstance(states, bytes) else len(states)
            raise ShapeError(f"{count} states were given for {len(chosen)} environments")
        before: list[tuple[int, bytes]] = []
        try:
            for i, state in zip(chosen, states, strict=True):
                own = None if self._unseeded[i] else self.native.get_state(i)
                self.native.set_state(i, state)
                if own is not None:
                    before.append((i, own))
        except Exception:
            for i, own in reversed(before):
                self.native.set_state(i, own)
            raise
        self._changed.update(chosen)
        self._unseeded[chosen] = False
        return np.stack([self.native.observe(i) for i in range(self.num_envs)])

    def _indices(self, indices: Any) -> list[int]:
        chosen = np.arange(self.num_envs)
        if indices is None:
            return chosen.tolist()
        given = np.atleast_1d(indices)
        if given.dtype == np.bool_:
            if given.shape != chosen.shape:
                raise ShapeError(
                    f"a mask of environments has shape {given.shape}, but {chosen.shape} is needed"
                )
            return chosen[given].tolist()
        for i in given.tolist():
            if not isinstance(i, int) or not 0 <= i < self.num_envs:
                raise EnvIndexError(
                    f"environment {i} does not exist: the batch has {self.num_envs}"
                )
        return given.tolist()
