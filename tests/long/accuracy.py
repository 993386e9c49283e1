"""How exact every stepper is, over a grid of pendulums: `make accuracy`.

Runs free swings from the horizontal through `cargo run --example swing`, keeps every result in
`runs/accuracy.csv` (a killed run goes on where it was), and writes

* `env-core/src/pendulum/accuracy/table.rs`: the steps that rods of a kind need;
* by `accuracy_page.py`, `docs/performance/accuracy.md` and its plot.

A rod belongs to the grid where its path converges: halving a step of 20 us moves the tip after 1
s by less than 1e-5 of the rod's length (ESDIRK3, whose steps of 10 us are the reference).
"""

from __future__ import annotations

import itertools
import math
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / "target" / "release" / "examples" / "swing"
STORE = ROOT / "runs" / "accuracy.csv"

MODULI = ("1e5", "1e6", "1e7", "1e8", "1e9", "1e10", "2e11")
WIDTHS = ("0.002", "0.004", "0.007", "0.012", "0.02")
LENGTHS = ("0.1", "0.3", "1")
NODES = (2, 7, 21, 31, 101)
DAMPINGS = ("0", "5e-4")
#: Steps a control step of 10 ms.
PARTS = {
    "esdirk3": (1, 2, 3, 4, 5, 6, 8, 10, 14, 20, 28, 40),
    "tr_bdf2": (2, 3, 4, 5, 6, 8, 10, 14, 20, 28, 40, 80),
    "bdf2": (4, 10, 20, 40, 80),
    "implicit": (10, 20),
}
#: The same of rods that bend far under their own weight.
SOFT_PARTS = {"esdirk3": (80, 160)}
#: Verlet's steps, over the fewest that are stable; at most so many a control step.
OVER, SOFT_OVER, MOST = (1.0, 1.3, 1.7, 2.5), (4.0, 6.0, 10.0, 16.0, 30.0), 500

#: Sag from which a rod counts as soft.
SOFT = 5.0

Rod = tuple[str, str, str, int, str]


def rods() -> list[Rod]:
    grid = itertools.product(NODES, DAMPINGS, LENGTHS, MODULI, WIDTHS)
    return [(e, w, length, n, beta) for n, beta, length, e, w in grid]


def sag(rod: Rod) -> float:
    """Weight over bending stiffness, `12 g rho L^3 / (E w^2)`: what a rod is looked up by."""
    modulus, width, length = map(float, rod[:3])
    return 12.0 * 9.81 * 1500.0 * length**3 / (modulus * width**2)


def ask(lines: list[str], *arguments: str) -> list[str]:
    done = subprocess.run(
        [PROGRAM, *arguments], input="\n".join(lines), capture_output=True, text=True, check=True
    )
    return done.stdout.splitlines()


def jobs(rod: Rod, limit: float) -> list[tuple[str, int, int]]:
    """Scheme, steps a second, and whether ten seconds are wanted."""
    energy = int(rod[4] == "0")
    fewest = math.ceil(0.01 / limit - 1e-9)
    soft = sag(rod) > SOFT
    verlet = sorted({math.ceil(fewest * over) for over in OVER + SOFT_OVER * soft})
    found = [("verlet", 100 * n, energy) for n in verlet if n <= MOST]
    found += [(scheme, 100 * n, energy) for scheme, all_ in PARTS.items() for n in all_]
    if soft:
        found += [(scheme, 100 * n, energy) for scheme, all_ in SOFT_PARTS.items() for n in all_]
    return [*found, ("esdirk3", 50_000, 0), ("esdirk3", 100_000, 0)]


def run() -> None:
    """Everything that the store lacks."""
    STORE.parent.mkdir(exist_ok=True)
    have = set()
    if STORE.exists():
        have = {tuple(line.split()[:8]) for line in STORE.read_text().splitlines()}
    all_rods = rods()
    limits = [
        float(line.split()[-1]) for line in ask([" ".join(map(str, r)) for r in all_rods], "limits")
    ]
    todo: dict[tuple[object, ...], list[str]] = {}
    for rod, limit in zip(all_rods, limits, strict=True):
        for job in jobs(rod, limit):
            fields = tuple(map(str, (*rod, *job)))
            if fields not in have:
                todo.setdefault((rod[3], rod[4], *job), []).append(" ".join(fields))
    # One call for each number of nodes and damping: what is stored is whole.
    calls: dict[tuple[object, ...], list[str]] = {}
    for key, lines in todo.items():
        calls.setdefault(key[:2], []).extend(lines)
    only = tuple(map(int, sys.argv[1:]))
    for key, lines in calls.items():
        if only and key[0] not in only:
            continue
        print(*key, len(lines), flush=True)
        with (
            STORE.open("a") as file,
            subprocess.Popen([PROGRAM], stdin=subprocess.PIPE, stdout=file, text=True) as process,
        ):
            process.communicate("\n".join(lines))


# --- the table that the core looks steps up in ----------------------------------------------------

TABLE = ROOT / "env-core" / "src" / "pendulum" / "accuracy" / "table.rs"
#: Classes of rods by nodes: up to so many, and which rods of the grid speak for them.
CLASSES = {2: (2,), 7: (2, 7), 21: (7, 21), 31: (21, 31), 101: (31, 101)}
#: Half decades of the sag: the first and their number.
FIRST, BINS = -11, 34
CONTRACT, LOSS, SAFETY = 1e-4, 1e-2, 0.6
#: A rod whose path is not known, or that a scheme cannot follow.
NEVER = 60_000

Result = tuple[float, float, float]


