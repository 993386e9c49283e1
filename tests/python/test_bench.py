"""Promise: `rodgym bench` measures what it says, and its arithmetic is right."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from rodgym.bench import mujoco_models, ours, report
from rodgym.bench.measure import Case, Timing, measure, ratio
from rodgym.bench.precision import distance, rodgym_tip


def timing(name, cpu, alone=True, wall=None):
    cpu = np.array(cpu, dtype=float)
    return Timing(name, cpu if wall is None else np.array(wall), cpu, alone)


def test_ratios_are_paired_round_by_round():
    # A machine that grows three times slower within the run: the ratio does not see it.
    load = np.array([1.0, 2.0, 3.0, 1.5])
    found = ratio(timing("slow", 8e-6 * load), timing("fast", 2e-6 * load))
    assert (found.low, found.median, found.high) == pytest.approx((4.0, 4.0, 4.0))


def test_work_in_several_threads_is_compared_by_wall_clock():
    one = timing("one", [1e-6] * 3, wall=[3e-6] * 3)
    two = timing("two", [1.1e-6] * 3, alone=False, wall=[1.5e-6] * 3)
    assert ratio(one, two).median == pytest.approx(2.0)
    assert two.rate == pytest.approx(1 / 1.5e-6)


def test_batch_layer_is_what_does_not_grow_with_the_physics():
    physics, layer = np.array([1.0, 1.2]), np.array([0.1, 0.3])
    share = ours.layer_share(physics + layer, physics * (ours.LONG / ours.SHORT) + layer)
    assert share == pytest.approx(layer / physics)


def test_every_case_runs_in_every_round_and_steps_are_counted():
    calls = {"a": [], "b": []}
    cases = [Case(name, 5, calls[name].append) for name in calls]
    found = measure(cases, rounds=4, seconds=1e-4)
    assert [t.name for t in found] == ["a", "b"]
    for t in found:
        measured = calls[t.name][-4:]
        assert len(set(measured)) == 1 and t.wall.shape == (4,) and (t.wall > 0).all()


def test_a_batch_case_takes_the_steps_that_it_counts():
    case = ours.batch("batch", ours.SWING_UP, 3, max_episode_steps=4)
    assert case.steps == 3 and case.alone
    case.run(9)


def test_tables_and_targets(tmp_path):
    assert report.number(1_043_211) == "1 040 000" and report.number(24.812) == "24.8"
    met, missed = report.at_least("rate", 71.0, 70.0), report.at_most("share", 16.0, 15.0, " %")
    text = report.targets_table([met, missed])
    assert "| rate | >= 70 | 71 | yes |" in text and "| share | <= 15 % | 16 % | **no** |" in text


def test_verlet_is_of_second_order_in_the_precision_plot():
    truth = rodgym_tip("verlet", 1e-5)
    coarse, fine = (distance(rodgym_tip("verlet", dt), truth) for dt in (4e-4, 2e-4))
    assert 3.5 < coarse / fine < 4.6


def test_a_whole_bench_writes_its_files(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    from rodgym.bench import facts, session
    from rodgym.runs import Run

    # The plant alone is timed here; a training and other interpreters take long.
    monkeypatch.setattr(session, "installed", lambda module: False)
    monkeypatch.setattr(facts, "instruction_sets", lambda rounds: {"baseline": 1.0})
    extent = session.Extent(2, 1e-3, (1, 8), (1, 2), 1, 1)
    page = session.bench(Run("tiny", tmp_path), extent)
    folder = tmp_path / "tiny"
    assert (folder / "bench.md").read_text() == page
    assert (folder / "work_precision.png").stat().st_size > 10_000
    rows = list(csv.DictReader((folder / "throughput.csv").read_text().splitlines()))
    # Two sizes with one and two threads, and the single environment.
    assert len(rows) == 5 * len(ours.machines())
    assert all(float(row["wall_us"]) > 0 for row in rows)
    assert "make_vec of 8192 environments" in page


def test_mujoco_models_have_the_parameters_of_the_table():
    mujoco = pytest.importorskip("mujoco")
    for xml in (mujoco_models.chain("RK4", 1e-3), mujoco_models.flex("Euler", 1e-4)):
        model = mujoco.MjModel.from_xml_string(xml)
        # Mass of the rod without the half node at the hinge, which does not move.
        assert model.body_mass.sum() == pytest.approx(1500 * 0.007**2 * 0.3 * 5.5 / 6)
