"""Every step of an evaluation as a table (CSV or Parquet) or as a data set of Minari."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import rodgym
from rodgym.errors import ParameterError
from rodgym.evaluation.conditions import make_single
from rodgym.extras import missing
from rodgym.runs import write_csv

if TYPE_CHECKING:
    from rodgym.evaluation.episodes import Evaluation

#: Endings of a table's name.
FORMATS = ("csv", "parquet")


@dataclass(frozen=True)
class Episode:
    """One episode of T steps: T + 1 observations, T of everything else."""

    seed: int
    observations: NDArray[np.float32]
    actions: NDArray[np.float32]
    rewards: NDArray[np.float64]
    metrics: dict[str, NDArray[np.float64]]
    terminated: bool
    control_dt: float

    def __len__(self) -> int:
        return len(self.rewards)


def episodes(evaluation: Evaluation) -> Iterator[Episode]:
    """The episodes of an evaluation that kept them.

    Raises
    ------
    ParameterError: it did not
    """
    if not evaluation.trajectories:
        raise ParameterError("no steps were kept: evaluate(..., trajectories=True) keeps them")
    for turn in evaluation.trajectories:
        assert turn.observations is not None
        for i, (seed, steps) in enumerate(zip(turn.seeds, turn.steps.tolist(), strict=True)):
            yield Episode(
                seed=seed,
                observations=turn.observations[: steps + 1, i],
                actions=turn.actions[:steps, i],
                rewards=turn.rewards[:steps, i],
                metrics={name: values[:steps, i] for name, values in turn.metrics.items()},
                terminated=bool(turn.terminated[i]),
                control_dt=turn.control_dt,
            )


def columns(evaluations: Sequence[Evaluation]) -> dict[str, NDArray[Any]]:
    """One row a step: what was seen, the action that it led to, and what came of that.

    The last row of an episode has its last observation, and NaN for the action that was not taken.
    """
    parts: dict[str, list[NDArray[Any]]] = {}

    def add(name: str, values: NDArray[Any]) -> None:
        parts.setdefault(name, []).append(values)

    for evaluation in evaluations:
        for episode in episodes(evaluation):
            rows = len(episode) + 1
            add("policy", np.full(rows, evaluation.policy))
            add("design", np.full(rows, evaluation.design))
            add("seed", np.full(rows, episode.seed, np.uint64))
            add("step", np.arange(rows))
            add("time", episode.control_dt * np.arange(rows))
            for k, values in enumerate(episode.observations.reshape(rows, -1).T):
                add(f"observation_{k}", values)
            for k, values in enumerate(episode.actions.reshape(len(episode), -1).T):
                add(f"action_{k}", np.append(values, np.float32(np.nan)))
            for name, steps in {"reward": episode.rewards, **episode.metrics}.items():
                add(name, np.append(steps, np.nan))
            ended = np.arange(rows) == len(episode)
            add("terminated", ended & episode.terminated)
            add("truncated", ended & (not episode.terminated))
    return {name: np.concatenate(values) for name, values in parts.items()}


def write_trajectories(path: str | Path, evaluations: Sequence[Evaluation]) -> None:
    """Writes every step of every episode: CSV or Parquet, as the name ends.

    Raises
    ------
    ParameterError: another ending, or steps that were not kept
    ImportError: Parquet without pyarrow
    """
    path = Path(path)
    kind = path.suffix.removeprefix(".")
    if kind not in FORMATS:
        raise ParameterError(
            f"path = {str(path)!r} is not allowed: it must end in .csv or .parquet"
        )
    table = columns(evaluations)
    if kind == "csv":
        rows = zip(*(_texts(values) for values in table.values()), strict=True)
        write_csv(path, list(table), rows)
        return
    _need("pyarrow")
    import pyarrow
    import pyarrow.parquet

    # `from_pandas`: NaN is stored as null.
    arrays = {name: pyarrow.array(values, from_pandas=True) for name, values in table.items()}
    pyarrow.parquet.write_table(pyarrow.table(arrays), path)


def _texts(values: NDArray[Any]) -> list[object]:
    """Cells of a CSV: every digit that a number has, nothing for NaN, 1 and 0 for flags."""
    if values.dtype == np.bool_:
        return values.astype(int).tolist()
    if values.dtype.kind != "f":
        return values.tolist()
    digits = 9 if values.dtype == np.float32 else 17
    return ["" if value != value else f"{value:.{digits}g}" for value in values.tolist()]


def write_minari(dataset_id: str, evaluation: Evaluation) -> Path:
    """Writes the episodes as a data set of Minari, and returns its folder.

    Minari keeps its data sets in ``~/.minari/datasets``, or where ``MINARI_DATASETS_PATH`` says.

    Parameters
    ----------
    dataset_id: as Minari has them: ``pendulum/lqr-v0``

    Raises
    ------
    ParameterError: an id that is not allowed or is there already, or steps that were not kept
    ImportError: without Minari
    """
    _need("minari", "h5py")
    import minari
    from minari.data_collector import EpisodeBuffer

    buffers = [
        EpisodeBuffer(
            id=number,
            seed=episode.seed,
            observations=list(episode.observations),
            actions=list(episode.actions),
            rewards=episode.rewards.tolist(),
            terminations=_last(len(episode), episode.terminated),
            truncations=_last(len(episode), not episode.terminated),
            infos={
                name: np.concatenate([[np.nan], values]) for name, values in episode.metrics.items()
            },
        )
        for number, episode in enumerate(episodes(evaluation))
    ]
    env = make_single(evaluation.env_id, evaluation.env_kwargs)
    try:
        with warnings.catch_warnings():
            # It asks for an author and a link to code, which are the user's to publish.
            warnings.simplefilter("ignore", UserWarning)
            data = minari.create_dataset_from_buffers(
                dataset_id,
                buffers,
                env=env,
                eval_env=env.spec,
                algorithm_name=evaluation.policy,
                description=(
                    f"{evaluation.policy} in {evaluation.env_id}, one episode for each of "
                    f"{len(buffers)} seeds"
                ),
                requirements=[f"rodgym=={rodgym.__version__}"],
                data_format="hdf5",
            )
    except ValueError as error:
        raise ParameterError(f"dataset_id = {dataset_id!r} is not allowed: {error}") from error
    finally:
        env.close()
    return Path(data.storage.data_path)


def _last(count: int, flag: bool) -> list[bool]:
    """False at every step but the last."""
    return [False] * (count - 1) + [flag]


def _need(*modules: str) -> None:
    if said := missing(modules):
        raise ImportError(said, name=modules[0])
