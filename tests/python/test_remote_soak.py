"""Promise: many clients at once, some over connections that keep breaking, lose and repeat nothing,
and the server does not grow. A short run of tests/long/remote_soak.py (`make soak`: 30 minutes)."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from remote_helpers import need_server

need_server()

SOAK = Path(__file__).parents[1] / "long" / "remote_soak.py"


def test_eight_clients_for_ten_seconds():
    command = [sys.executable, str(SOAK), "--minutes", "0.17", "--clients", "8"]
    # Its helpers are ours.
    here = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=300, check=False, env=here
    )
    assert done.returncode == 0, done.stderr
    assert "8 clients" in done.stdout
