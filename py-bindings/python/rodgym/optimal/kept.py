"""The best known actions of our own tasks, and their replay.

``zoo/best_known.json`` has a row for each environment: see `rodgym.evaluation.best_known`, which
puts the return into tables. ``zoo/best_known.npz`` has the actions, in whole numbers of 1 / LEVELS.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from rodgym.errors import ParameterError
from rodgym.evaluation.best_known import FILE

#: Actions are whole multiples of one over this.
LEVELS = 32767
ACTIONS = FILE.with_suffix(".npz")


@dataclass(frozen=True)
class Kept:
    """The best known actions of one episode."""

    #: The environment, its keywords and the seed of its reset.
    id: str
    config: dict[str, Any]
    seed: int
    #: Which way the rod goes up, as seen when the picture is drawn: `left` or `right`.
    side: str
    #: What it returned.
    total: float
    #: (t, 1), float32.
    actions: npt.NDArray[np.float32]


def kept(env_id: str | None = None) -> Iterator[Kept]:
    """All that is kept, of all environments or of one."""
    rows = json.loads(FILE.read_text(encoding="utf-8"))
    with np.load(ACTIONS) as arrays:
        for row in rows:
            if env_id not in (None, row["id"]):
                continue
            for episode in row["episodes"]:
                table = arrays[episode["actions"]]
                yield Kept(
                    row["id"],
                    dict(row["config"]),
                    episode["seed"],
                    episode["side"],
                    episode["return"],
                    actions_of(table),
                )


def actions_of(table: npt.NDArray[np.int16]) -> npt.NDArray[np.float32]:
    """Actions (t, 1) from whole numbers (t,)."""
    return (table.astype(np.float64) / LEVELS).astype(np.float32)[:, None]


def replay(episode: Kept) -> float:
    """Plays the actions in the environment and returns the sum of rewards.

    Raises:
        ParameterError: the episode ended before its last action.
    """
    env = gym.make(episode.id, **episode.config)
    env.reset(seed=episode.seed)
    rewards = []
    for step, action in enumerate(episode.actions, 1):
        _, reward, terminated, truncated, _ = env.step(action)
        rewards.append(float(reward))
        if (terminated or truncated) and step < len(episode.actions):
            raise ParameterError(f"the episode ended after {step} steps")
    env.close()
    return float(np.sum(rewards))
