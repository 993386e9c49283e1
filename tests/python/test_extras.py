"""Promise: every command says before it works which extra it needs, in one sentence with code 2,
and needs no more than it uses: with that one extra it works."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from rodgym.extras import EXTRAS, extras_with, missing

PROJECT = Path(__file__).parents[2] / "pyproject.toml"

#: Modules that come with those of an extra, by the packages' own requirements.
BESIDE = {"matplotlib": ("PIL",), "ray": ("msgpack",)}
ALL = sorted({module for modules in EXTRAS.values() for module in modules})

#: Run with the extra's name and a list of commands: hides what the extra does not bring, then does
#: one command after the other and prints code, errors and whether a folder was made.
PROGRAM = """
import contextlib, importlib.abc, importlib.util, io, json, os, sys
hidden, commands = json.loads(sys.argv[1])
class Hider(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in hidden:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Hider())
# Who only asks for a module (torch does, for onnx) is told that there is none.
real = importlib.util.find_spec
def find_spec(name, package=None):
    return None if name.partition(".")[0] in hidden else real(name, package)
importlib.util.find_spec = find_spec
from rodgym.cli import main
results = []
for words in commands:
    before = set(os.listdir("."))
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = main(words)
        except SystemExit as leaving:
            code = leaving.code
        except BaseException as error:
            code = repr(error)
    results.append([code, out.getvalue(), err.getvalue(), sorted(set(os.listdir(".")) - before)])
