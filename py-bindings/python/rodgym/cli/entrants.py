"""Policies as named on the command line, the environment that they play in, and their folder."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rodgym._own import is_named
from rodgym.baselines import CONTROLLERS
from rodgym.cli.arguments import UsageError, env_keywords
from rodgym.evaluation.design import design_text, usual_designs
from rodgym.evaluation.saved import read_card
from rodgym.runs import Run


def title(source: str) -> str:
    """What a table calls a policy: ``LQR``, ``PPO`` for a trained one, else its own name."""
    card = _card(trained(source)[0])
    if card:
        return str(card["algorithm"])
    if is_named(source):
        return source.rpartition(":")[2]
    law = CONTROLLERS.get(source)
    return law.title or source if law else source


def trained(source: str) -> list[str]:
    """The policies in a folder of several trainings, by seed; else the source alone."""
    path = Path(source)
    if not path.is_dir() or (path / "policy.zip").is_file():
        return [source]
    found = [p for p in path.glob("seed-*/policy.zip") if p.parent.name[5:].isdecimal()]
    return [str(p) for p in sorted(found, key=lambda p: int(p.parent.name[5:]))] or [source]


def _card(source: str) -> dict[str, Any]:
    path = Path(source)
    path = path / "policy.zip" if path.is_dir() else path
    return read_card(path) if path.is_file() else {}


def resolve_env(
    source: str, env_id: str | None, env_kwargs: dict[str, Any], default: str
) -> tuple[str, dict[str, Any]]:
    """The environment asked for; without one, that in which the policy was trained, or the default.

    Keywords given by the user come on top of those of the training.

    Raises:
        UsageError: a trained policy that does not say where it was trained.
    """
    if env_id is None:
        card = _card(trained(source)[0])
        if card and "env" not in card:
            raise UsageError(f"{source} does not say where it was trained: give --env ID")
        env_id = str(card.get("env", default))
        env_kwargs = {**card.get("env_kwargs", {}), **env_kwargs}
    return env_id, env_keywords(env_id, env_kwargs)


@dataclass(frozen=True)
class Row:
    """A row of a table: its name, the policy, and what a controller is designed for."""

    name: str
    policy: str
    design: Any = None


def rows_of(source: str, spec: Mapping[str, Any], designs: Sequence[Any]) -> list[Row]:
    """The rows of a policy: a controller has one for every design.

    Args:
        source: the policy's name.
        spec: the environment's `core_spec`.
        designs: what was asked for; empty: the usual ones.
    """
    if source not in CONTROLLERS:
        return [Row(title(source), source)]
    chosen = designs or usual_designs(source, spec)
    if len(chosen) == 1:
        return [Row(title(source), source, chosen[0])]
    return [Row(f"{title(source)} ({design_text(one)})", source, one) for one in chosen]


def new_run(name: str, root: str, force: bool) -> Run:
    """The folder of a run: beside an earlier one of that name, which is said, unless forced."""
    asked = Run(name, Path(root))
    run = asked if force else asked.beside()
    if run is not asked:
        print(
            f"{asked.path} is there: this run is {run.path} (--force replaces the earlier one)",
            file=sys.stderr,
        )
    return run
