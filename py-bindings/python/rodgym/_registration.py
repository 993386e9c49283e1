"""The table of environments, and their registration with Gymnasium."""

from __future__ import annotations

from dataclasses import dataclass

import gymnasium as gym


@dataclass(frozen=True)
class Entry:
    """What Gymnasium is told of one environment."""

    entry_point: str
    max_episode_steps: int
    #: Return at which the task counts as solved; None where no single number says so.
    reward_threshold: float | None = None


ENVIRONMENTS: dict[str, Entry] = {
    "rodgym/PendulumSwingUp-v0": Entry("rodgym.envs:PendulumEnv", 500, 400.0),
    "rodgym/PendulumBalance-v0": Entry("rodgym.envs:PendulumEnv", 1000, 950.0),
    "rodgym/PendulumSwingUpBase-v0": Entry("rodgym.envs:PendulumEnv", 500, 400.0),
    "rodgym/FinThrust-v0": Entry("rodgym.envs:FinEnv", 200),
    "rodgym/FinEfficiency-v0": Entry("rodgym.envs:FinEnv", 200),
    "rodgym/FinSwim-v0": Entry("rodgym.envs:FinEnv", 250),
}


#: Any environment of a server; needs `server=` and `env_id=`.
REMOTE = "rodgym/Remote-v0"


def register_all() -> None:
    """Registers every environment of the table, once."""
    for env_id, entry in ENVIRONMENTS.items():
        if env_id not in gym.registry:
            gym.register(
                id=env_id,
                entry_point=entry.entry_point,
                vector_entry_point="rodgym.vector:RodVectorEnv",
                max_episode_steps=entry.max_episode_steps,
                reward_threshold=entry.reward_threshold,
                kwargs={"env_id": env_id},
            )
    if REMOTE not in gym.registry:
        # Everything about it is the server's to tell: its address and `env_id` are arguments.
        gym.register(
            id=REMOTE,
            entry_point="rodgym.remote.envs:make",
            vector_entry_point="rodgym.remote:RemoteVectorEnv",
        )
