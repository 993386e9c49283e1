"""What a controller is designed for: nominal parameters, those of each episode, or others.

A controller needs a model. Where an environment draws its parameters, the choice of that model is
most of the result, so it is chosen by name and stands in every table:

* ``"nominal"``: the keywords of the environment, whatever an episode draws (a controller that
  learns its machine is told there what may be drawn);
* ``"each"``: every episode's own parameters. That is privileged: no policy is shown them;
* keywords, such as ``{"width": 0.009}``: these instead of the environment's;
* ``"drawn"``: of controllers that are found by playing (gaits): episodes as the environment draws
  them.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgym import _native
from rodgym._checks import refused
from rodgym.baselines import CONTROLLERS, Controller
from rodgym.baselines.controller import describe
from rodgym.evaluation.origin import DERIVED, shown
from rodgym.evaluation.policy import AnyEnv, Policy

Design: TypeAlias = str | Mapping[str, Any]

NOMINAL, EACH, DRAWN = WORDS = "nominal", "each", "drawn"


def drawn_by(spec: Mapping[str, Any]) -> tuple[str, ...]:
    """Names of the parameters that every episode of an environment draws."""
    return tuple(spec["config"].get("randomize") or ())


def usual_designs(name: str, spec: Mapping[str, Any]) -> tuple[Design, ...]:
    """The designs that a comparison shows where none is asked for, the best informed one first."""
    if not drawn_by(spec) or CONTROLLERS[name].learns:
        return (NOMINAL,)
    return (DRAWN,) if CONTROLLERS[name].plays else (EACH, NOMINAL)


def design_text(design: Design) -> str:
    """A design as tables and the command line write it."""
    if isinstance(design, str):
        return design
    return " ".join(f"{key}={shown(value)}" for key, value in design.items())


def designed(
    name: str, env: AnyEnv, env_id: str, design: Design | None = None
) -> tuple[Policy, str]:
    """A controller by name, and what it was designed for, in words; None: the first usual design.

    Raises
    ------
    ParameterError: a design that is not allowed, or wrappers that change what a controller sees
    DesignError: the design has no solution
    """
    law = CONTROLLERS[name]
    spec = describe(env)
    if design is None:
        design = usual_designs(name, spec)[0]
    drawn = drawn_by(spec)
    if isinstance(design, Mapping):
        return made(law, believed(spec, design)), design_text(design)
    if design == NOMINAL or (design in (EACH, DRAWN) and not drawn):
        # (What an environment draws is what a law that learns believes possible.)
        found = law.plays and not law.learns
        return made(law, with_parameters(spec, {}) if found else spec), NOMINAL
    if design == DRAWN and law.plays:
        return made(law, spec), DRAWN
    if design == EACH:
        return EachEpisode(law, spec, drawn), EACH
    words = f"{DRAWN!r}, " if law.plays else ""
    raise refused("design", design, f"{NOMINAL!r}, {EACH!r}, {words}or keywords of {env_id}")


def made(law: type[Controller], spec: Mapping[str, Any]) -> Controller:
    """A controller for a spec; one that is found by playing is found once and kept."""
    if not law.plays:
        return law(dict(spec))
    needed = ("id", "machine", "config", "observation", "action", "parameters")
    return _found(law.name, json.dumps({name: spec[name] for name in needed}, sort_keys=True))


@functools.lru_cache(maxsize=32)
def _found(name: str, spec: str) -> Controller:
    return CONTROLLERS[name](json.loads(spec))


def design_of(controller: Controller, spec: Mapping[str, Any]) -> str:
    """What a controller that is there was designed for, seen from an environment."""
    mine, here = controller.config, spec["config"]
    if controller.plays and mine.get("randomize"):
        return DRAWN
    names = [parameter["name"] for parameter in spec["parameters"]]
    changed = {k: mine[k] for k in names if k in mine and mine[k] != here.get(k)}
    return design_text(changed) if changed else NOMINAL


def with_parameters(spec: Mapping[str, Any], values: Mapping[str, float]) -> dict[str, Any]:
    """The spec of an environment with these parameters, which draws none."""
    return {**spec, "config": {**spec["config"], **values, "randomize": {}}}


def believed(spec: Mapping[str, Any], keywords: Mapping[str, Any]) -> dict[str, Any]:
    """The spec of the environment as a controller believes it to be.

    Raises
    ------
    ParameterError: keywords that it does not take
    """
    config = {k: v for k, v in spec["config"].items() if k not in DERIVED}
    fixed = {k: v for k, v in config["randomize"].items() if k not in keywords}
    belief: dict[str, Any] = _native.Batch(
        spec["id"], 1, {**config, "randomize": fixed, **keywords}
    ).spec
    return belief


class EachEpisode:
    """A controller that is designed anew for the parameters of every episode.

    `begin` is told them: one row an environment, when its first episode has begun.
    """

    def __init__(self, law: type[Controller], spec: Mapping[str, Any], drawn: tuple[str, ...]):
        self.law = law
        self.spec = spec
        self.drawn = drawn
        self.laws: list[Controller] = []

    def begin(self, parameters: Mapping[str, NDArray[np.float64]]) -> None:
        """Designs one controller for every episode, (n,) values of each parameter."""
        rows = zip(*(parameters[name] for name in self.drawn), strict=True)
        known: dict[tuple[float, ...], Controller] = {}
        self.laws = []
        for row in rows:
            key = tuple(float(value) for value in row)
            if key not in known:
                values = dict(zip(self.drawn, key, strict=True))
                known[key] = made(self.law, with_parameters(self.spec, values))
            self.laws.append(known[key])

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Each row by its own controller."""
        answers = [
            law.predict(
                observation[i : i + 1],
                None if state is None else state[i],
                None if episode_start is None else episode_start[i : i + 1],
            )
            for i, law in enumerate(self.laws)
        ]
        return np.concatenate([action for action, _ in answers]), [kept for _, kept in answers]
