"""The whole state of a training in one file, so that a resumed one ends with the same bits.

A checkpoint is taken between rollouts. It holds the model with its optimizers and store of steps,
the environments in the middle of their episodes, wrappers and callbacks, the random streams, and
what was seen of the agent so far. It is a pickle: read only files that you trust.
"""

from __future__ import annotations

import inspect
import io
import os
import random
from pathlib import Path
from typing import Any

import cloudpickle
import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecEnvWrapper

#: Raised when the contents change.
VERSION = 1
#: What a callback sees of the step that it was last called in.
PASSING = ("locals", "globals")


class Pickler(cloudpickle.Pickler):
    """Pickles what Stable-Baselines3's own classes keep from being pickled."""

    def reducer_override(self, value: Any) -> Any:
        """Wrappers whole, `VecNormalize` too; callbacks without their last step; no loggers."""
        if isinstance(value, VecEnvWrapper):
            state = {k: v for k, v in vars(value).items() if k != "class_attributes"}
            # A file of returns belongs to the process that opened it.
            state |= {"results_writer": None} if "results_writer" in state else {}
            return _bare, (type(value),), state, None, None, _fill_wrapper
        if isinstance(value, BaseCallback):
            state = {k: v for k, v in vars(value).items() if k not in PASSING}
            return _bare, (type(value),), state, None, None, _fill_callback
        if isinstance(value, Logger):
            return _nothing, ()
        return super().reducer_override(value)


def _nothing() -> None:
    """Instead of a logger: a new one is made when learning goes on."""


def _bare(cls: type) -> Any:
    return object.__new__(cls)


def _fill_wrapper(wrapper: Any, state: dict[str, Any]) -> None:
    vars(wrapper).update(state, class_attributes=dict(inspect.getmembers(type(wrapper))))


def _fill_callback(callback: Any, state: dict[str, Any]) -> None:
    vars(callback).update(state, **{name: {} for name in PASSING})


def random_streams() -> dict[str, Any]:
    """The global streams that learning draws from."""
    return {
        "python": random.getstate(),
        "numpy": np.random.get_state(),  # noqa: NPY002 (Stable-Baselines3 draws from it)
        "torch": torch.get_rng_state(),
    }


def set_random_streams(streams: dict[str, Any]) -> None:
    """Goes on where `random_streams` was."""
    random.setstate(streams["python"])
    np.random.set_state(streams["numpy"])  # noqa: NPY002
    torch.set_rng_state(streams["torch"])


def exploration(model: BaseAlgorithm) -> list[dict[str, Any]]:
    """The noise of state-dependent exploration, which is drawn at the start of every rollout."""
    return [
        {k: v for k, v in vars(module.action_dist).items() if k.startswith("exploration_")}
        for module in model.policy.modules()
        if hasattr(module, "action_dist")
    ]


def set_exploration(model: BaseAlgorithm, noise: list[dict[str, Any]]) -> None:
    """Goes on with the noise of `exploration`."""
    owners = [module for module in model.policy.modules() if hasattr(module, "action_dist")]
    for owner, values in zip(owners, noise, strict=True):
        vars(owner.action_dist).update(values)


def write(path: Path, state: dict[str, Any]) -> None:
    """Writes a checkpoint. A process that is killed meanwhile leaves the one before."""
    buffer = io.BytesIO()
    Pickler(buffer).dump({"version": VERSION, **state})
    new = path.with_suffix(".new")
    with new.open("wb") as stream:
        stream.write(buffer.getbuffer())
        stream.flush()
        os.fsync(stream.fileno())
    new.replace(path)


def read(path: Path) -> dict[str, Any]:
    """What `write` wrote.

    Raises
    ------
    ValueError: a damaged file, or one of another version
    """
    try:
        with path.open("rb") as stream:
            state = cloudpickle.load(stream)
        version = state["version"]
    except OSError:
        raise
    except Exception as error:
        raise ValueError(f"{path} is no checkpoint: {error}") from error
    if version != VERSION:
        raise ValueError(f"{path} has version {version}, but {VERSION} is needed")
    return dict(state)
