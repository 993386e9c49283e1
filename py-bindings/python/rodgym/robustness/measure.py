"""Plays every candidate at every value of every quantity."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rodgym import _checks as checks
from rodgym import machines
from rodgym._plain import plain
from rodgym.errors import ParameterError
from rodgym.evaluation.conditions import conditions, spec_for
from rodgym.evaluation.policies import Policy, check_policy
from rodgym.machines import Quantity
from rodgym.robustness.candidate import Candidate, usual_env
from rodgym.robustness.result import Robustness, success_column, success_of
from rodgym.study.case import row_of, run_case
from rodgym.study.engine import Backend, Rows, complete, local
from rodgym.study.spec import Case

#: Values of each quantity, and episodes at each value.
POINTS = 21
EPISODES = 20


def measure(
    candidates: Sequence[Candidate | str],
    *,
    seeds: int | range = EPISODES,
    quantities: Sequence[str] | None = None,
    points: int = POINTS,
    table: Path | None = None,
    backend: Backend | None = None,
    workers: int = 1,
    on_row: Callable[[int, int], None] | None = None,
) -> Robustness:
    """Success over each quantity, one at a time, all others at their nominal values.

    An episode succeeds when its task's own score says so (a pendulum: upright at the end; after a
    push it may swing up again). Where no score says so, as for fins, it succeeds when it returns at
    least 80 % of what the same policy returns on the same seed at the quantity's nominal value,
    which must be above 0.

    Arguments:
        candidates: who is measured; a name or a file alone plays where it is at home (`usual_env`).
        seeds: episodes at each value: a number of them, or a range of seeds.
        quantities: names of some; all that the machine has if left out.
        points: values of each quantity, odd, so that the nominal one is among them.
        table: a CSV file that keeps every value as it is finished: an interrupted measurement goes
            on from there. Left out, nothing is kept.
        backend: where the values are played, as for a study; `workers` processes if left out.
        workers: processes.
        on_row: called with (values there are, values in all).

    Raises:
        ParameterError: candidates of different machines or of one name, a quantity that the machine
            does not have, an even number of points.
        PolicyError: a policy that is not found.
    """
    seeds = _seeds(seeds)
    points = checks.whole("points", points, 3, None, "an odd whole number of at least 3")
    if points % 2 == 0:
        raise checks.refused("points", points, "an odd whole number of at least 3")
    known = [_candidate(one) for one in candidates]
    specs = [_spec(one) for one in known]
    chosen = _quantities(known, specs, quantities)
    success = success_column(specs[0])
    cases: list[Case] = []
    shown: list[dict[str, Any]] = []
    objects: dict[int, Policy] = {}
    for one, spec in zip(known, specs, strict=True):
        for quantity in chosen:
            for value in quantity.values(points):
                if not isinstance(one.policy, str):
                    objects[len(cases)] = one.policy
                cases.append(_case(one, spec, quantity, value, seeds))
                shown.append({"policy": one.name, "quantity": quantity.name, "value": value})
    run = backend or local(workers)
    if objects:
        if table is not None or backend is not None or workers > 1:
            raise ParameterError(
                "a policy that is not a name or a file cannot be kept in a table or sent to other "
                "processes: leave out table, backend and workers"
            )
        run = _with_objects(objects)
    with tempfile.TemporaryDirectory(prefix="rodgym-") as folder:
        rows = complete(cases, shown, table or Path(folder) / "table.csv", run, on_row)
    names = tuple(one.name for one in known)
    returns = np.array([[float(x) for x in row["each return"].split()] for row in rows])
    shape = (len(known), len(chosen), points)
    episodes = returns.reshape(*shape, len(seeds))
    if success is None:
        shares = success_of(episodes, [q.values(points).index(q.nominal) for q in chosen])
    else:
        shares = np.array([float(row[success]) for row in rows]).reshape(shape)
    return Robustness(names, tuple(chosen), seeds, shares, episodes, success)


def _seeds(seeds: int | range) -> range:
    if isinstance(seeds, range):
        if seeds.step != 1 or not seeds or seeds.start < 0:
            raise checks.refused("seeds", seeds, "a range of at least one seed in steps of 1")
        return seeds
    return range(checks.whole("seeds", seeds, 1, None, "at least 1"))


def _candidate(one: Candidate | str) -> Candidate:
    if isinstance(one, str):
        env_id, env_kwargs = usual_env(one)
        return Candidate(one, one, env_id, env_kwargs)
    check_policy(one.policy)
    return one


def _spec(one: Candidate) -> dict[str, Any]:
    """The nominal environment, as the core has it."""
    return spec_for(*conditions(one.env_id, one.env_kwargs))


def _quantities(
    known: Sequence[Candidate], specs: Sequence[Mapping[str, Any]], names: Sequence[str] | None
) -> list[Quantity]:
    """The quantities asked for.

    Raises:
        ParameterError: see `measure`.
    """
    if not known:
        raise ParameterError("candidates = [] is not allowed: name at least one policy")
    labels = [one.name for one in known]
    if twice := sorted({name for name in labels if labels.count(name) > 1}):
        raise ParameterError(f"candidates: two are called {twice[0]!r}")
    tables = [machines.of(spec).quantities(spec) for spec in specs]
    sorts = {tuple(quantity.name for quantity in table) for table in tables}
    if len(sorts) > 1:
        words = sorted({f"{spec['machine']} ({spec['task']})" for spec in specs})
        raise ParameterError(
            f"candidates play {', '.join(words)}: they have no quantities in common to be "
            "measured by; measure them apart"
        )
    by_name = {quantity.name: quantity for quantity in tables[0]}
    if not by_name:
        raise ParameterError(f"machine {specs[0]['machine']!r} has no quantities to vary")
    for name in names or ():
        if name not in by_name:
            raise checks.refused("quantity", name, f"one of {', '.join(by_name)}")
    return [by_name[name] for name in dict.fromkeys(names or by_name)]


def _case(
    one: Candidate, spec: Mapping[str, Any], quantity: Quantity, value: float, seeds: range
) -> Case:
    """A case of a study in which one quantity is other than the policy's design has it."""
    env_id, keywords = conditions(one.env_id, one.env_kwargs)
    config = spec["config"]
    changed = quantity.keywords(spec, value)
    drawn = {k: v for k, v in config.get("randomize", {}).items() if k not in changed}
    if drawn != config.get("randomize", {}):
        # What is varied is not drawn.
        changed["randomize"] = drawn
    env = {**keywords, **changed}
    design = {name: config[name] for name in changed if name in config}
    # An object has no name that a case could be played by: `_with_objects` plays it.
    named = (
        {"policy": one.policy}
        if isinstance(one.policy, str)
        else {
            "policy": "zero",
            "object": one.name,
        }
    )
    return {
        "env": env_id,
        **named,
        "seeds": len(seeds),
        "seed": seeds.start,
        "each": "return",
        **{f"env.{name}": plain(setting) for name, setting in env.items()},
        **{f"design.{name}": setting for name, setting in design.items()},
    }


def _with_objects(objects: Mapping[int, Policy]) -> Backend:
    """Plays the cases of policies that are no names in this process."""

    def run(cases: list[tuple[int, Case]]) -> Rows:
        for number, case in cases:
            policy = objects.get(number)
            yield number, run_case(case) if policy is None else row_of(case, policy)

    return run
