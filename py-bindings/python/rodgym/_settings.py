"""What may be changed of an environment after it was made, and how: `set_parameters`,
`set_randomize`, and nothing by setting attributes that are not there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from rodgym._checks import refused
from rodgym._plain import plain
from rodgym.errors import SettingError


class Settable:
    """Environments `_first` to `_first + _count` of a batch, whose parameters may be changed."""

    def set_parameters(self, **values: Any) -> None:
        """Changes physical parameters from the next episode on (a reset or an autoreset).

        Each value is a number, or of a batch a sequence with one for each environment; what was
        drawn before is fixed then. Snapshots and pickles keep it. Parameters that `reset` gets in
        its options hold for that episode only.

        Raises:
            ParameterError: an unknown name, a value outside its range, or one that the stepper
                is not stable with; nothing changes then.
            ShapeError: a sequence of another length.
        """
        checked = {name: _value(name, value) for name, value in values.items()}
        self._configure(checked, {})

    def set_randomize(self, ranges: Mapping[str, Any]) -> None:
        """Draws parameters from these ranges from the next episode on (a reset or an autoreset).

        `ranges` is as in the keyword `randomize`: `(low, high)`, `("log_uniform", low, high)` or
        `("log_normal", median, deviation, {other: correlation})` by name. Parameters that it does
        not name stay as they are; `set_parameters` ends a drawing.

        Raises:
            ParameterError: an unknown name, no range, or one that is not allowed; nothing changes
                then.
        """
        if not isinstance(ranges, Mapping):
            raise refused("ranges", ranges, "a dictionary such as {'width': (0.006, 0.009)}")
        self._configure({}, {name: _range(name, value) for name, value in ranges.items()})

    def _configure(self, parameters: dict[str, Any], randomize: dict[str, Any]) -> None:
        raise NotImplementedError


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _value(name: str, given: Any) -> Any:
    value = plain(given)
    if _is_number(value):
        return float(value)
    if isinstance(value, list | tuple) and value and all(map(_is_number, value)):
        return [float(one) for one in value]
    raise refused(name, given, "a finite number, or of a batch a sequence with one each")


def _is_part(value: Any) -> bool:
    """Whether a range may have this: a word, a number, or correlations by name."""
    if isinstance(value, dict):
        return all(isinstance(key, str) and _is_number(one) for key, one in value.items())
    return isinstance(value, str) or _is_number(value)


def _range(name: Any, given: Any) -> list[Any]:
    value = plain(given)
    if isinstance(value, list | tuple) and all(map(_is_part, value)):
        return list(value)
    allowed = (
        "(low, high), ('log_uniform', low, high) or ('log_normal', median, deviation, "
        "{other: correlation}), of finite numbers"
    )
    raise refused(f"randomize[{name!r}]", given, allowed)


class Many(Settable):
    """All environments of a batch."""

    _batch: Any
    num_envs: int

    def _configure(self, parameters: dict[str, Any], randomize: dict[str, Any]) -> None:
        self._batch.native.configure(0, self.num_envs, parameters, randomize)

    def _keywords(self) -> dict[str, Any]:
        return dict(self._batch.about["config"])

    def _physical(self) -> list[str]:
        return [parameter["name"] for parameter in self._batch.about["parameters"]]


class Fixed:
    """Attributes that are there may be set; one that is not would be kept, shown and do nothing.

    A class outside of this package may have attributes of its own; those that are called like a
    keyword are refused there, too.
    """

    #: Set when everything of our own is there.
    _made: bool = False

    def __setattr__(self, name: str, value: Any) -> None:
        if name.startswith("_") or not self._made or name in self.__dict__:
            object.__setattr__(self, name, value)
            return
        here = getattr(type(self), name, None)
        if isinstance(here, property) and here.fset is None:
            raise SettingError(
                f"{name!r} of {type(self).__name__} cannot be set: {self._how(name)}"
            )
        ours = type(self).__module__.partition(".")[0] == __name__.partition(".")[0]
        if here is None and not hasattr(type(self), name) and (ours or name in self._keywords()):
            raise SettingError(
                f"{type(self).__name__} has no attribute {name!r} that could be set: "
                f"{self._how(name)}"
            )
        object.__setattr__(self, name, value)

    def _keywords(self) -> dict[str, Any]:
        """Keywords with their values, physical parameters among them."""
        raise NotImplementedError

    def _physical(self) -> list[str]:
        """Names of the physical parameters that may change between episodes."""
        raise NotImplementedError

    def _how(self, name: str) -> str:
        if name in self._physical():
            return (
                f"set_parameters({name}=...) changes it from the next episode on, "
                f"set_randomize({{{name!r}: (low, high)}}) draws it"
            )
        if name == "randomize":
            return "set_randomize(...) changes ranges from the next episode on"
        if name in self._keywords():
            return f"give {name}=... when it is made"
        return (
            "set_parameters and set_randomize change parameters; what is your own belongs to a "
            "wrapper"
        )
