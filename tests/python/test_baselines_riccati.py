"""The Riccati solvers give scipy's and python-control's answers, and refuse what has none."""

import control
import numpy as np
import pytest
import rodgym.baselines
import scipy.linalg
from rodgym.baselines import care, dare
from rodgym.errors import DesignError, ParameterError, ShapeError


def random_system(seed, size=1.0):
    rng = np.random.default_rng(seed)
    n, m = rng.integers(1, 13), rng.integers(1, 4)
    root = rng.normal(size=(n + m, n + m))
    joint = root @ root.T + 0.1 * np.eye(n + m)
    a = size * rng.normal(size=(n, n)) / np.sqrt(n)
    return a, rng.normal(size=(n, m)), joint[:n, :n], joint[n:, n:], joint[:n, n:]


def tolerance(p):
    # The solution of a hardly controllable pair is large, and known to as many digits less.
    return 1e-9 * np.linalg.norm(p) * max(1.0, np.linalg.norm(p) * 1e-4)


@pytest.mark.parametrize("seed", range(60))
def test_dare_is_scipys(seed):
    a, b, q, r, n = random_system(seed, size=0.1 + 0.04 * seed)
    expected = scipy.linalg.solve_discrete_are(a, b, q, r, s=n)
    p, k = dare(a, b, q, r, n)
    assert np.linalg.norm(p - expected) < tolerance(expected)
    assert np.max(np.abs(np.linalg.eigvals(a - b @ k))) < 1


@pytest.mark.parametrize("seed", range(60))
def test_care_is_scipys(seed):
    a, b, q, r, n = random_system(1000 + seed, size=0.1 + 0.5 * seed)
    expected = scipy.linalg.solve_continuous_are(a, b, q, r, s=n)
    p, k = care(a, b, q, r, n)
    assert np.linalg.norm(p - expected) < tolerance(expected)
    assert np.max(np.linalg.eigvals(a - b @ k).real) < 0


