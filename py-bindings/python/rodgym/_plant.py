"""What one environment shows of its machine, be it alone or one of a batch."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box

from rodgym import _native, machines
from rodgym._checks import numbers, refused, snapshot, whole
from rodgym._plain import plain as plain
from rodgym._settings import Fixed, Settable
from rodgym.derivatives import RolloutGradient, StepJacobian, names
from rodgym.errors import ShapeError

if TYPE_CHECKING:
    from rodgym.backend import Batch
    from rodgym.sim import Simulation

Array = npt.NDArray[np.float64]
Frame = npt.NDArray[np.uint8]


def box(space: dict[str, Any]) -> Any:
    """A Gymnasium `Box` from the core's bounds."""
    low, high = (np.asarray(space[side], dtype=np.float32) for side in ("low", "high"))
    return Box(low, high, dtype=np.float32)


def picture_size(size: Any) -> tuple[int, int] | None:
    """`render_size`, checked: None, or width and height in pixels."""
    if size is None:
        return None
    low, high = _native.PICTURE_LIMITS
    try:
        width, height = (operator.index(side) for side in size)
    except (TypeError, ValueError):
        width = height = 0
    if not (low <= width <= high and low <= height <= high):
        allowed = f"None or (width, height), whole numbers from {low} to {high}"
        raise refused("render_size", size, allowed)
    return width, height


def pixels(name: str, side: Any) -> int:
    """One side of a picture, checked."""
    low, high = _native.PICTURE_LIMITS
    return whole(name, side, low, high, f"a whole number of pixels from {low} to {high}")


