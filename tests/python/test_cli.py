"""The `rodgym` program: what it answers to good and to bad input."""

import csv
import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rodgym
from PIL import Image
from rodgym import _native
from rodgym.cli import main
from rodgym.cli.app import build_parser, command_names, load_command
from rodgym.cli.arguments import key_value

ENV = "rodgym/PendulumSwingUp-v0"


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.mark.parametrize("name", command_names())
def test_every_command_has_help_with_an_example_that_its_parser_takes(
    name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main([name, "--help"])
    except SystemExit as leaving:
        code = leaving.code
    assert code == 0
    # The server, which is Rust, prints its own help.
    shown = capfd.readouterr().out
    assert name in shown
    assert "examples:" in shown or name == "serve"
    parser = build_parser()
    for line in load_command(name).EXAMPLES.strip().splitlines():
        program, *words = shlex.split(line)
        assert program == "rodgym"
        assert parser.parse_args(words).command == name


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("None", None),
        ("null", None),
        ("True", True),
        ("false", False),
        ("0.5", 0.5),
        ("[1, 2]", [1, 2]),
        ("bdf2", "bdf2"),
        ("1e-4", 1e-4),
        ('{"width": [0.006, 0.009]}', {"width": [0.006, 0.009]}),
        ("{'width': (0.006, 0.009)}", {"width": (0.006, 0.009)}),
        ("(1, 2)", (1, 2)),
        ("'None'", "None"),
        ("tcp://localhost:5555", "tcp://localhost:5555"),
        ("a=b", "a=b"),
        ("1j", "1j"),
        ("b'x'", "b'x'"),
        ("", ""),
    ],
)
def test_values_are_read_as_json_and_as_python_spells_them(text: str, value: object) -> None:
    assert key_value(f"name={text}") == ("name", value)


def test_a_range_as_python_spells_it_is_drawn_from() -> None:
    """The error once told what was given to be what it was."""
    for name, spelt in (
        ("python", "randomize={'width': (0.006, 0.009)}"),
        ("json", 'randomize={"width": [0.006, 0.009]}'),
    ):
        words = ["--env-arg", spelt]
        assert main(["evaluate", "zero", "--seeds", "3", "--name", name, *words]) == 0
    python, json_ = (rows(Path("runs") / name / "scores.csv") for name in ("python", "json"))
    assert python == json_
    facts = json.loads((Path("runs") / "python" / "run.json").read_text())
    assert facts["env_kwargs"] == {"randomize": {"width": [0.006, 0.009]}}


