"""Promise: the type stub of the native module says what the module has."""

from __future__ import annotations

import subprocess
import sys

import pytest


def test_stub_matches_the_module(tmp_path):
    pytest.importorskip("mypy")
    # PyO3 lists the module's names in `__all__`, which a stub has no need to repeat.
    allowed = tmp_path / "allowed"
    allowed.write_text("rodgym._native.__all__\n")
    command = [sys.executable, "-m", "mypy.stubtest", "rodgym._native", "--ignore-disjoint-bases"]
    # What the stub imports is none of this test's business, and slow to read.
    config = tmp_path / "mypy.ini"
    config.write_text("[mypy]\nfollow_imports = skip\n")
    command += ["--allowlist", str(allowed), "--mypy-config-file", str(config)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
