"""Writes the pages that follow from the code: `python docs/pages.py`.

The families of environments come from their docstrings, one page for each environment from the
catalogue and what the core says of it, the command line from its parser, and the code in
extending.md from the toy crate. `--play` first plays what scores the pages show and keeps them in
docs/environments/scores.csv (a minute or two); without it that file is read.
"""

from __future__ import annotations

import csv
import inspect
import re
import sys
from pathlib import Path
from typing import Any

import rodgym
from rodgym import machines
from rodgym.cli.app import command_names, load_command
from rodgym.cli.commands.list import native_spec, physics
from rodgym.envs import FinEnv, PendulumEnv
from rodgym.report.reward import reward_of

DOCS = Path(__file__).parent
ENVIRONMENTS = DOCS / "environments"
SCORES = ENVIRONMENTS / "scores.csv"
BEST_KNOWN = "../best-known.md"
NOTE = "<!-- Written by docs/pages.py. -->\n\n"

#: Page, title and class of each family of environments.
PAGES = (
    ("pendulum.md", "The elastic pendulum", PendulumEnv),
    ("fin.md", "The flexible fin", FinEnv),
)
#: By machine: the page of its family, and its diagram of coordinates.
FAMILIES = {
    "pendulum": ("pendulum.md", "pendulum-coordinates.svg", "Hinge, edges, angles and axes"),
    "fin": ("fin.md", "fin-coordinates.svg", "Pivot, pitch, flow and axes, seen from above"),
}
#: By environment: its moving picture, drawn by docs/images/draw.py.
FILMS = {
    "rodgym/PendulumSwingUp-v0": ("pendulum.gif", "The linear regulator swings the rod up"),
    "rodgym/PendulumBalance-v0": ("balance.gif", "The linear regulator straightens a bent rod"),
    "rodgym/PendulumSwingUpBase-v0": ("base.gif", "A Kalman filter and a regulator at work"),
    "rodgym/FinThrust-v0": ("fin.gif", "A fin that is pitched to and fro in a slow flow"),
    "rodgym/FinEfficiency-v0": ("efficiency.gif", "The same fin, with the demanded thrust"),
    "rodgym/FinSwim-v0": ("swim.gif", "A fin that pushes a hull"),
}
#: By environment: the question that it asks, and what makes it hard.
LEADS = {
    "rodgym/PendulumSwingUp-v0": (
        "Swing a hanging rod up and keep it upright, seeing all of it.",
        "The motor lifts the rod only if it is used at the right moments, and a rod that is swung "
        "too hard folds. Begin here: PPO learns it in one to two minutes, and the linear regulator "
        "gives a standard to compare with.",
    ),
    "rodgym/PendulumBalance-v0": (
        "Keep a bent rod upright.",
        "The rod starts near upright, bent and at rest, and would buckle under its own weight. "
        "Feedback must keep it straight. It is the easiest of the tasks, and ends when the rod "
        "falls.",
    ),
    "rodgym/PendulumSwingUpBase-v0": (
        "Swing the rod up while seeing only what an encoder on the motor sees.",
        "The angle and rate of the base are visible, the rest of the rod is not. A policy needs a "
        "memory or a filter. PPO with the last 24 observations did not learn it; a Kalman filter "
        "with a regulator does it, and so does a network that was taught.",
    ),
    "rodgym/FinThrust-v0": (
        "Get much thrust for little power from a fin whose stiffness changes every episode.",
        "A soft fin must be beaten more slowly than a stiff one, and nobody says which one it is: "
        "the policy must feel it.",
    ),
    "rodgym/FinEfficiency-v0": (
        "Deliver a demanded thrust at the least power.",
        "The demand is drawn at the start of each episode. Meeting it is most of the reward; the "
        "rest is paid for doing so cheaply.",
    ),
    "rodgym/FinSwim-v0": (
        "Push a hull through still water.",
        "The fin carries a hull that it must accelerate and keep moving. Speed pays, power costs.",
    ),
}  # fmt: skip


def linked(text: str) -> str:
    """A text of the package that names files of the documentation, with links to them."""
    return re.sub(r"(?<![\w/(])docs/([\w/-]+\.md)", r"[\1](\1)", text)


