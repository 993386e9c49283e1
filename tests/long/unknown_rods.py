"""Output feedback of rods that nobody measured: `make unknown-rods` writes docs/unknown-rods.md.

Three controllers play the same episodes: `lqg` that believes the nominal rod, `lqg-adaptive` that
is told the nominal rod too, and "informed", an `lqg` that is told each episode's rod. Beside them
stand, in the maps, the student `zoo:unknown-e` and the same student gone on by PPO ("tuned", made
where it is not there yet), and in the table of returns the students of `lqr` and of a policy. A
case that was played is kept in the log (`--log`); what is there is not played again, and a part of
the page of which nothing was played stays as it is.

Seeds from 10000 on report; those below were used while the controllers were made. Returns are those
of seeds from 20000 on, since 10000 to 10127 choose among the rounds of a student.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from controllers import ANY_ANGLE, BASE_ONLY, DOCS, NOISE, Blinded
from numpy.typing import NDArray
from rodgym import baselines, sim
from rodgym.evaluation import evaluate
from rodgym.evaluation.policies import of_zoo
from rodgym.machines import spec_of
from rodgym.runs import Run, provenance

FIRST_SEED = 10_000
#: Seeds of the table of returns, apart from those of 10000 on that choose among a student's rounds.
RETURN_SEED = 20_000
#: The nominal rod's width [m] and modulus [Pa].
WIDTH, MODULUS = 0.007, 1e7
MODULI = (7e6, 8e6, 9e6, 1e7, 11e6, 12e6, 13e6, 14e6, 15e6)
#: With 7 mm of the row before these are nine, too.
WIDTHS = (0.0056, 0.006, 0.0063, 0.00665, 0.00735, 0.0077, 0.0084, 0.009)
LAWS = ("lqg", "lqg-adaptive", "informed")
#: The student that comes with rodgym, and the one that PPO makes of it.
#: The student of a policy, too.
STUDENT, TUNED, OF_POLICY = "student", "tuned", "student-of-policy"
STUDENTS = {STUDENT: "zoo:unknown-e", OF_POLICY: "zoo:unknown-e-by-policy"}
#: Name of the run, steps and seed of the fine-tuning; the seed is that of the student.
TUNING = ("unknown-e", 500_000, 100)
HEADS = {
    "lqg": "`lqg`",
    "lqg-adaptive": "`lqg-adaptive`",
    "informed": "informed `lqg`",
    STUDENT: "student",
    TUNED: "fine-tuned student",
    OF_POLICY: "student of a policy",
}
#: Rods of the table of returns [Pa]; the first plays rods that are drawn from all of them.
RETURN_MODULI = (7e6, 8e6, 1e7, 12e6, 13e6)
#: Episodes of a case of the map.
MAP_SEEDS = 10
#: Rods of the map: factors of the nominal modulus and width.
MAP_MODULI = (0.5, 0.6, 0.7, 0.85, 1.0, 1.2, 1.4, 1.6, 2.0)
MAP_WIDTHS = (0.75, 0.8, 0.85, 0.9, 1.0, 1.1, 1.2, 1.3, 1.4)


class Informed:
    """One `lqg` a row, designed for the rod of its episode."""

    def __init__(self, env_id: str, seeds: Sequence[int], keywords: Mapping[str, Any]) -> None:
        env = gym.make_vec(env_id, num_envs=len(seeds), **keywords)
        _, info = env.reset(seed=list(seeds))
        spec = spec_of(env)
        env.close()
        drawn = {name: info["parameters"][name] for name in keywords.get("randomize", {})}
        self.laws = []
        for row in range(len(seeds)):
            rod = {name: float(values[row]) for name, values in drawn.items()}
            config = {**spec["config"], **rod, "randomize": {}}
            self.laws.append(baselines.Lqg({**spec, "config": config}))

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, **_: Any
    ) -> tuple[Any, Any]:
        actions, states = [], []
        for row, law in enumerate(self.laws):
            one = slice(row, row + 1)
            before = None if state is None else state[one]
            start = None if episode_start is None else episode_start[one]
            action, after = law.predict(observation[one], before, start)
            actions.append(action)
            states.append(after)
        return np.concatenate(actions), np.concatenate(states)


class Watched:
    """Keeps the state of a policy after some calls."""

    def __init__(self, policy: Any, calls: int) -> None:
        self.policy, self.left = policy, calls
        self.state: Any = None

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, **kwargs: Any
    ) -> tuple[Any, Any]:
        action, state = self.policy.predict(observation, state, episode_start, **kwargs)
        self.left -= 1
        if self.left == 0:
            self.state = state
        return action, state


@dataclass(frozen=True)
class Case:
    """Episodes of one kind: what every controller is told, and what the rods are."""

    table: str
    what: str
    #: Keywords that hold for nominal and true rods.
    told: Mapping[str, Any] = field(default_factory=dict)
    #: Keywords of the true rods alone.
    true: Mapping[str, Any] = field(default_factory=dict)
    lost: float = 0.0
    laws: tuple[str, ...] = LAWS
    seeds: int | None = None
    first: int = FIRST_SEED

    def play(self, law: str, seeds: Sequence[int]) -> dict[str, Any]:
        """How many of the episodes end upright."""
        told = {"sensor_noise": NOISE, **self.told}
        keywords = {**told, **self.true}
        if law == "informed":
            policy: Any = Informed(BASE_ONLY, seeds, keywords)
        else:
            policy = STUDENTS.get(law) or designed(law, told)
        if self.lost:
            policy = Blinded(policy, self.lost)
        result = evaluate(policy, BASE_ONLY, seeds, env_kwargs=keywords)
        returns = np.asarray(result.columns["return"], float)
        upright = int(result.columns["upright"].sum())
        return {"upright": upright, "returns": np.round(returns, 3).tolist()}


def tuned(runs: Path) -> str:
    """The file of the fine-tuned student, which is made first where it is not there."""
    name, steps, seed = TUNING
    run = Run(f"{name}-ppo", runs)
    file = run.path / "policy.zip"
    if not file.exists():
        from rodgym.distil.fine_tune import fine_tune

        source = of_zoo(STUDENTS[STUDENT], BASE_ONLY)
        file = fine_tune(str(source), run, steps=steps, seed=seed).policy
    return str(file)


def designed(law: str, keywords: Mapping[str, Any]) -> baselines.Controller:
    """A controller for an environment."""
    env = gym.make_vec(BASE_ONLY, num_envs=1, **keywords)
    try:
        return baselines.make(law, env)
    finally:
        env.close()


@dataclass(frozen=True)
class Jump(Case):
    """The modulus changes by a factor after 2.5 s; upright at the end of 5 s more."""

    factor: float = 1.0

    def play(self, law: str, seeds: Sequence[int]) -> dict[str, Any]:
        told = {"sensor_noise": NOISE, **self.told}
        keywords = {**told, **self.true}
        informed = law == "informed"
        controller = designed("lqg" if informed else law, keywords if informed else told)
        env = gym.make(BASE_ONLY, max_episode_steps=10_000, **keywords)
        modulus = self.factor * keywords.get("youngs_modulus", MODULUS)
        stands = 0
        for seed in seeds:
            observation, _ = env.reset(seed=seed)
            state: Any = None
            off = []
            for step in range(750):
                if step == 250:
                    rod = sim.Pendulum.of(env)
                    nodes = {"positions": rod.positions, "velocities": rod.velocities}
                    change = {"parameters": {"youngs_modulus": modulus}, "state": nodes}
                    observation, _ = env.reset(options=change)
                action, state = controller.predict(observation, state)
                observation, *_, info = env.step(action)
                off.append(info["upright_error"])
            stands += bool(np.sqrt(np.mean(np.square(off[-100:]))) < 0.05)
        env.close()
        return {"upright": stands}


@dataclass(frozen=True)
class Learned(Case):
    """How near the estimate of the modulus is after 3 s, the modulus alone unknown."""

    def play(self, law: str, seeds: Sequence[int]) -> dict[str, Any]:
        told = {"sensor_noise": NOISE, **self.told}
        controller = baselines.LqgAdaptive(spec_for(told))
        policy = Watched(controller, 300)
        result = evaluate(policy, BASE_ONLY, seeds, env_kwargs=told)
        env = gym.make_vec(BASE_ONLY, num_envs=len(seeds), **told)
        _, info = env.reset(seed=list(seeds))
        env.close()
        truth = info["parameters"]["youngs_modulus"]
        value, low, high = controller.estimate(policy.state)["youngs_modulus"].T
        return {
            "upright": int(result.columns["upright"].sum()),
            "errors": np.round(value / truth - 1, 6).tolist(),
            "covered": int(((low <= truth) & (truth <= high)).sum()),
        }


def spec_for(keywords: Mapping[str, Any]) -> dict[str, Any]:
    """The `core_spec` of an environment."""
    env = gym.make_vec(BASE_ONLY, num_envs=1, **keywords)
    try:
        return spec_of(env)
    finally:
        env.close()


def around(value: float, share: float) -> tuple[float, float]:
    return (value * (1 - share), value * (1 + share))


def cases() -> Iterator[Case]:
    """All cases, in the order of the page."""
    for modulus in MODULI:
        yield Case("line", f"7 mm, {modulus / 1e6:g} MPa", {}, {"youngs_modulus": modulus})
    for width in WIDTHS:
        yield Case("line", f"{1e3 * width:g} mm, 10 MPa", {}, {"width": width})
    modulus, width = around(MODULUS, 0.3), around(WIDTH, 0.15)
    both = {"youngs_modulus": modulus, "width": width}
    density = {"density": around(1500.0, 0.2)}
    yield Case("drawn", "E +-30 %, width +-15 %", {}, {"randomize": both})
    yield Case("drawn", "the same, density +-20 %", {}, {"randomize": {**both, **density}})
    stiff = {"randomize": {"youngs_modulus": modulus}}
    for width in (0.007, 0.009):
        rod = {"width": width}
        name = f"{1e3 * width:g} mm, E +-30 %"
        for nodes in (13, 31):
            yield Case("drawn", f"{name}, {nodes} nodes", {**rod, "nodes": nodes}, stiff)
        yield Case("drawn", f"{name}, 25 % of the samples lost", rod, stiff, lost=0.25)
        yield Case("drawn", f"{name}, from any angle", {**rod, "start_angle": ANY_ANGLE}, stiff)
    for delay in (0.01, 0.02):
        late = {"actuator_delay": delay}
        yield Case("drawn", f"7 mm, E +-30 %, {1e3 * delay:g} ms late", late, stiff)
    told = ("informed",)
    for delay in (0.01, 0.02):
        for modulus in (7e6, 8e6, 1e7, 12e6, 13e6):
            name = f"7 mm, {modulus / 1e6:g} MPa, {1e3 * delay:g} ms late"
            rod = {"youngs_modulus": modulus}
            yield Case("informed", name, {"actuator_delay": delay}, rod, laws=told)
    soft, thick = {"youngs_modulus": 7e6}, {"width": 0.009, "youngs_modulus": 13e6}
    anywhere = {"start_angle": ANY_ANGLE}
    yield Case("informed", "7 mm, 7 MPa, 31 nodes", {"nodes": 31}, soft, laws=told)
    yield Case("informed", "7 mm, 7 MPa, from any angle", anywhere, soft, laws=told)
    yield Case("informed", "9 mm, 13 MPa, from any angle", anywhere, thick, laws=told)
    for factor in (0.7, 1.3):
        yield Jump("jump", f"7 mm, 10 MPa, then {10 * factor:g} MPa", factor=factor)
    for turn in range(4):
        yield Learned(
            "estimate",
            f"7 mm, E +-30 %, part {turn + 1}",
            {"randomize": {"youngs_modulus": around(MODULUS, 0.3)}},
            laws=("lqg-adaptive",),
            seeds=250,
        )
    for width in MAP_WIDTHS:
        for modulus in MAP_MODULI:
            rod = {"width": WIDTH * width, "youngs_modulus": MODULUS * modulus}
            laws = (*LAWS, STUDENT, TUNED)
            yield Case("map", f"{width:g} x {modulus:g}", {}, rod, laws=laws, seeds=MAP_SEEDS)
    laws = ("lqg-adaptive", "informed", STUDENT, OF_POLICY)
    apart: dict[str, Any] = {"laws": laws, "first": RETURN_SEED}
    yield Case("return", "E drawn from 7 to 13 MPa", {}, stiff, **apart)
    for modulus in RETURN_MODULI:
        rod = {"youngs_modulus": modulus}
        yield Case("return", f"{modulus / 1e6:g} MPa", {}, rod, **apart)


def play_all(
    log: Path, seeds: int, tables: Sequence[str], laws: Sequence[str] = LAWS
) -> dict[str, dict[str, Any]]:
    """What every case gives, by case and controller; what is in the log is not played again."""
    done: dict[str, dict[str, Any]] = {}
    if log.exists():
        for line in log.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            done[row["key"]] = row
    for case in cases():
        if case.table not in tables:
            continue
        count = case.seeds or seeds
        first = case.first
        if isinstance(case, Learned):
            first += count * int(case.what.rpartition(" ")[2])
        for law in case.laws:
            key = key_of(case, law)
            if law not in laws:
                continue
            if key in done and done[key]["seeds"] >= count:
                continue
            began = time.process_time()
            result = case.play(law, range(first, first + count))
            row = {"key": key, "seeds": count, "cpu": time.process_time() - began, **result}
            done[key] = row
            with log.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
            print(f"{key}: {row['upright']} of {count} ({row['cpu']:.0f} s)", flush=True)
    return done


def key_of(case: Case, law: str) -> str:
    return f"{case.table}: {case.what}: {law}"


def cell(done: Mapping[str, Mapping[str, Any]], case: Case, law: str) -> str:
    row = done.get(key_of(case, law))
    return f"{row['upright']} of {row['seeds']}" if row else ""


def table(done: Mapping[str, Mapping[str, Any]], name: str, laws: Sequence[str]) -> str:
    """A table of cases (rows) and controllers (columns)."""
    lines = ["| " + " | ".join(["rods", *(HEADS[law] for law in laws)]) + " |"]
    lines.append("|---" * (len(laws) + 1) + "|")
    for case in cases():
        if case.table == name and any(key_of(case, law) in done for law in laws):
            cells = " | ".join(cell(done, case, law) for law in laws)
            lines.append(f"| {case.what} | {cells} |")
    return "\n".join(lines)


def square(done: Mapping[str, Mapping[str, Any]], law: str) -> str:
    """A map over modulus and width: episodes of `MAP_SEEDS` that end upright."""
    head = " | ".join(f"{MODULUS * modulus / 1e6:g}" for modulus in MAP_MODULI)
    lines = [f"| mm \\ MPa | {head} |", "|---" * (len(MAP_MODULI) + 1) + "|"]
    for width in MAP_WIDTHS:
        cells = []
        for modulus in MAP_MODULI:
            row = done.get(f"map: {width:g} x {modulus:g}: {law}")
            cells.append(str(row["upright"]) if row else "")
        lines.append(f"| {1e3 * WIDTH * width:.2f} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def returned(done: Mapping[str, Mapping[str, Any]]) -> str:
    """Mean returns, and by how much those of the students differ from `lqg-adaptive`'s."""
    laws = ("lqg-adaptive", "informed", STUDENT, OF_POLICY)
    heads = [HEADS[law] for law in laws]
    heads += [f"{name} over `lqg-adaptive`" for name in ("student", "student of a policy")]
    lines = ["| rods | " + " | ".join(heads) + " |", "|---" * (len(heads) + 1) + "|"]
    for case in cases():
        rows = {law: done.get(key_of(case, law)) for law in laws}
        if case.table != "return" or not any(rows.values()):
            continue
        cells = []
        for row in rows.values():
            text = "" if row is None else f"{np.mean(row['returns']):.1f}"
            if row is not None and row["upright"] < row["seeds"]:
                text += f" ({row['upright']} of {row['seeds']} upright)"
            cells.append(text)
        theirs = rows["lqg-adaptive"]
        cells += [difference(rows[law], theirs) for law in (STUDENT, OF_POLICY)]
        lines.append(f"| {case.what} | " + " | ".join(cells) + " |")
    facts = provenance()
    lines.append(f"\nMeasured on {facts['date']} ({facts['machine']}).")
    return "\n".join(lines)


