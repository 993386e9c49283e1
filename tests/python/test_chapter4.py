"""`rodgym reproduce chapter4` finds what an independent program found, and leaves every figure."""

import csv

import pytest

pytest.importorskip("matplotlib")

from rodgym.reproduction.chapter4 import FIGURES, reproduce
from rodgym.runs import Run


@pytest.fixture(scope="module")
def chapter4(tmp_path_factory):
    run = Run("chapter4", tmp_path_factory.mktemp("runs"))
    findings = reproduce(run, lambda text: None)
    return run.path, {finding.where: finding.result for finding in findings}


def rows(path):
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_every_figure_has_a_table_and_a_picture(chapter4):
    folder, findings = chapter4
    assert findings.keys() == FIGURES.keys()
    tables = {path.stem for path in folder.glob("*.csv")} - {"findings"}
    pictures = {path.stem for path in folder.glob("*.png")}
    assert tables == pictures and len(tables) == 7
    assert (folder / "report.html").stat().st_size > 100_000
    assert all((folder / f"{name}.png").stat().st_size > 10_000 for name in pictures)


def test_the_free_swing_loses_the_energy_of_backward_euler(chapter4):
    folder, findings = chapter4
    table = rows(folder / "fig4_2.csv")
    lost = float(table[0]["total"]) - float(table[-1]["total"])
    assert lost == pytest.approx(3.67e-4, rel=0.01)
    assert "0.367 mJ" in findings["Fig. 4.2"]


def test_state_feedback_switches_and_stands_as_found(chapter4):
    folder, findings = chapter4
    assert "0.638 s" in findings["Fig. 4.3"] and "stands" in findings["Fig. 4.3"]
    seven, between, nine, others = findings["Fig. 4.4"].split("; ")
    assert others == "of other widths 7.5, 8.5, 10 mm stand and 4, 5, 5.5, 6, 6.5 mm do not"
    assert "7 mm stands" in seven and "8.1 mm is lost" in between and "9 mm stands" in nine
    last = [row for row in rows(folder / "fig4_4.csv") if row["width"] == "0.007"][-1]
    assert float(last["time"]) == pytest.approx(3.0) and float(last["angle_error"]) < 1e-6


def test_the_linear_observer_does_not_catch_the_rod(chapter4):
    _, findings = chapter4
    assert findings["Fig. 4.5"].count("the observer is on for") == 2
    assert "the rod stands" not in findings["Fig. 4.5"] + findings["Fig. 4.6"]


def test_soft_rods_are_out_of_reach(chapter4):
    folder, _ = chapter4
    table = rows(folder / "controllability.csv")
    # Only the ratio of width to buckling width matters, whatever made it.
    near = sorted(table, key=lambda row: abs(float(row["width/buckling_width"]) - 1.0))[:6]
    assert {row["rank"] for row in near} == {"12"}
    soft = [row for row in table if float(row["width/buckling_width"]) < 0.3]
    assert soft and all(int(row["rank"]) < 12 for row in soft)
