"""A run's folder, ``runs/<name>/``, and what is written down about how it was made."""

from __future__ import annotations

import csv
import datetime
import importlib.metadata
import json
import os
import platform
import re
import shlex
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rodgym

PACKAGES = ("rodgym", "gymnasium", "numpy", "stable-baselines3", "torch", "matplotlib")


def default_name(command: str, env_id: str) -> str:
    """``compare`` and ``rodgym/PendulumSwingUp-v0`` make ``compare-pendulumswingup``."""
    machine = re.split("[:/]", env_id)[-1].partition("-v")[0].lower()
    return f"{command}-{machine}"


class RunError(rodgym.RodgymError, ValueError):
    """A run that cannot be named or written so."""


@dataclass
class Run:
    """Where results land. Files of an earlier run of the same name are replaced one by one; a run
    that must replace nothing is `beside` the earlier ones.

    The folder is made when its first file is asked for, so that a run which is refused leaves none.

    Parameters
    ----------
    name: folder below ``root``: letters, digits, ``-``, ``_`` and ``.``
    root: folder of all runs
    """

    name: str
    root: Path = Path("runs")
    facts: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}", self.name):
            raise RunError(
                f"run name {self.name!r}: allowed are up to 100 letters, digits, '-', '_' and '.'"
            )
        self.root = Path(self.root)
        self.facts = {**provenance(), **self.facts}

    def beside(self) -> Run:
        """Itself, or, where its folder holds an earlier run, the first free ``name-2``, ..."""
        number, run = 1, self
        while run.path.exists() and (not run.path.is_dir() or any(run.path.iterdir())):
            number += 1
            run = Run(f"{self.name}-{number}", self.root, self.facts)
        return run

    @property
    def path(self) -> Path:
        """The folder."""
        return self.root / self.name

    def file(self, name: str) -> Path:
        """A file of this run, in a folder that is there."""
        return self.folder() / name

    def folder(self) -> Path:
        """The folder, made now where it is not there."""
        self.path.mkdir(parents=True, exist_ok=True)
        return self.path

    def keep_policy(self) -> None:
        """Refuses to go on where a training would replace the policy of an earlier one.

        Raises
        ------
        RunError: the folder has a policy
        """
        policy = self.path / "policy.zip"
        if policy.exists():
            raise RunError(
                f"{policy} is there from an earlier training: choose another --name, "
                "or give --force to replace it"
            )

    def write_facts(self) -> None:
        """Writes ``run.json``: command, versions, machine and what was added to ``facts``."""
        text = json.dumps(self.facts, indent=2, default=str) + "\n"
        self.file("run.json").write_text(text, encoding="utf-8")


def provenance() -> dict[str, Any]:
    """The command, the time, the versions and the machine."""
    return {
        "command": command_line(),
        "date": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        "versions": versions(),
        "commit": commit(),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
    }


def commit() -> str | None:
    """The commit of rodgym's own clone, with a + where files differ from it; None elsewhere."""
    clone = Path(rodgym.__file__).parents[3]
    if not (clone / "py-bindings").is_dir():
        return None

    def git(*words: str) -> str | None:
        try:
            done = subprocess.run(
                ["git", "-C", str(clone), *words], capture_output=True, text=True, timeout=10
            )
        except (OSError, subprocess.TimeoutExpired):
            return None
        return done.stdout.strip() if done.returncode == 0 else None

    head = git("rev-parse", "HEAD")
    return None if head is None else head + ("+" if git("status", "--porcelain") else "")


def command_line() -> str:
    """The command as a user would type it."""
    program = Path(sys.argv[0])
    if program.name == "__main__.py":
        return shlex.join(["python", "-m", program.parent.name, *sys.argv[1:]])
    return shlex.join([program.name, *sys.argv[1:]])


def versions() -> dict[str, str]:
    """Python and the packages that matter, where installed."""
    installed = {
        name: importlib.metadata.version(name)
        for name in PACKAGES
        if next(iter(importlib.metadata.distributions(name=name)), None)
    }
    return {"python": platform.python_version(), **installed}


def write_csv(path: str | Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Writes a table; floats with all their digits."""
    with Path(path).open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
