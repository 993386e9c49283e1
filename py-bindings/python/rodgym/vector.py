"""The Gymnasium vector environment: many rods in one native batch."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from rodgym import _checks as checks
from rodgym._batch import Flags, Floats, Observations, SeededBatch, Seeds
from rodgym._infos import InfoBuilder
from rodgym._plant import Frame, Member, box, plain
from rodgym._settings import Fixed, Many
from rodgym.backend import LOCAL, Backend
from rodgym.derivatives import RolloutGradient, StepJacobian, names
from rodgym.errors import ShapeError
from rodgym.own_task import Reward, backend_of

if TYPE_CHECKING:
    from gymnasium.envs.registration import EnvSpec

__all__ = ["RodVectorEnv"]


class RodVectorEnv(Many, Fixed, VectorEnv[Observations, Any, Any]):
    """Many environments of one kind, stepped together in Rust.

    `gym.make_vec("rodgym/PendulumSwingUp-v0", num_envs=1024)` makes one. Observations, rewards,
    flags and infos are those that Gymnasium's `SyncVectorEnv` would return for as many single
    environments, to the bit, whatever `num_envs` and `num_threads` are.

    Arguments:
        env_id: id such as `"rodgym/PendulumSwingUp-v0"`.
        num_envs: number of environments.
        render_mode: `None` or `"rgb_array"`: then `render()` returns one picture an environment.
        autoreset_mode: `gymnasium.vector.AutoresetMode` or its value: `"NextStep"` (the step after
            an episode's end ignores the action and returns the reset observation), `"SameStep"`
            (the ending step returns it; the last one is in `infos["final_obs"]`) or `"Disabled"`
            (reset by `reset(options={"reset_mask": mask})`; stepping an ended environment is an
            error).
        max_episode_steps: steps after which an episode is truncated; `None`: as registered; -1:
            never.
        num_threads: threads of a step; `None`: as many as the process may use. Results do not
            depend on it.
        copy: `False` returns the same observation array at every call, overwritten by the next one.
        render_size: width and height of a picture in pixels; `None`: what suits the machine.
        backend: where the batch is computed: in this process, or a `rodgym.remote.Server`.
        reward: a function of one's own that pays, see `rodgym.own_task`; `observation=` may be a
            function, too.
        **kwargs: keywords of the environment, see its page, and `rod`: the `rod.yml` of a fitted
            rod (docs/lab.md), whose keywords it stands for; others come on top.
    """

    metadata: dict[str, Any] = {
        "render_modes": ["rgb_array"],
        "render_fps": 50,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        env_id: str,
        num_envs: int = 1,
        *,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        num_threads: int | None = None,
        copy: bool = True,
        render_size: tuple[int, int] | None = None,
        backend: Backend = LOCAL,
        reward: Reward | None = None,
        **kwargs: Any,
    ) -> None:
        mode = checks.autoreset_mode(autoreset_mode)
        self._batch = SeededBatch(
            checks.env_id(env_id),
            num_envs,
            kwargs,
            mode.value,
            max_episode_steps,
            num_threads,
            render_mode,
            render_size,
            backend_of(backend, reward, kwargs),
        )
        about = self._batch.about
        self._infos = InfoBuilder(about)
        #: What happens after an episode's end; Gymnasium's wrappers ask `metadata`, others this.
        self.autoreset_mode = mode
        self._same_step = mode is AutoresetMode.SAME_STEP
        self._spec: EnvSpec | None = None
        self.num_envs = self._batch.num_envs
        self.render_mode = render_mode
        self.metadata = {
            **self.metadata,
            "autoreset_mode": mode,
            "render_fps": round(1.0 / about["control_dt"]),
        }
        self.single_observation_space = box(about["observation"])
        self.single_action_space = box(about["action"])
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        shape = self.observation_space.shape
        assert shape is not None
        self._out = None if copy else np.zeros(shape, dtype=np.float32)
        self._made = True

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """How `gym.make_vec` made this environment, in types that JSON knows."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            spec.kwargs = plain(spec.kwargs)
        self._spec = spec

    @property
    def num_threads(self) -> int:
        """Threads of a step; results do not depend on it."""
        return self._batch.native.num_threads

    @num_threads.setter
    def num_threads(self, threads: int) -> None:
        self._batch.native.num_threads = threads

    @property
    def config(self) -> dict[str, Any]:
        """Every keyword of the environment with its value, defaults filled in."""
        return dict(self._batch.about["config"])

    @property
    def control_dt(self) -> float:
        """Duration of a step [s]."""
        return float(self._batch.about["control_dt"])

    @property
    def physics_dt(self) -> float:
        """Duration of a physics step [s]."""
        return float(self._batch.about["physics_dt"])

    @property
    def max_episode_steps(self) -> int | None:
        """Steps after which an episode is truncated; None: never."""
        return self._batch.native.max_episode_steps

    @property
    def members(self) -> list[Member]:
        """One object an environment: its plant (`rod`, `positions`, ...), snapshots and picture."""
        return self._batch.members

    def reset(
        self, *, seed: Seeds = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Starts episodes.

        Arguments:
            seed: an integer gives environment i the seed + i; a list gives each its own; `None`,
                alone or in the list, continues the random stream.
            options: `reset_mask` (bool array: only these environments; the others keep their last
                observation), `parameters` and `state` (exact values, the same for each
                environment).

        Returns:
            The (num_envs, d) observations, and infos with the episodes' `parameters`.
        """
        mask, options = self._split(checks.mapping("options", options))
        seed = checks.batch_seeds(seed, self.num_envs)
        # NumPy's generator is made and read only if an environment still needs a seed.
        needy = not isinstance(seed, int) and self._batch.needs_seeds
        result = self._batch.reset(
            seed, mask, options, self.np_random if needy else None, self._out
        )
        if isinstance(seed, int):
            super().reset(seed=seed)
        return result.observation, self._infos.reset(result)

    def step(self, actions: Any) -> tuple[Observations, Floats, Flags, Flags, dict[str, Any]]:
        """One control step of every environment; `actions` has shape (num_envs, a).

        Returns:
            Observations, rewards, terminations, truncations and infos.

        Raises:
            ActionError: an action is not finite; nothing changes then.
            ShapeError: actions of another shape than the action space.
            ResetNeededError: mode Disabled, and an environment's episode has ended.
        """
        result = self._batch.step(actions, self._out)
        own = self._batch
        if self._same_step:
            infos = self._infos.same_step(result, own.parameters, own.before)
        else:
            infos = self._infos.step(result, own.parameters)
        return result.observation, result.reward, result.terminated, result.truncated, infos

    def step_jacobian(self, actions: Any, parameters: Sequence[str] = ()) -> StepJacobian:
        """`step_jacobian` of every member under its own row of `actions` (num_envs, a), computed
        by `num_threads` threads.

        Returns:
            The same arrays with a first axis of num_envs.
        """
        rows = checks.actions(actions)
        self._check_rows(rows, rows.ndim == 2)
        return StepJacobian(**self._batch.step_jacobians(rows, names(parameters)))

    def rollout_gradient(self, actions: Any, parameters: Sequence[str] = ()) -> RolloutGradient:
        """`rollout_gradient` of every member for its own `actions` (num_envs, t, a), computed by
        `num_threads` threads.

        Returns:
            The same arrays with a first axis of num_envs.
        """
        rows = checks.actions(actions)
        self._check_rows(rows, rows.ndim == 3)
        return RolloutGradient(**self._batch.rollout_gradients(rows, names(parameters)))

    def _check_rows(self, rows: Any, fits: bool) -> None:
        if not fits or len(rows) != self.num_envs:
            needed = f"one row for each of {self.num_envs} environments"
            raise ShapeError(f"actions has shape {rows.shape}, but {needed} is needed")

    def get_state(self, indices: Any = None) -> list[bytes]:
        """Snapshots of all environments, or of those in `indices`."""
        return self._batch.get_state(indices)

    def set_state(self, states: list[bytes], indices: Any = None) -> Observations:
        """Puts snapshots in place, all or none.

        Returns:
            The (num_envs, d) last observations of the batch.

        Raises:
            SnapshotError: bytes that are damaged or belong to another kind of environment.
        """
        if isinstance(states, bytes | str) or not isinstance(states, Iterable):
            raise checks.refused("states", states, "a list of what get_state returned")
        return self._batch.set_state([checks.snapshot("state", state) for state in states], indices)

    def render(self) -> tuple[Frame, ...] | None:  # type: ignore[override]
        """One picture an environment, each (height, width, 3)."""
        if self.render_mode is None:
            gym.logger.warn(
                "render() was called, but the batch was made without a render_mode, "
                'such as gym.make_vec(..., render_mode="rgb_array")'
            )
            return None
        return tuple(member.frame() for member in self.members)

    def _repr_html_(self) -> str:
        """Pictures of the first environments, where a notebook shows this batch."""
        shown = "".join(member.svg(240) for member in self.members[:4])
        return f"<div>{shown}<p>{self.num_envs} environments</p></div>"

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Calls the method `name` of each environment (see `members`), or reads the attribute."""
        attributes = [getattr(member, name) for member in self.members]
        return tuple(a(*args, **kwargs) if callable(a) else a for a in attributes)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """The attribute `name` of each environment."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Sets the attribute `name` of each environment: a list or tuple gives each its own.

        Raises:
            SettingError: no attribute that can be set; parameters have `set_parameters`.
        """
        if not isinstance(values, list | tuple):
            values = [values] * self.num_envs
        if len(values) != self.num_envs:
            raise ShapeError(f"{len(values)} values were given for {self.num_envs} environments")
        for member, value in zip(self.members, values, strict=True):
            setattr(member, name, value)

    def close_extras(self, **kwargs: Any) -> None:
        """Gives back what a server holds; in this process memory and threads go with the object."""
        # (Nothing was held where the arguments were refused; Gymnasium closes what is forgotten.)
        if "_batch" in vars(self):
            self._batch.native.close()

    def _split(self, options: dict[str, Any]) -> tuple[Flags | None, dict[str, Any] | None]:
        """The reset mask, checked, and the other options."""
        if "reset_mask" not in options:
            return None, options or None
        others = {key: value for key, value in options.items() if key != "reset_mask"}
        mask = np.asarray(options["reset_mask"])
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise ShapeError(
                f"options['reset_mask'] must be a bool array of shape ({self.num_envs},) with at "
                f"least one True, but has shape {mask.shape} and type {mask.dtype}"
                + ("" if mask.any() else " and no True")
            )
        return mask, others
