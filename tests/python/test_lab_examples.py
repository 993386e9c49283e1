"""Promise: the recordings that come with rodgym are small, and the program reads them by name."""

from __future__ import annotations

import lab_examples
import numpy as np
import pytest
from rodgym import lab
from rodgym.cli.commands.fit import table
from rodgym.errors import ParameterError
from rodgym.lab import examples

pytest.importorskip("scipy")


def test_the_pendulum_is_the_hidden_one(tmp_path):
    made = lab_examples.pendulum()
    shipped = lab.read_tracks(table("example:pendulum"))
    assert np.allclose(shipped.points, made.points, atol=6e-6, equal_nan=True)
    assert sum(path.stat().st_size for path in examples.path("fin").parent.glob("*.csv")) < 50_000


def test_the_fin_and_its_bench_go_together():
    from rodgym.lab import drives

    bench = lab.read_cells(table("example:fin-bench"))
    recording = drives.recording(lab.read_tracks(table("example:fin")), bench)
    assert recording.tracks.markers == 8 and set(recording.loads) == {"thrust"}
    assert abs(np.abs(recording.pitch).max() / 0.15 - 1) < 0.01
    with pytest.raises(ParameterError, match="pendulum, fin, fin-bench"):
        examples.path("whale")


def test_the_simplex_of_the_thesis_finds_a_pendulum_too():
    from rodgym.lab.bench import Bench, record

    truth = {"youngs_modulus": 8.3e6, "bending_damping": 6e-4}
    (film,) = record([Bench(rod={**truth, "nodes": 7}, seconds=1.5)], [12])
    fit = lab.fit(film, known={"nodes": 7})
    found, cost = lab.fit_by_simplex(fit, {name: 1.5 * v for name, v in truth.items()})
    for name, (best, low, high) in fit.parameters.items():
        assert abs(found[name] - best) < high - low, name
    assert cost < 1.02 * np.sqrt(np.sum(fit.estimate.residuals**2))
