"""Ray clusters for tests: of this machine alone, gone afterwards."""

from __future__ import annotations

import contextlib
import importlib
import os
import secrets
import shutil
import tempfile
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from remote_helpers import until

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


def running_cases() -> list[Any]:
    """Workers below this process that compute a case of a study just now."""
    from rodgym.ray.study import TASK

    return [p for p in processes() if name(p).startswith(f"ray::{TASK}")]


class Killer(threading.Thread):
    """Kills the next worker that computes a case.

    Beside the study: while a study waits for its callback, it may be that no case is running.
    """

    victim: Any = None

    def __init__(self) -> None:
        super().__init__(daemon=True)

    def run(self) -> None:
        until(self._found, 30)
        self.victim.kill()

    def _found(self) -> bool:
        self.victim = next(iter(running_cases()), None)
        return self.victim is not None


def processes(parent: int | None = None) -> list[Any]:
    """The processes below this one, or below `parent` (`psutil.Process`)."""
    import psutil

    return [p for p in psutil.Process(parent).children(recursive=True) if alive(p)]


def name(process: Any) -> str:
    """Its command line; nothing once it has ended."""
    import psutil

    try:
        return " ".join(process.cmdline())
    except psutil.Error:
        return ""


def alive(process: Any) -> bool:
    """Whether it runs: that very process, not another with its number."""
    import psutil

    with contextlib.suppress(psutil.Error):
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    return False
