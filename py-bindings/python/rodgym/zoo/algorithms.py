"""The algorithms that trainings know, by name, from Stable-Baselines3 and from sb3-contrib.

All of them act on continuous actions. Names are read in any case; rl-baselines3-zoo's own spelling
(``ppo_lstm``) is understood.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

import rodgym

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

#: Packages and the algorithms that they bring.
PACKAGES = {
    "stable_baselines3": ("PPO", "SAC", "TD3", "DDPG", "A2C"),
    "sb3_contrib": ("TQC", "CrossQ", "RecurrentPPO", "TRPO"),
}
ALGORITHMS = tuple(name for names in PACKAGES.values() for name in names)
#: Those that learn from a store of old steps.
OFF_POLICY = ("SAC", "TD3", "DDPG", "TQC", "CrossQ")
#: What rl-baselines3-zoo calls an algorithm that has another name as a class.
ZOO_NAMES = {"RecurrentPPO": "ppo_lstm"}
#: Algorithms that are known and not taken, with the reason.
NOT_TAKEN = {
    "DQN": "it needs discrete actions",
    "QRDQN": "it needs discrete actions",
    "MaskablePPO": "it needs discrete actions",
    "ARS": "it has no single agent to watch as it learns",
    "HER": "it needs environments with goals",
}


class AlgorithmError(rodgym.RodgymError, ValueError):
    """An algorithm that is unknown or not taken."""


def canonical(name: str) -> str:
    """The name of the class: ``ppo`` is ``PPO``, ``ppo_lstm`` is ``RecurrentPPO``.

    Raises
    ------
    AlgorithmError: no such algorithm, or one that is not taken
    """
    spelt = {known.lower(): known for known in (*ALGORITHMS, *NOT_TAKEN)}
    spelt |= {zoo: known for known, zoo in ZOO_NAMES.items()}
    known = spelt.get(str(name).lower())
    if known in NOT_TAKEN:
        raise AlgorithmError(f"algorithm {name!r} is not taken: {NOT_TAKEN[known]}")
    if known is None:
        raise AlgorithmError(f"algorithm {name!r} is not one of {', '.join(ALGORITHMS)}")
    return known


def package_of(name: str) -> str:
    """The package that brings an algorithm."""
    return next(package for package, names in PACKAGES.items() if canonical(name) in names)


def algorithm_class(name: str) -> type[BaseAlgorithm]:
    """The class of an algorithm; its package is imported now."""
    found: type[BaseAlgorithm] = getattr(importlib.import_module(package_of(name)), canonical(name))
    return found


def zoo_name(name: str) -> str:
    """What rl-baselines3-zoo calls it: also the name of its file of recipes."""
    return ZOO_NAMES.get(name, name.lower())