def difference(ours: Mapping[str, Any] | None, theirs: Mapping[str, Any] | None) -> str:
    """By how much mean returns differ, with the 95 % interval of the bootstrap over episodes."""
    if ours is None or theirs is None:
        return ""
    off = np.subtract(ours["returns"], theirs["returns"])
    drawn = np.random.default_rng(0).integers(len(off), size=(10_000, len(off)))
    low, high = np.quantile(off[drawn].mean(1), (0.025, 0.975))
    return f"{off.mean():+.2f} ({low:+.2f} to {high:+.2f})"


def learned(done: Mapping[str, Mapping[str, Any]]) -> str:
    """A sentence on the estimate of the modulus."""
    rows = [row for key, row in done.items() if key.startswith("estimate: ")]
    if not rows:
        return "Not measured."
    errors: NDArray[np.float64] = np.concatenate([row["errors"] for row in rows])
    count = len(errors)
    covered = sum(row["covered"] for row in rows)
    off = np.abs(errors)
    return (
        f"After 3 s the estimate of the modulus is off by {np.median(off):.2%} (median of {count} "
        f"episodes; nine of ten are within {np.quantile(off, 0.9):.2%}; the median error with its "
        f"sign is {np.median(errors):+.2%}); its interval holds the truth in {covered / count:.1%}."
    )


