"""The pendulum of Table 4.1 (w = 7 mm) in MuJoCo, for comparisons and cross-checks.

Both start horizontal along +x at rest; z is up.

* `chain`: six inextensible links, linear hinge springs k = EI/l, a motor at the base. Its
  energy is not quite ours: springs are linear in the angle, edges do not stretch.
* `flex`: MuJoCo's one-dimensional flex, a discrete elastic rod with the energies of ours.
  No motor. Integrator "Euler" is the symplectic one.
"""

from __future__ import annotations

import math

EDGES = 6
#: Edge length [m], node masses after the hinge [kg], EI/l [N m/rad], EA/l [N/m].
EDGE = 0.05
MASSES = [1500.0 * 0.007**2 * EDGE * (0.5 if i == EDGES - 1 else 1.0) for i in range(EDGES)]
#: Bending stiffness E w^4/12 [N m^2].
BENDING = 1e7 * 0.007**4 / 12.0
BEND = BENDING / EDGE
STRETCH = 1e7 * 0.007**2 / EDGE


def document(integrator: str, dt: float, body: str) -> str:
    """A model without contacts and constraints, in SI units."""
    return (
        '<mujoco><compiler angle="radian" inertiafromgeom="false" boundmass="0" boundinertia="0"/>'
        f'<option timestep="{dt:.10g}" integrator="{integrator}" gravity="0 0 -9.81">'
        '<flag contact="disable" constraint="disable"/></option>'
        f"{body}</mujoco>"
    )


def inertial(place: float, mass: float) -> str:
    """A point mass on the x axis."""
    small = "1e-12 1e-12 1e-12"
    return f'<inertial pos="{place:.10g} 0 0" mass="{mass:.10g}" diaginertia="{small}"/>'


def chain(integrator: str, dt: float) -> str:
    """Six hinges, a point mass at the far end of each link, a motor on the first hinge."""
    bodies = ""
    for i, mass in enumerate(MASSES):
        bodies += (
            f'<body name="b{i}" pos="{EDGE if i else 0} 0 0">'
            f'<joint name="j{i}" type="hinge" axis="0 -1 0" stiffness="{BEND if i else 0:.10g}"/>'
            + inertial(EDGE, mass)
        )
    bodies += f'<site name="tip" pos="{EDGE} 0 0" size="0.001"/>' + "</body>" * EDGES
    motor = '<actuator><motor joint="j0"/></actuator>'
    return document(integrator, dt, f"<worldbody>{bodies}</worldbody>{motor}")


def flex(integrator: str, dt: float) -> str:
    """A flex whose first vertex is the world's origin; the others slide in x and z."""
    radius = 0.0035
    youngs_modulus = BENDING / (math.pi * radius**4 / 4.0)
    bodies = ""
    for i, mass in enumerate(MASSES, start=1):
        bodies += (
            f'<body name="n{i}" pos="{EDGE * i:.10g} 0 0">'
            f'<joint name="x{i}" type="slide" axis="1 0 0"/>'
            f'<joint name="z{i}" type="slide" axis="0 0 1"/>' + inertial(0.0, mass) + "</body>"
        )
    names = " ".join(f"n{i}" for i in range(1, EDGES + 1))
    vertices = " ".join(["0 0 0"] * (EDGES + 1))
    elements = " ".join(f"{i} {i + 1}" for i in range(EDGES))
    rod = (
        f'<deformable><flex name="rod" dim="1" radius="{radius}" body="world {names}" '
        f'vertex="{vertices}" element="{elements}"><edge stiffness="{STRETCH:.10g}"/>'
        f'<elasticity young="{youngs_modulus:.10g}" section="circle"/></flex></deformable>'
    )
    return document(integrator, dt, f"<worldbody>{bodies}</worldbody>{rod}")