class Plant(Settable, Fixed):
    """One environment's plant, snapshots and settings: environment number `_index` of `_batch`.

    Its keywords can be read as attributes; physical parameters have this episode's value.
    """

    _batch: Batch
    _index: int = 0
    _render_size: tuple[int, int] | None = None

    def get_state(self) -> bytes:
        """Everything about this environment: physics, random stream, episode clock; versioned
        bytes.

        The step counter of Gymnasium's `TimeLimit` wrapper is not part of it.
        """
        return self._batch.get_state(self._index)

    def set_state(self, state: bytes) -> npt.NDArray[np.float32]:
        """Goes to a state that `get_state` of the same kind of environment returned.

        Returns:
            The observation that the environment had returned last when the state was taken.

        Raises:
            SnapshotError: the bytes are damaged or belong elsewhere; nothing changes then.
            ParameterError: no bytes at all.
        """
        self._batch.set_state(self._index, snapshot("state", state))
        return self._batch.observe(self._index)

    @property
    def last_observation(self) -> npt.NDArray[np.float32]:
        """What the last reset or step showed, before any wrapper, a copy."""
        return self._batch.observe(self._index)

    @property
    def positions(self) -> Array:
        """Positions of the nodes [m], shape (nodes, 2), a copy."""
        return self._batch.nodes(self._index)[0]

    @property
    def velocities(self) -> Array:
        """Velocities of the nodes [m/s], shape (nodes, 2), a copy."""
        return self._batch.nodes(self._index)[1]

    @property
    def parameters(self) -> dict[str, float]:
        """Physical parameters of this episode, by keyword."""
        return self._batch.parameters(self._index)

    @property
    def core_spec(self) -> dict[str, Any]:
        """All that the core says of this kind of environment: `id`, `machine`, `task`, spaces with
        names, reward terms, metrics, parameters with units and ranges, `config`.
        """
        return dict(self._batch.spec)

    @property
    def config(self) -> dict[str, Any]:
        """Every keyword of the environment with its value, defaults filled in."""
        return dict(self._batch.spec["config"])

    @property
    def control_dt(self) -> float:
        """Duration of a step [s]."""
        return float(self._batch.spec["control_dt"])

    @property
    def physics_dt(self) -> float:
        """Duration of a physics step [s]."""
        return float(self._batch.spec["physics_dt"])

    @property
    def simulation(self) -> Simulation:
        """A copy of the machine as it is now, `rodgym.sim`; stepping it leaves the environment
        alone. Each machine has a word for it too: `.rod` of a pendulum, `.fin` of a fin.
        """
        simulation: type[Simulation] = machines.load(machines.of(self.core_spec).simulation)
        return simulation.of(self)

    def step_jacobian(self, action: npt.ArrayLike, parameters: Sequence[str] = ()) -> StepJacobian:
        """Exact derivatives of the control step that `action` would make; the environment stays
        where it is.

        The state is the vector of `.simulation.get_vector()`; with an `actuator_delay` the torques
        on their way to the motor [N m] follow, or a fin's commands, newest first; last of a fin
        stands the thrust smoothed over 0.5 s [N], which one task pays by. Autoreset and time limit
        have no derivatives; noise is what the step would draw. docs/derivatives.md says what is
        smooth.

        Arguments:
            action: one action (a,); beyond the bounds it is clipped, and has no slope.
            parameters: names of physical parameters to differentiate by, too.

        Raises:
            ParameterError: a name that is no parameter.
            ActionError, ShapeError: no action.
            SolverError: the solver gives up in this step.
        """
        found = self._batch.step_jacobian(self._index, action, names(parameters))
        return StepJacobian(**found)

    def rollout_gradient(
        self, actions: npt.ArrayLike, parameters: Sequence[str] = ()
    ) -> RolloutGradient:
        """Exact gradients of the sum of rewards that these actions would bring from here on; the
        environment stays where it is.

        The sum ends with the last action, or where the task ends the episode.

        Arguments:
            actions: (t, a), one a control step.
            parameters: names of physical parameters to differentiate by, too.

        Raises:
            ParameterError: a name that is no parameter.
            ActionError, ShapeError: no actions.
            SolverError: the solver gives up in one of the steps.
        """
        array = numbers("actions", actions)
        size = self._batch.spec["action"]["low"]
        if array.ndim != 2 or array.shape[1] != len(size):
            raise ShapeError(f"actions has shape {array.shape}, but (t, {len(size)}) is needed")
        found = self._batch.rollout_gradient(self._index, array, names(parameters))
        return RolloutGradient(**found)

    def __getattr__(self, name: str) -> Any:
        """`simulation` by the machine's own word; another machine's word says what is here."""
        for about in machines.known():
            if name == about.word:
                mine = machines.of(self.core_spec)
                if about is mine:
                    return self.simulation
                raise AttributeError(
                    f"this environment has a {mine.machine}, not a {about.machine}: "
                    f"see `.{mine.word}`"
                )
        if not name.startswith("_"):
            if name in self._physical():
                return self.parameters[name]
            if name in (config := self.config):
                return config[name]
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def _configure(self, parameters: dict[str, Any], randomize: dict[str, Any]) -> None:
        self._batch.configure(self._index, 1, parameters, randomize)

    def _keywords(self) -> dict[str, Any]:
        return self.config

    def _physical(self) -> list[str]:
        return [parameter["name"] for parameter in self._batch.spec["parameters"]]

    def _simulation(self) -> _native.Simulation:
        """An exact copy of what runs, as the core has it."""
        return self._batch.simulation(self._index)

    def scene(self) -> dict[str, Any]:
        """What there is to draw: nodes, thickness, curvature, action, time, named values."""
        return self._batch.scene(self._index)

    def frame(self, width: int | None = None, height: int | None = None) -> Frame:
        """A picture of this environment, shape (height, width, 3), without a display."""
        return self._batch.render(self._index, *self._size(width, height))

    def svg(self, width: int | None = None, height: int | None = None) -> str:
        """The same picture as an SVG document, for figures."""
        return self._batch.svg(self._index, *self._size(width, height))

    def _repr_html_(self) -> str:
        """The picture, where a notebook shows this environment."""
        return self.svg(360)

    def _size(self, width: int | None, height: int | None) -> tuple[int | None, int | None]:
        usual = self._render_size or (None, None)
        given = [("width", width, usual[0]), ("height", height, usual[1])]
        return tuple(side if s is None else pixels(name, s) for name, s, side in given)  # type: ignore[return-value]


class Member(Plant):
    """One environment of a batch: what `call`, `get_attr` and `env_method` reach."""

    def __init__(
        self,
        batch: Batch,
        index: int,
        render_mode: str | None = None,
        render_size: tuple[int, int] | None = None,
        changed: set[int] | None = None,
    ) -> None:
        self._batch = batch
        self._index = index
        self._changed = changed
        self._render_size = render_size
        self.render_mode = render_mode
        self._made = True

    def set_state(self, state: bytes) -> npt.NDArray[np.float32]:
        """See `Plant.set_state`; the batch is told."""
        observation = super().set_state(state)
        if self._changed is not None:
            self._changed.add(self._index)
        return observation

    @property
    def unwrapped(self) -> Member:
        """Itself: there are no wrappers in a batch."""
        return self

    def render(self) -> Frame | None:
        """The picture, if the batch was made with render_mode="rgb_array"."""
        return self.frame() if self.render_mode == "rgb_array" else None

    def __repr__(self) -> str:
        return f"<environment {self._index} of {self._batch!r}>"
