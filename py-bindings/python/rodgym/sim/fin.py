"""The bare fin."""

from __future__ import annotations

from typing import Any

import numpy.typing as npt

from rodgym._checks import count, matrix, number, vector
from rodgym.sim.simulation import Array, Simulation


class Fin(Simulation):
    """The flexible fin, pitched by hand (`step`) or by its servo (`drive`): no task.

    It starts straight and at rest, nose at x = -40 mm, pivot at the origin. x points downstream;
    thrust is the force of the water along -x.

    Arguments:
        **fin: keywords of the environments that concern the fin and its water: `youngs_modulus`,
            `damping`, `bending_damping`, `density`, `flow_speed`, `added_mass_coefficient`,
            `friction_coefficient`, `drag_coefficient`, `hull_mass`, `hull_drag_area`,
            `hydrodynamics`, `geometry`, `stiffness_profile`, `stepper`, `physics_dt`, `thesis`,
            `command_cutoff` (3 Hz as there, None: the servo is told the bare command); and
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

    machine = "fin"

    @property
    def loads(self) -> dict[str, float]:
        """Forces and power of the last physics step.

        `pitch` [rad], `thrust`, `shed_thrust`, `resistive_thrust`, `mount_thrust` [N], `torque`
        [N m], `power` [W].
        """
        return self._native.ask("loads")

    @property
    def thrust(self) -> float:
        """Force of the water along -x in the last physics step [N]."""
        return self.loads["thrust"]

    @property
    def torque(self) -> float:
        """Torque of the drive about the pivot in the last physics step [N m]."""
        return self.loads["torque"]

    @property
    def power(self) -> float:
        """Power of the drive in the last physics step [W]."""
        return self.loads["power"]

    def step(self, pitch: float, n: int = 1) -> None:
        """`n` physics steps, each ending at this pitch [rad]; the same bits as n steps of one.

        Raises:
            SolverError: a step failed in its smallest parts; the state is the one before it.
        """
        self._step(number("pitch", pitch, "rad"), n)

    def drive(self, command: float, n: int = 1) -> None:
        """`n` physics steps under the servo of the environments, told this pitch [rad].

        After `step` or `set_state` servo and low-pass start at rest at the pitch that the fin has.

        Raises:
            SolverError: a step failed in its smallest parts; the state is the one before it.
        """
        self._native.act("drive", [[number("command", command, "rad")]], count(n))

    def follow(self, pitches: npt.ArrayLike) -> dict[str, Array]:
        """Physics steps that end at these pitches [rad], one after the other.

        Returns:
            `thrust` [N], `torque` [N m], `power` [W] and `tail` (y of the last node) [m], one
            value a step.
        """
        return self._native.act("follow", [vector("pitches", pitches)])

    def forces(self, positions: npt.ArrayLike, velocities: npt.ArrayLike) -> dict[str, Any]:
        """Forces in any motion (velocities absolute); the fin itself is not touched.

        Returns:
            Arrays (nodes, 2): `elastic` = -dE/dx [N], `fluid_momentum` p_f [kg m/s],
            `fluid_gradient` dT_f/dq [N], `tail_flux` G [N], `resistive` [N]; and `elastic_energy`,
            `fluid_energy` T_f [J].
        """
        x, v = matrix("positions", positions), matrix("velocities", velocities)
        return self._native.ask("forces", [x.ravel().tolist(), v.ravel().tolist()])
