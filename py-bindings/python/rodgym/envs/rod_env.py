"""The Gymnasium face of one environment, whatever machine is inside."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, SupportsFloat

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from rodgym import _checks as checks
from rodgym._plant import Frame, Plant, box, picture_size, plain
from rodgym._rod import with_rod
from rodgym.backend import LOCAL, Backend
from rodgym.own_task import Reward, backend_of

if TYPE_CHECKING:
    from gymnasium.envs.registration import EnvSpec

Vector = npt.NDArray[np.float32]


class RodEnv(Plant, gym.Env[Vector, Vector]):
    """One environment of the Rust core.

    Physics, task, random stream and clock live in `rodgym._native`; this class translates. It sets
    no time limit: `gym.make` does, and stepping goes on after an episode's end.

    Arguments:
        env_id: id such as `"rodgym/PendulumSwingUp-v0"`.
        render_mode: `None`, `"rgb_array"` (no display needed) or `"human"` (needs pygame).
        render_size: width and height of the picture in pixels; `None`: what suits the machine.
        backend: where it is computed: in this process, or a `rodgym.remote.Server`.
        reward: a function of one's own that pays, see `rodgym.own_task`; `observation=` may be a
            function, too.
        **kwargs: keywords of the environment, see its page, and `rod`: the `rod.yml` of a fitted
            rod (docs/lab.md), whose keywords it stands for; others come on top.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 50}

    def __init__(
        self,
        env_id: str,
        render_mode: str | None = None,
        render_size: tuple[int, int] | None = None,
        *,
        backend: Backend = LOCAL,
        reward: Reward | None = None,
        **kwargs: Any,
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            allowed = f"None or one of {self.metadata['render_modes']}"
            raise checks.refused("render_mode", render_mode, allowed)
        keywords, name = with_rod(kwargs), checks.env_id(env_id)
        backend = backend_of(backend, reward, keywords)
        self._batch = backend.open(name, 1, keywords, "Single", -1, None)
        self._spec: EnvSpec | None = None
        self._render_size = picture_size(render_size)
        self._window: Any = None
        self._seeded = False
        #: Parameters of the episode: each info has them.
        #: Those of the episode; None where they must be read.
        self._parameters: dict[str, float] | None = None
        about = self._batch.spec
        self.metadata = {**self.metadata, "render_fps": round(1.0 / about["control_dt"])}
        self._names: tuple[list[str], list[str]] = about["reward_terms"], about["metrics"]
        self.render_mode = render_mode
        self.observation_space = box(about["observation"])
        self.action_space = box(about["action"])
        self._made = True

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """How `gym.make` made this environment; its keywords are kept in types that JSON knows."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            spec.kwargs = plain(spec.kwargs)
        self._spec = spec

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Vector, dict[str, Any]]:
        """Starts an episode.

        Without a seed the random stream goes on; if it never had one, it takes one from
        `np_random`.

        Arguments:
            seed: restarts the random stream.
            options: `parameters` (exact values by name) and `state` (an exact start), see the page
                of the environment. They hold for this episode only.

        Returns:
            The observation, and `info` with the episode's `parameters` and the other keys that it
            has at a step: `reward_terms` are 0, and metrics NaN, since no step was taken.
        """
        native_seed = seed = checks.seed(seed)
        if seed is None and not self._seeded:
            native_seed = int(self.np_random.integers(2**63))
        # An exception (Ctrl-C) leaves open which episode it is.
        self._parameters = None
        observation, info = self._batch.reset_single(native_seed, options)
        super().reset(seed=seed)
        self._seeded = True
        self._parameters = info["parameters"].copy()
        terms, metrics = self._names
        info["reward_terms"] = dict.fromkeys(terms, 0.0)
        info.update(dict.fromkeys(metrics, math.nan), solver_failure=False)
        if self.render_mode == "human":
            self.render()
        return observation, info

    def step(self, action: Vector) -> tuple[Vector, SupportsFloat, bool, bool, dict[str, Any]]:
        """One control step.

        Returns:
            Observation, reward, terminated, truncated (by a solver failure only; the time limit is
            `gym.make`'s), and `info` with `reward_terms`, which add up to the reward, metrics,
            `solver_failure` and the episode's `parameters`.

        Raises:
            ActionError: the action is not finite; nothing changes then.
            ShapeError: the action has another shape than the action space.
        """
        result = self._batch.step_single(action)
        if self._parameters is None:
            self._parameters = self._batch.parameters(0)
        result[4]["parameters"] = self._parameters.copy()
        if self.render_mode == "human":
            self.render()
        return result

    def set_state(self, state: bytes) -> Vector:
        """See `Plant.set_state`; the random stream of the state counts as seeded."""
        observation = super().set_state(state)
        self._seeded = True
        self._parameters = self._batch.parameters(0)
        return observation

    def render(self) -> Frame | None:  # type: ignore[override]
        """The picture of mode "rgb_array"; in mode "human" shows it and returns None."""
        if self.render_mode is None:
            gym.logger.warn(
                "render() was called, but the environment was made without a render_mode, "
                'such as gym.make(..., render_mode="rgb_array")'
            )
            return None
        frame = self.frame()
        if self.render_mode == "rgb_array":
            return frame
        if self._window is None:
            from rodgym.rendering import Window

            self._window = Window("rodgym", self.metadata["render_fps"])
        self._window.show(frame)
        return None

    def close(self) -> None:
        """Closes the window, if there is one, and gives back what a server holds."""
        if self._window is not None:
            self._window.close()
            self._window = None
        self._batch.close()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_window": None}
