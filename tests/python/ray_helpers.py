"""Ray clusters for tests: of this machine alone, gone afterwards."""

from __future__ import annotations

import contextlib
import importlib
import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator

import pytest

# Before Ray is imported: it would write a token of its own into the user's home.
os.environ["RAY_AUTH_MODE"] = "token"
os.environ["RAY_AUTH_TOKEN"] = secrets.token_hex()
os.environ["RAY_USAGE_STATS_ENABLED"] = "0"

#: Long proofs, and no excuse for a missing package.
LONG = bool(os.environ.get("RODGYM_NEED_RAY"))


def need_ray(module: str, reason: str) -> None:
    """Skips the test module that asks where a module of Ray is missing."""
    if LONG:
        importlib.import_module(module)
    pytest.importorskip(module, reason=reason, exc_type=ImportError)


@contextlib.contextmanager
def short_folder() -> Iterator[str]:
    """A folder with a name that leaves room for sockets in it (107 characters in all)."""
    folder = tempfile.mkdtemp(prefix="r", dir="/tmp")
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def running_cases() -> dict[int, str]:
    """Process ids of workers that compute a case of a study just now."""
    from rodgym.ray.study import TASK

    return {pid: name for pid, name in processes().items() if name.startswith(f"ray::{TASK}")}


def processes(parent: int | None = None) -> dict[int, str]:
    """The processes below this one, or below `parent`, with their command lines."""
    import psutil

    found = {}
    for process in psutil.Process(parent).children(recursive=True):
        with contextlib.suppress(psutil.Error):
            if process.status() != psutil.STATUS_ZOMBIE:
                found[process.pid] = " ".join(process.cmdline())
    return found


def alive(pid: int) -> bool:
    """Whether a process runs, whoever its parent is by now."""
    import psutil

    with contextlib.suppress(psutil.Error):
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    return False
