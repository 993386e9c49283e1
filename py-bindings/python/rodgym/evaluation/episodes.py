"""Plays a policy on given seeds in the native batch, one episode per seed, and measures each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from rodgym import _checks as checks
from rodgym import machines
from rodgym.evaluation.conditions import conditions, needs_end
from rodgym.evaluation.policies import Policy, ask, check_policy, label_of, load_policy
from rodgym.evaluation.score import Column, Trajectories, columns_for, score
from rodgym.runs import write_csv

#: Episodes stepped side by side; more seeds are played in turns of this size.
BATCH = 1024


@dataclass(frozen=True)
class Evaluation:
    """Scores of one policy: ``columns[name][i]`` belongs to ``seeds[i]``."""

    policy: str
    env_id: str
    seeds: tuple[int, ...]
    described: tuple[Column, ...]
    columns: Mapping[str, NDArray[np.float64]]

    def mean(self, name: str) -> float:
        """Mean of a column over the episodes where it is defined; NaN where it is nowhere."""
        values = self.columns[name]
        defined = values[np.isfinite(values)]
        return float(defined.mean()) if defined.size else float("nan")

    def rows(self) -> list[list[object]]:
        """One row per episode: policy, seed, columns in SI units; empty where not defined."""
        table = zip(self.seeds, *(self.columns[c.name] for c in self.described), strict=True)
        return [
            [self.policy, seed, *("" if np.isnan(v) else f"{v:.9g}" for v in values)]
            for seed, *values in table
        ]

    def write_csv(self, path: Path) -> None:
        """Writes :meth:`rows` with a header."""
        write_csv(path, ["policy", "seed", *(c.name for c in self.described)], self.rows())


def evaluate(
    policy: str | Policy,
    env_id: str,
    seeds: Sequence[int] = range(100),
    *,
    env_kwargs: Mapping[str, Any] | None = None,
    name: str | None = None,
    on_step: Callable[[int, int], None] | None = None,
) -> Evaluation:
    """Plays one episode per seed and measures it.

    Every episode is the one that ``gym.make(env_id, **env_kwargs).reset(seed=seed)`` starts, bit
    for bit. The policy acts deterministically.

    Parameters
    ----------
    policy: something with ``predict``, or a name or file for :func:`load_policy`
    env_id: environment
    seeds: one episode each
    env_kwargs: keywords of the environment
    name: what the policy is called in tables
    on_step: called with (seeds done, steps of the present turn) after every step

    Raises
    ------
    PolicyError: the policy cannot be found or does not fit the environment
    ParameterError: no seeds, or seeds that are no whole numbers; a keyword that an evaluation
        chooses itself, or episodes without an end
    """
    seeds = checks.seeds(seeds)
    env_id, keywords = conditions(env_id, env_kwargs)
    check_policy(policy)
    label = label_of(policy, name)
    described: tuple[Column, ...] = ()
    parts: list[dict[str, NDArray[np.float64]]] = []
    for first in range(0, len(seeds), BATCH):
        turn = list(seeds[first : first + BATCH])
        env = gym.make_vec(env_id, num_envs=len(turn), **keywords)
        try:
            needs_end(env)
            actor = load_policy(policy, env) if isinstance(policy, str) else policy
            played = play(actor, env, turn, on_step and (lambda t, done=first: on_step(done, t)))
        finally:
            env.close()
        described = columns_for(played.spec)
        parts.append(score(played))
    columns = {c.name: np.concatenate([part[c.name] for part in parts]) for c in described}
    return Evaluation(label, env_id, tuple(seeds), described, columns)


def play(
    policy: Policy,
    env: gym.vector.VectorEnv[Any, Any, Any],
    seeds: Sequence[int],
    on_step: Callable[[int], None] | None = None,
) -> Trajectories:
    """Steps all environments until each has ended once."""
    count = env.num_envs
    observation, begun = env.reset(seed=list(seeds))  # type: ignore[arg-type]
    drawn = begun.get("parameters", {})
    running = np.ones(count, bool)
    terminated = np.zeros(count, bool)
    state: Any = None
    start = np.ones(count, bool)
    alive, rewards, actions = [], [], []
    metrics: dict[str, list[NDArray[np.float64]]] = {}
    while running.any():
        action, state = ask(policy, observation, state, start)
        observation, reward, ended, cut, info = env.step(action)
        alive.append(running.copy())
        rewards.append(reward)
        actions.append(np.array(action, np.float32))
        for key in metric_names(info):
            metrics.setdefault(key, []).append(np.array(info[key], np.float64))
        terminated |= running & ended
        start = ended | cut
        # An ended environment goes on with its next episode; its steps are not `alive`.
        running &= ~start
        if on_step:
            on_step(len(alive))
    return Trajectories(
        spec=machines.spec_of(env),
        alive=np.array(alive),
        rewards=np.array(rewards, np.float64),
        actions=np.array(actions),
        metrics={key: np.array(values) for key, values in metrics.items()},
        terminated=terminated,
        parameters={key: np.array(drawn[key], np.float64) for key in metric_names(drawn)},
    )


def metric_names(info: Mapping[str, Any]) -> list[str]:
    """The numbers that every step reports: one float64 per environment."""
    return [
        key
        for key, value in info.items()
        if not key.startswith("_")
        and isinstance(value, np.ndarray)
        and value.ndim == 1
        and value.dtype == np.float64
    ]
