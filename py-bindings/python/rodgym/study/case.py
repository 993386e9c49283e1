"""One case of a study: a pure function from its dictionary to a row of the table."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from rodgym import machines
from rodgym._own import is_named
from rodgym.baselines import CONTROLLERS
from rodgym.evaluation.conditions import conditions, make_batch, needs_end
from rodgym.evaluation.episodes import play
from rodgym.evaluation.policies import Policy, controller_names, find, ready
from rodgym.evaluation.saved import statistics_file
from rodgym.evaluation.score import score
from rodgym.study.spec import Case, StudyError
from rodgym.zoo import is_zoo

Row = dict[str, Any]


class Started(gym.vector.VectorWrapper):
    """Starts the first episodes from one exact state instead of a drawn one."""

    transparent = True

    def __init__(self, env: Any, state: dict[str, Any]) -> None:
        super().__init__(env)
        self._state = state

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """As the environment's, from the state."""
        inner: Any = self.env
        return inner.reset(seed=seed, options={**(options or {}), "state": self._state})


def run_case(case: Case) -> Row:
    """Plays the case's policy on its seeds and returns the means of the scores.

    The row depends on the case alone: not on the machine, the process or what ran before. Scores
    that no episode defines are NaN. A case with a key ``each`` also has that score of every
    episode, in one text.
    """
    return row_of(case)


def row_of(case: Case, policy: Policy | None = None) -> Row:
    """The row of a case; `policy` plays instead of the one that it names."""
    columns = play_case(case, policy)
    row: Row = {name: _mean(values) for name, values in columns.items()}
    if each := case.get("each"):
        row[f"each {each}"] = " ".join(f"{value:.9g}" for value in columns[each])
    return row


def play_case(case: Case, policy: Policy | None = None) -> dict[str, NDArray[np.float64]]:
    """Every score of every episode of a case; `policy` plays instead of the one that it names."""
    env_id, kwargs = conditions(case["env"], _below("env.", case))
    env: Any = make_batch(env_id, case["seeds"], kwargs, num_threads=1)
    try:
        needs_end(env)
        # Of a policy that nobody designs, such as a trained one, a case's design says nothing.
        design = _below("design.", case) or case.get("design")
        design = design if policy is None and case["policy"] in CONTROLLERS else None
        policy = ready(policy or case["policy"], env, env_id, design).policy
        start = _below("start.", case)
        if start:
            env = Started(env, start_state(machines.spec_of(env), start))
        first = case.get("seed", 0)
        return score(play(policy, env, range(first, first + case["seeds"])))
    finally:
        env.close()


def start_state(spec: Mapping[str, Any], given: Mapping[str, float]) -> dict[str, Any]:
    """The exact state that the keys `start.*` of a case stand for.

    Raises:
        StudyError: the machine has no such key.
    """
    about = machines.of(spec)
    for key in given:
        if about.start is None or key not in about.starts:
            allowed = ", ".join(f"start.{name}" for name in about.starts) or "none"
            raise StudyError(f"'start.{key}' is no start of a {about.word}: there are {allowed}")
    assert about.start is not None
    return about.start(spec, given)


def policy_files(policy: str) -> tuple[Path, ...]:
    """The files of a trained policy: itself, and what lies beside it (statistics, the card of an
    ONNX file); none for a policy that every rodgym has, or that is a class of the user's own.

    Raises:
        PolicyError: neither a name nor a file.
    """
    if is_zoo(policy) or policy in controller_names() or is_named(policy):
        return ()
    file = find(policy)
    beside = file.with_suffix(".json") if file.suffix == ".onnx" else statistics_file(file)
    return (file,) if beside is None else (file, beside)


def _below(prefix: str, case: Case) -> dict[str, Any]:
    return {key[len(prefix) :]: value for key, value in case.items() if key.startswith(prefix)}


def _mean(values: np.ndarray) -> float:
    defined = values[np.isfinite(values)]
    return float(defined.mean()) if defined.size else float("nan")
