"""Where policies come from: a controller's name, a saved policy, a class of somebody's own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rodgym import _native, machines
from rodgym._layers import running
from rodgym._own import is_named
from rodgym.baselines import CONTROLLERS, Controller
from rodgym.errors import ParameterError
from rodgym.evaluation import own
from rodgym.evaluation.adapters import Normalized, Stacked, behind
from rodgym.evaluation.design import NOMINAL, Design, design_of, designed
from rodgym.evaluation.origin import Origin
from rodgym.evaluation.policy import AnyEnv, Policy, PolicyError, Random, Zero, check_policy
from rodgym.evaluation.saved import CARD, STATISTICS, read_card
from rodgym.zoo import is_zoo, zoo_policy

__all__ = [
    "CARD",
    "IDLE",
    "STATISTICS",
    "Normalized",
    "Player",
    "Policy",
    "PolicyError",
    "Random",
    "Stacked",
    "Zero",
    "behind",
    "controller_names",
    "find",
    "load_policy",
    "read_card",
    "ready",
]

#: Who reads a policy's file, `module:function` of path, card and environment, by the `kind` that
#: its card says. A card that says none is of Stable-Baselines3.
KINDS = {
    "student": "rodgym.distil.policy:load",
    "onnx": "rodgym.export.policy:load",
}
#: Policies that look at nothing.
IDLE: dict[str, Callable[[Any], Policy]] = {"random": Random, "zero": Zero}


def controller_names() -> list[str]:
    """Names that `load_policy` takes beside files."""
    return [*(name for name, _ in _native.controllers()), *IDLE]


@dataclass(frozen=True)
class Player:
    """A policy that is ready to play in an environment."""

    policy: Policy
    #: What a controller was designed for, or what was otherwise in a policy's training.
    design: str = ""


def ready(
    source: str | Policy,
    env: AnyEnv,
    env_id: str,
    design: Design | None = None,
    normalize: Any = None,
) -> Player:
    """A policy, by name or as an object, ready for an environment, with what it was made for.

    Parameters
    ----------
    source, env: as for `load_policy`
    env_id: the environment's id
    design: what a controller is designed for, see `rodgym.evaluation.design`
    normalize: statistics of a trained policy's ``VecNormalize`` (itself or its file); None: those
        that it brings along; False: none

    Raises
    ------
    PolicyError: it cannot be found, or does not fit the environment
    ParameterError: a design for something that is no controller
    """
    check_policy(source)
    if kept := running(env):
        raise ParameterError(
            f"{kept[0]} of {env_id} is not allowed in an evaluation: its statistics run on, so "
            "that no episode would be that of its seed (VecNormalize's statistics are kept)"
        )
    if isinstance(source, str) and source in CONTROLLERS:
        if normalize not in (None, False):
            raise PolicyError(f"normalize: {source!r} is a controller, which was not trained")
        return Player(*designed(source, env, env_id, design))
    if isinstance(source, Controller):
        if design is not None:
            raise ParameterError(f"design = {design!r}: {source!r} is designed already")
        source.fits(env)
        return Player(source, design_of(source, machines.spec_of(env)))
    if design is not None:
        raise ParameterError(f"design = {design!r} is for controllers; {source!r} is none")
    policy, origin = _found(source, env, normalize)
    if origin is None:
        return Player(policy)
    try:
        changed = origin.differences(machines.spec_of(env), env_id)
    except PolicyError as error:
        who = source if isinstance(source, str) else type(source).__name__
        raise PolicyError(f"{who} does not fit: {error}") from error
    return Player(policy, f"trained: {changed}" if changed else "")


def _found(source: str | Policy, env: AnyEnv, normalize: Any) -> tuple[Policy, Origin | None]:
    if isinstance(source, str) and source in IDLE:
        return IDLE[source](getattr(env, "single_action_space", env.action_space)), None
    if isinstance(source, str) and is_named(source):
        source = own.policy(source, env)
    if not isinstance(source, str):
        from rodgym.evaluation.trained import prepared

        return prepared(source, env, normalize)
    path = find(source, env)
    card = read_card(path)
    if "kind" not in card:
        from rodgym.evaluation.trained import load_trained

        return load_trained(path, env, normalize)
    if card["kind"] not in KINDS:
        known = ", ".join(KINDS)
        raise PolicyError(f"{path}: kind {card['kind']!r} is not one of {known}")
    if normalize not in (None, False):
        raise PolicyError(f"normalize: {path} is a {card['kind']}, which normalises by itself")
    return machines.load(KINDS[card["kind"]])(path, card, env), Origin.of_card(card)


def load_policy(source: str, env: AnyEnv) -> Policy:
    """The policy called ``source``, ready for ``env`` (single or vector).

    Parameters
    ----------
    source: a controller's name (`controller_names`), ``zoo`` or ``zoo:NAME`` for a trained
        policy that comes with rodgym, the path of a saved policy (``runs/demo/policy.zip``, also
        one that Stable-Baselines3 saved alone), or a class of your own (``mine.py:Policy``)
    env: environment that it will play in; a controller designs itself for its nominal parameters

    Raises
    ------
    PolicyError: unknown name, unreadable file, or a policy for another task, other observations or
        actions
    """
    spec = env.spec
    env_id = machines.spec_of(env)["id"] if spec is None else spec.id
    design = NOMINAL if source in CONTROLLERS else None
    return ready(source, env, env_id, design).policy


def find(source: str, env: AnyEnv | None = None) -> Path:
    """The file of a trained policy: ``zoo`` or ``zoo:NAME`` (of `env`), a path, a run's folder."""
    if is_zoo(source):
        if env is None:
            raise PolicyError(f"policy {source!r} is that of an environment: say which")
        return of_zoo(source, machines.spec_of(env)["id"])
    path = Path(source)
    if path.is_dir():
        path = path / "policy.zip"
    if not path.is_file():
        names = ", ".join(["zoo", *controller_names()])
        raise PolicyError(f"policy {source!r} is neither a file nor one of {names}")
    return path


def of_zoo(source: str, env_id: str) -> Path:
    """The file of a policy that comes with rodgym.

    Raises
    ------
    PolicyError: there is none of this name
    """
    name = source.partition(":")[2]
    found = zoo_policy(env_id, name)
    if found is None:
        called = f" called {name!r}" if name else ""
        raise PolicyError(f"no trained policy{called} for {env_id} comes with rodgym")
    return found
