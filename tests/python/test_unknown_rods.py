"""A short version of `make unknown-rods`: every kind of case is played."""

import gymnasium as gym
import numpy as np
import unknown_rods
from rodgym import baselines
from unknown_rods import BASE_ONLY, DOCS, LAWS, Jump, Learned, cases, key_of, page, play_all


def first(table, kind=None):
    return next(c for c in cases() if c.table == table and (kind is None or isinstance(c, kind)))


def test_every_case_has_a_key_of_its_own():
    keys = [key_of(case, law) for case in cases() for law in case.laws]
    assert len(set(keys)) == len(keys)


def test_rods_that_lqg_loses_stand():
    case = first("line")
    played = {law: case.play(law, range(6))["upright"] for law in LAWS}
    assert played == {"lqg": 0, "lqg-adaptive": 6, "informed": 6}


def test_drawn_rods_are_each_told_to_the_informed():
    case = first("drawn")
    assert case.play("informed", range(6))["upright"] >= 5
    assert case.play("lqg-adaptive", range(6))["upright"] >= 5


def test_a_jump_is_survived():
    assert first("jump", Jump).play("lqg-adaptive", range(2))["upright"] == 2


def test_the_modulus_is_found_out():
    played = first("estimate", Learned).play("lqg-adaptive", range(10))
    assert max(map(abs, played["errors"])) < 0.03 and played["upright"] == 10


def test_what_is_in_the_log_is_not_played_again(tmp_path, monkeypatch):
    only = [first("line")]
    monkeypatch.setattr(unknown_rods, "cases", lambda: iter(only))
    log = tmp_path / "log.jsonl"
    done = play_all(log, 2, ["line"])
    assert len(log.read_text().splitlines()) == len(LAWS)
    monkeypatch.setattr(unknown_rods.Case, "play", None)
    assert play_all(log, 2, ["line"]) == done


def test_the_page_is_written_from_what_was_played(monkeypatch):
    monkeypatch.setattr(unknown_rods, "call_times", lambda: "times")
    done = {key_of(first("line"), "lqg"): {"upright": 3, "seeds": 7}}
    text = page(done, (DOCS / "unknown-rods.md").read_text(encoding="utf-8"))
    assert "| 7 mm, 7 MPa | 3 of 7 |" in text and "times" in text


def test_what_was_not_played_stays_on_the_page():
    before = (DOCS / "unknown-rods.md").read_text(encoding="utf-8")
    case = first("return")
    row = {"upright": 3, "seeds": 4}
    done = {
        key_of(case, "lqg-adaptive"): {**row, "returns": [470.0, 471.0, 472.0, 473.0]},
        key_of(case, "student-of-policy"): {**row, "returns": [471.0, 472.0, 473.0, 474.0]},
    }
    after = page(done, before)
    rows = [line for line in after.splitlines() if line not in before.splitlines()]
    cells = "471.5 (3 of 4 upright) |  |  | 472.5 (3 of 4 upright) |  | +1.00 (+1.00 to +1.00)"
    assert f"| {case.what} | {cells} |" in rows
    assert after.partition("<!-- return -->")[0] == before.partition("<!-- return -->")[0]


def test_a_late_rod_that_is_believed_wrong_is_still_told_numbers():
    """The forecast over the motor's delay was flung off, and the action was NaN."""
    told = {"sensor_noise": {"angle": 1e-3, "rate": 1e-2}, "actuator_delay": 0.01}
    controller = baselines.make("lqg", gym.make(BASE_ONLY, **told))
    env = gym.make(BASE_ONLY, **told, randomize={"youngs_modulus": (7e6, 13e6)})
    observation, _ = env.reset(seed=10065)
    state = None
    for _ in range(500):
        action, state = controller.predict(observation, state)
        assert np.isfinite(action).all() and np.isfinite(state).all()
        observation, *_ = env.step(action)
