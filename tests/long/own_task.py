"""What a reward and an observation of one's own cost: prints the table of docs/how-to/own-task.md.

python tests/long/own_task.py
"""

from __future__ import annotations

import time
from statistics import median

import gymnasium as gym
import numpy as np
import rodgym  # noqa: F401
from rodgym.own_task import State

SWING_UP = "rodgym/PendulumSwingUp-v0"
ROUNDS, STEPS = 15, 40


def reward(state: State) -> dict[str, np.ndarray]:
    """That of the page."""
    height = state.positions[:, -1, 1] / state.parameters["length"]
    speed = np.linalg.norm(state.velocities[:, -1], axis=1)
    return {"height": height, "calm": -0.05 * speed, "effort": -0.02 * state.actions[:, 0] ** 2}


def tip(state: State) -> np.ndarray:
    """That of the page."""
    return np.concatenate([state.positions[:, -1], state.velocities[:, -1]], axis=1)


def cost(envs: gym.vector.VectorEnv, actions: np.ndarray) -> float:
    """CPU time of a step [us]."""
    began = time.process_time()
    for _ in range(STEPS):
        envs.step(actions)
    return 1e6 * (time.process_time() - began) / STEPS


if __name__ == "__main__":
    print("| environments | native | own reward | own reward and observation |\n|---|---|---|---|")
    for count in (64, 256, 1024):
        kinds = [{}, {"reward": reward}, {"reward": reward, "observation": tip}]
        batches = [gym.make_vec(SWING_UP, num_envs=count, num_threads=1, **kind) for kind in kinds]
        for envs in batches:
            envs.reset(seed=0)
        actions = np.zeros((count, 1), np.float32)
        # All take turns, so that what else the machine does hits all alike.
        rounds = [[cost(envs, actions) for envs in batches] for _ in range(ROUNDS)]
        cells = [f"{median(column):.0f} us" for column in zip(*rounds, strict=True)]
        print(f"| {count} | {' | '.join(cells)} |")
