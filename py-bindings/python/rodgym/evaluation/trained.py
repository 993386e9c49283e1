"""Trained policies: files of Stable-Baselines3 and models that are still in memory.

Such a policy is never asked about raw numbers that it did not see in its training: what its
training put before it (stacked frames, normalisation, its own actions) is put before it again, or
it is refused by name.
"""

from __future__ import annotations

import importlib
import pickle
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from rodgym import machines
from rodgym._layers import is_transparent, layers, name_of, opaque
from rodgym._registration import REMOTE
from rodgym.errors import ParameterError
from rodgym.evaluation.adapters import Normalized, Stacked, behind
from rodgym.evaluation.origin import Origin
from rodgym.evaluation.policy import AnyEnv, Policy, PolicyError
from rodgym.evaluation.saved import LIBRARIES, STATISTICS, read_card, statistics_file


def algorithm_class(name: str) -> Any:
    """The class of an algorithm, of Stable-Baselines3 or sb3-contrib; None where there is none."""
    for library in LIBRARIES:
        try:
            found = getattr(importlib.import_module(library), name, None)
        except ImportError:
            continue
        if found is not None:
            return found
    return None


@dataclass(frozen=True)
class Sight:
    """What stood between the environment and a policy in its training."""

    #: Observations that it saw at once; None: as many as its space says.
    frames: int | None = None
    #: Numbers of its own last action after each of them.
    own_actions: int = 0
    #: A `VecNormalize`; None: none was found; False: there was none.
    statistics: Any = None


def load_trained(path: Path, env: AnyEnv, normalize: Any = None) -> tuple[Policy, Origin | None]:
    """A saved policy behind what it saw in its training, and what is known of that.

    Parameters
    ----------
    normalize: statistics of its `VecNormalize`, see `statistics_of`

    Raises
    ------
    PolicyError: it cannot be read, or does not fit the environment
    """
    import torch

    torch.set_num_threads(1)
    card = read_card(path)
    algorithm = algorithm_class(str(card.get("algorithm")))
    if algorithm is None:
        raise PolicyError(
            f"{path}: algorithm {card.get('algorithm')!r} is in none of {', '.join(LIBRARIES)}"
        )
    try:
        model = algorithm.load(path, device="cpu")
    except (ValueError, KeyError, TypeError, AttributeError, pickle.UnpicklingError) as error:
        raise PolicyError(f"{path} cannot be loaded as {card['algorithm']}: {error}") from error
    origin = Origin.of_card(card)
    sight = Sight(
        frames=int(card["frame_stack"]) if "frame_stack" in card else None,
        own_actions=int(model.action_space.shape[0]) if card.get("own_actions") else 0,
        statistics=_found(path) if normalize is None else statistics_of(normalize),
    )
    behind_wrappers = [name.rpartition(".")[2] for name in card.get("wrappers") or ()]
    if absent := [name for name in behind_wrappers if name not in opaque(env)]:
        raise PolicyError(
            f"{path} was trained behind {absent[0]}, which the environment here does not have: "
            "register one that has it"
        )
    trained = f" was trained in {origin.env_id} and" if origin else ""
    return _behind(model, f"{path}{trained}", env, sight), origin


def statistics_of(source: Any) -> Any:
    """A `VecNormalize` with the statistics of a training: one itself, or the file of one. False,
    which says that there was none, and None stay.

    Raises
    ------
    PolicyError: something else
    """
    if source is None or source is False:
        return source
    if hasattr(source, "normalize_obs"):
        return source
    try:
        return _unpickled(Path(source).read_bytes(), str(source))
    except (TypeError, OSError) as error:
        reason = getattr(error, "strerror", None) or "no file and no VecNormalize"
        raise PolicyError(f"normalize = {source!r} is not allowed: {reason}") from error


def _unpickled(content: bytes, name: str) -> Any:
    try:
        statistics = pickle.loads(content)
    except Exception as error:  # Whatever a damaged pickle raises.
        raise PolicyError(f"{name} holds no VecNormalize of Stable-Baselines3: {error}") from error
    if not hasattr(statistics, "normalize_obs"):
        kind = type(statistics).__name__
        raise PolicyError(f"{name} holds no VecNormalize of Stable-Baselines3 but a {kind}")
    return statistics


def _found(path: Path) -> Any:
    """The statistics in a policy's file or beside it; None where there are none."""
    with zipfile.ZipFile(path) as archive:
        if STATISTICS in archive.namelist():
            return _unpickled(archive.read(STATISTICS), f"{path}, {STATISTICS}")
    beside = statistics_file(path)
    return None if beside is None else statistics_of(beside)


def _behind(model: Any, name: str, env: AnyEnv, sight: Sight) -> Policy:
    """A model behind stacked frames and statistics, where they fit the environment."""
    space = _observations(env)
    check_actions(model, name, env)
    frames = _frames(model, name, space, sight)
    if sight.statistics is None:
        _check_normalized(model, name, frames)
    if len(space.shape) != 1:
        return model  # type: ignore[no-any-return]
    try:
        return behind(model, frames, sight.own_actions, sight.statistics or None)
    except PolicyError as error:
        raise PolicyError(f"{name}: {error}") from error