def call_times(calls: int = 2000) -> str:
    """CPU time of a call of `lqg-adaptive`: for one rod, and each of 64 [ms]."""
    rows = []
    for nodes in (7, 13, 31):
        times = []
        for count in (1, 64):
            env = gym.make_vec(BASE_ONLY, num_envs=count, sensor_noise=NOISE, nodes=nodes)
            law = baselines.make("lqg-adaptive", env)
            observation, _ = env.reset(seed=0)
            _, state = law.predict(observation)
            began = time.process_time()
            for _ in range(calls // count):
                _, state = law.predict(observation, state)
            times.append(1e3 * (time.process_time() - began) / (calls // count * count))
            env.close()
        rows.append(f"| {nodes} | {times[0]:.3f} ms | {times[1]:.3f} ms |")
    return "\n".join(["| nodes | one rod | each of 64 |", "|---|---|---|", *rows])


def total(done: Mapping[str, Mapping[str, Any]], law: str) -> str:
    """How many episodes of the first table end upright."""
    keys = [key for key in done if key.startswith("line: ") and key.endswith(f": {law}")]
    rows = [done[key] for key in keys]
    return f"{sum(row['upright'] for row in rows)} of {sum(row['seeds'] for row in rows)}"


def played(done: Mapping[str, Mapping[str, Any]], part: str) -> bool:
    """Whether there is anything to write in a part of the page."""
    table, _, law = part.partition(" ")
    # (Both say something of the tables before the maps.)
    if table in ("date", "cost"):
        table = "line"
    return any(key.startswith(f"{table}: ") and key.endswith(law) for key in done)


def page(done: Mapping[str, Mapping[str, Any]], template: str) -> str:
    """The page: the text of today's with its measured parts replaced."""
    facts = provenance()
    versions = ", ".join(f"{name} {value}" for name, value in facts["versions"].items())
    parts: dict[str, Callable[[], str]] = {
        "date": lambda: f"Measured on {facts['date']} ({facts['machine']}; {versions}).",
        "line": lambda: (
            table(done, "line", LAWS)
            + "\n\nTogether: "
            + ", ".join(f"`{law}` {total(done, law)}" for law in LAWS)
            + "."
        ),
        "drawn": lambda: table(done, "drawn", LAWS),
        "informed": lambda: table(done, "informed", ("informed",)),
        "jump": lambda: table(done, "jump", LAWS),
        "estimate": lambda: learned(done),
        "cost": call_times,
        "return": lambda: returned(done),
        **{f"map {law}": partial(square, done, law) for law in (*LAWS, STUDENT, TUNED)},
    }
    for name, text in parts.items():
        if not played(done, name):
            continue
        begin, end = f"<!-- {name} -->", f"<!-- end {name} -->"
        before, found, rest = template.partition(begin)
        _, closed, after = rest.partition(end)
        if not (found and closed):
            raise SystemExit(f"the page has no part {begin} ... {end}")
        template = f"{before}{begin}\n{text()}\n{end}{after}"
    return template


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--log", type=Path, default=Path("runs/unknown-rods.jsonl"))
    parser.add_argument("--page", type=Path, default=DOCS / "unknown-rods.md")
    parser.add_argument("--tables", default="line,drawn,informed,jump,estimate,map,return")
    parser.add_argument("--laws", default=",".join(HEADS))
    arguments = parser.parse_args()
    arguments.log.parent.mkdir(parents=True, exist_ok=True)
    tables, laws = arguments.tables.split(","), arguments.laws.split(",")
    if TUNED in laws and "map" in tables:
        STUDENTS[TUNED] = tuned(arguments.log.parent)
    done = play_all(arguments.log, arguments.seeds, tables, laws)
    text = arguments.page.read_text(encoding="utf-8")
    arguments.page.write_text(page(done, text), encoding="utf-8")
    print(f"wrote {arguments.page}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