print("results " + json.dumps(results))
"""

STUDY = {
    "env": "rodgym/PendulumSwingUp-v0",
    "fixed": {"env.max_episode_steps": 3},
    "sweep": {"policy": ["lqr"], "env.width": [0.007, 0.008]},
    "plot": {"x": "env.width", "value": "return"},
}
SHORT = ("--env-arg", "max_episode_steps=5")
PLAY = ("--seeds", "2", *SHORT, "--runs")

#: A name, a command (its run folder is its name) and the extras with each of which alone it works;
#: None: it needs none at all.
COMMANDS: list[tuple[str, list[str], set[str] | None]] = [
    ("list", ["list"], None),
    ("list of one", ["list", "PendulumSwingUp"], None),
    ("doctor", ["doctor"], None),
    ("completion", ["completion", "bash"], None),
    ("evaluate", ["evaluate", "lqr", *PLAY, "evaluate"], None),
    ("steps", ["evaluate", "lqr", "--trajectories", "parquet", *PLAY, "steps"], {"data", "lab"}),
    ("evaluate-zoo", ["evaluate", "zoo", *PLAY, "evaluate-zoo"], {"train"}),
    ("gif", ["render", "lqr", "lqr.gif", *SHORT], {"render", "report", "train", "ray", "lab"}),
    ("film", ["render", "lqr", "lqr.mp4", *SHORT], {"render", "report", "train"}),
    ("strip", ["render", "zoo", "zoo.png", *SHORT], {"train"}),
    ("window", ["render", "lqr", "--show", *SHORT], {"render"}),
    (
        "compare",
        ["compare", "--policy", "lqr", "--controller", "zero", *PLAY, "compare"],
        {"report", "train", "lab"},
    ),
    ("compare-zoo", ["compare", "--policy", "zoo", *PLAY, "compare-zoo"], {"train"}),
    (
        "train",
        ["train", "--steps", "64", "--set", "n_envs=8", "--set", "n_steps=8", "--set",
         "batch_size=64", *SHORT, "--runs", "train"],
        {"train"},
    ),
    (
        "distil",
        ["distil", "--rounds", "1", "--set", "batches=2", "--set", "rods=2", *SHORT, "--runs",
         "distil"],
        {"train"},
    ),
    ("study", ["study", "plan.yml", "--runs", "study"], {"report", "ray", "train", "lab"}),
    ("serve", ["serve", "--version"], None),
    (
        "remote",
        ["evaluate", "lqr", "--env", "Remote", "--env-arg", "server=tcp://127.0.0.1:9",
         "--env-arg", "env_id=rodgym/PendulumSwingUp-v0", "--env-arg", "timeout=0.1"],
        {"remote"},
    ),
]  # fmt: skip


def brought(extra: str | None) -> set[str]:
    own = set(EXTRAS[extra]) if extra else set()
    return own | {more for module in own for more in BESIDE.get(module, ())}


def run(extra: str | None, commands: list[list[str]], folder: Path) -> list[list]:
    hidden = sorted({*ALL, "ray", "msgpack"} - brought(extra))
    (folder / "plan.yml").write_text(json.dumps(STUDY))
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, json.dumps([hidden, commands])],
        capture_output=True,
        text=True,
        cwd=folder,
        env={**os.environ, "SDL_VIDEODRIVER": "dummy"},
    )
    line = done.stdout.splitlines()[-1] if done.stdout else ""
    assert line.startswith("results "), done.stderr
    return json.loads(line.removeprefix("results "))


@pytest.mark.parametrize("extra", [None, *EXTRAS])
def test_each_command_with_each_extra_alone(extra, tmp_path):
    here = [module for module in brought(extra) if missing([module])]
    if here:
        pytest.skip(f"not installed: {', '.join(here)}")
    results = run(extra, [words for _, words, _ in COMMANDS], tmp_path)
    for (name, words, fits), (code, out, err, made) in zip(COMMANDS, results, strict=True):
        told = f"{name} with {extra}: {code} {err} {out}"
        if fits is None or extra in fits:
            if name == "remote":
                # Nobody listens there: it got as far as the network.
                assert code == 2 and "127.0.0.1:9" in err, told
            else:
                assert code == 0, told
            continue
        pattern = rf"rodgym {words[0]}: error: this needs .+: pip install 'rodgym\[(.+)\]'\n"
        said = re.fullmatch(pattern, err)
        assert code == 2 and said, told
        # The extra that is named is one with which the command works.
        assert said[1] in fits, told
        assert made == [] and out == "", told


def test_what_is_missing_is_told_with_the_fewest_extras_for_all_that_is_needed():
    assert extras_with(["matplotlib", "jinja2", "PIL"]) == ("report",)
    assert extras_with(["stable_baselines3", "yaml", "matplotlib"]) == ("train",)
    assert extras_with(["pygame", "stable_baselines3"]) == ("render", "train")
    assert extras_with(["cv2", "scipy"]) == ("lab",)
    assert extras_with(["control"]) is None
    assert missing(["json"]) is None
    assert missing(["json", "no_such_module"]) == "this needs no_such_module"


def test_the_extras_are_those_of_the_project():
    tomllib = pytest.importorskip("tomllib")
    listed = tomllib.loads(PROJECT.read_text())["project"]["optional-dependencies"]
    names = {"stable-baselines3": "stable_baselines3", "sb3-contrib": "sb3_contrib",
             "pyyaml": "yaml", "pyzmq": "zmq", "pillow": "PIL",
             "imageio-ffmpeg": "imageio_ffmpeg", "opencv-python-headless": "cv2"}  # fmt: skip
    for extra, modules in EXTRAS.items():
        packages = {re.split(r"[<>=\[]", text)[0] for text in listed[extra]}
        # PyTorch is a requirement of Stable-Baselines3.
        assert {names.get(p, p) for p in packages} == set(modules) - {"torch"}, extra


def test_a_bench_without_matplotlib_says_so_first_and_ends_well(tmp_path, monkeypatch, capsys):
    """It worked for minutes and was lost."""
    from rodgym.bench import report, session
    from rodgym.bench.precision import Point
    from rodgym.runs import Run

    points = [Point("rodgym Verlet", 1e-3, 1e-6, 1e-4)]
    monkeypatch.setattr(report, "installed", lambda module: False)
    table = report.write_precision(Run("bench", tmp_path), points)
    assert "rodgym Verlet" in table
    assert [path.name for path in (tmp_path / "bench").iterdir()] == ["precision.csv"]
    monkeypatch.setattr(session, "missing", lambda modules: f"this needs {modules[0]}")
    monkeypatch.setattr(session, "headline_cases", lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        session.bench(Run("bench", tmp_path), session.QUICK)
    assert "no picture of error against cost: this needs matplotlib" in capsys.readouterr().out


def test_the_bar_needs_no_rich(monkeypatch, capsys):
    from rodgym import progress

    monkeypatch.setattr(progress, "installed", lambda module: False)
    with progress.Bar("study", 4) as bar:
        bar.at(2)
        bar.say("half")
    assert capsys.readouterr().err == "study:  50%  half\n"
