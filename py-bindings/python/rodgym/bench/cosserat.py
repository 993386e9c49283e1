"""rodgym as a solver of cosseratbench, a benchmark of rod solvers that others keep.

cosseratbench finds the class through the entry point group `cosseratbench.solvers`, so that
`pip install rodgym cosseratbench` is all that `cosseratbench run -s rodgym` needs. rodgym takes
part in what stays in a plane: one rod, pinned or clamped at its start, under gravity and forces at
its end. It says of the rest that it is outside its model.

Motions run in `rodgym.sim.Pendulum`. Where only the equilibrium is asked for, Newton's method finds
it from the forces and the stiffness of the same rod.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from cosseratbench.scenario import EndCondition, Rod, Scenario
from cosseratbench.solver import Capability, Diverged
from cosseratbench.trajectory import Trajectory

import rodgym
from rodgym.sim import Pendulum

Array = npt.NDArray[np.float64]

#: Part of the largest stable step of Verlet that is taken, and rounds of Newton's method at most.
SAFETY, ROUNDS = 0.5, 200
#: Shorter steps must be a whole part of this [s], the shortest control step that the core has.
SHORT = 1e-5
#: Where the equilibrium is found: what is left of the forces, over the one that doubles an edge.
LEFT = 1e-10


class RodgymSolver:
    """The planar discrete rod, by velocity Verlet or as an equilibrium.

    Arguments:
        time_step_scale: factor of the time step that would be taken otherwise.
    """

    name = "rodgym"
    backend_version = rodgym.__version__
    capabilities = frozenset({Capability.STRETCH})

    def __init__(self, time_step_scale: float = 1.0) -> None:
        self.scale = time_step_scale

    def settings(self, scenario: Scenario, *, n_elements: int, n_frames: int) -> dict[str, Any]:
        """The numerical choices of a run, as JSON values."""
        if scenario.quasi_static:
            return {"method": "Newton", "forces_left": LEFT}
        return {"method": "Verlet", "time_step": self._step(scenario, n_elements, n_frames)[0]}

    def run(self, scenario: Scenario, *, n_elements: int, n_frames: int) -> Trajectory:
        """Frames at even times; of an equilibrium the start, and the equilibrium from then on.

        Raises:
            NotImplementedError: a scenario that leaves the plane, or that holds a rod otherwise.
            Diverged: no equilibrium was found.
        """
        rod = planar(scenario)
        nodes = rod.nodes(n_elements)
        times = np.linspace(0.0, scenario.duration, n_frames)
        flat = nodes[:, [0, 2]] - nodes[0, [0, 2]]
        if scenario.quasi_static:
            rest = equilibrium(scenario, rod, flat)
            frames = np.stack([flat] + [rest] * (n_frames - 1))
        else:
            frames = self._motion(scenario, rod, flat, n_frames)
        positions = np.empty((n_frames, n_elements + 1, 3))
        positions[..., [0, 2]] = frames + nodes[0, [0, 2]]
        positions[..., 1] = nodes[0, 1]
        return Trajectory(times, (positions,), (directors(rod, positions),))

    def _step(self, scenario: Scenario, elements: int, frames: int) -> tuple[float, int]:
        """Time step [s], and how many of them make a frame."""
        interval = scenario.duration / (frames - 1)
        limit = SAFETY * self.scale * min(verlet_limit(rod, elements) for rod in scenario.rods)
        count = math.ceil(interval / limit)
        if interval < count * SHORT:
            count = math.ceil(interval / SHORT) * math.ceil(SHORT / limit)
        return interval / count, count

    def _motion(self, scenario: Scenario, rod: Rod, start: Array, frames: int) -> Array:
        """Positions (frames, nodes, 2) of the rod that is let go."""
        if rod.start is not EndCondition.PINNED or rod.end is not EndCondition.FREE or rod.loads:
            raise NotImplementedError("a motion that does not hang freely from a pin")
        dt, count = self._step(scenario, len(start) - 1, frames)
        machine = pendulum(scenario, rod, len(start), physics_dt=dt)
        machine.set_state(start)
        shown = [start]
        for _ in range(frames - 1):
            machine.step(n=count)
            shown.append(machine.positions)
        return np.stack(shown)


def planar(scenario: Scenario) -> Rod:
    """The scenario's rod, which stays in the plane of x and z.

    Raises:
        NotImplementedError: it leaves that plane, is one of several, touches or is moved.
    """
    rods = scenario.rods
    if len(rods) != 1 or scenario.obstacles or scenario.self_contact:
        raise NotImplementedError("contact, or more rods than one")
    (rod,) = rods
    across = [point[1] - rod.centerline[0][1] for point in rod.centerline]
    across += [load.force[1] for load in rod.loads] + [*scenario.gravity[:2]]
    if any(across) or scenario.gravity[2] > 0:
        raise NotImplementedError("a rod that leaves the plane of x and z")
    moved = rod.start_motion or rod.end_motion
    if moved or rod.start is EndCondition.FREE or rod.end is EndCondition.CLAMPED:
        raise NotImplementedError("a rod that is moved, free at its start or clamped at its end")
    if any(load.at.value == "start" for load in rod.loads):
        raise NotImplementedError("a force at the start")
    return rod


def pendulum(scenario: Scenario, rod: Rod, nodes: int, **more: Any) -> Pendulum:
    """The rod as `rodgym.sim` has it: of square section, with the same EA, EI and mass.

    A circle of radius r has I/A = r^2/4 and a square of side w has w^2/12: w = r sqrt(3). What the
    area is larger by, modulus and density are smaller by.
    """
    width = rod.radius * math.sqrt(3.0)
    part = rod.area / width**2
    return Pendulum(
        length=rod.length,
        width=width,
        youngs_modulus=rod.material.youngs_modulus * part,
        density=rod.material.density * part,
        gravity=-scenario.gravity[2],
        nodes=nodes,
        stepper="verlet",
        damping=0.0,
        bending_damping=0.0,
        **more,
    )


def verlet_limit(rod: Rod, elements: int) -> float:
    """Largest stable time step [s], by the fastest stretching and bending of the discrete rod."""
    edge, speed = (
        rod.length / elements,
        math.sqrt(rod.material.youngs_modulus / rod.material.density),
    )
    return min(edge / speed, edge**2 / (rod.radius * speed))


def equilibrium(scenario: Scenario, rod: Rod, start: Array) -> Array:
    """Positions (nodes, 2) at which every force vanishes.

    Newton's method on the accelerations and the stiffness that the core computes. As long as forces
    are large, steps are held back as by a strong friction. A clamp is a spring between its
    direction and the first edge, whose middle is half an edge away: 2 EI over the edge's length.
    """
    nodes = len(start)
    # No step is taken, but the machine wants one that would be stable.
    step = SHORT / math.ceil(SHORT / verlet_limit(rod, nodes - 1))
    machine = pendulum(scenario, rod, nodes, physics_dt=step)
    # The first node is held by the hinge; a pinned end is left out of what may move.
    free = slice(0, 2 * (nodes - 1) - (2 if rod.end is EndCondition.PINNED else 0))
    edge = rod.length / (nodes - 1)
    modulus = rod.material.youngs_modulus
    spring = 2.0 * modulus * rod.second_moment_of_area / edge
    spring *= rod.start is EndCondition.CLAMPED
    tip_mass = 0.5 * rod.material.density * rod.area * edge
    pushed = np.zeros(2 * (nodes - 1))
    for load in rod.loads:
        pushed[-2:] += np.array(load.force)[[0, 2]] / tip_mass
    machine.set_state(start)
    clamp, x = machine.angles[0], start.copy()
    # The acceleration of the last node when the last edge is stretched to twice its length.
    scale = modulus * rod.area / tip_mass
    half, first = 2 * (nodes - 1), 0.0
    for _ in range(ROUNDS):
        machine.set_state(x)
        torque = spring * math.remainder(clamp - machine.angles[0], math.tau)
        linear = machine.linearize(torque)
        by_torque = linear.B[half:, 0]
        pull = machine.get_vector()[2 * half : 3 * half] + by_torque * torque + pushed
        stiffness = linear.A[half:, :half] - spring * np.outer(by_torque, linear.C[0, :half])
        left = float(np.abs(pull[free]).max())
        if left < LEFT * scale:
            return x
        first = first or left
        friction = left / edge * min(1.0, left / first)
        matrix = friction * np.eye(half)[free, free] - stiffness[free, free]
        move = np.zeros(half)
        move[free] = np.linalg.solve(matrix, pull[free])
        # A turn of an edge by a radian is the most that a linear step is good for.
        move *= min(1.0, 0.5 * edge / np.abs(move).max())
        x[1:] += move.reshape(-1, 2)
    raise Diverged(f"no equilibrium after {ROUNDS} rounds")


def directors(rod: Rod, positions: Array) -> Array:
    """Material directions (frames, elements, 3): they turn with their elements, in the plane."""
    tangents = np.diff(positions, axis=1)
    tangents /= np.linalg.norm(tangents, axis=-1, keepdims=True)
    beside = np.stack([-tangents[..., 2], np.zeros(tangents.shape[:-1]), tangents[..., 0]], axis=-1)
    start = rod.directors(positions.shape[1] - 1)
    turned = (start * beside[0]).sum(axis=-1, keepdims=True) * beside
    turned[..., 1] += start[:, 1]
    return turned
