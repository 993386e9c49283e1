"""Intervals, profiles and probabilities are those of SciPy and of arithmetic by hand."""

import numpy as np
import pytest
import scipy.stats
from rodgym.errors import ParameterError
from rodgym.evaluation import statistics
from rodgym.evaluation.statistics import (
    curve_band,
    interquartile_mean,
    interval,
    mean,
    median,
    middle,
    performance_profile,
    probability_of_improvement,
    ratio,
    summary,
    trimmed_mean,
)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 40, 101])
def test_the_interquartile_mean_is_scipys_trimmed_mean(rng, count):
    scores = rng.normal(size=count)
    assert interquartile_mean(scores) == pytest.approx(scipy.stats.trim_mean(scores, 0.25))
    assert interquartile_mean(scores.reshape(1, -1)) == interquartile_mean(scores.reshape(-1, 1))
    assert median(scores) == np.median(scores)


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [(trimmed_mean, lambda x, axis: scipy.stats.trim_mean(x, 0.25, axis=axis)), (mean, np.mean)],
)
def test_a_single_training_has_scipys_interval(rng, ours, theirs):
    scores = rng.gamma(2.0, size=60)
    found = interval(scores, ours, resamples=20_000)
    expected = scipy.stats.bootstrap(
        (scores,), theirs, n_resamples=20_000, method="percentile", rng=np.random.default_rng(9)
    ).confidence_interval
    spread = expected.high - expected.low
    assert found.low == pytest.approx(expected.low, abs=0.03 * spread)
    assert found.high == pytest.approx(expected.high, abs=0.03 * spread)
    assert found.low < found.value < found.high


def test_trainings_are_drawn_not_only_their_episodes(rng):
    """Ten trainings that differ much and whose episodes hardly do: what is uncertain is the mean of
    ten numbers, however many episodes there are.
    """
    luck = rng.normal(size=(10, 1))
    scores = luck + 0.01 * rng.normal(size=(10, 200))
    found = interval(scores, mean)
    expected = scipy.stats.bootstrap(
        (scores.mean(axis=1),), np.mean, n_resamples=20_000, method="percentile"
    ).confidence_interval
    width = expected.high - expected.low
    assert found.high - found.low == pytest.approx(width, rel=0.05)
    # As if 2000 independent episodes were known, it would be fourteen times too narrow.
    assert interval(scores.ravel(), mean).high - interval(scores.ravel(), mean).low < 0.1 * width


def test_intervals_cover_the_truth_as_often_as_they_say(rng):
    """Of 200 repetitions with 20 trainings each, some 95 % of the intervals have the true mean."""
    covered = 0
    for _ in range(200):
        scores = rng.normal(size=(20, 1)) + rng.normal(size=(20, 10))
        found = interval(scores, mean, resamples=300)
        covered += found.low <= 0.0 <= found.high
    assert 180 <= covered <= 199, covered


def test_strata_are_never_mixed(rng):
    """Two tasks far apart, each without any spread: nothing is uncertain."""
    parts = [np.zeros((5, 8)), np.full((3, 8), 100.0)]
    found = interval(parts, mean)
    assert found.low == found.value == found.high == pytest.approx(100.0 * 24 / 64)


def test_the_same_scores_give_the_same_interval(rng):
    scores = rng.normal(size=(4, 9))
    assert interval(scores) == interval(scores.tolist())
    assert interval(scores) != interval(scores, seed=1)
    found = summary(scores)
    assert (found.trained, found.episodes) == (4, 9)
    assert found.interquartile_mean == interval(scores)
    assert found.median == interval(scores, middle) and found.mean == interval(scores, mean)


def test_the_probability_of_improvement_is_mann_and_whitneys(rng):
    a, b = rng.integers(0, 6, size=(7, 1)), rng.integers(1, 7, size=(9, 1))
    found = probability_of_improvement(a, b, resamples=200)
    u = scipy.stats.mannwhitneyu(a.ravel(), b.ravel()).statistic
    assert found.value == pytest.approx(u / (7 * 9))
    assert found.low <= found.value <= found.high
    back = probability_of_improvement(b, a, resamples=10)
    assert back.value == pytest.approx(1.0 - found.value)


