"""A policy of the user's own, named as ``mine.py:Class`` or ``package.module:Class``."""

from __future__ import annotations

import inspect
from typing import Any

from rodgym._own import module_of
from rodgym.evaluation.policy import AnyEnv, Policy, PolicyError


def policy(source: str, env: AnyEnv) -> Policy:
    """The policy that a text names: an object with ``predict``, or a class or function that makes
    one, given the environment where it takes an argument.

    Raises
    ------
    PolicyError: no such module or name, or what it makes has no ``predict``
    """
    place, _, name = source.rpartition(":")
    module = module_of(place)
    found: Any = getattr(module, name, None)
    if found is None:
        raise PolicyError(f"{place!r} has no {name!r}")
    made = found
    if inspect.isclass(found) or not callable(getattr(found, "predict", None)):
        if not callable(found):
            raise PolicyError(f"{source!r} is {found!r}, which has no predict")
        made = found(env) if _takes_argument(found) else found()
    if not callable(getattr(made, "predict", None)):
        raise PolicyError(f"{source!r} makes a {type(made).__name__}, which has no predict")
    return made  # type: ignore[no-any-return]


def _takes_argument(made_by: Any) -> bool:
    """Whether it needs, or first takes, an argument by place."""
    by_place = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    try:
        parameters = inspect.signature(made_by).parameters.values()
    except (TypeError, ValueError):
        return False
    return any(p.kind in by_place and p.default is p.empty for p in parameters)
