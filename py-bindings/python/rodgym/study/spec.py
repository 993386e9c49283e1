"""What a study is, and how its YAML is read.

.. code-block:: yaml

    title: Region of attraction
    env: rodgym/PendulumSwingUp-v0
    seeds: 1                       # episodes of every case: n seeds from 0 on, or from `seed` on
    fixed: {env.width: 0.007}      # the same in every case
    sweep:                         # every combination is a case
      policy: [lqr, lqr-hybrid]
      start.angle: {from: -3.1, to: 3.1, steps: 41}
    plot: {x: start.angle, y: start.rate, value: upright, panel: policy}

Keys: ``policy`` (a controller's name or a trained policy's file), ``env.<keyword>`` of the
environment, ``design`` (what a controller is designed for: ``nominal``, ``each``, see
`rodgym.evaluation.design`), ``design.<keyword>`` (what it believes, where that differs),
``start.<name>`` of the machine's exact start (``start.angle`` [rad] and ``start.rate`` [rad/s] of a
straight pendulum), ``seed`` (the first seed of
the case's episodes: sweep it to have a row for each).
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import rodgym
from rodgym import _native, machines
from rodgym._checks import episode_steps
from rodgym._literal import literal
from rodgym._registration import REMOTE
from rodgym.evaluation.conditions import CHOSEN
from rodgym.evaluation.design import WORDS
from rodgym.machines import Column

Case = dict[str, Any]

#: Cases that one study may have.
MAX_CASES = 1_000_000
_TOP = ("title", "env", "seeds", "fixed", "sweep", "plot")
_PLOT = ("x", "y", "value", "panel", "line")
_PLAIN = ("policy", "seed", "design")
LIMIT = "env.max_episode_steps"


class StudyError(rodgym.RodgymError, ValueError):
    """A study that cannot be read or continued."""


@dataclass(frozen=True)
class Study:
    """A grid of cases: ``fixed`` and every combination of ``sweep``, in the order written."""

    title: str
    env: str
    seeds: int = 1
    fixed: Mapping[str, Any] = field(default_factory=dict)
    sweep: Mapping[str, list[Any]] = field(default_factory=dict)
    plot: Mapping[str, str] = field(default_factory=dict)

    def cases(self) -> Iterator[Case]:
        """Every case, a dictionary that JSON can write; the sweep's last key runs fastest."""
        for values in itertools.product(*self.sweep.values()):
            swept = dict(zip(self.sweep, values, strict=True))
            yield {"env": self.env, "seeds": self.seeds, **self.fixed, **swept}

    @property
    def policies(self) -> list[str]:
        """Every policy of its cases, once."""
        fixed = [self.fixed["policy"]] if "policy" in self.fixed else []
        return list(dict.fromkeys([*fixed, *self.sweep.get("policy", ())]))

    def with_keywords(self, keywords: Mapping[str, Any]) -> Study:
        """The same with more keywords of the environment; its own come on top."""
        more = {f"env.{name}": value for name, value in keywords.items()}
        fixed = {name: value for name, value in more.items() if name not in self.sweep}
        return replace(self, fixed={**fixed, **self.fixed})

    def __len__(self) -> int:
        count = 1
        for values in self.sweep.values():
            count *= len(values)
        return count


def case_id(case: Case, files: Sequence[Path] = ()) -> str:
    """A name for a case that depends on its content only, that of its policy's files included."""
    text = json.dumps(case, sort_keys=True, separators=(",", ":"))
    content = b"".join([text.encode(), *(file.read_bytes() for file in files)])
    return hashlib.sha256(content).hexdigest()[:16]


def plans() -> dict[str, Path]:
    """The studies that come with rodgym, by name."""
    return {path.stem: path for path in sorted((Path(__file__).parent / "plans").glob("*.yml"))}


def read(source: str | Path) -> Study:
    """A study from a YAML file, or one of ours by name (`plans`).

    Raises:
        StudyError: the file is missing, or says something that no study has.
    """
    import yaml

    path = plans().get(str(source), Path(source))
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        known = ", ".join(plans())
        raise StudyError(f"study {str(source)!r}: {error.strerror}; ours are {known}") from error
    except yaml.YAMLError as error:
        raise StudyError(f"study {str(source)!r} is not YAML: {error}") from error
    if not isinstance(content, dict):
        raise StudyError(f"study {str(source)!r} must be a mapping with env and sweep")
    return parse(content, path.stem)


