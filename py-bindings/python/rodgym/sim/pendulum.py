"""The bare pendulum."""

from __future__ import annotations

from typing import NamedTuple

import numpy.typing as npt

from rodgym._checks import count, number, vector
from rodgym.sim.simulation import Array, Simulation


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


class Pendulum(Simulation):
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

    machine = "pendulum"

    @property
    def angles(self) -> Array:
        """Angles of the edges from hanging, in (-pi, pi] [rad], (nodes - 1,)."""
        return self._native.ask("angles")["angles"]

    @property
    def rates(self) -> Array:
        """Rates of the edges' angles [rad/s], (nodes - 1,)."""
        return self._native.ask("rates")["rates"]

    def set_angles(self, angles: npt.ArrayLike, rates: npt.ArrayLike | None = None) -> None:
        """Sets angles [rad] and rates [rad/s] of all edges at their rest lengths; the time goes
        back to 0.

        Rates left out are zero.
        """
        first = vector("angles", angles)
        second = [0.0] * len(first) if rates is None else vector("rates", rates)
        self._native.act("set_angles", [first, second])

    def step(self, torque: float = 0.0, n: int = 1) -> None:
        """`n` physics steps under a constant base torque [N m]; the same bits as n steps of one.

        Raises:
            SolverError: a step failed in its smallest parts; the state is the one before it.
        """
        self._step(number("torque", torque, "N m"), n)

    def step_feedback(self, constant: float, gain: npt.ArrayLike, n: int = 1) -> None:
        """`n` physics steps under the torque `constant + gain . (theta - pi, rate)` of the new
        state.

        The torque is solved for within the implicit step, as the controller of the thesis does.
        `constant` [N m]; `gain` has 2 (nodes - 1) numbers [N m/rad, N m s/rad].

        Raises:
            ParameterError: the stepper is explicit.
            SolverError: a step failed in its smallest parts; the state is the one before it.
        """
        first = number("constant", constant, "N m")
        self._native.act("step_feedback", [[first], vector("gain", gain)], count(n))

    def linearize(self, torque: float = 0.0) -> Linear:
        """The linear motion near the present state and torque [N m].

        Poles mean something where that is an equilibrium.
        """
        return Linear(**self._native.ask("linearize", [[number("torque", torque, "N m")]]))