def _frames(model: Any, name: str, space: gym.spaces.Box, sight: Sight) -> int:
    """Observations that a model sees at once; refuses one that sees others than those here."""
    sees, shows = model.observation_space.shape, space.shape
    flat = len(sees) == len(shows) == 1
    each = (shows[0] + sight.own_actions) if flat else 0
    frames = sight.frames or (max(1, sees[0] // each) if flat else 1)
    if sees != ((frames * each,) if flat else shows):
        alone = (sees[0] // frames - sight.own_actions,) if flat and sight.frames else sees
        raise PolicyError(
            f"{name} sees {numbers(alone)} numbers; this environment shows {numbers(shows)}"
        )
    if sight.frames is None:
        _check_bounds(model, name, space, frames)
    return frames


def numbers(shape: tuple[int, ...]) -> str:
    """A shape in words."""
    return " x ".join(str(side) for side in shape)


def prepared(model: Any, env: AnyEnv, normalize: Any = None) -> tuple[Policy, Origin | None]:
    """A policy object, ready for an environment; one of Stable-Baselines3 behind what it saw.

    A model in memory knows its training's environment: every wrapper there is applied here too,
    or refused by name. Other objects with `predict` stand as they are.

    Raises
    ------
    PolicyError: it does not fit the environment, or what it saw is not known
    """
    name = type(model).__name__
    statistics = statistics_of(normalize)
    if not (hasattr(model, "observation_space") and hasattr(model, "action_space")):
        return (Normalized(model, statistics) if statistics else model), None
    venv = model.get_env() if callable(getattr(model, "get_env", None)) else None
    if venv is None:
        return _behind(model, name, env, Sight(statistics=statistics)), None
    check_actions(model, name, env)
    policy: Policy = model
    mine = opaque(env)
    base = _innermost(venv)
    for layer in layers(venv):
        if name_of(layer) == "VecFrameStack":
            policy = Stacked(policy, layer.stacked_obs.n_stack)
        elif name_of(layer) == "OwnActions":
            policy = Stacked(policy, 1, int(layer.action_space.shape[0]))
        elif name_of(layer) == "VecNormalize" and layer.norm_obs:
            policy = Normalized(policy, statistics or layer)
        elif is_transparent(layer):
            continue
        elif name_of(layer) in mine:
            # The environment that it plays in is wrapped so, too.
            mine.remove(name_of(layer))
        else:
            raise PolicyError(
                f"{name} was trained behind {name_of(layer)}, which the environment here does not "
                "have: register one that has it, or, where it changes neither observations nor "
                "actions, give the wrapper an attribute transparent = True"
            )
    if mine and "envs" in vars(base):
        raise PolicyError(f"{name} was trained without {mine[0]}, which the environment here has")
    _check_bounds(base, name, _observations(env), 1)
    try:
        spec = machines.spec_of(base)
        registered = base.get_attr("spec", 0)[0].id
    except (ParameterError, AttributeError):
        return policy, None
    return policy, Origin.of_spec(spec, None if registered == REMOTE else registered)


def _innermost(venv: Any) -> Any:
    """The batch below all wrappers of Stable-Baselines3."""
    while "venv" in vars(venv):
        venv = venv.venv
    return venv


def _observations(env: AnyEnv) -> gym.spaces.Box:
    """The space of one environment's observations."""
    space = getattr(env, "single_observation_space", env.observation_space)
    if not isinstance(space, gym.spaces.Box):
        raise PolicyError(f"this environment shows {space}; a trained policy needs a Box")
    return space


def check_actions(model: Any, name: str, env: AnyEnv) -> None:
    """Refuses a policy whose actions mean something else here."""
    space: Any = getattr(env, "single_action_space", env.action_space)
    mine = model.action_space
    same = mine.shape == space.shape and all(
        np.allclose(getattr(mine, side, 0), getattr(space, side, 0)) for side in ("low", "high")
    )
    if not same:
        raise PolicyError(
            f"{name} acts in {mine}, but this environment takes {space}: was it trained behind a "
            "wrapper such as RescaleAction? Play it in an environment that has the wrapper"
        )


def _check_bounds(trained: Any, name: str, space: gym.spaces.Box, frames: int) -> None:
    """Refuses a policy whose observations were in other bounds: wrappers leave that trace."""
    mine = trained.observation_space
    if frames == 1 and mine.shape != space.shape:
        raise PolicyError(
            f"{name} sees {numbers(mine.shape)} numbers; this environment shows "
            f"{numbers(space.shape)}"
        )
    same = all(
        np.allclose(getattr(mine, side), np.repeat(getattr(space, side), frames, axis=-1))
        or np.allclose(getattr(mine, side), np.tile(getattr(space, side), frames))
        for side in ("low", "high")
    )
    if not same:
        raise PolicyError(
            f"{name} saw observations in {mine}, but this environment shows {space}: was it "
            "trained behind a wrapper such as NormalizeObservation or RescaleObservation? Play it "
            "in an environment that has the wrapper"
        )


def _check_normalized(model: Any, name: str, frames: int) -> None:
    """Refuses a policy that was trained on normalised observations, where nothing normalises them.

    A file of Stable-Baselines3 does not say so, but keeps the last observations of its training:
    normalised ones leave the bounds of the observation space.
    """
    last = getattr(model, "_last_obs", None)
    space = model.observation_space
    if not isinstance(last, np.ndarray) or not last.size:
        return
    low, high = space.low, space.high
    if frames > 1:
        # VecFrameStack repeats each bound, but puts whole observations one after the other.
        low, high = low.min(), high.max()
    slack = 1e-3 * np.maximum(1.0, np.abs(high))
    if (last < low - slack).any() or (last > high + slack).any():
        raise PolicyError(
            f"{name} was trained on normalised observations (VecNormalize), but its statistics are "
            f"not here: put {STATISTICS} beside it, or give --normalize FILE (normalize= in "
            "Python; False, or --normalize none, where there was none)"
        )
