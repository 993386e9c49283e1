"""A study's table is the same bytes whatever was interrupted and wherever its cases ran."""

import csv
import itertools
import sys
from pathlib import Path

import pytest
import rodgym

pytest.importorskip("yaml")

from rodgym.cli import main
from rodgym.study import StudyError, local, plans, read, run_case, run_study
from rodgym.study.plot import draw
from rodgym.study.spec import parse

CONTENT = {
    "env": "rodgym/PendulumSwingUp-v0",
    "seeds": 2,
    "fixed": {"start.rate": 1.0},
    "sweep": {
        "policy": ["lqr", "zero"],
        "env.width": [0.007, 0.009],
        "start.angle": {"from": 0.0, "to": 3.0, "steps": 2},
    },
    "plot": {"x": "start.angle", "y": "env.width", "value": "upright", "panel": "policy"},
}


@pytest.fixture(scope="module")
def study():
    return parse(CONTENT, "test")


@pytest.fixture(scope="module")
def finished(study, tmp_path_factory):
    table = tmp_path_factory.mktemp("study") / "table.csv"
    run_study(study, table)
    return table.read_bytes()


def test_every_combination_is_a_case(study):
    cases = list(study.cases())
    assert len(cases) == len(study) == 8
    combinations = {(c["policy"], c["env.width"], c["start.angle"]) for c in cases}
    assert combinations == set(itertools.product(["lqr", "zero"], [0.007, 0.009], [0.0, 3.0]))
    assert all(c["start.rate"] == 1.0 and c["seeds"] == 2 for c in cases)


def test_rows_tell_controllers_from_idleness(finished):
    rows = list(csv.DictReader(finished.decode().splitlines()))
    assert {row["upright"] for row in rows if row["policy"] == "lqr"} == {"1"}
    assert {row["upright"] for row in rows if row["policy"] == "zero"} == {"0"}
    # What no episode defines is left empty.
    assert all((row["time_to_upright"] == "") == (row["upright"] == "0") for row in rows)


def test_two_processes_give_the_same_bytes(study, finished, tmp_path):
    run_study(study, tmp_path / "table.csv", local(workers=2))
    assert (tmp_path / "table.csv").read_bytes() == finished


class Killed(Exception):
    pass


def test_a_killed_study_goes_on_where_it_stopped(study, finished, tmp_path):
    table, ran = tmp_path / "table.csv", []

    def mortal(cases):
        for number, case in cases:
            if len(ran) == 3:
                raise Killed
            ran.append(number)
            yield number, run_case(case)

    with pytest.raises(Killed):
        run_study(study, table, mortal)
    # A line cut off in its middle counts as not finished.
    with table.open("a") as stream:
        stream.write("0123456789abcdef,rodgym/Pend")
    again = []

    def counting(cases):
        # Backwards: the order in which cases are finished leaves no trace.
        for number, case in reversed(cases):
            again.append(number)
            yield number, run_case(case)

    run_study(study, table, counting)
    assert sorted(ran + again) == list(range(8))
    assert table.read_bytes() == finished
    run_study(study, table, counting)
    assert len(again) == 5


def test_a_table_of_another_study_is_refused_and_kept(study, finished, tmp_path):
    table = tmp_path / "table.csv"
    table.write_bytes(finished)
    other = parse({**CONTENT, "seeds": 3}, "other")
    with pytest.raises(StudyError, match="another study"):
        run_study(other, table)
    assert table.read_bytes() == finished
    table.write_text("a,b\n1,2\n")
    with pytest.raises(StudyError, match="not the table of a study"):
        run_study(study, table)


def test_a_wrong_belief_is_the_controllers_alone():
    case = {"env": CONTENT["env"], "seeds": 1, "policy": "lqr", "env.width": 0.007}
    right, same = run_case(case), run_case({**case, "design.width": 0.007})
    wrong = run_case({**case, "design.width": 0.0075})
    assert right == same
    assert wrong["return"] != right["return"]


