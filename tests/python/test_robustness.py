"""A measurement of robustness says what happens to a policy whose world is not the one that it was
made for.
"""

import csv

import numpy as np
import pytest
from rodgym import machines
from rodgym._native import Batch, catalog
from rodgym.cli import main
from rodgym.errors import ParameterError
from rodgym.evaluation import band_keywords, bands, evaluate, load_policy
from rodgym.robustness import Candidate, measure, usual_env
from rodgym.robustness.result import success_of

SWING_UP = "rodgym/PendulumSwingUp-v0"
THRUST = "rodgym/FinThrust-v0"
SHORT = {"max_episode_steps": 250}


@pytest.fixture(scope="module")
def swing_up():
    """Three values of a few quantities, two episodes each."""
    chosen = ["width", "actuator_gain", "actuator_delay", "push"]
    return measure(["lqr", "zero"], seeds=2, points=3, quantities=chosen)


def test_the_lqr_holds_and_idleness_does_not(swing_up):
    assert swing_up.policies == ("lqr", "zero") and swing_up.column == "upright"
    assert swing_up.mean("zero") == 0.0 and swing_up.holds("zero", "width") is None
    # Nominal, in every quantity.
    nominal = [q.values(3).index(q.nominal) for q in swing_up.quantities]
    assert all(swing_up.success[0, j, k] == 1.0 for j, k in enumerate(nominal))
    assert swing_up.score("lqr", "actuator_gain") == 1.0
    assert swing_up.holds("lqr", "actuator_gain") == (0.7, 1.3)


def test_a_point_is_what_evaluate_plays(swing_up):
    """The controller is designed for 7 mm whatever the rod is."""
    import gymnasium as gym

    nominal = gym.make_vec(SWING_UP, num_envs=1)
    law = load_policy("lqr", nominal)
    nominal.close()
    for k, factor in enumerate([0.75, 1.0, 1.25]):
        expected = evaluate(law, SWING_UP, range(2), env_kwargs={"width": factor * 0.007})
        found = swing_up.returns[0, 0, k]
        assert found == pytest.approx(expected.columns["return"], rel=1e-8)
        assert swing_up.success[0, 0, k] == expected.mean("upright")


def test_the_push_comes_while_it_stands(swing_up):
    """Longer episodes, in which the motor's limit is exceeded for 50 ms."""
    spec = Batch(SWING_UP, 1).spec
    (push,) = (q for q in machines.of(spec).quantities(spec) if q.name == "push")
    keywords = push.keywords(spec, 2.0)
    assert keywords["push"] == {"torque": 0.1, "start": 4.0, "duration": 0.05}
    assert keywords["max_episode_steps"] == 800
    result = evaluate("lqr", SWING_UP, range(2), env_kwargs=keywords)
    assert swing_up.returns[0, 3, 2] == pytest.approx(result.columns["return"], rel=1e-8)
    assert (result.columns["length"] == 8.0).all()


@pytest.mark.parametrize("env_id", [row["id"] for row in catalog()])
def test_every_quantity_and_band_makes_an_environment(env_id):
    spec = Batch(env_id, 1).spec
    about = machines.of(spec)
    quantities = about.quantities(spec)
    assert len(quantities) >= 9
    for quantity in quantities:
        values = quantity.values(21)
        assert len(values) == 21 and values == sorted(values) and quantity.nominal in values
        for value in values:
            keywords = quantity.keywords(spec, value)
            changed = Batch(env_id, 1, _of_core(keywords)).spec["config"]
            # What a task draws unless it is given.
            changed["randomize"] = spec["config"]["randomize"]
            if value == quantity.nominal and quantity.name != "push":
                assert changed == spec["config"], quantity.name
            elif quantity.name != "push":
                assert changed != spec["config"], (quantity.name, value)
    assert list(bands(spec)) == ["nominal", "starts", "rods"]
    for band in bands(spec):
        Batch(env_id, 1, _of_core(band_keywords(band, env_id)))


def _of_core(keywords):
    return {name: value for name, value in keywords.items() if name != "max_episode_steps"}


def test_fins_succeed_by_what_they_return_nominally():
    returns = np.array([[[[10.0, 20.0], [8.1, 15.0], [-1.0, 16.0]]], [[[-5, 0], [9, 9], [0, 1]]]])
    assert success_of(returns, [0]).tolist() == [[[1.0, 0.5, 0.5]], [[0.0, 0.0, 0.0]]]
    gait = Candidate("gait", "gait-sine", THRUST, {"youngs_modulus": 3e5})
    found = measure([gait], seeds=2, points=3, quantities=["sensor_noise", "actuator_gain"])
    assert found.column is None
    # A gait looks at nothing.
    assert found.score("gait", "sensor_noise") == 1.0
    assert len(set(found.returns[0, 0, :, 0])) == 1
    assert found.score("gait", "actuator_gain") < 1.0


def read(table):
    return list(csv.DictReader(table.read_text().splitlines()))


class Killed(Exception):
    pass


def test_an_interrupted_measurement_goes_on(tmp_path):
    table = tmp_path / "runs" / "table.csv"
    asked = {"seeds": 1, "points": 3, "quantities": ["actuator_gain"], "table": table}
    one = Candidate("LQR", "lqr", SWING_UP, SHORT)

    def after_one(done, values):
        if done == 1:
            raise Killed

    with pytest.raises(Killed):
        measure([one], **asked, on_row=after_one)
    assert len(table.read_text().splitlines()) == 2
    seen = []
    result = measure([one], **asked, on_row=lambda done, values: seen.append((done, values)))
    assert seen == [(1, 3), (2, 3), (3, 3)]
    assert (result.success == measure([one], **{**asked, "table": None}).success).all()
    rows = read(table)
    assert [row["value"] for row in rows] == ["0.7", "1", "1.3"]
    assert {row["policy"] for row in rows} == {"LQR"}


