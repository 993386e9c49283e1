"""Who is measured, and where."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rodgym import _native, machines
from rodgym.evaluation.policies import Policy, PolicyError, read_card

#: Where a policy plays of which nothing else is known.
DEFAULT_ENV = "rodgym/PendulumSwingUp-v0"


@dataclass(frozen=True)
class Candidate:
    """A policy and the nominal environment that it was made for.

    ``policy`` is a name or a file, as `rodgym.evaluation.load_policy` takes it, or anything with
    ``predict``. A controller is designed for the nominal environment and learns nothing of what
    becomes of it: how it bears that is the question.
    """

    name: str
    policy: str | Policy
    env_id: str = DEFAULT_ENV
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)


def usual_env(policy: str | Policy) -> tuple[str, dict[str, Any]]:
    """The environment in which a policy is at home, and its keywords: that of its training; for a
    controller the first one of which it is the usual controller (`lqg` sees the base alone).

    Raises:
        PolicyError: a trained policy that does not say where it was trained.
    """
    if not isinstance(policy, str):
        return DEFAULT_ENV, {}
    file = Path(policy) / "policy.zip" if Path(policy).is_dir() else Path(policy)
    if file.is_file():
        card = read_card(file)
        if "env" not in card:
            raise PolicyError(f"{policy} does not say where it was trained: name an environment")
        return str(card["env"]), dict(card.get("env_kwargs", {}))
    ids = [row["id"] for row in _native.catalog()]
    for env_id in sorted(ids, key=lambda known: known != DEFAULT_ENV):
        spec = _native.Batch(env_id, 1).spec
        usual = machines.of(spec).controllers(spec)
        if any(policy == name or policy.startswith(f"{name}-") for name in usual):
            return env_id, {}
    return DEFAULT_ENV, {}
