"""Wheel and source archive as a stranger gets them: `make packages`.

Builds both into dist/, installs each in fresh environments and tries it there: the wheel alone,
with each extra alone, what the source archive builds, and beside the wheel that of
`examples/own-task`, which adds a task in Rust. Ends with an error where something fails,
where the wheel is larger than 8 MB, or where importing rodgym adds more than 0.15 s to importing
Gymnasium. What was tried with the same file is not tried again: stopped, it goes on where it was.
It writes docs/records/packages.md, which also says what was not tried yet.

    python tests/long/packages.py                       # everything
    python tests/long/packages.py --extras render       # the wheel, and these extras
    python tests/long/packages.py --no-sdist            # not what the source archive builds
    python tests/long/packages.py --no-own              # not the wheel of examples/own-task
    python tests/long/packages.py --wheel dist/X.whl    # a wheel that is built already
"""

from __future__ import annotations

import argparse
import datetime
import hashlib
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

ROOT = Path(__file__).parents[2]
DIST = ROOT / "dist"
OWN_CRATE = ROOT / "examples" / "own-task" / "wheel" / "Cargo.toml"
LOG = ROOT / "runs" / "packages" / "log.json"
PAGE = ROOT / "docs" / "records" / "packages.md"
LARGEST, SLOWEST = 8_000_000, 0.15
#: What is tried with the wheel alone.
PLAIN = (
    ("rodgym", "--version"),
    ("rodgym", "doctor"),
    ("rodgym", "list", "PendulumSwingUp"),
    ("rodgym", "serve", "--version"),
    ("rodgym", "evaluate", "lqr", "--seeds", "3", "--name", "plain"),
)
#: A film of a rod, made by the simulation, for the commands that read one.
FILM = """
from rodgym.lab.bench import Bench, Flaws, record
(film,) = record([Bench(rod={"youngs_modulus": 8.3e6}, flaws=Flaws(noise=5e-4))], seeds=[7])
film.write("film.csv")
"""
#: A client of a server of its own.
CLIENT = """
import subprocess, rodgym.remote
server = subprocess.Popen(["rodgym", "serve", "--bind", "tcp://127.0.0.1:55557"])
try:
    envs = rodgym.remote.connect("tcp://127.0.0.1:55557", "rodgym/PendulumSwingUp-v0", num_envs=4)
    print(envs.reset(seed=0)[0].shape)
    envs.close()
finally:
    server.terminate()
    server.wait()
"""
#: A study of two cases.
STUDY = """
open("sweep.yml", "w").write('''
title: Two rods
env: rodgym/PendulumSwingUp-v0
seeds: 2
sweep: {policy: [lqr], env.width: [0.006, 0.008]}
plot: {x: env.width, value: upright, line: policy}
''')
"""
#: The environment of examples/own-task, single and in batches, beside rodgym's own.
OWN = """
import own_task, gymnasium as gym, numpy as np
envs = gym.make_vec("example/PendulumLevel-v0", num_envs=64)
envs.reset(seed=0)
rewards, infos = envs.step(np.zeros((64, 1)))[1::3]
assert set(infos["reward_terms"]) >= {"level", "effort"}, infos
env = gym.make("example/PendulumLevel-v0")
env.reset(seed=7)
assert env.step(np.zeros(1))[1] == rewards[7]
assert gym.make("rodgym/PendulumSwingUp-v0").reset(seed=0)[0].shape == (18,)
"""
#: A policy that was exported elsewhere.
ONNX = ROOT / "runs" / "packages" / "zoo.onnx"
OWN_ID = "example/PendulumLevel-v0"
RLLIB = str(ROOT / "docs" / "examples" / "rllib_ppo.py")
#: What is tried with each extra alone, beside that. An extra of two names is both of them.
WITH_EXTRA = {
    "report": [
        ("rodgym", "compare", "--policy", "lqr", "--controller", "lqr-hybrid", "--seeds", "2")
    ],
    "render": [("rodgym", "render", "lqr", "swing.gif")],
    "remote": [("python", "-c", CLIENT)],
    "data": [
        ("rodgym", "evaluate", "lqr", "--seeds", "2", "--trajectories", "parquet", "--name", "d")
    ],
    "export": [("rodgym", "evaluate", str(ONNX), "--seeds", "2", "--name", "o")],
    "lab": [
        ("python", "-c", FILM),
        ("python", "-c", "import rodgym.lab.vision"),
        ("rodgym", "fit", "film.csv", "--known", "width=0.007", "--known", "density=1500"),
    ],
    "tune": [("python", "-c", "import optuna, rodgym")],
    "train": [
        ("rodgym", "evaluate", "zoo", "--seeds", "2", "--name", "z"),
        ("rodgym", "train", "--steps", "9000", "--name", "t"),
    ],
    "train,tune": [("rodgym", "tune", "--trials", "1", "--steps", "9000", "--name", "u")],
    "train,export": [("rodgym", "export", "zoo", "--out", "zoo.onnx")],
    "ray": [
        ("python", "-c", STUDY),
        ("rodgym", "study", "sweep.yml", "--ray", "local", "--workers", "2"),
    ],
    "rllib": [("python", RLLIB, "--iterations", "1", "--seeds", "2")],
}
#: A command that needs an extra which is not here says which one, at once, with exit code 2.
LACKING = (
    (("rodgym", "train"), "rodgym[train]"),
    (("rodgym", "compare"), "rodgym[train]"),
    (("rodgym", "render", "lqr", "x.gif"), "rodgym[render]"),
)