def test_improvement_is_judged_episode_by_episode():
    """One is better by a little in every episode, which differ much among themselves."""
    hard = np.linspace(0.0, 100.0, 30)
    a, b = np.tile(hard + 0.1, (3, 1)), np.tile(hard, (4, 1))
    found = probability_of_improvement(a, b, resamples=100)
    assert (found.low, found.value, found.high) == (1.0, 1.0, 1.0)
    with pytest.raises(ParameterError, match="same episodes"):
        probability_of_improvement(a, b[:, :-1])


def test_a_profile_counts_what_is_above(rng):
    scores = np.array([[0.0, 1.0, 2.0], [1.0, 2.0, 3.0]])
    found = performance_profile(scores, [-1.0, 0.0, 1.0, 1.5, 3.0])
    assert found.share == pytest.approx([1.0, 5 / 6, 3 / 6, 3 / 6, 0.0])
    assert (found.low <= found.share).all() and (found.share <= found.high).all()
    assert (np.diff(found.share) <= 0).all()
    # Its area is the mean, where scores begin at 0.
    many, at = rng.random((4, 50)), np.linspace(0.0, 1.0, 2001)
    area = np.trapezoid(performance_profile(many, at, resamples=2).share, at)
    assert area == pytest.approx(many.mean(), abs=1e-3)


def test_a_band_of_curves_goes_as_far_as_all_of_them():
    curves = [([0, 10, 20], [0.0, 1.0, 2.0]), ([5, 25], [1.5, 3.5]), ([0, 30], [1.0, 4.0])]
    band = curve_band(curves, points=4)
    assert band.x == pytest.approx([5, 10, 15, 20])
    # At 5: 0.5, 1.5, 1.5. None of three is left out by quarters.
    assert band.value == pytest.approx([3.5 / 3, 5 / 3, 6.5 / 3, 8 / 3])
    assert (band.low <= band.value).all() and (band.value <= band.high).all()
    single = curve_band(curves[:1], points=3)
    assert single.low == pytest.approx([0, 1, 2]) and single.high == pytest.approx([0, 1, 2])


@pytest.mark.parametrize("bad", [[], [[np.nan, 1.0]], np.zeros((2, 2, 2)), np.zeros((0, 3))])
def test_scores_that_are_none_are_refused(bad):
    with pytest.raises(ParameterError, match="scores"):
        interval(bad)


def test_an_interval_reads_well():
    assert str(statistics.Interval(471.23456, 470.0, 472.5)) == "471.2 [470, 472.5]"


def test_the_plots_of_many_seeds(tmp_path, rng):
    pytest.importorskip("matplotlib")
    from PIL import Image
    from rodgym.report.statistics import intervals, learning_curves, profiles

    scores = {"PPO": rng.normal(470, 5, (5, 20)), "LQR": np.full(20, 471.0)}
    profiles(tmp_path / "profiles.png", scores)
    intervals(tmp_path / "intervals.png", scores)
    steps = np.arange(0.0, 1e5, 1e4)
    runs = [(steps, steps / (900 + seed), np.sqrt(steps) + seed) for seed in range(5)]
    learning_curves(tmp_path / "curves.png", {"PPO": runs, "SAC": runs[:1]}, {"LQR": 250.0})
    for name in ("profiles", "intervals", "curves"):
        pixels = np.asarray(Image.open(tmp_path / f"{name}.png").convert("RGB"), np.int16)
        # Blue, the first policy's colour, was drawn.
        assert (np.abs(pixels - [0x00, 0x72, 0xB2]).sum(axis=-1) < 30).sum() > 50, name


def test_a_ratio_of_means_draws_the_same_episodes_for_both():
    """Episodes that differ much among themselves do not blur a factor that all of them have."""
    hard = np.linspace(1.0, 100.0, 30)
    found = ratio(np.tile(1.2 * hard, (3, 1)), hard, resamples=100)
    assert found.value == pytest.approx(1.2)
    assert found.low == pytest.approx(1.2) and found.high == pytest.approx(1.2)
    spread = ratio(np.stack([1.1 * hard, 1.3 * hard]), hard, resamples=500)
    assert spread.low == pytest.approx(1.1) and spread.high == pytest.approx(1.3)
    with pytest.raises(ParameterError, match="same episodes"):
        ratio(hard, hard[:-1])
