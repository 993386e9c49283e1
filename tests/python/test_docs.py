"""Promise: the examples in the documentation run, and pages say what the environments have."""

from __future__ import annotations

import ast
import doctest
import importlib
import re
import warnings
from pathlib import Path

import gymnasium as gym
import pages
import pytest
from conftest import SWING_UP
from rodgym.errors import ParameterError

THRUST = "rodgym/FinThrust-v0"
ROOT = Path(__file__).parents[2] / "docs"
DOCS = sorted(ROOT.rglob("*.md"))


@pytest.mark.parametrize(
    "page",
    [page for page in DOCS if ">>> " in page.read_text()],
    ids=lambda page: str(page.relative_to(ROOT)),
)
def test_pages(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if "stable_baselines3" in page.read_text():
        pytest.importorskip("stable_baselines3")
    with warnings.catch_warnings():
        result = doctest.testfile(str(page), module_relative=False)
    assert result.attempted > 0 and result.failed == 0


@pytest.mark.parametrize("name", ["rodgym.envs.pendulum", "rodgym.envs.fin", "rodgym.sim"])
def test_docstrings(name):
    result = doctest.testmod(importlib.import_module(name))
    assert result.attempted > 0 and result.failed == 0


def test_environment_pages_are_those_of_the_docstrings():
    for name, title, environment in pages.PAGES:
        written = (ROOT / name).read_text()
        assert written == pages.page(name, title, environment), "run python docs/pages.py"


@pytest.mark.parametrize(("page", "env_id"), [("pendulum.md", SWING_UP), ("fin.md", THRUST)])
def test_the_page_lists_every_keyword_with_default_range_and_unit(page, env_id):
    env = gym.make(env_id).unwrapped
    rows = {}
    for line in (ROOT / page).read_text().split("## Arguments")[1].splitlines():
        cells = [cell.strip() for cell in line.strip("| \n").split("|")]
        if line.startswith("| `"):
            rows[cells[0].strip("`")] = cells[1:]
    assert set(rows) == {*env.config, "render_mode", "render_size"}
    for parameter in env.core_spec["parameters"]:
        default, allowed, unit, _ = rows[parameter["name"]]
        low, high = (float(bound) for bound in allowed.split(" to "))
        assert float(default) == parameter["default"] and unit == parameter["unit"]
        assert (low, high) == (parameter["low"], parameter["high"])
    assert float(rows["control_dt"][0]) == env.config["control_dt"]
    # What the page calls a default is what an environment takes without the keyword.
    for name in ("sensor_noise", "actuator_delay", "thesis", "observation"):
        given = ast.literal_eval(rows[name][0])
        assert gym.make(env_id, **{name: given}).unwrapped.config == env.config


def test_a_keyword_that_is_out_of_its_documented_range_is_refused():
    for env_id in (SWING_UP, THRUST):
        for row in gym.make(env_id).unwrapped.core_spec["keywords"]:
            numbers = re.fullmatch(
                r"(?:a number|an integer) from (\S+) to (\S+?)(, or None)?", row["allowed"]
            )
            if numbers:
                too_large = type(ast.literal_eval(numbers[2]))(2 * float(numbers[2]) + 1)
                with pytest.raises(ParameterError, match=re.escape(row["allowed"].split(",")[0])):
                    gym.make(env_id, **{row["name"]: too_large})