def read() -> dict[Rod, dict[tuple[str, int], Result]]:
    """Of every rod whose path converges: by scheme and steps a control step, error of the tip over
    the length, share of the energy lost in 10 s, CPU seconds of a second."""
    raw: dict[Rod, dict[tuple[str, int], tuple[float, ...]]] = {}
    for line in STORE.read_text().splitlines():
        f = line.split()
        if len(f) == 12:
            rod = (f[0], f[1], f[2], int(f[3]), f[4])
            raw.setdefault(rod, {})[f[5], int(f[6]) // 100] = tuple(map(float, f[8:]))
    found: dict[Rod, dict[tuple[str, int], Result]] = {}
    for rod, results in raw.items():
        if ("esdirk3", 500) not in results or ("esdirk3", 1000) not in results:
            continue
        (x1, y1), (x, y) = results.pop(("esdirk3", 500))[:2], results.pop(("esdirk3", 1000))[:2]
        length = float(rod[2])
        if not math.hypot(x1 - x, y1 - y) < 1e-5 * length:
            continue
        found[rod] = {
            key: (math.hypot(r[0] - x, r[1] - y) / length, r[2], r[3]) for key, r in results.items()
        }
    return found


def needed(rod: Rod, results: dict[tuple[str, int], Result], scheme: str) -> tuple[float, bool]:
    """Steps in 10 ms from which on the contract is kept, and whether fewer would break it.

    An error may be small by chance: what counts is what all smaller steps say by the order of the
    scheme, so that the estimate is a bound for them. (Verlet is of first order where there is
    damping; ESDIRK3 does not reach its third order in stiff parts.)
    """
    order = 1 if scheme == "verlet" else 2
    damped = rod[4] != "0"
    tried = sorted((n, r) for (s, n), r in results.items() if s == scheme)
    if not tried:
        return 0, False

    def share(result: Result) -> float:
        return max(result[0] / (SAFETY * CONTRACT), 0.0 if damped else result[1] / LOSS)

    best, tight = tried[-1][0], False
    for n, result in reversed(tried):
        if not share(result) < 1.0:
            tight = True
            break
        best = n
    counted = [n * share(result) ** (1 / order) for n, result in tried if n >= best]
    return (NEVER if any(map(math.isnan, counted)) else min(NEVER, max(best, *counted, 0))), tight


def table() -> dict[str, list[list[list[list[int]]]]]:
    """By scheme, class of nodes, damping, length and half decade of sag: steps in 10 ms."""
    data = read()
    found: dict[str, list[list[list[list[int]]]]] = {}
    for scheme in ("verlet", "esdirk3"):
        classes = []
        for grid in CLASSES.values():
            cells: list[list[list[list[tuple[float, bool]]]]] = [
                [[[] for _ in range(BINS)] for _ in LENGTHS] for _ in DAMPINGS
            ]
            for rod, results in data.items():
                if rod[3] in grid:
                    steps = needed(rod, results, scheme)
                    if steps[0]:
                        place = math.floor(2 * math.log10(sag(rod))) - FIRST
                        cells[DAMPINGS.index(rod[4])][LENGTHS.index(rod[2])][place].append(steps)
            classes.append([[fill(list(map(most, row))) for row in rows] for rows in cells])
        found[scheme] = classes
    return found


def most(steps: list[tuple[float, bool]]) -> int:
    """The most that a rod of a cell needs; the fewest that were tried where all do with fewer."""
    tight = [n for n, broken in steps if broken]
    return math.ceil(max(tight) if tight else min((n for n, _ in steps), default=0))


def fill(row: list[int]) -> list[int]:
    """What no rod speaks for is taken from the next softer one, or else from the next stiffer; a
    cell needs what its neighbours do, halved."""
    known = [i for i, n in enumerate(row) if n]
    if not known:
        return [NEVER] * len(row)
    after = [next((row[i] for i in known if i >= k), row[known[-1]]) for k in range(len(row))]
    wide = [0, *after, 0]
    return [max(after[k], (wide[k] + 1) // 2, (wide[k + 2] + 1) // 2) for k in range(len(row))]


def write_table() -> None:
    text = [
        "//! Steps that keep the contract, written by `make accuracy` (tests/long/accuracy.py).",
        "",
        f"pub(super) const FIRST: i32 = {FIRST};",
        f"pub(super) const BINS: usize = {BINS};",
        f"pub(super) const CLASSES: [usize; {len(CLASSES)}] = {list(CLASSES)};",
        f"pub(super) const NEVER: f64 = {0.5 * NEVER};",
        f"pub(super) const LENGTHS: [f64; 3] = [{', '.join(str(float(x)) for x in LENGTHS)}];",
        "",
        "/// By class of nodes, damping (without, with), length and half decade of sag.",
        "pub(super) type Steps = [[[[u16; BINS]; 3]; 2]; CLASSES.len()];",
    ]
    for scheme, classes in table().items():
        rows = str(classes).replace(" ", "")
        text += ["", "#[rustfmt::skip]", f"pub(super) const {scheme.upper()}: Steps = "]
        text[-1] += rows.replace("],[", "],\n[") + ";"
    TABLE.parent.mkdir(exist_ok=True)
    TABLE.write_text("\n".join(text) + "\n")


if __name__ == "__main__":
    run()
    write_table()
    build = ["cargo", "build", "--release", "-p", "rodgym-core", "--example", "swing"]
    subprocess.run(build, check=True, cwd=ROOT)
    subprocess.run([sys.executable, ROOT / "tests" / "long" / "accuracy_page.py"], check=True)
