"""The README promises nothing that does not run."""

import re
import shlex
from pathlib import Path

import gymnasium as gym
import pytest
import rodgym
from rodgym.cli.app import build_parser

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    """The code blocks of a language."""
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


@pytest.fixture(autouse=True)
def one_torch_thread() -> None:
    """On a shared machine, threads that wait for each other take minutes over a small network."""
    torch = pytest.importorskip("torch")
    torch.set_num_threads(1)


@pytest.mark.parametrize("code", blocks("python"))
def test_every_python_block_runs_and_is_short(
    code: str, capsys: pytest.CaptureFixture[str]
) -> None:
    exec(compile(code, "README.md", "exec"), {"__name__": "readme"})
    assert capsys.readouterr().out.strip()
    assert len(code.splitlines()) <= 14


def test_the_controller_example_stands_at_the_end(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = [block for block in blocks("python") if "Lqr" in block]
    exec(compile(code, "README.md", "exec"), {"__name__": "readme"})
    assert float(capsys.readouterr().out) > 0.999


def test_every_command_is_one_that_the_program_takes() -> None:
    lines = [line.partition("#")[0] for block in blocks("bash") for line in block.splitlines()]
    commands = [shlex.split(line) for line in lines if line.startswith("rodgym ")]
    assert len(commands) >= 4
    parser = build_parser()
    for words in commands:
        assert parser.parse_args(words[1:]).command == words[1]


def test_every_make_target_exists() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = re.findall(r"^make ([a-z-]+)", "\n".join(blocks("bash")), flags=re.MULTILINE)
    assert {"demo", "test"} <= set(targets)
    for target in targets:
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target


def test_the_table_of_environments_lists_what_the_package_has() -> None:
    listed = set(re.findall(r"^\| `(rodgym/[A-Za-z]+-v\d+)` \|", README, flags=re.MULTILINE))
    assert listed and listed <= set(rodgym.ENVIRONMENTS)
    for name, steps in re.findall(r"^\| `(rodgym/\S+)` .* (\d+) steps \|$", README, re.MULTILINE):
        spec = gym.spec(name)
        assert spec.max_episode_steps == int(steps)


def test_every_linked_file_exists() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        if "://" not in target:
            assert (ROOT / target).exists(), target
