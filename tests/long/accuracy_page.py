"""The page of `accuracy.py`: defaults of the grid, and of rods beside it, against converged runs.

Writes `docs/performance/accuracy.md` and `accuracy.png` from `runs/accuracy.csv` and new runs.
"""

from __future__ import annotations

import math
import random

from accuracy import (
    CONTRACT,
    DAMPINGS,
    LOSS,
    MODULI,
    NODES,
    ROOT,
    STORE,
    WIDTHS,
    Rod,
    ask,
    read,
    rods,
)
from fin_beats import FINE, beat, errors

PAGE = ROOT / "docs" / "performance" / "accuracy.md"
PLOT = PAGE.with_suffix(".png")
WORDS = {"verlet": "Verlet", "esdirk3": "ESDIRK3", "tr_bdf2": "TR-BDF2"}
#: Of the plot: name, Young's modulus, nodes (7 mm, 0.3 m, no damping).
SHOWN = (
    ("silicone, 1e7 Pa", "1e7", 7),
    ("1e9 Pa", "1e9", 7),
    ("steel, 2e11 Pa", "2e11", 7),
    ("31 nodes, 1e7 Pa", "1e7", 31),
    ("101 nodes, 1e7 Pa", "1e7", 101),
)


def choices(rods: list[Rod]) -> dict[Rod, tuple[str, int, float]]:
    """What the core takes: scheme, steps a second, estimated error."""
    lines = [line.split() for line in ask([" ".join(map(str, r)) for r in rods], "choices")]
    return {r: (f[5], int(f[6]), float(f[7])) for r, f in zip(rods, lines, strict=True)}


def strangers(count: int) -> list[Rod]:
    """Rods that are not on the grid."""
    rng = random.Random(1)
    found = []
    for _ in range(count):
        modulus = 10 ** rng.uniform(5, math.log10(2e11))
        width, length = (
            10 ** rng.uniform(math.log10(2e-3), math.log10(2e-2)),
            10 ** rng.uniform(-1, 0),
        )
        nodes, beta = rng.choice((2, 4, 7, 10, 16, 25)), rng.choice(("0", "5e-4", "2e-3"))
        found.append((f"{modulus:.4e}", f"{width:.4e}", f"{length:.4e}", nodes, beta))
    # Neighbours of a kind run side by side.
    return sorted(found, key=lambda rod: rod[3:])


def verify(rods: list[Rod]) -> dict[Rod, tuple[str, int, float, float, float, float]]:
    """Default steps against converged runs: scheme, steps a second, estimate, error, energy lost,
    cost; only rods whose path converges."""
    chosen = choices(rods)
    jobs = [(rod, *chosen[rod][:2], int(rod[4] == "0")) for rod in rods]
    jobs += [(rod, "esdirk3", steps, 0) for steps in (50_000, 100_000) for rod in rods]
    lines = [" ".join(map(str, (*rod, *job))) for rod, *job in jobs]
    # What `accuracy.py` has run is not run again, but for the costs of the defaults.
    known = {line.rsplit(maxsplit=4)[0]: line for line in STORE.read_text().splitlines()}
    fresh = [line for i, line in enumerate(lines) if i < len(rods) or line not in known]
    known |= dict(zip(fresh, ask(fresh), strict=True))
    done = [known[line].split() for line in lines]
    result = {}
    n = len(rods)
    for rod, mine, rough, fine in zip(rods, done[:n], done[n : 2 * n], done[2 * n :], strict=True):
        (x, y), (x1, y1), (x2, y2) = ((float(f[8]), float(f[9])) for f in (mine, rough, fine))
        length = float(rod[2])
        if math.hypot(x1 - x2, y1 - y2) < 1e-5 * length:
            off = math.hypot(x - x2, y - y2) / length
            result[rod] = (*chosen[rod], off, float(mine[10]), float(mine[11]))
    return result


def broken(rod: Rod, row: tuple[str, int, float, float, float, float]) -> bool:
    return not (row[3] < CONTRACT and (rod[4] != "0" or row[4] < LOSS))