@pytest.mark.parametrize("seed", range(10))
def test_gains_are_those_of_python_control(seed):
    a, b, q, r, n = random_system(2000 + seed)
    assert np.allclose(care(a, b, q, r, n)[1], control.lqr(a, b, q, r, n)[0], rtol=1e-6, atol=1e-8)
    assert np.allclose(dare(a, b, q, r, n)[1], control.dlqr(a, b, q, r, n)[0], rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("spread", [1e2, 1e4, 1e6])
def test_modes_far_apart_and_cheap_control(spread):
    """Poles and weights orders of magnitude apart, as flexible rods have them."""
    a = np.diag([0.5, -1.0, -spread, 0.1 * spread])
    a[0, 2] = a[3, 1] = 1.0
    b = np.array([[1.0], [0.3], [spread], [1.0]])
    q, r = np.diag([1.0, spread, 1e-3, 1.0]), np.array([[1.0 / spread]])
    p, k = care(a, b, q, r)
    expected = scipy.linalg.solve_continuous_are(a, b, q, r)

    # Scipy's own residual grows with the spread: compare what both leave of the equation.
    def residual(x):
        return np.linalg.norm(a.T @ x + x @ a - x @ b @ (b.T @ x) / r + q)

    assert residual(p) < 10 * residual(expected) + 1e-9 * np.linalg.norm(p)
    assert np.max(np.linalg.eigvals(a - b @ k).real) < 0


def test_what_has_no_solution_is_refused():
    identity = np.eye(2)
    out_of_reach = np.array([[0.0], [0.0]])
    with pytest.raises(DesignError, match="no stabilising solution"):
        dare(1.2 * identity, out_of_reach, identity, np.eye(1))
    with pytest.raises(DesignError, match="no stabilising solution"):
        care(identity, out_of_reach, identity, np.eye(1))
    with pytest.raises(ShapeError, match="Q has shape"):
        care(identity, out_of_reach, np.eye(3), np.eye(1))
    with pytest.raises(ParameterError, match="positive definite"):
        dare(identity, out_of_reach, identity, -np.eye(1))


def badly_scaled(seed):
    """States in units up to six powers of ten apart, poles up to 100, weights up to 1e8 apart."""
    rng = np.random.default_rng(seed)
    n, m = rng.integers(2, 13), rng.integers(1, 4)
    unit = 10.0 ** rng.uniform(-3, 3, n)
    a = rng.normal(size=(n, n)) * 10 ** rng.uniform(-1, 2) / np.sqrt(n)
    q = np.diag(10.0 ** rng.uniform(-3, 3, n) / unit**2)
    r = np.eye(m) * 10.0 ** rng.uniform(-4, 4)
    return a * unit[:, None] / unit, rng.normal(size=(n, m)) * unit[:, None], q, r, unit


def far_apart(seed):
    """States and inputs in units up to twelve powers of ten apart, a cost of few of them."""
    rng = np.random.default_rng(seed)
    n, m = rng.integers(1, 9), rng.integers(1, 4)
    unit = 10.0 ** rng.uniform(-6, 6, n)
    seen = rng.normal(size=(rng.integers(1, n + 1), n)) / unit
    a = rng.normal(size=(n, n)) * unit[:, None] / unit
    q = seen.T @ seen * 10 ** rng.uniform(-6, 6)
    return a, rng.normal(size=(n, m)) * unit[:, None], q, np.diag(10 ** rng.uniform(-6, 6, m)), unit


@pytest.mark.parametrize("system", [badly_scaled, far_apart])
def test_badly_scaled_systems_are_solved_or_refused_as_inaccurate(system):
    """All of them have a solution, which nobody denies; a few are refused for want of digits."""
    refused = 0
    for seed in range(300):
        a, b, q, r, unit = system(seed)
        expected = scipy.linalg.solve_continuous_are(a, b, q, r)
        try:
            _, k = care(a, b, q, r)
        except DesignError as error:
            refused += 1
            assert "continuous Riccati equation cannot be solved accurately" in str(error)
            continue
        assert np.max(np.linalg.eigvals((a - b @ k) / unit[:, None] * unit).real) < 0
        gain = np.linalg.solve(r, b.T @ expected)
        assert np.linalg.norm((k - gain) * unit) < 1e-3 * np.linalg.norm(gain * unit)
    assert refused <= 9


def test_units_of_the_states_change_nothing_but_the_units():
    """Powers of two are exact; balancing leaves what rounding makes of another order of sums."""
    for seed in range(20):
        a, b, q, r, _ = random_system(3000 + seed)
        p, k = care(a, b, q, r)
        unit = 2.0 ** np.random.default_rng(seed).integers(-30, 30, len(a))
        scaled = care(a * unit[:, None] / unit, b * unit[:, None], q / np.outer(unit, unit), r)
        assert np.allclose(scaled[0] * np.outer(unit, unit), p, rtol=1e-9, atol=1e-12 * p.max())
        assert np.allclose(scaled[1] * unit, k, rtol=1e-9, atol=1e-12 * np.abs(k).max())


# Thinner and finer ones (5 mm with 10 nodes) are refused: the residual stays above 1e-7.
@pytest.mark.parametrize("width", [0.006, 0.007, 0.009, 0.012])
@pytest.mark.parametrize("nodes", [5, 7, 10])
def test_rods_are_solved_as_scipy_solves_them(width, nodes):
    """The thesis' own cheap-control problem: closed-loop poles from 1 to 15000 1/s."""
    a, b, c = rodgym.baselines.upright({"width": width, "nodes": nodes, "bending_damping": 0.0})
    n = nodes - 1
    q, r = np.diag([100.0] * n + [0.01] * n), np.eye(1)
    k = care(a, b, q, r)[1]
    expected = (b.T @ scipy.linalg.solve_continuous_are(a, b, q, r)) / r
    assert np.allclose(k, expected, rtol=1e-3, atol=1e-4 * np.abs(expected).max())
    assert np.max(np.linalg.eigvals(a - b @ k).real) < 0
    # The observer's equation is the regulator's of the transposed system.
    observer = care(a.T, c.T, 1e-3 * b @ b.T, np.eye(2))[1].T
    wanted = scipy.linalg.solve_continuous_are(a.T, c.T, 1e-3 * b @ b.T, np.eye(2)) @ c.T
    assert np.allclose(observer, wanted, rtol=1e-3, atol=1e-4 * np.abs(wanted).max())
