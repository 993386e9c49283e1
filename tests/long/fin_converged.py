"""The soft fin without tail flux to convergence: writes tests/data/fin/morison_soft.csv.

The flexible grid of the reference extrapolates a first-order stepper from 400 and 800 steps a
period. Where the soft fin is near its resonance and nothing is shed at the tail, that is not yet
the limit. Here the same equations (docs/physics.md) are written down once more, from the energies
alone: all forces are complex-step derivatives, accelerations come from a dense mass matrix, and the
integrator is explicit, of order eight, with its own error control. Nothing of rodgym is used.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

N, EDGE, HEIGHT, PIVOT = 8, 0.020, 0.115, 2
WIDTH = 1e-3 * np.array([0, 18.5, 18.5, 16.8, 13.4, 9.9, 3.6, 0])
AREA = 1e-6 * np.array([0, 2133, 2133, 1933, 1544, 1144, 414, 0])
DENSITY, WATER, FLOW, ZETA = 1100.0, 1000.0, 0.05, 0.1238
ADDED = 0.5 * WATER * np.pi * HEIGHT**2 / 4
FRICTION, DRAG = 0.016, 1.2
YOUNG = 2.5e5

EDGE_AREA = (AREA[1:] + AREA[:-1]) / 2
MASS = np.zeros(N)
MASS[:-1] += DENSITY * EDGE_AREA * EDGE / 2
MASS[1:] += DENSITY * EDGE_AREA * EDGE / 2
MOMENT = HEIGHT * WIDTH**3 / 12
PERIMETER = 2 * (HEIGHT + (WIDTH[1:] + WIDTH[:-1]) / 2)
FREE = [i for i in range(2 * N) if i // 2 not in (PIVOT, PIVOT + 1)]
TINY = 1e-30
#: Three points of an edge and their weights.
GAUSS = ((0.5, 8 / 18), (0.5 - 0.5 * 0.6**0.5, 5 / 18), (0.5 + 0.5 * 0.6**0.5, 5 / 18))
PAGE = Path(__file__).parents[1] / "data" / "fin" / "morison_soft.csv"


def edges(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lengths (..., 7) and tangents (..., 7, 2); holds for complex coordinates too."""
    e = q[..., 1:, :] - q[..., :-1, :]
    length = np.sqrt((e * e).sum(-1))
    return length, e / length[..., None]


def normal(t: np.ndarray) -> np.ndarray:
    return np.stack([-t[..., 1], t[..., 0]], axis=-1)


def elastic_energy(q: np.ndarray) -> np.ndarray:
    length, t = edges(q)
    stretch = 0.5 * YOUNG * EDGE_AREA * EDGE * (length / EDGE - 1) ** 2
    before, after = t[..., :-1, :], t[..., 1:, :]
    sine = before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]
    curvature = 2 * sine / (1 + (before * after).sum(-1))
    bend = 0.5 * YOUNG * MOMENT[1:-1] / EDGE * curvature**2
    return stretch.sum(-1) + bend.sum(-1)


def water_energy(q: np.ndarray, relative: np.ndarray) -> np.ndarray:
    length, t = edges(q)
    n = normal(t)
    a, b = (n * relative[..., :-1, :]).sum(-1), (n * relative[..., 1:, :]).sum(-1)
    return (ADDED * length * (a * a + a * b + b * b) / 6).sum(-1)


def water_momentum(q: np.ndarray, relative: np.ndarray) -> np.ndarray:
    """dT_f/dV, one (x, y) a node; T_f is quadratic in V, so this is exact."""
    length, t = edges(q)
    n = normal(t)
    a, b = (n * relative[..., :-1, :]).sum(-1), (n * relative[..., 1:, :]).sum(-1)
    p = np.zeros(np.broadcast(q, relative).shape, np.result_type(q, relative))
    p[..., :-1, :] += (ADDED * length * (2 * a + b) / 6)[..., None] * n
    p[..., 1:, :] += (ADDED * length * (a + 2 * b) / 6)[..., None] * n
    return p


def gradient(energy, q: np.ndarray, *rest: np.ndarray) -> np.ndarray:
    shifted = q + 1j * TINY * np.eye(2 * N).reshape(2 * N, N, 2)
    return energy(shifted, *rest).imag.reshape(N, 2) / TINY


def resistance(q: np.ndarray, relative: np.ndarray) -> np.ndarray:
    length, t = edges(q)
    n = normal(t)
    force = np.zeros((N, 2))
    for s, weight in GAUSS:
        v = (1 - s) * relative[:-1] + s * relative[1:]
        u, w = (t * v).sum(-1), (n * v).sum(-1)
        across = DRAG * HEIGHT * w * np.abs(w)
        along = FRICTION * PERIMETER * u * np.abs(u)
        f = -0.5 * WATER * (across[:, None] * n + along[:, None] * t) * (weight * length)[:, None]
        force[:-1] += (1 - s) * f
        force[1:] += s * f
    return force


