"""Policies as named on the command line, and the environment that they play in."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rodgym.baselines import CONTROLLERS
from rodgym.cli.arguments import env_keywords
from rodgym.evaluation.policies import read_card


def title(source: str) -> str:
    """What a table calls a policy: ``LQR``, ``PPO`` for a trained one, else its own name."""
    card = _card(source)
    if card:
        return str(card["algorithm"])
    law = CONTROLLERS.get(source)
    return law.title or source if law else source


def _card(source: str) -> dict[str, Any]:
    path = Path(source)
    path = path / "policy.zip" if path.is_dir() else path
    return read_card(path) if path.is_file() else {}


def resolve_env(
    source: str, env_id: str | None, env_kwargs: dict[str, Any], default: str
) -> tuple[str, dict[str, Any]]:
    """The environment asked for; without one, that in which the policy was trained, or the default.

    Keywords given by the user come on top of those of the training.
    """
    if env_id is None:
        card = _card(source)
        env_id = str(card.get("env", default))
        env_kwargs = {**card.get("env_kwargs", {}), **env_kwargs}
    return env_id, env_keywords(env_id, env_kwargs)
