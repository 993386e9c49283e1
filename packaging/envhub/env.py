"""rodgym's environments for LeRobot's EnvHub.

Put this file into a repository OWNER/rodgym of the Hugging Face Hub, where OWNER is your name
there. Nothing in the file must be replaced. Users then call `make_env("OWNER/rodgym",
trust_remote_code=True)`; they need `pip install rodgym`. RODGYM_TASK chooses one task instead of
all.
"""

from __future__ import annotations

import os

import gymnasium as gym
import rodgym


def make_env(
    n_envs: int = 1, use_async_envs: bool = False
) -> dict[str, dict[int, gym.vector.VectorEnv]]:
    """Native batches by suite and number; one process steps them, whatever `use_async_envs` says.

    Arguments:
        n_envs: environments of a batch.
        use_async_envs: not used: a native batch has threads of its own.
    """
    wanted = os.environ.get("RODGYM_TASK")
    tasks = [wanted] if wanted else list(rodgym.ENVIRONMENTS)
    # LeRobot reads the last observation of an ending step from `final_info`.
    made = [gym.make_vec(task, num_envs=n_envs, autoreset_mode="SameStep") for task in tasks]
    return {"rodgym": dict(enumerate(made))}
