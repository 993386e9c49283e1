"""Promise: the examples in the documentation run, and pages say what the environments have."""

from __future__ import annotations

import doctest
import importlib
import runpy
import warnings
from pathlib import Path

import gymnasium as gym
import pytest
from conftest import SWING_UP

DOCS = sorted((Path(__file__).parents[2] / "docs").glob("*.md"))


@pytest.mark.parametrize(
    "page", [page for page in DOCS if ">>> " in page.read_text()], ids=lambda page: page.name
)
def test_pages(page):
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
    pages = runpy.run_path(str(DOCS[0].parent / "pages.py"))
    for name, title, environment in pages["PAGES"]:
        written = (DOCS[0].parent / name).read_text()
        assert written == pages["page"](title, environment), "run python docs/pages.py"


def test_the_page_lists_every_keyword_with_default_and_unit():
    env = gym.make(SWING_UP).unwrapped
    rows = {}
    for line in (DOCS[0].parent / "pendulum.md").read_text().split("## Arguments")[1].splitlines():
        cells = [cell.strip() for cell in line.strip("| \n").split("|")]
        if line.startswith("| `"):
            rows[cells[0].strip("`")] = cells[1:]
    assert set(rows) == {*env.config, "render_mode"}
    for parameter in env._batch.spec["parameters"]:
        default, unit, _ = rows[parameter["name"]]
        assert float(default) == parameter["default"] and unit == parameter["unit"]
    assert int(rows["nodes"][0]) == env.config["nodes"]
    assert float(rows["control_dt"][0]) == env.config["control_dt"]
