"""`rodgym reproduce chapter3` finds what an independent program found, and leaves every figure."""

import csv
from pathlib import Path

import pytest

pytest.importorskip("matplotlib")

from rodgym.reproduction.chapter3 import FINS, reproduce
from rodgym.runs import Run

DATA = Path(__file__).parents[1] / "data" / "fin"


def rows(path):
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


@pytest.fixture(scope="module")
def chapter3(tmp_path_factory):
    run = Run("chapter3", tmp_path_factory.mktemp("runs"))
    findings = reproduce(run, lambda text: None)
    return run.path, findings


def test_every_figure_has_a_table_and_a_picture(chapter3):
    folder, findings = chapter3
    tables = {path.stem for path in folder.glob("*.csv")} - {"findings", "fit", "fit_errors"}
    pictures = {path.stem for path in folder.glob("*.png")}
    assert tables == pictures == {Path(finding.picture).stem for finding in findings}
    assert all(finding.verdict.startswith(("agrees", "partly", "differs")) for finding in findings)
    assert (folder / "report.html").stat().st_size > 100_000


def test_grids_are_those_of_the_independent_program(chapter3):
    found = {
        (row["fin"], float(row["A_deg"]), float(row["f_Hz"])): row
        for row in rows(chapter3[0] / "thrust.csv")
    }
    for row in rows(DATA / "rigid_grid.csv"):
        ours = found["rigid", float(row["A_deg"]), float(row["f_Hz"])]
        thrust = float(row["T_mean_N"])
        assert float(ours["thrust_N"]) == pytest.approx(thrust, rel=1e-3, abs=1e-6)
        phase = float(row["peak_phase_deg"])
        assert float(ours["peak_phase_deg"]) == pytest.approx(phase, abs=0.2)
        assert float(ours["C_T"]) == pytest.approx(float(row["C_T"]), rel=1e-3, abs=1e-4)
        assert float(ours["strouhal"]) == pytest.approx(float(row["St"]), rel=1e-3)
    names = {str(int(modulus)): name for name, modulus in FINS.items()}
    compared = 0
    for row in rows(DATA / "flex_grid_ilm.csv"):
        if row["E_Pa"] in names:
            ours = found[names[row["E_Pa"]], float(row["A_deg"]), float(row["f_Hz"])]
            thrust = float(row["T_x_N"])
            assert float(ours["thrust_N"]) == pytest.approx(thrust, rel=5e-3, abs=5e-6)
            compared += 1
    assert compared >= 32


def test_the_fit_finds_a_soft_fin(chapter3):
    soft = rows(chapter3[0] / "fit.csv")[1]
    assert float(soft["fitted_E_Pa"]) == pytest.approx(float(soft["true_E_Pa"]), rel=0.05)
    # What is left is the noise that was added.
    left = [float(row["rms_m"]) for row in rows(chapter3[0] / "fit_errors.csv")]
    assert len(left) == 32 and max(left) < 6e-4