def page(name: str, title: str, environment: type) -> str:
    """The page of a family."""
    text = inspect.getdoc(environment)
    assert text is not None
    note = "<!-- Written by docs/pages.py from the docstring. -->"
    lead, _, rest = linked(text.strip()).partition("\n\n")
    diagram, words = next(d for family, *d in FAMILIES.values() if family == name)
    return f"{note}\n\n# {title}\n\n{lead}\n\n![{words}](images/{diagram})\n\n{rest}\n"


def slug(env_id: str) -> str:
    """`rodgym/PendulumSwingUp-v0` as the name of a page: `pendulum-swing-up`."""
    name = env_id.rpartition("/")[2].partition("-v")[0]
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "-", name).lower()


def short(env_id: str) -> str:
    """The name that people say: `PendulumSwingUp`."""
    return env_id.rpartition("/")[2].partition("-v")[0]


def environment_page(env_id: str) -> str:
    """The page of one environment."""
    entry, spec = rodgym.ENVIRONMENTS[env_id], native_spec(env_id)
    family, diagram, words = FAMILIES[entry.machine]
    lead, why = LEADS[env_id]
    film, shows = FILMS[env_id]
    solved = "no single number" if entry.reward_threshold is None else f"{entry.reward_threshold:g}"
    seconds = entry.max_episode_steps * spec["control_dt"]
    expected = "" if spec["error"] is None else f", tip within {spec['error']:.0e} rod lengths"
    facts = [
        ("id", f"`{env_id}`"),
        ("observation", f"{len(spec['observation']['low'])} numbers"),
        ("action", ", ".join(spec["action"]["names"])),
        ("a step lasts", f"{1e3 * spec['control_dt']:g} ms"),
        ("an episode lasts", f"at most {entry.max_episode_steps} steps, {seconds:g} s"),
        ("physics", physics(spec) + expected),
        ("counts as solved at a return of", solved),
    ]
    reward = reward_of(spec)
    assert reward is not None, env_id
    bounds = zip(*(spec["observation"][k] for k in ("names", "low", "high")), strict=True)
    return "\n".join(
        [
            f"{NOTE}# {short(env_id)}\n",
            f"**{lead}** {why}\n",
            f"![{shows}](../images/{film})\n",
            *table(("property", "value"), facts),
            "## Coordinates\n",
            f"![{words}](../images/{diagram})\n",
            "## Reward\n",
            f"{reward.symbols}\n",
            *table(("term", "value", "range"), [(f"`{t}`", v, r) for t, v, r in reward.terms]),
            "## Observation\n",
            *table(("number", "what", "from", "to"), grouped(list(bounds))),
            "## Scores\n",
            *scores_section(env_id),
            "## More\n",
            f"[The family's page](../{family}) has starting states, the end of an episode, `info`,",
            "and every keyword with default, range and unit. The same on the command line:\n",
            f"```bash\nrodgym list {short(env_id)}\n```\n",
        ]
    )


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    """Lines of a table, and an empty one."""
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    return [*lines, *(f"| {' | '.join(row)} |" for row in rows), ""]


def grouped(components: list[tuple[str, float, float]]) -> list[tuple[str, ...]]:
    """Components of an observation, those that differ only by their index in one row."""
    rows: list[tuple[str, ...]] = []
    first = 0
    kinds = [(re.sub(r"\d+", "#", name, count=1), low, high) for name, low, high in components]
    for i in range(1, len(kinds) + 1):
        if i < len(kinds) and kinds[i] == kinds[first]:
            continue
        name, low, high = components[first]
        number = f"{first}"
        if i - first > 1:
            begin, end = (re.findall(r"\d+", components[k][0])[0] for k in (first, i - 1))
            number = f"{first} to {i - 1}"
            name = f"{re.sub(r'[0-9]+', 'k', name, count=1)}, k = {begin} to {end}"
        rows.append((number, name, f"{low:g}", f"{high:g}"))
        first = i
    return rows


