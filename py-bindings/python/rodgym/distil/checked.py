"""Values of a recipe: they say what is allowed of them, and can be changed by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass, replace
from typing import Any, TypeVar

from rodgym import RodgymError

Self = TypeVar("Self", bound="Checked")


class RecipeError(RodgymError, ValueError):
    """A recipe that is missing or cannot be used."""


class Checked:
    """Base of the dataclasses of a recipe."""

    #: What messages call it.
    called = "a recipe"

    def _check(self, name: str, fits: bool, allowed: str) -> None:
        if not fits:
            value = getattr(self, name)
            raise RecipeError(f"{name} = {value!r} is not allowed: it must be {allowed}")

    def _list(self, name: str, fits: Any, allowed: str) -> None:
        value = getattr(self, name)
        good = isinstance(value, Sequence) and not isinstance(value, str) and all(map(fits, value))
        self._check(name, good, f"a list of {allowed}")
        object.__setattr__(self, name, tuple(value))

    def with_changes(self: Self, changes: Mapping[str, Any]) -> Self:
        """Returns these values with some of them changed.

        Raises:
            RecipeError: a name that is not among them, or a value that is not allowed.
        """
        assert is_dataclass(self)
        known = [one.name for one in fields(self)]
        for name in changes:
            if name not in known:
                raise RecipeError(f"{name!r} is not in {self.called}: it has {', '.join(known)}")
        return replace(self, **changes)

    def as_dict(self) -> dict[str, Any]:
        """All of it, as in a YAML entry."""
        assert is_dataclass(self)
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
        }


def whole(value: Any) -> bool:
    """Whether it is a whole number; true and false are none."""
    return isinstance(value, int) and not isinstance(value, bool)


def number(value: Any) -> bool:
    """Whether it is a number; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)
