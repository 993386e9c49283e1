"""Shows the environments, or everything about one of them."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Sequence
from typing import Any

from rodgym.cli.arguments import UsageError, env_id

#: Parts of a space.
SPACE = ("low", "high", "names")

SUMMARY = "show the environments, or everything about one: reward, keywords, accuracy"
EXAMPLES = """
rodgym list
rodgym list PendulumSwingUp
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("env", nargs="?", type=env_id, metavar="ID", help="show this one in full")


def run(args: argparse.Namespace) -> int:
    from rodgym._registration import REMOTE

    if args.env == REMOTE:
        raise UsageError(f"{REMOTE} is any environment of a server, which knows its keywords")
    print(describe(args.env) if args.env else overview())
    return 0


def overview() -> str:
    """One line per environment, and the names of the controllers."""
    from rodgym import ENVIRONMENTS
    from rodgym._registration import REMOTE
    from rodgym.evaluation import controller_names

    rows = [("id", "observation", "action", "steps", "step [s]", "physics", "error")]
    for name in ENVIRONMENTS:
        spec = native_spec(name)
        rows.append(
            (
                name,
                str(len(spec["observation"]["low"])),
                str(len(spec["action"]["low"])),
                str(spec["default_max_episode_steps"]),
                f"{spec['control_dt']:g}",
                physics(spec),
                "-" if spec["error"] is None else f"{spec['error']:.0e}",
            )
        )
    names = ", ".join(controller_names())
    remote = f"{REMOTE}, with --env-arg server=tcp://HOST:5555 --env-arg env_id=ID (docs/remote.md)"
    return (
        f"environments\n{table(rows)}\n\nany of them on a server\n  {remote}\n\n"
        f"controllers\n  {names}"
    )


def physics(spec: dict[str, Any]) -> str:
    """Scheme and step."""
    return f"{spec['config']['stepper']} {1e3 * spec['physics_dt']:g} ms"


def describe(name: str) -> str:
    """Spaces, reward and keywords of one environment."""
    spec = native_spec(name)
    seen = [
        (f"{low:g}", f"{high:g}", what)
        for low, high, what in zip(*(spec["observation"][k] for k in SPACE), strict=True)
    ]
    head = ("keyword", "default", "allowed", "unit", "what")
    keywords = [
        (p["name"], f"{p['default']:g}", f"{p['low']:g} to {p['high']:g}", p["unit"], p["doc"])
        for p in spec["parameters"]
    ]
    others = [
        (
            k["name"],
            shown(spec["config"][k["name"]], k["default"]),
            k["allowed"],
            k["unit"],
            k["doc"],
        )
        for k in spec["keywords"]
    ]
    return "\n\n".join(
        [
            f"{name}: {spec['default_max_episode_steps']} steps of {spec['control_dt']:g} s, "
            f"physics by {physics(spec)}{expected(spec)}",
            "observation\n" + table([("from", "to", "what"), *seen]),
            f"action\n  {', '.join(spec['action']['names'])}",
            reward(spec),
            f"info at every step\n  reward_terms, {', '.join(spec['metrics'])}",
            "physical parameters (fixed, randomised, or set at reset)\n" + table([head, *keywords]),
            "other keywords\n" + table([head, *others]),
        ]
    )


def expected(spec: dict[str, Any]) -> str:
    """How exact the steps are, where there is an estimate."""
    if spec["error"] is None:
        return ""
    return (
        f",\n  which keeps the tip within {spec['error']:.0e} of the length from the converged "
        "path after 1 s of free swing"
    )


def reward(spec: dict[str, Any]) -> str:
    """Terms with formula and range, as the environment's page has them."""
    from rodgym.report.reward import reward_of

    known = reward_of(spec)
    if known is None:
        return f"reward, the sum of\n  {', '.join(spec['reward_terms'])}"
    symbols = textwrap.fill(known.symbols, 96, initial_indent="  ", subsequent_indent="  ")
    return "reward\n" + table([("term", "value", "range"), *known.terms]) + f"\n{symbols}"


def shown(value: Any, words: str) -> str:
    """A default as this environment has it, or in words where that would fill the line."""
    text = str(value)
    return text if len(text) <= 60 else words


def native_spec(name: str) -> dict[str, Any]:
    """What the core says of an environment."""
    import rodgym._native

    spec: dict[str, Any] = rodgym._native.Batch(name, 1).spec
    return spec


def table(rows: Sequence[Sequence[str]]) -> str:
    """Columns, two blanks apart."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = [
        "  " + "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True))
        for row in rows
    ]
    return "\n".join(line.rstrip() for line in lines)