def scores_section(env_id: str) -> list[str]:
    """What is known of returns here."""
    with SCORES.open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["id"] == env_id]
    shown = [
        (f"`{r['policy']}`", f"{float(r['return']):.1f}", r["success"] or "-", r["seeds"])
        for r in rows
    ]
    known = best_known(env_id)
    shown += known
    lines = [
        "Mean returns over episodes from the same seeds, by `rodgym evaluate`. *Success*: episodes",
        "that end [upright](../glossary.md#scores), in percent. `zoo` is the trained policy that",
        "comes with rodgym.\n",
        *table(("policy", "return", "success", "seeds"), shown),
    ]
    if known:
        lines.append("*Best known*: the actions of each episode that a search found; no policy.\n")
    else:
        lines.append(f"Nobody has searched for the [best return]({BEST_KNOWN}) of this task yet.\n")
    return lines


def best_known(env_id: str) -> list[tuple[str, ...]]:
    """The row of the best actions that are kept, of the environment with its defaults."""
    from rodgym.optimal import kept

    best: dict[int, float] = {}
    for episode in kept(env_id):
        if not episode.config:
            best[episode.seed] = max(episode.total, best.get(episode.seed, episode.total))
    if not best:
        return []
    mean = sum(best.values()) / len(best)
    return [(f"[best known]({BEST_KNOWN})", f"{mean:.1f}", "-", f"{min(best)} to {max(best)}")]


def play() -> None:
    """Plays every controller that fits, and the zoo's policy, in every environment."""
    from rodgym.evaluation import PolicyError, evaluate

    rows: list[dict[str, Any]] = []
    for env_id in rodgym.ENVIRONMENTS:
        spec = native_spec(env_id)
        description = machines.of(spec)
        for policy in (*description.controllers(spec), "zoo"):
            try:
                result = evaluate(policy, env_id, seeds=range(100))
            except PolicyError as error:
                print(f"{env_id}, {policy}: {error}")
                continue
            success = next((c.name for c in result.described if c.success), None)
            share = "" if success is None else f"{100 * result.mean(success):.0f} %"
            rows.append(
                {
                    "id": env_id,
                    "policy": policy,
                    "return": f"{result.mean('return'):.1f}",
                    "success": share,
                    "seeds": "0 to 99",
                }
            )
            print(*rows[-1].values())
    with SCORES.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def command_page() -> str:
    """Every subcommand with its examples."""
    lines = [
        f"{NOTE}# Command line\n",
        "The program `rodgym` comes with the package; `rodgym COMMAND --help` has all arguments.\n",
        *table(
            ("command", "what it does"),
            [(f"[`{n}`](#{n})", load_command(n).SUMMARY) for n in command_names()],
        ),
    ]
    for name in command_names():
        command = load_command(name)
        examples = "\n".join(line.strip() for line in command.EXAMPLES.strip().splitlines())
        text = linked(inspect.getdoc(command) or "")
        text = text.replace("](", "](../")
        lines.append(f"## {name}\n\n{text}\n\n```bash\n{examples}\n```\n")
    return "\n".join(lines)


def with_code(text: str, sources: Path) -> str:
    """A page whose blocks that begin with `// name` show the file of that name."""

    def block(found: re.Match[str]) -> str:
        return f"```rust\n// {found[1]}\n{(sources / found[1]).read_text()}```"

    return re.sub(r"```rust\n// (\S+)\n.*?```", block, text, flags=re.DOTALL)


def written() -> dict[Path, str]:
    """Every page that is written here, by its file."""
    texts = {DOCS / name: page(name, title, kind) for name, title, kind in PAGES}
    for env_id in rodgym.ENVIRONMENTS:
        texts[ENVIRONMENTS / f"{slug(env_id)}.md"] = environment_page(env_id)
    texts[DOCS / "api" / "command-line.md"] = command_page()
    return texts


if __name__ == "__main__":
    if "--play" in sys.argv[1:]:
        play()
    extending = DOCS / "extending.md"
    toy = DOCS.parent / "tests" / "toy" / "src"
    extending.write_text(with_code(extending.read_text(), toy))
    for path, text in written().items():
        path.write_text(text, encoding="utf-8")
