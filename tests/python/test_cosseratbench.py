"""Promise: rodgym is a solver of cosseratbench, right in its planar cases, frank about the others.

The errors are cosseratbench's own. Each bound is what theory leaves: a discrete rod's error falls
with the square of the number of its elements.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from rodgym.sim import Pendulum

tomllib = pytest.importorskip("tomllib")
pytest.importorskip("cosseratbench", reason="needs cosseratbench: extra dev")

from cosseratbench import registry  # noqa: E402
from cosseratbench.experiment import run  # noqa: E402
from rodgym.bench.cosserat import RodgymSolver, equilibrium, pendulum  # noqa: E402

ROOT = Path(__file__).parents[2]


def result(name: str, factor: int = 1, scale: float = 1.0, **values: float):
    experiment = registry.load_experiment(name)
    elements = factor * experiment.n_elements
    return run(experiment, RodgymSolver(scale), values=values, n_elements=elements)


def test_cosseratbench_finds_the_solver_by_its_entry_point():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (module, name) = project["entry-points"][registry.SOLVERS]["rodgym"].split(":")
    assert (RodgymSolver.__module__, RodgymSolver.__qualname__) == (module, name)


@pytest.mark.parametrize(
    ("name", "values", "metric", "bound"),
    [
        ("cantilever", {}, "tip_deflection_error", 1e-3),
        ("catenary", {}, "shape_error", 5e-4),
        ("catenary", {"youngs_modulus": 1e5}, "shape_error", 1e-4),
        ("pendulum", {}, "period_error", 2e-4),
        ("pendulum", {"youngs_modulus": 1e6}, "period_error", 2e-4),
    ],
)
def test_a_planar_case_ends_where_the_reference_is(name, values, metric, bound):
    found = result(name, **values)
    assert found.outcome == "completed", found.failure
    assert found.metrics[metric] < bound
    assert found.metrics.get("settling_residual", 0.0) == 0.0


def test_the_period_is_of_second_order_in_the_elements_and_the_swing_keeps_its_size():
    coarse, fine = (result("pendulum", factor).metrics for factor in (1, 2))
    # The reference is linear, and off by this much for a swing of 2 cm.
    linear = 0.051 * 0.02**2
    ratio = (coarse["period_error"] - linear) / (fine["period_error"] - linear)
    assert 3.5 < ratio < 4.5
    assert abs(coarse["amplitude_change"]) < 5e-5


def test_a_longer_step_is_taken_where_it_is_asked_for():
    usual, long = (result("pendulum", scale=scale) for scale in (1.0, 2.0))
    assert long.settings["time_step"] > 1.5 * usual.settings["time_step"]
    assert long.metrics["period_error"] != usual.metrics["period_error"]


def test_what_leaves_the_plane_or_touches_is_unsupported_by_name():
    for name in ("twist", "capstan", "crossing", "pile"):
        found = result(name)
        assert found.outcome == "unsupported" and all(found.missing), name


def test_the_square_rod_is_as_stiff_and_heavy_as_the_round_one():
    scenario = registry.load_experiment("cantilever").scenario
    (rod,) = scenario.rods
    machine: Pendulum = pendulum(scenario, rod, 21, physics_dt=1e-4)
    side, modulus, density = (
        machine.parameters[key] for key in ("width", "youngs_modulus", "density")
    )
    assert modulus * side**2 == pytest.approx(rod.material.youngs_modulus * rod.area)
    bending = rod.material.youngs_modulus * rod.second_moment_of_area
    assert modulus * side**4 / 12 == pytest.approx(bending)
    assert density * side**2 == pytest.approx(rod.material.density * rod.area)


def test_at_the_equilibrium_the_rod_of_the_core_stays():
    scenario = registry.load_experiment("catenary").scenario
    (rod,) = scenario.rods
    flat = rod.nodes(50)[:, [0, 2]]
    rest = equilibrium(scenario, rod, flat - flat[0])
    assert np.array_equal(rest[-1], flat[-1] - flat[0]), "a pinned end was moved"
    machine = pendulum(scenario, rod, 51, physics_dt=1e-5)
    machine.set_state(rest)
    pull = machine.get_vector()[200:300].reshape(-1, 2)[:-1]
    assert np.abs(pull).max() < 1e-6 * 9.81


def test_the_page_has_the_numbers_that_come_out_today():
    page = (ROOT / "docs" / "performance" / "cosseratbench.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| as it is \| [^|]+ \| ([^|]+) \| ([^|]+) \|", page, re.MULTILINE)
    metrics = ("tip_deflection_error", "shape_error", "period_error")
    assert len(rows) == len(metrics)
    for name, metric, row in zip(
        ("cantilever", "catenary", "pendulum"), metrics, rows, strict=True
    ):
        for factor, said in zip((1, 4), row, strict=True):
            assert result(name, factor).metrics[metric] == pytest.approx(float(said), rel=0.06)