class Failed(Exception):
    """A command of a fresh environment did not end as it should."""


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
        clean["PATH"] = f"{self.bin}{os.pathsep}{clean['PATH']}"
        ran = subprocess.run(
            [self.bin / program, *words], cwd=self.folder, env=clean, text=True, capture_output=True
        )
        if ran.returncode != code:
            shown = f"{program} {' '.join(words)}"
            raise Failed(f"{shown}: exit code {ran.returncode}\n{ran.stdout}{ran.stderr}")
        return ran.stdout + ran.stderr

    def added_seconds(self, program: str, more: str) -> tuple[float, float]:
        """What `more` adds to a program: wall and CPU time, medians of pairs of runs."""
        added = []
        for _ in range(15):
            runs = []
            for code in (program, f"{program}; {more}"):
                wall, cpu = time.perf_counter(), cpu_seconds()
                self.run("python", "-c", code)
                runs.append((time.perf_counter() - wall, cpu_seconds() - cpu))
            added.append([both - alone for alone, both in zip(*runs, strict=True)])
        wall, cpu = map(median, zip(*added, strict=True))
        return wall, cpu


def cpu_seconds() -> float:
    """CPU time of all programs that were run: what a busy machine disturbs least."""
    if resource is None:
        used = os.times()
        return used.children_user + used.children_system
    finer = resource.getrusage(resource.RUSAGE_CHILDREN)
    return finer.ru_utime + finer.ru_stime


def build(*words: str, out: Path = DIST) -> Path:
    """The file that maturin writes."""
    before = set(out.glob("*"))
    subprocess.run([sys.executable, "-m", "maturin", *words, "--out", out], cwd=ROOT, check=True)
    files = set(out.glob("*")) - before or set(out.glob("*.gz" if "sdist" in words else "*.whl"))
    return max(files, key=lambda path: path.stat().st_mtime)


def try_plain(fresh: Fresh, package: Path) -> None:
    """Everything that needs no extra, and what lacks one."""
    fresh.install(str(package))
    for command in PLAIN:
        fresh.run(*command)
    for command, words in LACKING:
        began = cpu_seconds()
        said = fresh.run(*command, code=2)
        took = cpu_seconds() - began
        if words not in said or took > 3:
            raise Failed(f"{' '.join(command)} says after {took:.1f} s of CPU time: {said}")


class Log:
    """What was tried with which file, by the file's hash."""

    def __init__(self, *packages: Path) -> None:
        content = b"".join(package.read_bytes() for package in packages)
        self.digest = hashlib.sha256(content).hexdigest()
        self.all: dict[str, Any] = json.loads(LOG.read_text()) if LOG.is_file() else {}
        self.tried: dict[str, str] = self.all.setdefault(self.digest, {})

    def once(self, name: str, attempt: Any) -> None:
        """Makes an attempt that was not made before, and keeps what it says."""
        if name not in self.tried:
            with tempfile.TemporaryDirectory() as folder:
                self.tried[name] = attempt(Fresh(Path(folder)))
            LOG.parent.mkdir(parents=True, exist_ok=True)
            LOG.write_text(json.dumps(self.all, indent=1))
        print(f"{name}: {self.tried[name]}", flush=True)


def wheel_alone(wheel: Path, fresh: Fresh) -> str:
    """The wheel without any extra, and how long its import takes."""
    try_plain(fresh, wheel)
    wall, cpu = fresh.added_seconds("import gymnasium", "import rodgym")
    said = f"importing rodgym adds {wall:.3f} s to importing Gymnasium, {cpu:.3f} s of CPU time"
    if min(wall, cpu) > SLOWEST:
        raise Failed(f"{said}, more than {SLOWEST} s")
    return f"works; {said}"