def test_a_seed_names_the_first_episode_of_a_case():
    case = {"env": CONTENT["env"], "seeds": 2, "policy": "lqr"}
    both, first, second = (
        run_case(case | change)["return"]
        for change in ({"seed": 3}, {"seeds": 1, "seed": 3}, {"seeds": 1, "seed": 4})
    )
    assert first != second and both == pytest.approx((first + second) / 2, rel=1e-14)
    assert run_case(case) == run_case({**case, "seed": 0})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sweeep": {}}, "has no 'sweeep'"),
        ({"seeds": 0}, "seeds = 0"),
        ({"sweep": {"width": [1]}}, "'width' is no key of a case"),
        ({"sweep": {"policy": []}}, "is empty"),
        ({"sweep": {"policy": ["lqr"], "start.rate": [0]}}, "both fixed and swept"),
        ({"sweep": {"env.width": [0.007]}}, "names no policy"),
        ({"sweep": {"policy": [7]}}, "policy = 7"),
        ({"sweep": {"policy": "lqr", "seed": [0, -1]}}, "seed = -1"),
        ({"sweep": {"policy": "lqr", "env.width": {"from": 0, "to": 1}}}, "from, to and steps"),
        (
            {"sweep": {"policy": "lqr", "start.angle": {"from": "a", "to": 1, "steps": 2}}},
            "from = 'a'",
        ),
        (
            {"sweep": {"policy": "lqr", "start.angle": {"from": 0, "to": None, "steps": 2}}},
            "to = None",
        ),
        (
            {
                "sweep": {
                    "policy": "lqr",
                    "start.angle": {"from": 0, "to": float("inf"), "steps": 2},
                }
            },
            "to = inf",
        ),
        (
            {"sweep": {"policy": "lqr", "start.angle": {"from": 0, "to": 1, "steps": 10**12}}},
            "steps = 1000000000000 .* from 2 to 1000000",
        ),
        ({"fixed": {"start.rate": "fast"}}, "value = 'fast' of 'start.rate'"),
        ({"fixed": {"env.randomize": "{'width': (0.006"}}, "env.randomize: .* neither JSON nor"),
        ({"env": "rodgym/FinThrust-v0"}, "'start.rate' is no key of a case in rodgym/FinThrust-v0"),
        ({"env": "CartPole-v1"}, "unknown environment 'CartPole-v1'"),
        ({"plot": {"x": "env.width"}}, "needs x and value"),
        ({"plot": {"x": "env.wdth", "value": "upright"}}, "x = 'env.wdth' is no column"),
        ({"plot": {"x": "env.width", "value": "thrust"}}, "value = 'thrust' is no column"),
        ({"plot": {"x": "policy", "value": "upright"}}, "must be numbers, but has 'lqr'"),
        (
            {"plot": {"x": "env.width", "y": "start.angle", "value": "upright", "line": "policy"}},
            "has no line",
        ),
    ],
)
def test_what_is_no_study_is_refused(change, message):
    with pytest.raises(rodgym.RodgymError, match=message):
        parse({**CONTENT, **change}, "bad")


def test_values_are_read_as_python_spells_them_too():
    """YAML takes 1e-4 and whatever is Python's for text."""
    fixed = {
        "policy": "zero",
        "env.randomize": "{'width': (0.006, 0.009)}",
        "env.stepper": "implicit",
    }
    sweep = {"env.bending_damping": ["1e-4", 5e-4], "env.actuator_delay": [0.0]}
    study = parse({"env": CONTENT["env"], "fixed": fixed, "sweep": sweep}, "text")
    first, second = study.cases()
    assert first["env.bending_damping"] == 1e-4 and second["env.bending_damping"] == 5e-4
    assert (
        first["env.randomize"] == {"width": (0.006, 0.009)} and first["env.stepper"] == "implicit"
    )
    assert run_case({**first, "env.max_episode_steps": 2})["length"] == 0.02


def test_a_case_of_a_fin_has_no_start_of_a_rod():
    """It was a `KeyError` when the case was run."""
    case = {"env": "rodgym/FinThrust-v0", "seeds": 1, "policy": "zero", "start.angle": 0.1}
    with pytest.raises(StudyError, match=r"'start\.angle' is no start of a fin: there are none"):
        run_case(case)


def test_our_plans_can_be_read(tmp_path):
    assert {"attraction", "width", "stiffness", "damping", "delay"} <= plans().keys()
    assert all(len(read(name)) > 1 for name in plans())
    with pytest.raises(StudyError, match="ours are"):
        read(tmp_path / "missing.yml")


def test_the_study_in_the_documentation_can_be_read(tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "ray.md").read_text(encoding="utf-8")
    (tmp_path / "sweep.yml").write_text(page.split("```yaml\n")[1].split("```")[0])
    assert len(read(tmp_path / "sweep.yml")) == 5 * 7 * 3 * 3


def test_a_map_and_lines_are_drawn(study, finished, tmp_path):
    pytest.importorskip("matplotlib")
    rows = list(csv.DictReader(finished.decode().splitlines()))
    draw(study, rows, tmp_path / "map.png")
    plot = {"x": "env.width", "value": "return", "line": "policy"}
    draw(parse({**CONTENT, "plot": plot}, "lines"), rows[::2], tmp_path / "lines.png")
    for name in ("map.png", "lines.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    # Both widths in one point: their mean, and a band from one to the other.
    spread = {"x": "start.angle", "value": "return", "line": "policy"}
    draw(parse({**CONTENT, "plot": spread}, "band"), rows, tmp_path / "band.png")
    assert (tmp_path / "band.png").read_bytes() != (tmp_path / "lines.png").read_bytes()
    with pytest.raises(StudyError, match="'nothing' is no column"):
        draw(parse({**CONTENT, "plot": {**plot, "x": "nothing"}}, "bad"), rows, tmp_path / "x.png")


def test_a_study_that_could_not_be_drawn_is_not_run(tmp_path, monkeypatch, capsys):
    """Without matplotlib the program says so at once and leaves no folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.delitem(sys.modules, "rodgym.study.plot", raising=False)
    monkeypatch.delitem(sys.modules, "rodgym.report.style", raising=False)
    assert main(["study", "width"]) == 2
    assert "rodgym[report]" in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()
