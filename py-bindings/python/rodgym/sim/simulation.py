"""What the bare machines share: keywords, motion, exact states, copies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from rodgym import _native
from rodgym._checks import count, matrix, number, refused, vector
from rodgym._settings import Fixed
from rodgym.derivatives import Jacobian, names

if TYPE_CHECKING:
    from typing_extensions import Self

Array = npt.NDArray[np.float64]


class Simulation(Fixed):
    """One bare machine in Rust, by itself."""

    #: The word that the core knows the machine by; empty: a copy of any (`of`).
    machine: ClassVar[str] = ""
    _native: _native.Simulation
    _made = True

    def __init__(self, **keywords: Any) -> None:
        self._native = _native.Simulation(self.machine, keywords)

    @classmethod
    def of(cls, env: Any) -> Self:
        """An exact copy of what runs in an environment, wrapped or not: this episode's parameters,
        the motion, and what stepper and actuator remember. The next step of both has the same bits.

        Raises:
            ParameterError: not one environment with this machine.
        """
        base = getattr(env, "unwrapped", env)
        spec = getattr(base, "core_spec", None)
        if not isinstance(spec, dict) or cls.machine not in ("", spec["machine"]):
            what = cls.machine or "machine"
            raise refused("machine", env, f"one environment of rodgym with a {what}")
        twin = object.__new__(cls)
        twin._native = base._simulation()
        return twin

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

    def get_vector(self) -> Array:
        """The whole state as one vector (s,), a copy: all that the next step depends on.

        Of a pendulum positions [m], then velocities [m/s] of the nodes after the hinge, x and y a
        node. Then what its stepper carries: `verlet`, `tr_bdf2`, `esdirk3` their accelerations
        without what the base torque does [m/s^2]; `bdf2` positions and velocities a step before,
        and 1 where those are known, else 0.

        Of a fin positions [m] of all nodes but the pivot, x and y a node, with the pivot's x where
        it swims freely; velocities [m/s] of all nodes; with `bdf2` the same a step before, and 1
        where those are known, else 0; then angle and rate of the servo and of the five stages of
        its low-pass [rad, rad/s].
        """
        return self._native.get_vector()

    def set_vector(self, x: npt.ArrayLike) -> None:
        """Goes to a state that `get_vector` has the numbers of; the time goes back to 0.

        Raises:
            ShapeError: not as many numbers as the state has.
            ParameterError: no state of this machine; nothing changes then.
        """
        self._native.set_vector(np.asarray(vector("x", x), dtype=np.float64))

    def jacobian(self, input: float = 0.0, n: int = 1, parameters: Sequence[str] = ()) -> Jacobian:
        """Exact derivatives of `get_vector()` after `n` physics steps under a constant input; the
        machine stays where it is.

        Arguments:
            input: a pendulum's base torque [N m]; a fin's pitch [rad], at which every step ends.
            n: physics steps.
            parameters: names of physical parameters.

        Returns:
            `A` (s, s) by the vector, `B` (s, 1) by the input, `P` (s, p) by the parameters.

        Raises:
            ParameterError: an input that is not finite, a name that is no parameter.
            SolverError: a step failed in its smallest parts.
        """
        value = number("input", input, "N m")
        return Jacobian(**self._native.jacobian(value, count(n), names(parameters)))

    def _step(self, value: float, n: int) -> None:
        """`n` physics steps under a constant input."""
        self._native.step(value, count(n))

    def energy(self) -> dict[str, float]:
        """Energies by kind and their `total` [J].

        A pendulum: `kinetic`, `stretch`, `bend`, `gravity`; a fin: `kinetic`, `stretch`, `bend`,
        `fluid` (relative to the flow).
        """
        return self._native.energy()

    def _keywords(self) -> dict[str, Any]:
        return self.config

    def _physical(self) -> list[str]:
        # A bare machine keeps what it was made with.
        return []

    def __copy__(self) -> Self:
        twin = object.__new__(type(self))
        twin._native = self._native.copy()
        return twin

    def __deepcopy__(self, memo: Mapping[int, Any]) -> Self:
        return self.__copy__()

    def __repr__(self) -> str:
        return f"{type(self).__name__}(nodes={len(self.positions)}, time={self.time:g})"