def page() -> None:
    """Runs every default of the grid, and of rods beside it, and writes the page and the plot."""
    on, beside = verify(rods()), verify(strangers(200))
    text = [HEAD]
    for name, rows in (("on the grid", on), ("not on it, drawn at random", beside)):
        promised = {rod: row for rod, row in rows.items() if row[2] <= CONTRACT * 1.000001}
        bad = [rod for rod, row in promised.items() if broken(rod, row)]
        off = max(row[3] for row in promised.values())
        lost = max(row[4] for rod, row in promised.items() if rod[4] == "0")
        text += [
            f"Of {len(rows)} rods {name} whose path converges, {len(promised)} are promised the "
            f"contract, and {len(promised) - len(bad)} keep it; makers of the others are warned. "
            f"Largest error of those that are promised it: {off:.1e} of the length, largest loss "
            f"of energy {100 * lost:.2g} %.",
            "",
        ]
        text += [f"* broken: {' '.join(map(str, rod))}: {promised[rod]}" for rod in bad]
    text += [
        "",
        "## What is taken",
        "",
        "Rods of 0.3 m. Scheme, step [ms], error of the tip after 1 s [1e-6 L] / "
        "its estimate, cost [us] of 10 ms a rod in lanes "
        "(wall clock).",
        "",
    ]
    for damping, word in zip(
        DAMPINGS, ("without damping", "with bending damping 5e-4 s"), strict=True
    ):
        for nodes in NODES:
            text += [
                f"### {nodes} nodes, {word}",
                "",
                "| E [Pa] | " + " | ".join(f"{1e3 * float(w):g} mm" for w in WIDTHS) + " |",
                "|---|" + "---|" * len(WIDTHS),
            ]
            for modulus in MODULI:
                cells = []
                for width in WIDTHS:
                    row = on.get((modulus, width, "0.3", nodes, damping))
                    if row is None:
                        cells.append("no converged path")
                        continue
                    scheme, steps, estimate, off, _, cost = row
                    bound = f"{1e6 * off:.2g} / {1e6 * estimate:.2g}"
                    name = WORDS[scheme]
                    cells.append(f"{name} {1e3 / steps:.3g}: {bound}, {1e4 * cost:.2g}")
                text.append(f"| {modulus} | " + " | ".join(cells) + " |")
            text.append("")
    PAGE.write_text("\n".join([*text, *fin()]))
    plot()