def test_two_processes_give_the_same_table(tmp_path):
    asked = {"seeds": 1, "points": 3, "quantities": ["density"]}
    one = Candidate("LQR", "lqr", SWING_UP, SHORT)
    for workers in (1, 2):
        measure([one], **asked, table=tmp_path / f"{workers}.csv", workers=workers)
    assert (tmp_path / "1.csv").read_bytes() == (tmp_path / "2.csv").read_bytes()


class Bang:
    """Anything with `predict`: full torque with the rotation."""

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return np.sign(observation[:, 12:13]).astype(np.float32), state


def test_an_object_is_measured_in_this_process(tmp_path):
    one = Candidate("bang", Bang(), SWING_UP, SHORT)
    found = measure([one, "zero"], seeds=1, points=3, quantities=["actuator_gain"])
    assert found.returns[0, 0, 0] > 2 * found.returns[1, 0, 0]
    with pytest.raises(ParameterError, match="leave out table"):
        measure([one], seeds=1, points=3, table=tmp_path / "table.csv")


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"points": 4}, "odd"),
        ({"seeds": 0}, "seeds = 0"),
        ({"seeds": range(0, 10, 2)}, "steps of 1"),
        ({"quantities": ["colour"]}, "one of width, length"),
    ],
)
def test_what_cannot_be_measured_is_refused(asked, words):
    with pytest.raises(ParameterError, match=words):
        measure(["lqr"], **{"seeds": 1, "points": 3, **asked})


def test_machines_are_measured_apart():
    with pytest.raises(ParameterError, match="measure them apart"):
        measure(["lqr", "gait"], seeds=1, points=3)
    with pytest.raises(ParameterError, match="two are called 'lqr'"):
        measure(["lqr", "lqr"], seeds=1, points=3)
    with pytest.raises(ParameterError, match="at least one policy"):
        measure([], seeds=1, points=3)


def test_controllers_are_at_home_where_they_see_enough():
    assert usual_env("lqr")[0] == usual_env("zero")[0] == SWING_UP
    assert usual_env("lqg")[0] == "rodgym/PendulumSwingUpBase-v0"
    assert usual_env("gait-sine")[0] == usual_env("gait")[0] == THRUST


def test_what_is_varied_is_not_drawn():
    """Young's modulus of the fin is drawn by default; at a value of ours it has that value."""
    drawn = Candidate("zero", "zero", SWING_UP, {"randomize": {"width": (0.006, 0.008)}, **SHORT})
    found = measure([drawn], seeds=3, points=3, quantities=["width", "density"])
    fixed = evaluate("zero", SWING_UP, range(3), env_kwargs={**SHORT, "width": 0.75 * 0.007})
    assert found.returns[0, 0, 0] == pytest.approx(fixed.columns["return"], rel=1e-8)
    both = {**SHORT, "randomize": {"width": (0.006, 0.008)}, "density": 1125.0}
    also = evaluate("zero", SWING_UP, range(3), env_kwargs=both)
    assert found.returns[0, 1, 0] == pytest.approx(also.columns["return"], rel=1e-8)


def test_bands_change_what_nobody_asked_for():
    starts = band_keywords("starts", SWING_UP, {"width": 0.009, "start_angle": (0.0, 0.1)})
    assert starts == {"width": 0.009, "start_angle": (0.0, 0.1), "start_rate": (-5.0, 5.0)}
    rods = band_keywords("rods", SWING_UP, {"width": 0.01, "randomize": {"length": (0.2, 0.3)}})
    assert rods["randomize"]["width"] == pytest.approx((0.0085, 0.0115))
    assert rods["randomize"]["length"] == [0.2, 0.3]
    assert band_keywords("nominal", SWING_UP) == {}
    # Its own range, which is wider.
    fins = band_keywords("rods", THRUST)["randomize"]
    assert fins["youngs_modulus"][0] == "log_uniform" and len(fins) == 3
    with pytest.raises(ParameterError, match="nominal, starts, rods"):
        band_keywords("winds", SWING_UP)


def test_seeds_of_a_band_are_different_episodes():
    returns = evaluate("lqr", SWING_UP, range(8)).columns["return"]
    anywhere = evaluate("lqr", SWING_UP, range(8), env_kwargs=band_keywords("starts", SWING_UP))
    assert anywhere.columns["return"].std() > 20 * returns.std()


def test_the_program_measures_and_evaluates_in_bands(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    runs = ["--runs", str(tmp_path)]
    quick = ["--seeds", "1", "--points", "3", "--quantity", "push,actuator_gain"]
    assert main(["robustness", "lqr", "lqg", "zero", *quick, *runs, "--name", "r"]) == 0
    said = capsys.readouterr().out
    assert said.splitlines()[0].split() == ["success", "[%]", "LQR", "LQG", "zero"]
    assert "push for 50 ms" in said
    rows = read(tmp_path / "r" / "scores.csv")
    assert [row["quantity"] for row in rows] == ["push", "actuator_gain", "mean"] * 3
    assert (tmp_path / "r" / "plot.png").stat().st_size > 20_000
    assert main(["robustness", "lqr@NoSuch", *quick, *runs]) == 2
    assert "there is no environment 'NoSuch'" in capsys.readouterr().err
    assert main(["evaluate", "lqr", "--band", "starts", "--seeds", "2", *runs, "--name", "e"]) == 0
    assert '"band": "starts"' in (tmp_path / "e" / "run.json").read_text()
