"""Promise: an independent simulator with the same energies visits the same positions.

MuJoCo's one-dimensional flex is a discrete elastic rod. Its integrator "Euler" is symplectic:
velocities first, v += dt a(x), then x += dt v. Velocity Verlet without damping, seen at half steps,
is the same with the velocity half a step behind: started at v0 - dt/2 a0 both visit the same
positions, to rounding.
"""

from __future__ import annotations

import numpy as np
import pytest
from rodgym.bench import mujoco_models
from rodgym.sim import Pendulum

mujoco = pytest.importorskip("mujoco", minversion="4")

DT = 1e-4


def edge_angles(positions: np.ndarray) -> np.ndarray:
    """Angles of the edges from hanging, (nodes - 1,)."""
    edges = np.diff(positions, axis=0)
    return np.arctan2(edges[:, 0], -edges[:, 1])


def test_flex_rod_and_ours_visit_the_same_positions_for_a_second():
    model = mujoco.MjModel.from_xml_string(mujoco_models.flex("Euler", DT))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    data.qvel -= 0.5 * DT * data.qacc
    ours = Pendulum(stepper="verlet", physics_dt=DT, bending_damping=0.0)
    ours.set_angles([np.pi / 2] * 6)
    furthest = 0.0
    for _ in range(100):
        mujoco.mj_step(model, data, 100)
        ours.step(0.0, n=100)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_flex(model, data)
        theirs = edge_angles(data.flexvert_xpos[:, [0, 2]])
        difference = np.angle(np.exp(1j * (theirs - edge_angles(ours.positions))))
        assert np.abs(difference).max() < 1e-9, f"at {ours.time:g} s"
        furthest = max(furthest, np.abs(theirs - np.pi / 2).max())
    assert ours.time == pytest.approx(1.0)
    assert furthest > 1.0, "the rod has swung"