def timed(rounds: int = 5) -> dict[tuple[str, int, str, int], float]:
    """Seconds of 1 s of the plot's rods by scheme and steps in 10 ms: the least of some rounds, in
    which all cases take turns."""
    data, lines = read(), []
    for _, modulus, nodes in SHOWN:
        rod = (modulus, "0.007", "0.3", nodes, "0")
        lines += [" ".join(map(str, (*rod, s, 100 * n, 0))) for s, n in data[rod] if n <= 200]
    costs: dict[tuple[str, int, str, int], float] = {}
    for _ in range(rounds):
        for f in map(str.split, ask(lines)):
            key = (f[0], int(f[3]), f[5], int(f[6]) // 100)
            costs[key] = min(costs.get(key, math.inf), float(f[11]))
    return costs


def plot() -> None:
    """Error against cost: a panel a rod, a line a scheme."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    data, costs = read(), timed()
    figure, panels = plt.subplots(1, len(SHOWN), figsize=(17, 4), sharey=True)
    for panel, (name, modulus, nodes) in zip(panels, SHOWN, strict=True):
        results = data[modulus, "0.007", "0.3", nodes, "0"]
        words = {**WORDS, "bdf2": "BDF2", "implicit": "SDIRK2"}
        for i, (scheme, word) in enumerate(words.items()):
            # By step: costs jump where neighbours on the machine are busy.
            points = [
                (1e4 * costs[modulus, nodes, s, n], error)
                for (s, n), (error, *_) in sorted(results.items())
                if s == scheme and (modulus, nodes, s, n) in costs
            ]
            if points:
                panel.plot(*zip(*points, strict=True), "o-", color=f"C{i}", label=word)
        panel.axhline(CONTRACT, color="grey", linestyle=":")
        panel.set(xscale="log", yscale="log", title=name, xlabel="us of 10 ms, a rod in lanes")
        panel.grid(alpha=0.3)
    panels[0].set_ylabel("tip after 1 s: error / length")
    panels[0].legend()
    figure.tight_layout()
    figure.savefig(PLOT, dpi=90)


HEAD = """# Accuracy: what default steps promise of a pendulum, and what they cost

Written by `make accuracy` (`tests/long/accuracy.py`).

**The contract.** After a free swing of 1 s from the horizontal the tip is within 1e-4 of the
rod's length from the path that smaller steps converge to, and without damping less than 1 % of
the swing's energy is lost in 10 s. It is promised for E from 1e5 to 2e11 Pa, widths of 2 to 20
mm, lengths of 0.1 to 1 m, 2 to 101 nodes, at every corner of `randomize`, where the path
converges; where no affordable step keeps it (soft rods without damping), `make` warns and says by
how much.

**The rule.** How far a rod bends decides how its vibration counts beside its swing, and so which
steps are needed: that is its *sag*, `12 g rho L^3 / (E w^2)`, weight over bending stiffness. Rods
of equal sag, nodes, damping and length need nearly the same steps. This script has measured them
for Verlet and ESDIRK3 over the grid, and keeps for each half decade of sag what all rods in it
need, at least half of what its neighbours do (`env-core/src/pendulum/accuracy/table.rs`).
Verlet's step is at most 0.85 of its limit of stability on top. Of the two the one with less work
is taken, in a number of steps that leaves round steps. `spec["error"]` is the estimate for the
step that is used: it goes with the square of the step, and is a bound, mostly a loose one.

![error against cost](accuracy.png)

* **Verlet** wins wherever its limit of stability is near the step that the swing needs: soft rods
  of few nodes, and all rods that sag far without damping, whose energy it alone keeps.
* **ESDIRK3** (an explicit and three implicit stages, third order) wins elsewhere, for stiff rods
  by far. The two schemes of second order need two to four times as many steps, and SDIRK2, whose
  stages are of first order, loses two orders on stiff rods.
* An **implicit-explicit** Verlet (damping implicit) was not built: its step is bounded by the
  limit of the undamped rod, which costs, at 2.6 ns an edge and step before the damping is solved
  for, 8 us at 31 nodes and 95 us at 101 at the least.

"""

FIN = """
## The fin

Thrust and power over the fifth period of a beat of 10 degrees at 1.5 Hz (its amplitude grows over
the first two) against steps of 0.1 ms: rms of the difference over rms of the whole, in percent
(thrust / power).

The default is 4 ms, 1.6 ms for a fin known to be softer than 6e4 Pa, and 2 ms in `morison` water.
Where FinThrust draws its stiffness, from 3e4 Pa on, it keeps 4 ms: fins of 4e4 Pa are then off by
3.5 %. In `morison` water nothing is shed at the tail: the vibration of an undamped fin below 2.5e5
Pa never dies, and no step reaches 1 %. `make` warns of it, and of less than 1e5 Pa with the
thesis' damping (0.1238 kg/s).
"""


def fin() -> list[str]:
    """The table of the fin's errors by water and step."""
    columns = [
        *(("lighthill", 0.0, dt) for dt in (4e-3, 2e-3, 1.6e-3)),
        *(("morison", zeta, dt) for zeta in (0.0, 0.1238) for dt in (4e-3, 2e-3, 1e-3)),
    ]
    text = [
        FIN,
        "| E [Pa] | "
        + " | ".join(f"{w}, zeta {z:g}, {1e3 * dt:g} ms" for w, z, dt in columns)
        + " |",
        "|---|" + "---|" * len(columns),
    ]
    for modulus in (1e4, 2e4, 3e4, 4e4, 5e4, 7e4, 1e5, 2.5e5, 5e5, 1e6, 3e6, 8.11e6):
        cells = []
        for water, zeta, dt in columns:
            keywords = {"youngs_modulus": modulus, "hydrodynamics": water, "damping": zeta}
            off = errors(beat(**keywords, physics_dt=dt), beat(**keywords, physics_dt=FINE))
            cells.append(" / ".join(f"{100 * error:.2g}" for error in off))
        text.append(f"| {modulus:g} | " + " | ".join(cells) + " |")
    return [*text, ""]


if __name__ == "__main__":
    page()