def test_the_bare_program_says_what_it_can_do(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    said = capsys.readouterr()
    assert all(name in said.out for name in command_names()) and "start here:" in said.out
    assert said.err == ""


def test_help_does_not_load_heavy_packages() -> None:
    code = (
        "import sys; from rodgym.cli.app import build_parser; build_parser(); "
        "heavy = {'torch', 'stable_baselines3', 'matplotlib', 'scipy'}; "
        "print(sorted(heavy & sys.modules.keys()))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["evaluate", "no-such-policy"], "no-such-policy"),
        (["evaluate", "lqr", "--env", "CartPole"], "CartPole"),
        (["evaluate", "lqr", "--seeds", "0"], "'0' names 0 seeds"),
        (["evaluate", "lqr", "--seeds", "5:3"], "'5:3' names 0 seeds"),
        (["evaluate", "lqr", "--seeds", "many"], "many"),
        (["evaluate", "lqr", "--env-arg", "width"], "NAME=VALUE"),
        (["evaluate", "lqr", "--env-arg", "width=-1"], "width"),
        (["evaluate", "lqr", "--env-arg", "colour=red"], "colour"),
        (["evaluate", "lqr", "--env-arg", "num_envs=3"], "num_envs"),
        (["evaluate", "lqr", "--env-arg", "max_episode_steps=-1"], "at least 1"),
        (["evaluate", "lqr", "--runs", __file__, "--seeds", "1"], "Not a directory"),
        (["evaluate", "lqr", "--name", "../elsewhere"], "../elsewhere"),
        (
            ["evaluate", "lqr", "--env-arg", "randomize={'width': (0.006"],
            "neither JSON nor a value",
        ),
        (["evaluate", "lqr", "--env-arg", "randomize={1, 2}"], "neither JSON nor a value"),
        (["train", "--set", "policy_kwargs={'net_arch': [64"], "neither JSON nor a value"),
        (["train", "--steps", "0"], "'0' is not a whole number"),
        (["train", "--seed", "-1"], "'-1' is not a whole number from 0"),
        (["train", "--algorithm", "DQN"], "DQN"),
        (["train", "--set", "n_envs=none"], "n_envs"),
        (["train", "--set", "speed=3"], "speed"),
        (["train", "--set", "learning_rate=abc"], "learning_rate = 'abc' is not allowed for PPO"),
        (["train", "--set", "learning_rate=lin_fast"], "'lin_fast' must be lin_ and a number"),
        (["train", "--set", "learning_rate=-1"], "Invalid learning rate"),
        (["train", "--set", "use_sde=3"], "it must be true or false"),
        (["train", "--set", "n_epochs=0"], "n_epochs = 0"),
        (["train", "--set", "n_steps=1.5"], "a whole number of at least 1"),
        (["train", "--set", "target_kl=low"], "a number or null"),
        (["train", "--set", "policy=Foo"], "Policy Foo unknown"),
        (["train", "--set", "policy_kwargs=3"], "it must be a mapping"),
        (["train", "--set", 'policy_kwargs={"activation_fn": "Foo"}'], "'Foo' is no class"),
        (["train", "--set", "frame_stack=100000"], "at most 1000"),
        (["train", "--set", "seed=4"], "'seed' is no hyperparameter of PPO"),
        (["train", "--env-arg", "width=-1"], "width"),
        (["train", "--runs", __file__, "--steps", "1"], "Not a directory"),
        (["train", "--recipe", "missing.yml"], "missing.yml"),
        (["compare", "--controller", "pid"], "pid"),
        (["compare", "--policy", ""], "'' names no policy"),
        (["compare", "--policy", "zoo", "--steps", "5", "--set", "gamma=1"], "--steps, --set"),
        (["compare", "--policy", "zoo", "--seed", "0"], "--seed: nothing is trained"),
        (["evaluate", "lqr", "--env", "rodgym/Remote-v0"], "server=tcp://HOST:5555"),
        (["compare", "--env", "Remote", "--env-arg", "server=tcp://a:1"], "env_id=ID"),
        (["list", "Remote"], "any environment of a server"),
        (["render", "lqr"], "--show"),
        (["render", "lqr", "film.mov"], "film.mov"),
        (["render", "lqr", "no/such/folder.gif"], "no/such"),
        (["render", "lqr", "strip.png", "--stills", "100000"], "'100000' is more than 100"),
        (["dance"], "dance"),
    ],
)
def test_bad_input_is_refused_in_one_sentence_with_code_2(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main(arguments)
    except SystemExit as leaving:
        code = leaving.code
    error = capsys.readouterr().err
    assert code == 2
    assert said in error.splitlines()[-1]
    assert "Traceback" not in error
    # What was refused leaves nothing behind.
    assert not Path("runs").exists()


def test_a_folder_is_not_written_over(capsys: pytest.CaptureFixture[str]) -> None:
    Path("film.gif").mkdir()
    assert main(["render", "lqr", "film.gif"]) == 2
    assert "it is a folder" in capsys.readouterr().err


def test_list_shows_every_registered_environment(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    shown = capsys.readouterr().out
    for name in (*rodgym.ENVIRONMENTS, "rodgym/Remote-v0"):
        assert name in shown


def test_list_of_one_environment_names_its_keywords(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "PendulumSwingUp"]) == 0
    shown = capsys.readouterr().out
    for keyword in ("width", "youngs_modulus", "bending_damping"):
        assert keyword in shown
    # Formula and range of each term, and how exact the steps are.
    assert "(1 + y / L) / 2" in shown and "-0.02 ... 0" in shown and "6e-05" in shown


def test_doctor_names_versions_extras_and_what_holds_the_physics_back(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["doctor", "--speed"]) == 0
    shown = capsys.readouterr().out
    assert rodgym.__version__ in shown and _native.instruction_set() in shown
    assert re.search(r"gymnasium +\d", shown) and re.search(r"render +installed", shown)
    speed = re.search(r"([\d ]+) steps of the default pendulum a second", shown)
    assert speed and int(speed[1].replace(" ", "")) > 1000
    monkeypatch.setattr(_native, "instruction_set", lambda: "baseline")
    monkeypatch.setattr("rodgym.extras.installed", lambda module: module != "zmq")
    assert main(["doctor"]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"remote +lacks zmq$", shown, re.MULTILINE)
    assert ("holds the physics back" in shown) == (_native.INSTRUCTION_SETS[-1] != "baseline")


def test_completion_offers_what_the_parsers_take(capsys: pytest.CaptureFixture[str]) -> None:
    def after(*words: str) -> set[str]:
        assert main(["completion", "--words", *words]) == 0
        return set(capsys.readouterr().out.split())

    assert set(command_names()) <= after()
    assert {"PendulumSwingUp"} <= after("list") & after("evaluate", "lqr", "--env")
    assert {"lqr", "zoo"} <= after("evaluate") & after("compare", "--policy")
    assert {"--seeds", "--env"} <= after("evaluate", "lqr")
    assert after("evaluate", "lqr", "--trajectories") == {"csv", "parquet"}
    assert after("no-such-command") == set()
    assert main(["completion"]) == 2
    assert "bash, zsh or fish" in capsys.readouterr().err


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_the_script_for_bash_completes_there() -> None:
    """Bash reads the script, then completes a word with a `rodgym` that is this package."""
    program = f'rodgym() {{ "{sys.executable}" -m rodgym "$@"; }}'
    asked = 'COMP_WORDS=(rodgym evalu); COMP_CWORD=1; _rodgym; echo "${COMPREPLY[@]}"'
    script = f'{program}\neval "$(rodgym completion bash)"\n{asked}'
    ran = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    assert ran.stdout.split() == ["evaluate"], ran.stderr


def test_evaluate_writes_one_row_per_seed_and_says_how_it_was_made(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["evaluate", "lqr", "--seeds", "3:7", "--name", "check"]) == 0
    table = rows(Path("runs/check/scores.csv"))
    assert [row["seed"] for row in table] == ["3", "4", "5", "6"]
    assert all(float(row["return"]) > 0 for row in table)
    facts = json.loads(Path("runs/check/run.json").read_text())
    assert facts["env"] == ENV
    assert facts["versions"]["numpy"] == np.__version__
    assert "mean of 4 episodes" in capsys.readouterr().out


def test_render_draws_a_moving_picture_and_a_strip_of_stills() -> None:
    assert main(["render", "lqr", "swing.gif", "--seed", "1"]) == 0
    with Image.open("swing.gif") as film:
        # Five seconds of episode, then a pause; equal pictures are stored once, so count time.
        shown = 0
        for k in range(film.n_frames):
            film.seek(k)
            shown += film.info["duration"]
        assert 5000 <= shown <= 7000
        film.seek(0)
        first = np.asarray(film.convert("RGB"), int)
        film.seek(40)
        assert np.abs(np.asarray(film.convert("RGB"), int) - first).max() > 50
    assert main(["render", "lqr", "strip.png", "--stills", "3"]) == 0
    with Image.open("strip.png") as strip:
        assert strip.width > 2 * strip.height


def test_python_dash_m_is_the_same_program() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rodgym", "evaluate", "nobody"], capture_output=True, text=True
    )
    assert done.returncode == 2
    assert done.stderr.startswith("rodgym evaluate: error: policy 'nobody'")
