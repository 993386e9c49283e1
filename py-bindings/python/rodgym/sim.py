"""The bare machines, for people who want the physics: no motor limit, sensors, task or control
step.

```python
>>> import rodgym
>>> rod = rodgym.sim.Pendulum(width=0.007)
>>> rod.set_angles([1.57] * 6)
>>> rod.step(torque=0.0, n=5000)
>>> round(rod.time, 6)
1.0

```
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from rodgym import _native
from rodgym._machine import Array, Machine
from rodgym.errors import ParameterError, ShapeError

__all__ = ["Fin", "Linear", "Pendulum"]


class Linear(NamedTuple):
    """Motion near a state: dz/dt = A (z - z0) + B T, y = C (z - z0), with p = nodes - 1.

    z: displacements of the nodes after the hinge, x and y a node [m], then their velocities [m/s].
    y: angles of the edges [rad], then their rates [rad/s]. T: base torque [N m].
    """

    #: (4p, 4p)
    A: Array
    #: (4p, 1)
    B: Array
    #: (2p, 4p)
    C: Array


class Pendulum:
    """The elastic pendulum, driven by a torque on its first edge.

    It starts hanging at rest. Angles are from hanging, counter-clockwise; E1 points right, E2 up,
    the hinge is the origin.

    Arguments:
        **rod: keywords of the environments that concern the rod: `width`, `length`, `density`,
            `youngs_modulus`, `damping`, `bending_damping`, `gravity`, `nodes`, and `stepper`,
            `physics_dt`, `thesis`.

    Raises:
        ParameterError: an unknown keyword, or a value outside its range.
    """

    def __init__(self, **rod: Any) -> None:
        self._native = _native.PendulumSimulation(rod)

    @classmethod
    def of(cls, machine: Machine) -> Pendulum:
        """The pendulum of an environment, with this episode's parameters and as it is now."""
        own = cls()
        known = own.config
        config = {**machine.config, **machine.parameters}
        sim = cls(**{key: value for key, value in config.items() if key in known})
        sim.set_state(machine.positions, machine.velocities)
        return sim

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

    @property
    def angles(self) -> Array:
        """Angles of the edges from hanging, in (-pi, pi] [rad], (nodes - 1,)."""
        return self._native.angles

    @property
    def rates(self) -> Array:
        """Rates of the edges' angles [rad/s], (nodes - 1,)."""
        return self._native.rates

    def set_state(self, positions: npt.ArrayLike, velocities: npt.ArrayLike | None = None) -> None:
        """Sets positions [m] and velocities [m/s] of all nodes, (nodes, 2); the time goes back to
        0.

        Velocities left out are zero.

        Raises:
            ShapeError, ParameterError: arrays that are no state of this rod; nothing changes then.
        """
        x = _matrix("positions", positions)
        v = np.zeros_like(x) if velocities is None else _matrix("velocities", velocities)
        self._native.set_state(x, v)

    def set_angles(self, angles: npt.ArrayLike, rates: npt.ArrayLike | None = None) -> None:
        """Sets angles [rad] and rates [rad/s] of all edges at their rest lengths; the time goes
        back to 0.

        Rates left out are zero.
        """
        first = _vector("angles", angles)
        second = [0.0] * len(first) if rates is None else _vector("rates", rates)
        self._native.set_angles(first, second)

    def step(self, torque: float = 0.0, n: int = 1) -> None:
        """`n` physics steps under a constant base torque [N m]; the same bits as n steps of one.

        Raises:
            SolverError: a step failed in its smallest parts; the state is the one before it.
        """
        self._native.step(torque, _count(n))

    def step_feedback(self, constant: float, gain: npt.ArrayLike, n: int = 1) -> None:
        """`n` physics steps under the torque `constant + gain . (theta - pi, rate)` of the new
        state.

        The torque is solved for within the implicit step, as the controller of the thesis does.
        `constant` [N m]; `gain` has 2 (nodes - 1) numbers [N m/rad, N m s/rad].

        Raises:
            ParameterError: the stepper is explicit.
            SolverError: a step failed in its smallest parts; the state is the one before it.
        """
        self._native.step_feedback(constant, _vector("gain", gain), _count(n))

    def energy(self) -> dict[str, float]:
        """Energies [J]: `kinetic`, `stretch`, `bend`, `gravity` and their `total`."""
        return self._native.energy()

    def linearize(self, torque: float = 0.0) -> Linear:
        """The linear motion near the present state and torque [N m].

        Poles mean something where that is an equilibrium.
        """
        return Linear(*self._native.linearize(torque))

    def __copy__(self) -> Pendulum:
        twin = object.__new__(type(self))
        twin._native = self._native.copy()
        return twin

    def __deepcopy__(self, memo: Mapping[int, Any]) -> Pendulum:
        return self.__copy__()

    def __repr__(self) -> str:
        return f"Pendulum(nodes={self.config['nodes']}, time={self.time:g})"


