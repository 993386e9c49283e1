"""The catalogue's environments in Python, and their registration with Gymnasium."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import gymnasium as gym

from rodgym import _native


@dataclass(frozen=True)
class Entry:
    """What the core's catalogue says of one environment."""

    id: str
    machine: str
    task: str
    max_episode_steps: int
    #: Return at which the task counts as solved; None where no single number says so.
    reward_threshold: float | None
    #: Class of a single environment, `module:name`.
    entry_point: str


#: Every row of the catalogue, by id.
ENVIRONMENTS: dict[str, Entry] = {}

#: Any environment of a server; needs `server=` and `env_id=`.
REMOTE = "rodgym/Remote-v0"


def register_all(environment: Callable[[str], str]) -> None:
    """Registers every row of the catalogue; again, where its machine has been described since.

    Args:
        environment: the class of a machine's single environment, `module:name`.
    """
    for row in _native.catalog():
        entry = Entry(**row, entry_point=environment(row["machine"]))
        ENVIRONMENTS[entry.id] = entry
        known = gym.registry.get(entry.id)
        if known is None or known.entry_point != entry.entry_point:
            gym.registry.pop(entry.id, None)
            gym.register(
                id=entry.id,
                entry_point=entry.entry_point,
                vector_entry_point="rodgym.vector:RodVectorEnv",
                max_episode_steps=entry.max_episode_steps,
                reward_threshold=entry.reward_threshold,
                kwargs={"env_id": entry.id},
            )
    if REMOTE not in gym.registry:
        # Everything about it is the server's to tell: its address and `env_id` are arguments.
        gym.register(
            id=REMOTE,
            entry_point="rodgym.remote.envs:make",
            vector_entry_point="rodgym.remote:RemoteVectorEnv",
        )
