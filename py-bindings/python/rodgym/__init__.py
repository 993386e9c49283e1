"""Elastic rods as reinforcement-learning environments.

Importing registers the environments, so that `gym.make("rodgym:rodgym/PendulumSwingUp-v0")` works
alone. Parts that need more than numpy and gymnasium are imported when first used: `rodgym.sb3`,
`rodgym.baselines`, `rodgym.remote`, `rodgym.ray`, `rodgym.optimize`.
"""

from __future__ import annotations

import importlib
from typing import Any

from rodgym import machines
from rodgym._native import __version__
from rodgym._registration import ENVIRONMENTS
from rodgym.errors import RodgymError

__all__ = ["ENVIRONMENTS", "RodgymError", "__version__"]

_SUBMODULES = frozenset(
    {"baselines", "envs", "errors", "machines", "optimal", "ray", "remote", "sb3", "sim", "vector"}
)

machines.register_environments()


def __getattr__(name: str) -> Any:
    if name in _SUBMODULES:
        return importlib.import_module(f"rodgym.{name}")
    if name == "optimize":
        return importlib.import_module("rodgym.optimal").optimize
    raise AttributeError(f"module 'rodgym' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_SUBMODULES, "optimize"})