def parse(content: Mapping[str, Any], name: str) -> Study:
    """A study from what its YAML says."""
    _only("the study", content, _TOP)
    for needed in ("env", "sweep"):
        if needed not in content:
            raise StudyError(f"the study has no {needed!r}")
    seeds = content.get("seeds", 1)
    if not isinstance(seeds, int) or isinstance(seeds, bool) or seeds < 1:
        raise StudyError(f"seeds = {seeds!r} is not allowed: it must be a whole number, 1 or more")
    fixed = {k: _read(k, v) for k, v in _mapping("fixed", content.get("fixed", {})).items()}
    sweep = {
        k: [_read(k, one) for one in _values(k, v)]
        for k, v in _mapping("sweep", content["sweep"]).items()
    }
    env = str(content["env"])
    scores, starts = columns_of(env), starts_of(env)
    for key in (*fixed, *sweep):
        if key not in (*_PLAIN, *starts) and not key.startswith(("env.", "design.")):
            raise StudyError(
                f"{key!r} is no key of a case in {env}: there are env.<keyword>, "
                f"design.<keyword>, {', '.join((*_PLAIN, *starts))}"
            )
        start = key in starts
        for value in (*sweep.get(key, ()), fixed.get(key, 0.0)) if start else ():
            _end(key, "value", value)
        if (word := key.removeprefix("env.")) != key and word in (*CHOSEN, "num_threads"):
            raise StudyError(f"{key!r} is not allowed: a study chooses it")
    for limit in (*sweep.get(LIMIT, ()), fixed.get(LIMIT)):
        episode_steps(limit)
    if both := sorted(set(fixed) & set(sweep)):
        raise StudyError(f"{both[0]!r} is both fixed and swept")
    if "policy" not in (*fixed, *sweep):
        raise StudyError("the study names no policy, neither fixed nor swept")
    for seed in (*sweep.get("seed", ()), fixed.get("seed", 0)):
        if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
            raise StudyError(
                f"seed = {seed!r} is not allowed: it must be a whole number, 0 or more"
            )
    for policy in (*sweep.get("policy", ()), fixed.get("policy", "")):
        if not isinstance(policy, str):
            raise StudyError(f"policy = {policy!r} is not allowed: it must be a name or a file")
    for design in (*sweep.get("design", ()), *((fixed["design"],) if "design" in fixed else ())):
        if design not in WORDS:
            raise StudyError(f"design = {design!r} is not allowed: there are {', '.join(WORDS)}")
    if "design" in (*fixed, *sweep) and any(k.startswith("design.") for k in (*fixed, *sweep)):
        raise StudyError("a study has either design or design.<keyword>")
    plot = _mapping("plot", content.get("plot", {}))
    _check_plot(plot, {**{key: [value] for key, value in fixed.items()}, **sweep}, scores)
    title = str(content.get("title", name))
    study = Study(title, env, seeds, fixed, sweep, plot)
    if len(study) > MAX_CASES:
        raise StudyError(f"the study has {len(study)} cases; allowed are {MAX_CASES}")
    return study


def specs_of(env: str) -> list[dict[str, Any]]:
    """What an environment may be: a server's may be any."""
    if env == REMOTE:
        return _native.catalog()
    return [_native.Batch(env, 1).spec]


def columns_of(env: str) -> dict[str, Column]:
    """Columns of an environment's scores, by name.

    Raises:
        UnknownEnvError: there is none of that id.
    """
    columns = (c for spec in specs_of(env) for c in machines.of(spec).columns_of(spec["task"]))
    return {column.name: column for column in columns}


def starts_of(env: str) -> list[str]:
    """Keys of an exact start that the cases of an environment may have."""
    names = (name for spec in specs_of(env) for name in machines.of(spec).starts)
    return list(dict.fromkeys(f"start.{name}" for name in names))


def _check_plot(
    plot: Mapping[str, Any], keys: Mapping[str, list[Any]], scores: Collection[str]
) -> None:
    """Refuses, before anything is run, a picture that could not be drawn at the end."""
    _only("plot", plot, _PLOT)
    if plot and not {"x", "value"} <= plot.keys():
        raise StudyError("plot needs x and value")
    for role, column in plot.items():
        if column not in keys and column not in scores:
            known = ", ".join((*keys, *scores))
            raise StudyError(f"plot: {role} = {column!r} is no column; there are {known}")
        if role in ("panel", "line"):
            continue
        for value in keys.get(column, ()):
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise StudyError(f"plot: {role} = {column!r} must be numbers, but has {value!r}")
    if "y" in plot and "line" in plot:
        raise StudyError("plot: a map (x and y) has no line; use panel")


def _mapping(name: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
        raise StudyError(f"{name} = {value!r} must be a mapping of names to values")
    return value


def _read(key: str, value: Any) -> Any:
    """A keyword's value; YAML takes ``1e-4`` and values of Python for text."""
    if not isinstance(value, str) or key in _PLAIN:
        return value
    try:
        return literal(value)
    except ValueError as error:
        raise StudyError(f"{key}: {error}") from error


def _end(key: str, side: str, value: Any) -> float:
    """An end of an interval."""
    value = _read(key, value)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise StudyError(f"{side} = {value!r} of {key!r} is not allowed: it must be a number")
    return float(value)


def _only(name: str, content: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for key in content:
        if key not in known:
            raise StudyError(f"{name} has no {key!r}; it has {', '.join(known)}")


def _values(key: str, value: Any) -> list[Any]:
    """A list as it is, or `steps` numbers evenly from `from` to `to`, or one value."""
    if isinstance(value, list):
        if not value:
            raise StudyError(f"sweep of {key!r} is empty")
        return value
    if not isinstance(value, dict):
        return [value]
    if set(value) != {"from", "to", "steps"}:
        raise StudyError(f"sweep of {key!r} must have from, to and steps, or be a list")
    first, last = (_end(key, side, value[side]) for side in ("from", "to"))
    steps = value["steps"]
    if not isinstance(steps, int) or not 2 <= steps <= MAX_CASES:
        raise StudyError(
            f"steps = {steps!r} of {key!r} must be a whole number from 2 to {MAX_CASES}"
        )
    # Twelve digits, so that the table shows 0.3 where arithmetic gives 0.30000000000000004.
    return [float(f"{first + (last - first) * i / (steps - 1):.12g}") for i in range(steps)]
