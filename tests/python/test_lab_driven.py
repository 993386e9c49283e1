"""Promise: a film of a rod whose base a known torque drives tells its density, too.

The films are *synthetic*: a rod of seven nodes before a camera with flaws.
"""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("scipy")

from rodgym import lab
from rodgym.cli import main
from rodgym.lab.bench import Bench, Flaws, record
from rodgym.lab.film import Torque
from rodgym.runs import write_csv

yaml = pytest.importorskip("yaml")

TRUTH = {"youngs_modulus": 8.3e6, "density": 1650.0, "bending_damping": 6.1e-4}
TIMES = np.arange(0.0, 2.1, 1 / 300)


def torque(t):
    sines = 0.012 * np.sin(2 * np.pi * 0.9 * t) + 0.01 * np.sin(2 * np.pi * 2.7 * t)
    return sines * np.minimum(t, 1.0)


BENCH = Bench(
    rod={**TRUTH, "nodes": 7},
    angle=0.3,
    bend=0.4,
    seconds=2.0,
    torque=torque,
    flaws=Flaws(scale=1.03, tilt=0.03, clock=0.012),
)


@pytest.fixture(scope="module")
def film():
    return record([BENCH], [31])[0]


def test_the_program_takes_a_torque_and_finds_the_density(film, tmp_path):
    pytest.importorskip("matplotlib")
    film.write(tmp_path / "film.csv")
    rows = zip(TIMES.tolist(), (1e3 * torque(TIMES)).tolist(), strict=True)
    write_csv(tmp_path / "torque.csv", ("time [s]", "torque [mNm]"), rows)
    words = ["fit", str(tmp_path / "film.csv"), "--bench", str(tmp_path / "torque.csv")]
    words += ["--free", ",".join(TRUTH), "--known", "nodes=7", "--out", str(tmp_path / "out")]
    assert main(words) == 0
    rod = yaml.safe_load((tmp_path / "out" / "rod.yml").read_text())
    for name, most in (("youngs_modulus", 0.005), ("density", 0.005), ("bending_damping", 0.1)):
        assert abs(rod["parameters"][name]["value"] / TRUTH[name] - 1) < most, name
    assert rod["not_identifiable"] == [] and rod["holdout"]["passed"]
    assert abs(rod["camera"]["clock"]["value"] + 0.012) < 5e-4


@pytest.mark.parametrize(
    ("driven", "says"),
    [
        (Torque(TIMES, 0 * TIMES), "all the time"),
        (Torque(TIMES + 100.0, torque(TIMES)), "one clock"),
        (Torque(TIMES[::-1], torque(TIMES)), "must rise"),
        (Torque(TIMES, torque(TIMES)[1:]), "as many"),
    ],
)
def test_a_torque_that_drives_no_such_rod_is_refused(film, driven, says):
    with pytest.raises(lab.FramesError, match=says):
        lab.fit(film, known={"nodes": 7}, torque=driven)


def test_the_bench_needs_a_torque_in_newton_metres(film, tmp_path, capsys):
    film.write(tmp_path / "film.csv")
    for header, says in (
        (("time [s]", "force [N]"), "no 'torque'"),
        (("time [s]", "torque [V]"), "calibrate"),
    ):
        rows = zip(TIMES.tolist(), TIMES.tolist(), strict=True)
        write_csv(tmp_path / "bench.csv", header, rows)
        bench = ["--bench", str(tmp_path / "bench.csv")]
        assert main(["fit", str(tmp_path / "film.csv"), *bench]) == 2
        assert says in " ".join(capsys.readouterr().err.split())
