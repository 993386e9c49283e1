"""What Python says of each machine: one description a machine, looked up by the environment's spec.

Evaluation, reports, studies and the program ask `of(spec)`; none of them knows a machine by name.
Another package adds its own machine with `register`.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any

from rodgym._checks import refused
from rodgym._registration import register_all
from rodgym.errors import ParameterError
from rodgym.machines import fin, pendulum
from rodgym.machines.description import (
    Band,
    Column,
    Description,
    Picture,
    Quantity,
    Task,
    Trace,
)

__all__ = [
    "Band",
    "Column",
    "Description",
    "Picture",
    "Quantity",
    "Task",
    "Trace",
    "known",
    "load",
    "of",
    "register",
    "register_environments",
    "spec_of",
]

_KNOWN = {about.machine: about for about in (pendulum.PENDULUM, fin.FIN)}


def known() -> tuple[Description, ...]:
    """Every description, ours first."""
    return tuple(_KNOWN.values())


def of(spec: Mapping[str, Any]) -> Description:
    """The description of the machine of an environment, by its `core_spec` or catalogue's row.

    A machine that nobody has described (a newer server's) has a plain description: any environment
    can be stepped, scored by its return, recorded and drawn.
    """
    machine = str(spec["machine"])
    return _KNOWN.get(machine) or Description(machine)


def load(entry_point: str) -> Any:
    """The class that a description names as `module:name`."""
    module, _, name = entry_point.partition(":")
    return getattr(importlib.import_module(module), name)


def spec_of(env: Any) -> dict[str, Any]:
    """What the core says of an environment (`core_spec`), be it single, a vector environment or a
    Stable-Baselines3 `VecEnv`, however it is wrapped.

    Raises:
        ParameterError: not an environment of rodgym.
    """
    base = getattr(env, "unwrapped", env)
    spec = getattr(base, "core_spec", None)
    if spec is None:
        for name in ("get_attr", "call"):
            if hasattr(base, name):
                spec = getattr(base, name)("core_spec")[0]
                break
    if not isinstance(spec, dict):
        raise refused("env", env, "an environment of rodgym")
    return spec


def register(about: Description) -> None:
    """Adds a machine, and registers its environments with Gymnasium.

    Raises:
        ParameterError: a machine of that name, or one that calls its simulation so, is there.
    """
    taken = {word for other in known() for word in (other.machine, other.word)}
    if both := sorted(taken & {about.machine, about.word}):
        raise ParameterError(f"machine {both[0]!r} is not allowed: it is described already")
    _KNOWN[about.machine] = about
    register_environments()


def register_environments() -> None:
    """Registers the core's catalogue with Gymnasium, each row with its machine's environment."""
    register_all(lambda machine: of({"machine": machine}).environment)
