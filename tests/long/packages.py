"""Wheel and source archive as a stranger gets them: `make packages`.

Builds both into dist/, installs each in fresh environments and tries it there: the wheel alone,
with each extra alone, and what the source archive builds. Ends with an error where something fails,
where the wheel is larger than 8 MB, or where importing rodgym adds more than 0.15 s to importing
Gymnasium.

    python tests/long/packages.py                    # everything
    python tests/long/packages.py --extras render    # the wheel, and these extras
    python tests/long/packages.py --no-sdist         # all but the compilation of the source archive
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
DIST = ROOT / "dist"
LARGEST, SLOWEST = 8_000_000, 0.15
#: What is tried with the wheel alone.
PLAIN = (
    ("rodgym", "--version"),
    ("rodgym", "doctor"),
    ("rodgym", "list", "PendulumSwingUp"),
    ("rodgym", "evaluate", "lqr", "--seeds", "3", "--name", "plain"),
)
#: What is tried with each extra alone, beside that. An extra of two names is both of them.
WITH_EXTRA = {
    "report": [
        ("rodgym", "compare", "--policy", "lqr", "--controller", "lqr-hybrid", "--seeds", "2")
    ],
    "render": [("rodgym", "render", "lqr", "swing.gif")],
    "remote": [("python", "-c", "import rodgym.remote")],
    "data": [
        ("rodgym", "evaluate", "lqr", "--seeds", "2", "--trajectories", "parquet", "--name", "d")
    ],
    "export": [("python", "-c", "import rodgym.export, onnxruntime")],
    "train": [
        ("rodgym", "evaluate", "zoo", "--seeds", "2", "--name", "z"),
        ("rodgym", "train", "--steps", "9000", "--name", "t"),
    ],
    "train,tune": [("rodgym", "tune", "--trials", "1", "--steps", "9000", "--name", "u")],
    "ray": [("python", "-c", "import rodgym.ray; rodgym.ray.register()")],
}
#: A command that needs an extra which is not here says which one, at once, with exit code 2.
LACKING = (
    (("rodgym", "train"), "rodgym[train]"),
    (("rodgym", "compare"), "rodgym[train]"),
    (("rodgym", "render", "lqr", "x.gif"), "rodgym[render]"),
)


class Fresh:
    """A new environment in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        subprocess.run([sys.executable, "-m", "venv", folder / "venv"], check=True)
        self.bin = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")

    def install(self, what: str) -> None:
        """Installs by pip."""
        self.run("python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", what)

    def run(self, program: str, *words: str, code: int = 0) -> str:
        """What a program of the environment prints; it must end with this code."""
        clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
        ran = subprocess.run(
            [self.bin / program, *words], cwd=self.folder, env=clean, text=True, capture_output=True
        )
        shown = f"{program} {' '.join(words)}"
        if ran.returncode != code:
            sys.exit(f"{shown}: exit code {ran.returncode}\n{ran.stdout}{ran.stderr}")
        return ran.stdout + ran.stderr

    def seconds_of(self, code: str) -> float:
        """Median wall time of a short program."""
        times = []
        for _ in range(7):
            began = time.perf_counter()
            self.run("python", "-c", code)
            times.append(time.perf_counter() - began)
        return statistics.median(times)


def build(*words: str) -> Path:
    """The file that maturin writes."""
    before = set(DIST.glob("*"))
    subprocess.run([sys.executable, "-m", "maturin", *words, "--out", DIST], cwd=ROOT, check=True)
    files = set(DIST.glob("*")) - before or set(DIST.glob("*.gz" if "sdist" in words else "*.whl"))
    return max(files, key=lambda path: path.stat().st_mtime)


def try_plain(fresh: Fresh, package: Path) -> None:
    """Everything that needs no extra, and what lacks one."""
    fresh.install(str(package))
    for command in PLAIN:
        fresh.run(*command)
    for command, words in LACKING:
        began = time.perf_counter()
        said = fresh.run(*command, code=2)
        took = time.perf_counter() - began
        if words not in said or took > 10:
            sys.exit(f"{' '.join(command)} says after {took:.1f} s: {said}")


def main() -> None:
    """See the file's docstring."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--extras", nargs="*", default=list(WITH_EXTRA), metavar="EXTRA")
    parser.add_argument("--no-sdist", action="store_true")
    args = parser.parse_args()
    wheel = build("build", "--release")
    size = wheel.stat().st_size
    print(f"{wheel.name}: {size / 1e6:.2f} MB")
    if size > LARGEST:
        sys.exit(f"that is more than {LARGEST / 1e6:g} MB")
    with tempfile.TemporaryDirectory() as folder:
        fresh = Fresh(Path(folder))
        try_plain(fresh, wheel)
        alone = fresh.seconds_of("import gymnasium")
        added = fresh.seconds_of("import gymnasium, rodgym") - alone
        print(f"alone: works; importing rodgym adds {added:.3f} s to {alone:.3f} s of Gymnasium")
        if added > SLOWEST:
            sys.exit(f"that is more than {SLOWEST} s")
    for extra in args.extras:
        with tempfile.TemporaryDirectory() as folder:
            fresh = Fresh(Path(folder))
            fresh.install(f"rodgym[{extra}] @ {wheel.as_uri()}")
            for command in (PLAIN[-1], *WITH_EXTRA[extra]):
                fresh.run(*command)
            print(f"[{extra}]: works")
    if not args.no_sdist:
        archive = build("sdist")
        with tempfile.TemporaryDirectory() as folder:
            try_plain(Fresh(Path(folder)), archive)
        print(f"{archive.name}: builds and works")


if __name__ == "__main__":
    main()