def from_source(archive: Path, fresh: Fresh) -> str:
    """What pip builds from the source archive."""
    try_plain(fresh, archive)
    return f"builds, and works alone; the archive has {archive.stat().st_size / 1e6:.2f} MB"


def with_extra(wheel: Path, extra: str, fresh: Fresh) -> str:
    """The wheel with one extra."""
    fresh.install(f"rodgym[{extra}] @ {wheel.as_uri()}")
    for command in (PLAIN[-1], *WITH_EXTRA[extra]):
        fresh.run(*command)
    return "works"


def with_own_task(wheel: Path, own: Path, fresh: Fresh) -> str:
    """The wheel, and beside it the one of a crate of one's own."""
    fresh.install(str(wheel))
    fresh.install(str(own))
    fresh.run("python", "-c", OWN)
    fresh.run("python", "-m", "own_task", "list", OWN_ID)
    fresh.run("python", "-m", "own_task", "evaluate", "random", "--env", OWN_ID, "--seeds", "2")
    return f"works; {own.stat().st_size / 1e6:.2f} MB"


def page(wheel: Path, tried: dict[str, str]) -> str:
    """The record."""
    date = datetime.datetime.now(datetime.timezone.utc)
    where = f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"
    names = ["wheel alone", *(f"wheel with `{extra}`" for extra in WITH_EXTRA)]
    names += ["wheel with that of `examples/own-task`", "source archive"]
    rows = "\n".join(f"| {name} | {tried.get(name, 'not tried yet')} |" for name in names)
    return f"""# Packages in fresh environments

Written by `make packages` on {date:%Y-%m-%d} ({where}).

Each row is a new virtual environment. rodgym was installed there by pip from the file that the row
names, and its commands were tried. The wheel is `{wheel.name}`,
{wheel.stat().st_size / 1e6:.2f} MB with the network server inside (wanted: at most
{LARGEST / 1e6:g} MB). Importing rodgym may add {SLOWEST} s to importing Gymnasium.

| tried | result |
|---|---|
{rows}

"Works" means that a controller plays in this environment, and that the commands of the extra do
their work: `train` trains, `render` draws, `remote` steps rods on a server, `lab` fits a rod
to a film that the simulation made (*synthetic*), `train,export` writes an ONNX file and `export`
plays one, `ray` plays a study on a cluster that it starts, `rllib` trains PPO of RLlib for an
iteration, and the task of `examples/own-task` plays beside rodgym's own. A command that lacks an
extra names it and ends within three seconds of CPU time.
"""


def main() -> None:
    """See the file's docstring."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--extras", nargs="*", default=list(WITH_EXTRA), metavar="EXTRA")
    parser.add_argument("--no-sdist", action="store_true")
    parser.add_argument("--no-own", action="store_true")
    parser.add_argument("--wheel", type=Path, help="try this one instead of building one")
    parser.add_argument("--sdist", type=Path, help="the same of the source archive")
    args = parser.parse_args()
    wheel = args.wheel.resolve() if args.wheel else build("build", "--release")
    size = wheel.stat().st_size
    print(f"{wheel.name}: {size / 1e6:.2f} MB")
    if size > LARGEST:
        sys.exit(f"that is more than {LARGEST / 1e6:g} MB")
    ONNX.parent.mkdir(parents=True, exist_ok=True)
    words = ["-m", "rodgym", "export", "zoo", "--env", "PendulumSwingUp", "--out", str(ONNX)]
    subprocess.run([sys.executable, *words], check=True)
    log = Log(wheel)
    tried = log.tried
    try:
        log.once("wheel alone", lambda fresh: wheel_alone(wheel, fresh))
        for extra in args.extras:
            log.once(f"wheel with `{extra}`", lambda fresh, e=extra: with_extra(wheel, e, fresh))
        if not args.no_own:
            own = build("build", "--release", "--manifest-path", str(OWN_CRATE), out=DIST / "own")
            both = Log(wheel, own)
            name = "wheel with that of `examples/own-task`"
            both.once(name, lambda fresh: with_own_task(wheel, own, fresh))
            tried = {**tried, **both.tried}
        if not args.no_sdist:
            archive = args.sdist.resolve() if args.sdist else build("sdist")
            built = Log(archive)
            built.once("source archive", lambda fresh: from_source(archive, fresh))
            tried = {**tried, **built.tried}
    except Failed as error:
        sys.exit(str(error))
    PAGE.write_text(page(wheel, tried), encoding="utf-8")
    print(f"wrote {PAGE}")


if __name__ == "__main__":
    main()
