"""Promise: film and load cell of a fin in water give its modulus, drag and added mass.

The recordings are *synthetic*: a fin of 113 nodes by backward Euler before a camera with noise, a
wrong scale, tilt and clock, on a cell with noise, gain and bias.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("scipy")

from rodgym import lab
from rodgym.cli import main
from rodgym.lab.bench import Flaws
from rodgym.lab.fin_bench import FinBench, record_fin
from rodgym.runs import write_csv
from rodgym.sim import Fin

yaml = pytest.importorskip("yaml")

#: The thesis' fin with a tail that is 1 mm thick: one of no thickness has no converged tail.
SHAPE = Fin().config["geometry"]
GEOMETRY = {
    **SHAPE,
    "widths": [*SHAPE["widths"][:-1], 1e-3],
    "areas": [*SHAPE["areas"][:-1], 1e-3 * SHAPE["height"]],
}
TRUTH = {"youngs_modulus": 3e5, "drag_coefficient": 1.5, "added_mass_coefficient": 0.6}
BENCH = FinBench(
    fin={**TRUTH, "geometry": GEOMETRY},
    periods=6.0,
    flaws=Flaws(tilt=0.02, scale=1.02, base=(0.01, -0.005), clock=0.013),
    gain=1.01,
    bias=0.02,
    clamp=0.01,
    substeps=12,
)


@pytest.fixture(scope="module")
def swum():
    return record_fin(BENCH, 1)


def written(folder, recording):
    """The files that a user has."""
    recording.tracks.write(folder / "film.csv")
    rows = zip(
        recording.times, np.degrees(recording.pitch), 1e3 * recording.loads["thrust"], strict=True
    )
    header = ("time [s]", "pitch [deg]", "thrust [mN]")
    write_csv(folder / "bench.csv", header, [[float(v) for v in row] for row in rows])
    return [str(folder / "film.csv"), "--bench", str(folder / "bench.csv")]


def test_the_program_finds_modulus_drag_and_added_mass(swum, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    words = ["--machine", "fin", "--known", f"geometry={GEOMETRY}", "--out", str(tmp_path / "out")]
    assert main(["fit", *written(tmp_path, swum), *words]) == 0
    rod = yaml.safe_load((tmp_path / "out" / "rod.yml").read_text())
    for name, truth in TRUTH.items():
        best, low, high = (rod["parameters"][name][key] for key in ("value", "low", "high"))
        assert abs(best / truth - 1) < 0.05, name
        assert 2 * low - best < truth < 2 * high - best
    assert rod["machine"] == "fin" and rod["not_identifiable"] == [] and rod["holdout"]["passed"]
    assert abs(rod["camera"]["scale"]["value"] - 1.02) < 2e-3
    assert abs(rod["camera"]["clock"]["value"] + 0.013) < 2e-3
    assert abs(rod["cells"]["thrust_bias"]["value"] - 0.02) < 2e-3
    assert abs(rod["residual_loads"]["thrust"] / 5e-3 - 1) < 0.1
    # Eight nodes bend more easily: the same motion needs a higher E.
    assert rod["equivalent"]["parameters"]["youngs_modulus"] > 1.1 * TRUTH["youngs_modulus"]
    assert [row["nodes"] for row in rod["nodes"]] == [8, 29, 57]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "added_mass_coefficient" in page and page.count("data:image/png") == 3
    assert "95 %" in capsys.readouterr().out
    # The twin has the geometry, and draws the three together.
    keywords = lab.keywords(tmp_path / "out" / "rod.yml")
    assert keywords["geometry"]["widths"][-1] == 1e-3 and set(keywords["randomize"]) == set(TRUTH)


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        (lambda r: replace(r, pitch=np.degrees(r.pitch)), lab.UnitsError, "degrees"),
        (lambda r: replace(r, pitch=-r.pitch), lab.AxisError, "against its pitch"),
        (lambda r: replace(r, pitch=r.pitch[:-1]), lab.FramesError, "as many"),
        (lambda r: replace(r, loads={"lift": r.pitch}), lab.RecordingError, "lift"),
        (
            lambda r: replace(r, times=r.times[::10], pitch=r.pitch[::10], loads={}),
            lab.FramesError,
            "do not tell how it is moved",
        ),
        (
            lambda r: replace(r, tracks=lab.Tracks(r.tracks.times, r.tracks.points[:, ::-1])),
            lab.OrderError,
            "nose to the tail",
        ),
        (
            lambda r: replace(r, tracks=lab.Tracks(r.tracks.times, 1e3 * r.tracks.points)),
            lab.UnitsError,
            "mm",
        ),
    ],
)
def test_a_recording_that_makes_no_sense_is_refused_by_name(change, error, says, swum):
    with pytest.raises(error, match=says):
        lab.fit_fin([change(swum)])


def test_a_fin_that_moves_otherwise_is_refused(swum):
    """In air it would hardly pull at its mount."""
    air = {"nodes": 8, "hydrodynamics": "air", "geometry": GEOMETRY, "youngs_modulus": 3e5}
    with pytest.raises(lab.MisfitError, match="water or air"):
        lab.fit_fin([swum], free=["damping"], known=air)


def test_films_and_bench_files_go_together(swum, tmp_path, capsys):
    film, *_ = written(tmp_path, swum)
    assert main(["fit", film, "--machine", "fin"]) == 2
    assert "1 films and 0 files of the bench" in " ".join(capsys.readouterr().err.split())
