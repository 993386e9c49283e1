"""The Stable-Baselines3 face: many rods in one native batch as a `VecEnv`.

Needs `pip install "rodgym[train]"`.
"""

from __future__ import annotations

import copy
import importlib
import inspect
import math
import warnings
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode

try:
    from stable_baselines3.common import env_util
    from stable_baselines3.common.vec_env import VecEnv, VecMonitor
except ImportError as error:  # pragma: no cover
    raise ImportError('rodgym.sb3 needs Stable-Baselines3: pip install "rodgym[train]"') from error

from rodgym import _checks as checks
from rodgym import _native
from rodgym._batch import Result, SeededBatch
from rodgym._own import module_of
from rodgym._plant import Member, box, plain
from rodgym._registration import ENVIRONMENTS, REMOTE
from rodgym._settings import Fixed, Many
from rodgym.backend import LOCAL, Backend
from rodgym.errors import EnvIndexError, ParameterError, ShapeError
from rodgym.own_task import Reward, backend_of

if TYPE_CHECKING:
    from gymnasium.envs.registration import EnvSpec

__all__ = ["Monitor", "RodVecEnv", "make_vec_env"]

Indices = int | Iterable[int] | None


def make_vec_env(
    env_id: str | Callable[..., gym.Env],
    n_envs: int = 1,
    seed: int | None = None,
    start_index: int = 0,
    monitor_dir: str | None = None,
    wrapper_class: Callable[..., gym.Env] | None = None,
    env_kwargs: dict[str, Any] | None = None,
    vec_env_cls: type[VecEnv] | None = None,
    vec_env_kwargs: dict[str, Any] | None = None,
    monitor_kwargs: dict[str, Any] | None = None,
    wrapper_kwargs: dict[str, Any] | None = None,
    *,
    monitor: bool = True,
    server: str | None = None,
    **kwargs: Any,
) -> VecEnv:
    """A batch for Stable-Baselines3, with the arguments of its own `make_vec_env`, by name and by
    place.

    The batch is the native one, unless environments are to be wrapped one by one (`wrapper_class`),
    or are made by a function, or a `vec_env_cls` is asked for: then Stable-Baselines3 makes it of
    single environments, with the same episodes and a fraction of the speed.

    Arguments:
        env_id: id such as `"rodgym/PendulumSwingUp-v0"`, also behind the module that registers it
            (`"rodgym:rodgym/PendulumSwingUp-v0"`), or a function that makes an environment.
        n_envs: number of environments.
        seed: seed of the first reset; environment i takes seed + i.
        start_index: number of the first environment in the name of the monitor's file.
        monitor_dir: folder for a CSV of returns, `START_INDEX.monitor.csv`, which
            `stable_baselines3.common.monitor.load_results` reads.
        wrapper_class: a wrapper around each environment.
        env_kwargs: keywords of the environment, for callers that keep them apart.
        vec_env_cls: `DummyVecEnv` or `SubprocVecEnv`, instead of the native batch.
        vec_env_kwargs: keywords of that class; of the native batch, those of `RodVecEnv`.
        monitor_kwargs: `info_keywords`: numbers of an episode's last info that the CSV has too.
        wrapper_kwargs: keywords of `wrapper_class`.
        monitor: wrap in a `Monitor`, so that learning curves have returns.
        server: address such as `"tcp://host:5555"` of a `rodgym serve` that computes the batch;
            then `keys`, `server_key`, `timeout` and `recover` as for `rodgym.remote.connect`.
        **kwargs: more keywords of the environment, and those of `RodVecEnv`: `num_threads`,
            `max_episode_steps`, `render_mode`, `render_size`.
    """
    kwargs = {**checks.mapping("env_kwargs", env_kwargs), **kwargs}
    monitor_kwargs = checks.mapping("monitor_kwargs", monitor_kwargs)
    if callable(env_id) or wrapper_class is not None or vec_env_cls is not None:
        if server is not None:
            raise ParameterError(
                f"server = {server!r} is not allowed with a wrapper_class, a vec_env_cls or a "
                "function: a server computes native batches"
            )
        # Threads are those of a native batch.
        kwargs.pop("num_threads", None)
        return env_util.make_vec_env(
            env_id,
            n_envs,
            seed,
            start_index,
            monitor_dir,
            wrapper_class,
            kwargs,
            vec_env_cls,  # type: ignore[arg-type]
            vec_env_kwargs,
            monitor_kwargs,
            wrapper_kwargs,
        )
    if wrapper_kwargs:
        raise ParameterError(f"wrapper_kwargs = {wrapper_kwargs!r} needs a wrapper_class")
    kwargs |= checks.mapping("vec_env_kwargs", vec_env_kwargs)
    name, kwargs = built_on(imported(env_id), kwargs)
    if name == REMOTE:
        # As in `gym.make`, where server and environment are keywords.
        server, name = kwargs.pop("server", server), kwargs.pop("env_id", name)
    if server is not None:
        from rodgym.remote import Server

        names = ("keys", "server_key", "timeout", "recover")
        where = {key: kwargs.pop(key) for key in names if key in kwargs}
        kwargs["backend"] = Server(server, **where)
    env: VecEnv = RodVecEnv(name, n_envs, **kwargs)
    if seed is not None:
        env.seed(seed)
        number = checks.seed(seed)
        assert isinstance(number, int)
        env.action_space.seed(number + start_index)
    if not monitor:
        return env
    if monitor_dir is not None:
        Path(monitor_dir).mkdir(parents=True, exist_ok=True)
        monitor_dir = str(Path(monitor_dir) / str(start_index))
    return Monitor(env, monitor_dir, info_keywords(monitor_kwargs))


