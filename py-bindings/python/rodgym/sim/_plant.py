"""What the bare machines share: keywords, motion, exact states, copies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from rodgym import _native
from rodgym._checks import matrix, refused
from rodgym._machine import Array, Machine

if TYPE_CHECKING:
    from typing_extensions import Self

Native = TypeVar("Native", _native.PendulumSimulation, _native.FinSimulation)


class Plant(Generic[Native]):
    """One machine in Rust, by itself."""

    _native: Native

    @classmethod
    def _like(cls, machine: Machine, **others: Any) -> Self:
        """The machine of an environment, with this episode's parameters and as it is now."""
        config = {**machine.config, **machine.parameters}
        known = cls().config
        plant = cls(**{key: value for key, value in config.items() if key in known}, **others)
        plant.set_state(machine.positions, machine.velocities)
        return plant

    @property
    def config(self) -> dict[str, Any]:
        """Every keyword with its value, defaults filled in."""
        return self._native.config

    @property
    def parameters(self) -> dict[str, float]:
        """Physical parameters by keyword."""
        return self._native.parameters

    @property
    def time(self) -> float:
        """Simulated time since the state was set [s]."""
        return self._native.time

    @property
    def physics_dt(self) -> float:
        """Duration of a step [s]."""
        return self._native.physics_dt

    @property
    def positions(self) -> Array:
        """Positions of the nodes [m], (nodes, 2), a copy."""
        return self._native.positions

    @property
    def velocities(self) -> Array:
        """Velocities of the nodes [m/s], (nodes, 2), a copy."""
        return self._native.velocities

    def set_state(self, positions: npt.ArrayLike, velocities: npt.ArrayLike | None = None) -> None:
        """Sets positions [m] and velocities [m/s] of all nodes, (nodes, 2); the time goes back to
        0.

        Velocities left out are zero. The first node of a pendulum rests at the origin; the pivot of
        a fin is there and its driven edge has its rest length.

        Raises:
            ShapeError, ParameterError: arrays that are no state of this machine; nothing
                changes then.
        """
        x = matrix("positions", positions)
        v = np.zeros_like(x) if velocities is None else matrix("velocities", velocities)
        self._native.set_state(x, v)

    def __copy__(self) -> Self:
        twin = object.__new__(type(self))
        twin._native = self._native.copy()
        return twin

    def __deepcopy__(self, memo: Mapping[int, Any]) -> Self:
        return self.__copy__()

    def __repr__(self) -> str:
        return f"{type(self).__name__}(nodes={len(self.positions)}, time={self.time:g})"


def machine_of(env: Any, kind: str) -> Machine:
    """The machine of an environment, however it is wrapped."""
    machine = getattr(env, "unwrapped", env)
    if not isinstance(machine, Machine) or machine.kind != kind:
        raise refused("machine", env, f"one environment of rodgym with a {kind}")
    return machine
