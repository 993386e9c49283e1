"""Plays a policy on given seeds in the native batch, one episode per seed, and measures each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from rodgym import _checks as checks
from rodgym import machines
from rodgym._layers import is_unknown, layers
from rodgym._registration import REMOTE
from rodgym.baselines import Controller
from rodgym.errors import ParameterError
from rodgym.evaluation.best_known import best_known
from rodgym.evaluation.conditions import conditions, make_batch, needs_end
from rodgym.evaluation.design import Design, EachEpisode, drawn_by
from rodgym.evaluation.policies import ready
from rodgym.evaluation.policy import Policy, ask, check_policy, label_of
from rodgym.evaluation.score import Column, Trajectories, columns_for, score
from rodgym.evaluation.trajectories import write_minari, write_trajectories
from rodgym.runs import write_csv

#: Episodes stepped side by side; more seeds are played in turns of this size.
BATCH = 1024


@dataclass(frozen=True)
class Evaluation:
    """Scores of one policy: ``columns[name][i]`` belongs to ``seeds[i]``.

    ``design`` says what a controller was designed for (``nominal``, ``each``, keywords), and of a
    trained policy what was otherwise in its training (``trained: width=0.007``); ``parameters`` are
    the physical parameters that the episodes drew; ``best_known`` is the best mean return that
    anybody has found there, where one is kept (`rodgym.evaluation.best_known`);
    ``trajectories`` are kept where asked for.
    """

    policy: str
    env_id: str
    seeds: tuple[int, ...]
    described: tuple[Column, ...]
    columns: Mapping[str, NDArray[np.float64]]
    design: str = ""
    parameters: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    best_known: float | None = None
    trajectories: tuple[Trajectories, ...] = ()

    def mean(self, name: str) -> float:
        """Mean of a column over the episodes where it is defined; NaN where it is nowhere."""
        values = self.columns[name]
        defined = values[np.isfinite(values)]
        return float(defined.mean()) if defined.size else float("nan")

    @property
    def header(self) -> list[str]:
        """Names of the columns of `rows`."""
        return ["policy", "design", "seed", *(c.name for c in self.described), *self._drawn]

    def rows(self) -> list[list[object]]:
        """One row per episode: policy, design, seed, columns and drawn parameters in SI units;
        empty where not defined.
        """
        drawn = (self.parameters[name] for name in self._drawn)
        table = zip(
            self.seeds, *(self.columns[c.name] for c in self.described), *drawn, strict=True
        )
        return [
            [self.policy, self.design, seed, *("" if np.isnan(v) else f"{v:.9g}" for v in values)]
            for seed, *values in table
        ]

    @property
    def _drawn(self) -> list[str]:
        """Drawn parameters that are no column already."""
        return [name for name in self.parameters if name not in self.columns]

    def write_csv(self, path: str | Path) -> None:
        """Writes `rows` with a header."""
        write_csv(path, self.header, self.rows())

    def write_trajectories(self, path: str | Path) -> None:
        """Writes every step, see `rodgym.evaluation.trajectories.write_trajectories`."""
        write_trajectories(path, [self])

    def write_minari(self, dataset_id: str) -> Path:
        """Writes a data set, see `rodgym.evaluation.trajectories.write_minari`."""
        return write_minari(dataset_id, self)


def evaluate(
    policy: str | Policy,
    env_id: str,
    seeds: Sequence[int] = range(100),
    *,
    env_kwargs: Mapping[str, Any] | None = None,
    name: str | None = None,
    design: Design | None = None,
    normalize: Any = None,
    trajectories: bool = False,
    on_step: Callable[[int, int], None] | None = None,
) -> Evaluation:
    """Plays one episode per seed and measures it.

    Every episode is the one that ``gym.make(env_id, **env_kwargs).reset(seed=seed)`` starts, bit
    for bit. The policy acts deterministically.

    Parameters
    ----------
    policy: something with ``predict``, or a name or file for `load_policy`
    env_id: environment, ours or one that you registered (``module:id`` imports the module)
    seeds: one episode each
    env_kwargs: keywords of the environment
    name: what the policy is called in tables
    design: what a controller is designed for: ``"nominal"``, ``"each"`` (every episode's own
        parameters) or keywords; None: each episode's where parameters are drawn
    normalize: statistics of a trained policy's ``VecNormalize``, or their file; None: those that
        the model or its folder has; False: none
    trajectories: keeps every step, observations included
    on_step: called with (seeds done, steps of the present turn) after every step

    Raises
    ------
    PolicyError: the policy cannot be found or does not fit the environment
    ParameterError: no seeds, or seeds that are no whole numbers; a keyword that an evaluation
        chooses itself, or episodes without an end; a design for what is no controller
    """
    seeds = checks.seeds(seeds)
    env_id, keywords = conditions(env_id, env_kwargs)
    check_policy(policy)
    label = label_of(policy, name)
    turns: list[Trajectories] = []
    scores: list[dict[str, NDArray[np.float64]]] = []
    for first in range(0, len(seeds), BATCH):
        turn = list(seeds[first : first + BATCH])
        env = make_batch(env_id, len(turn), keywords)
        try:
            needs_end(env)
            player = ready(policy, env, env_id, design, normalize)
            noted = None if on_step is None else partial(on_step, first)
            played = play(player.policy, env, turn, noted, trajectories)
        finally:
            env.close()
        turns.append(played)
        scores.append(score(played))
    spec = turns[0].spec
    described = columns_for(spec)
    return Evaluation(
        policy=label,
        env_id=env_id,
        seeds=tuple(seeds),
        described=described,
        columns={c.name: np.concatenate([part[c.name] for part in scores]) for c in described},
        design=player.design,
        parameters={
            name: np.concatenate([turn.parameters[name] for turn in turns])
            for name in drawn_by(spec)
        },
        env_kwargs=keywords,
        best_known=best_known(spec) if _usual(env_id, spec, keywords) else None,
        trajectories=tuple(turns) if trajectories else (),
    )


def _usual(env_id: str, spec: Mapping[str, Any], keywords: Mapping[str, Any]) -> bool:
    """Whether episodes have our rewards and last as long as ours: others have another best."""
    steps = spec["default_max_episode_steps"]
    return env_id in (spec["id"], REMOTE) and keywords.get("max_episode_steps", steps) == steps


def play(
    policy: Policy,
    env: gym.vector.VectorEnv[Any, Any, Any],
    seeds: Sequence[int],
    on_step: Callable[[int], None] | None = None,
    observations: bool = False,
) -> Trajectories:
    """Steps all environments until each has ended once; keeps what was seen where asked to."""
    count = env.num_envs
    observation, begun = env.reset(seed=list(seeds))  # type: ignore[arg-type]
    drawn = begun.get("parameters", {})
    parameters = {key: np.array(drawn[key], np.float64) for key in metric_names(drawn)}
    begin(policy, env, observation, parameters)
    seen = [np.array(observation)] if observations else []
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
        if observations:
            seen.append(np.array(observation))
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
        parameters=parameters,
        observations=np.array(seen) if observations else None,
        seeds=tuple(seeds),
    )


def begin(
    policy: Policy, env: Any, observation: NDArray[Any], parameters: Mapping[str, NDArray[Any]]
) -> None:
    """Tells a policy that is designed for each episode what has begun.

    Raises
    ------
    ParameterError: a controller that would be shown other numbers than those of rodgym, by a
        wrapper of which nothing tells what it does
    """
    if not isinstance(policy, Controller | EachEpisode):
        return
    unknown = [type(layer).__name__ for layer in layers(env) if is_unknown(layer)]
    if unknown and not np.array_equal(observation, _shown_by_the_core(env), equal_nan=True):
        raise ParameterError(
            f"observations behind {' and '.join(unknown)} are not allowed for a controller: they "
            "are not those that rodgym defines"
        )
    if isinstance(policy, EachEpisode):
        policy.begin(parameters)


def _shown_by_the_core(env: Any) -> NDArray[Any]:
    """The observations below all wrappers, in the shape of the batch or of one environment."""
    if hasattr(env, "call"):
        return np.stack(env.call("last_observation"))
    return np.asarray(env.unwrapped.last_observation)[np.newaxis]


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