class Fin:
    """The flexible fin, pitched by hand: no servo, no task.

    It starts straight and at rest, nose at x = -40 mm, pivot at the origin. x points downstream;
    thrust is the force of the water along -x.

    Arguments:
        **fin: keywords of the environments that concern the fin and its water: `youngs_modulus`,
            `damping`, `bending_damping`, `density`, `flow_speed`, `added_mass_coefficient`,
            `friction_coefficient`, `drag_coefficient`, `hull_mass`, `hull_drag_area`,
            `hydrodynamics`, `geometry`, `stiffness_profile`, `stepper`, `physics_dt`, `thesis`; and
            `free_swimming`, which frees the pivot along x in water at rest.

    Raises:
        ParameterError: an unknown keyword, or a value outside its range.

    ```python
    >>> import rodgym
    >>> fin = rodgym.sim.Fin(youngs_modulus=1e6)
    >>> fin.step(pitch=0.01, n=10)
    >>> fin.positions.shape, round(fin.time, 6)
    ((8, 2), 0.04)

    ```
    """

    def __init__(self, **fin: Any) -> None:
        self._native = _native.FinSimulation(fin)

    @classmethod
    def of(cls, machine: Machine) -> Fin:
        """The fin of an environment, with this episode's parameters and as it is now.

        The water's momentum follows from the motion; what the second-order stepper remembers of the
        step before does not come along.
        """
        own = cls()
        known = own.config
        config = {**machine.config, **machine.parameters}
        swims = "hull_speed" in machine.scene()["values"]
        physical = {key: value for key, value in config.items() if key in known}
        sim = cls(**{**physical, "free_swimming": swims})
        sim.set_state(machine.positions, machine.velocities)
        return sim

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

    @property
    def loads(self) -> dict[str, float]:
        """Forces and power of the last physics step.

        `pitch` [rad], `thrust`, `shed_thrust`, `resistive_thrust`, `mount_thrust` [N], `torque`
        [N m], `power` [W].
        """
        return self._native.loads

    @property
    def thrust(self) -> float:
        """Force of the water along -x in the last physics step [N]."""
        return self._native.loads["thrust"]

    @property
    def torque(self) -> float:
        """Torque of the drive about the pivot in the last physics step [N m]."""
        return self._native.loads["torque"]

    @property
    def power(self) -> float:
        """Power of the drive in the last physics step [W]."""
        return self._native.loads["power"]

    def set_state(self, positions: npt.ArrayLike, velocities: npt.ArrayLike | None = None) -> None:
        """Sets positions [m] and velocities [m/s] of all nodes, (nodes, 2); the time goes back to
        0.

        The pivot must be at the origin and the driven edge at its rest length. Velocities left out
        are zero.

        Raises:
            ShapeError, ParameterError: arrays that are no state of this fin; nothing changes then.
        """
        x = _matrix("positions", positions)
        v = np.zeros_like(x) if velocities is None else _matrix("velocities", velocities)
        self._native.set_state(x, v)

    def step(self, pitch: float, n: int = 1) -> None:
        """`n` physics steps, each ending at this pitch [rad]; the same bits as n steps of one.

        Raises:
            SolverError: a step failed in its smallest parts; the state is the one before it.
        """
        self._native.step(pitch, _count(n))

    def follow(self, pitches: npt.ArrayLike) -> dict[str, Array]:
        """Physics steps that end at these pitches [rad], one after the other.

        Returns:
            `thrust` [N], `torque` [N m], `power` [W] and `tail` (y of the last node) [m], one
            value a step.
        """
        trace = self._native.follow(_vector("pitches", pitches))
        return dict(zip(("thrust", "torque", "power", "tail"), trace.T, strict=True))

    def forces(self, positions: npt.ArrayLike, velocities: npt.ArrayLike) -> dict[str, Any]:
        """Forces in any motion (velocities absolute); the fin itself is not touched.

        Returns:
            Arrays (nodes, 2): `elastic` = -dE/dx [N], `fluid_momentum` p_f [kg m/s],
            `fluid_gradient` dT_f/dq [N], `tail_flux` G [N], `resistive` [N]; and `elastic_energy`,
            `fluid_energy` T_f [J].
        """
        x, v = _matrix("positions", positions), _matrix("velocities", velocities)
        return self._native.forces(x, v)

    def energy(self) -> dict[str, float]:
        """Energies [J]: `kinetic`, `stretch`, `bend`, `fluid` (relative to the flow), `total`."""
        return self._native.energy()

    def __copy__(self) -> Fin:
        twin = object.__new__(type(self))
        twin._native = self._native.copy()
        return twin

    def __deepcopy__(self, memo: Mapping[int, Any]) -> Fin:
        return self.__copy__()

    def __repr__(self) -> str:
        return f"Fin(nodes={len(self.positions)}, time={self.time:g})"


def _numbers(name: str, values: npt.ArrayLike) -> Array:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"{name} must be an array of numbers, but is {values!r}") from error


def _matrix(name: str, values: npt.ArrayLike) -> Array:
    array = _numbers(name, values)
    if array.ndim != 2:
        raise ShapeError(f"{name} has shape {array.shape}, but (nodes, 2) is needed")
    return array


def _vector(name: str, values: npt.ArrayLike) -> list[float]:
    array = _numbers(name, values)
    if array.ndim != 1:
        raise ShapeError(f"{name} has shape {array.shape}, but one dimension is needed")
    return array.tolist()


def _count(n: int) -> int:
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or n < 0:
        raise ParameterError(f"n = {n!r} is not allowed: it must be a whole number, 0 or more")
    return int(n)