def imported(env_id: Any) -> Any:
    """An id without the module in front of it, which is imported now, as `gym.make` does it."""
    if not isinstance(env_id, str) or ":" not in env_id:
        return env_id
    module, _, rest = env_id.rpartition(":")
    if module.endswith(".py"):
        module_of(module)
        return rest
    try:
        importlib.import_module(module)
    except (ImportError, ValueError) as error:
        raise ParameterError(f"env_id = {env_id!r}: module {module!r} is not found") from error
    return rest


def built_on(env_id: Any, given: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """The environment of ours that a registered one of the user's is built on, with its keywords.

    Such a one names ours by the keyword `env_id`, as Gymnasium gives it to the entry point.
    """
    spec = gym.registry.get(env_id)
    if env_id in ENVIRONMENTS or spec is None or spec.kwargs.get("env_id") not in ENVIRONMENTS:
        return env_id, given
    own = {**spec.kwargs, "max_episode_steps": spec.max_episode_steps or -1}
    return own.pop("env_id"), {**own, **given}


def info_keywords(monitor_kwargs: dict[str, Any]) -> tuple[str, ...]:
    """What a batch's monitor writes beside return, length and time; the rest must be as it is."""
    usual = {"allow_early_resets": True, "override_existing": True}
    for name, value in monitor_kwargs.items():
        if name != "info_keywords" and usual.get(name) is not value:
            raise ParameterError(
                f"monitor_kwargs: {name} = {value!r} is not allowed: the monitor of a native batch "
                "takes info_keywords, allows early resets and begins a new file"
            )
    return tuple(monitor_kwargs.get("info_keywords", ()))


class Monitor(VecMonitor):
    """A `VecMonitor` that pickles and copies, as the environments inside do.

    A copy goes on counting where this one was, but writes no CSV: the file is the first one's.
    """

    def __getstate__(self) -> dict[str, Any]:
        # What Stable-Baselines3 keeps of its own class for look-ups cannot be pickled.
        return {**self.__dict__, "class_attributes": None, "results_writer": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.class_attributes = dict(inspect.getmembers(type(self)))


class RodVecEnv(Many, Fixed, VecEnv):
    """Many environments of one kind, stepped together in Rust, as Stable-Baselines3 wants them.

    Observations, rewards, dones and infos are those of `DummyVecEnv` over as many `gym.make`d
    environments: an ending step returns the reset observation, the last one is in
    `infos[i]["terminal_observation"]`, and `infos[i]["TimeLimit.truncated"]` says whether time was
    up.

    An episode's `infos[i]["parameters"]` is one dictionary, the same at each of its steps.

    Arguments:
        env_id: id such as `"rodgym/PendulumSwingUp-v0"`.
        n_envs: number of environments.
        render_mode: `None` or `"rgb_array"`.
        max_episode_steps: steps after which an episode is truncated; `None`: as registered; -1:
            never.
        num_threads: threads of a step; `None`: as many as the process may use.
        render_size: width and height of a picture in pixels; `None`: what suits the machine.
        backend: where the batch is computed: in this process, or a `rodgym.remote.Server`.
        reward: a function of one's own that pays, see `rodgym.own_task`; `observation=` may be a
            function, too.
        **kwargs: keywords of the environment, see its page.
    """

    def __init__(
        self,
        env_id: str,
        n_envs: int = 1,
        *,
        render_mode: str | None = None,
        max_episode_steps: int | None = None,
        num_threads: int | None = None,
        render_size: tuple[int, int] | None = None,
        backend: Backend = LOCAL,
        reward: Reward | None = None,
        **kwargs: Any,
    ) -> None:
        env_id = checks.env_id(env_id)
        given = {**kwargs, "render_size": render_size, "reward": reward}
        self._batch = SeededBatch(
            env_id,
            n_envs,
            kwargs,
            "SameStep",
            max_episode_steps,
            num_threads,
            render_mode,
            render_size,
            backend_of(backend, reward, kwargs),
        )
        about = self._batch.about
        self._terms: list[str] = about["reward_terms"]
        self._metrics: list[str] = about["metrics"]
        self._parameters: list[str] = [parameter["name"] for parameter in about["parameters"]]
        self._actions: npt.NDArray[Any] | None = None
        self._named: list[dict[str, float]] = [{} for _ in range(self._batch.num_envs)]
        #: That of Stable-Baselines3: an ending step returns the reset observation.
        self.autoreset_mode = AutoresetMode.SAME_STEP
        #: Whether options wait for a reset.
        self._waiting = False
        #: How `gym.make` would make one of the environments; keywords in types that JSON knows.
        self.spec = self._describe(*backend.registered(env_id, given))
        if self.spec is not None:
            self.spec.max_episode_steps = self._batch.native.max_episode_steps
            if render_mode is not None:
                self.spec.kwargs["render_mode"] = render_mode
        super().__init__(self._batch.num_envs, box(about["observation"]), box(about["action"]))
        self.metadata["render_fps"] = round(1.0 / about["control_dt"])
        self._made = True

    def _describe(self, env_id: str, kwargs: dict[str, Any]) -> EnvSpec | None:
        """The registered spec with these keywords, those left out not among them."""
        if env_id not in gym.registry:
            return None
        spec = copy.deepcopy(gym.registry[env_id])
        given = {key: value for key, value in kwargs.items() if value is not None}
        spec.kwargs = plain({**spec.kwargs, **given})
        return spec

    @property
    def members(self) -> list[Member]:
        """One object an environment: its plant, snapshots and picture."""
        return self._batch.members

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seeds of the next reset: environment i takes seed + i; None draws one from NumPy."""
        return super().seed(checks.seed(seed))

    def set_options(self, options: list[dict[str, Any]] | dict[str, Any] | None = None) -> None:
        """Options of the next `reset`: one dictionary for all, or a list with one an environment.

        Steps and their autoresets do not use them, as with any `VecEnv`, so that they do nothing in
        a training: see `set_parameters`.
        """
        if isinstance(options, list):
            if len(options) != self.num_envs:
                given = len(options)
                raise ShapeError(f"{given} options were given for {self.num_envs} environments")
            options = [checks.mapping("options", one) for one in options]
        else:
            options = checks.mapping("options", options)
        super().set_options(options)
        self._waiting = any(self._options)

    def reset(self) -> npt.NDArray[np.float32]:
        """Starts all episodes, with the seeds and options set before, once."""
        shape = self.observation_space.shape
        assert shape is not None
        observation = np.empty((self.num_envs, *shape), dtype=np.float32)
        for mask, options in self._option_groups():
            result = self._batch.reset(list(self._seeds), mask, options)
            rows = slice(None) if mask is None else mask
            observation[rows] = result.observation[rows]
            self._note_parameters(result)
        self._reset_seeds()
        self._reset_options()
        self._waiting = False
        return observation

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Keeps the actions for `step_wait`."""
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.bool_], list[dict]]:
        """One control step: observations, rewards (float32, as SB3 has them), dones, infos."""
        if self._waiting:
            self._waiting = False
            warnings.warn(
                "what set_options was given waits for reset(); steps and autoresets do not use it. "
                "set_parameters changes parameters from the next episode on",
                stacklevel=3,
            )
        result = self._batch.step(self._actions)
        dones = result.terminated | result.truncated
        infos = self._step_infos(result)
        if dones.any():
            self._note_parameters(result)
            for i in np.flatnonzero(dones):
                infos[i]["terminal_observation"] = result.final_observation[i].copy()
        return result.observation, result.reward.astype(np.float32), dones, infos

    def _step_infos(self, result: Result) -> list[dict[str, Any]]:
        limit = result.truncated & ~result.terminated
        for i in self._batch.refreshed:
            self._name_parameters(i, self._batch.before[i])
        # An episode's parameters are one dictionary: a thousand copies a step would cost too much.
        return _native.info_list(
            self._terms, self._metrics, result.terms, self._named, limit, result.solver_failure
        )

    def _name_parameters(self, index: int, row: npt.NDArray[np.float64]) -> None:
        """Parameters of an environment by name."""
        self._named[index] = dict(zip(self._parameters, row.tolist(), strict=True))

    def _note_parameters(self, result: Result) -> None:
        for i in np.flatnonzero(result.began).tolist():
            self._name_parameters(i, result.parameters[i])
            self.reset_infos[i] = {
                "parameters": self._named[i].copy(),
                "reward_terms": dict.fromkeys(self._terms, 0.0),
                **dict.fromkeys(self._metrics, math.nan),
                "solver_failure": False,
            }

    def _option_groups(self) -> list[tuple[npt.NDArray[np.bool_] | None, dict[str, Any] | None]]:
        """Environments that are reset with the same options, together."""
        if all(options == self._options[0] for options in self._options):
            return [(None, self._options[0] or None)]
        groups: list[tuple[npt.NDArray[np.bool_], dict[str, Any]]] = []
        for i, options in enumerate(self._options):
            for mask, known in groups:
                if known == options:
                    mask[i] = True
                    break
            else:
                mask = np.zeros(self.num_envs, dtype=np.bool_)
                mask[i] = True
                groups.append((mask, options))
        return [(mask, options or None) for mask, options in groups]

    def close(self) -> None:
        """Gives back what a server holds; in this process memory and threads go with the object."""
        self._batch.native.close()

    def get_images(self) -> Sequence[npt.NDArray[np.uint8] | None]:
        """One picture an environment, or None without render_mode="rgb_array"."""
        return [member.render() for member in self.members]

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """The attribute of each environment, see `members`; or else of the batch."""
        return [
            getattr(member if hasattr(member, attr_name) else self, attr_name)
            for member in self._targets(indices)
        ]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Sets the attribute of each environment.

        Raises:
            SettingError: no attribute that can be set; parameters have `set_parameters`.
        """
        for member in self._targets(indices):
            setattr(member, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Calls the method of each environment, such as `get_state`."""
        return [
            getattr(member, method_name)(*method_args, **method_kwargs)
            for member in self._targets(indices)
        ]

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper], indices: Indices = None
    ) -> list[bool]:
        """False: the environments of a native batch have no wrappers."""
        return [False for _ in self._targets(indices)]

    def _targets(self, indices: Indices) -> list[Member]:
        chosen = list(self._get_indices(indices))
        for i in chosen:
            if not -self.num_envs <= i < self.num_envs:
                there = self.num_envs
                raise EnvIndexError(f"environment {i} does not exist: the batch has {there}")
        return [self.members[i] for i in chosen]
