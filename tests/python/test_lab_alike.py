"""Promise: residuals that are alike widen intervals. Noise does not."""

from __future__ import annotations

import numpy as np
import pytest
from rodgym import lab
from rodgym.lab.alike import likeness, widening
from rodgym.lab.bench import Bench, Flaws, record


def like(shape, share, seed=0):
    """Residuals of deviation 1 of which a share is that of the frame before."""
    random = np.random.default_rng(seed)
    found = np.empty(shape)
    found[0] = random.normal(size=shape[1:])
    for i in range(1, shape[0]):
        found[i] = share * found[i - 1] + np.sqrt(1 - share**2) * random.normal(size=shape[1:])
    return found


def test_noise_alone_widens_nothing():
    factors = [widening([like((90, 7, 2), 0.0, seed)]) for seed in range(200)]
    assert np.mean(np.array(factors) == 1.0) > 0.98 and max(factors) < 1.3


@pytest.mark.parametrize("share", [0.5, 0.8])
def test_frames_that_are_alike_count_as_fewer(share):
    found = widening([like((900, 7, 2), share), like((600, 7, 2), share, 1)])
    assert abs(found / ((1 + share) / (1 - share)) - 1) < 0.2
    assert abs(likeness([like((900, 7, 2), share)]) - share) < 0.05


def test_markers_that_are_alike_count_as_fewer_whatever_is_lost():
    gap = like((12, 400, 2), 0.6).swapaxes(0, 1)
    gap[np.random.default_rng(3).random(gap.shape) < 0.1] = np.nan
    gap[5, 3] = 1e3
    assert abs(widening([gap]) - 3.0) < 1.0
    # Loads have no markers.
    assert abs(widening([like((4000,), 0.5)]) - 3.0) < 0.4


def test_intervals_hold_the_rod_where_the_lens_is_off():
    """A picture that is drawn out by up to a millimetre, as by a lens that is not quite known."""
    truth = {"youngs_modulus": 8.3e6, "bending_damping": 6e-4, "nodes": 7}
    (film,) = record([Bench(rod=truth, flaws=Flaws(noise=5e-5))], [4])
    x, y = film.points[..., 0] / 0.3, film.points[..., 1] / 0.3
    off = 1e-3 * np.stack([x**2 - x * y**2, x**2 * y], axis=-1)
    known = {"width": 0.007, "length": 0.3, "nodes": 7}
    clean = lab.fit(film, known=known)
    bent = lab.fit(lab.Tracks(film.times, film.points + off), known=known)
    for name in clean.parameters:
        _, low, high = bent.parameters[name]
        assert low < truth[name] < high, name
        narrow = clean.parameters[name]
        assert high / low - 1 > 3 * (narrow.high / narrow.low - 1)
    assert "alike" in " ".join(bent.notes) and "alike" not in " ".join(clean.notes)