def pitch(t: float, amplitude: float, frequency: float) -> tuple[float, float, float]:
    """Pitch, rate and acceleration: a sine behind the ramp x^3 (10 - 15 x + 6 x^2)."""
    x, dx = min(t * frequency, 1.0), frequency if t * frequency < 1 else 0.0
    r = (x**3 * (10 - 15 * x + 6 * x * x), 30 * x * x * (1 - x) ** 2 * dx)
    r2 = 60 * x * (1 - x) * (1 - 2 * x) * dx * dx
    w = 2 * np.pi * frequency
    s, c = np.sin(w * t), w * np.cos(w * t)
    parts = r[0] * s, r[1] * s + r[0] * c, r2 * s + 2 * r[1] * c - r[0] * w * w * s
    return tuple(amplitude * part for part in parts)


def motion(t: float, y: np.ndarray, drive: tuple[float, float]):
    """Positions and velocities of all nodes, and the driven node's acceleration."""
    th, rate, acceleration = pitch(t, *drive)
    q, v, a = np.zeros((N, 2)), np.zeros((N, 2)), np.zeros(2 * N)
    along, across = np.array([np.cos(th), np.sin(th)]), np.array([-np.sin(th), np.cos(th)])
    q[PIVOT + 1], v[PIVOT + 1] = EDGE * along, EDGE * rate * across
    a[2 * PIVOT + 2 : 2 * PIVOT + 4] = EDGE * (acceleration * across - rate * rate * along)
    q.flat[FREE], v.flat[FREE] = y[:12], y[12:24]
    return q, v, a


def derivative(t: float, y: np.ndarray, drive: tuple[float, float]) -> np.ndarray:
    """Of free coordinates, velocities, work of the drive and impulse of the resistive thrust."""
    q, v, a = motion(t, y, drive)
    relative = v - [FLOW, 0]
    water = resistance(q, relative)
    # d p_f/dt = M_a(q) dV/dt + what turning and stretching edges do to p_f at the same V.
    turning = water_momentum(q + 1j * TINY * v, relative).imag / TINY
    known = water - gradient(elastic_energy, q) + gradient(water_energy, q, relative)
    known = (known - ZETA * v - turning).ravel()
    unit = np.eye(2 * N).reshape(2 * N, N, 2)
    mass = water_momentum(q, unit).reshape(2 * N, 2 * N) + np.diag(np.repeat(MASS, 2))
    right = known - mass @ a
    a[FREE] = np.linalg.solve(mass[np.ix_(FREE, FREE)], right[FREE])
    drive_force = (mass @ a - known).reshape(N, 2)
    power = drive_force[PIVOT + 1] @ v[PIVOT + 1]
    return np.concatenate([v.flat[FREE], a[FREE], [power, -water[:, 0].sum()]])


def fifth_cycle(degrees: float, frequency: float, tolerance: float) -> tuple[float, float]:
    """Mean thrust [N] and power [W] of the fifth period."""
    drive = (np.radians(degrees), frequency)
    start = np.zeros((N, 2))
    start[:, 0] = EDGE * (np.arange(N) - PIVOT)
    y = np.concatenate([start.flat[FREE], np.zeros(14)])
    ends = [4 / frequency, 5 / frequency]
    # From rest the first guess of a step would be far too large.
    limits = {"rtol": tolerance, "atol": tolerance, "first_step": 1e-5, "max_step": 1e-3}
    found = solve_ivp(derivative, (0, ends[1]), y, "DOP853", ends, args=(drive,), **limits)
    (work, push), lent = (found.y[24:, 1] - found.y[24:, 0]), []
    for t, y in zip(found.t, found.y.T, strict=True):
        q, v, _ = motion(t, y, drive)
        lent.append(water_momentum(q, v - [FLOW, 0])[:, 0].sum())
    return (push + lent[1] - lent[0]) * frequency, work * frequency


def main() -> None:
    lines = [
        "# provenance: tests/long/fin_converged.py, DOP853 at tolerance 1e-9, nothing of rodgym",
        "# morison water, E = 250 kPa, damping 0.1238 kg/s; 5th cycle after a 1-cycle ramp",
        "A_deg,f_Hz,T_mean_N,P_in_W",
    ]
    for degrees in (4, 6, 8, 10):
        for frequency in (1.5, 2.0):
            thrust, power = fifth_cycle(degrees, frequency, 1e-9)
            lines.append(f"{degrees},{frequency:g},{thrust:.7g},{power:.7g}")
            print(lines[-1], flush=True)
    PAGE.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
