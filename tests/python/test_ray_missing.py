"""Without Ray, `rodgym.ray` and `rodgym study --ray` say which extra to install."""

import subprocess
import sys

import pytest

WITHOUT = "import sys; sys.modules['ray'] = None; "


def run(code):
    return subprocess.run([sys.executable, "-c", WITHOUT + code], capture_output=True, text=True)


def test_importing_says_which_extra_to_install():
    done = run("import rodgym.ray")
    assert done.returncode == 1
    assert 'pip install "rodgym[ray]"' in done.stderr.splitlines()[-1]


def test_the_program_says_it_in_one_sentence():
    pytest.importorskip("yaml")
    done = run(
        "from rodgym.cli import main; sys.exit(main(['study', 'attraction', '--ray', 'local']))"
    )
    assert done.returncode == 2
    assert done.stderr == "rodgym study: error: this needs ray: pip install 'rodgym[ray]'\n"


def test_everything_else_works():
    done = run("import rodgym, gymnasium; gymnasium.make('rodgym/PendulumSwingUp-v0').reset()")
    assert done.returncode == 0, done.stderr
