"""Which of several animals or cameras is read."""

from __future__ import annotations

from collections.abc import Sequence

from rodgym.lab.errors import ChoiceError


def chosen(file: str, what: str, there: Sequence[str], asked: str | None) -> str:
    """The one that was asked for, or the only one.

    Raises
    ------
    ChoiceError: there are several and none was named, or none of that name
    """
    if asked is None and len(there) == 1:
        return there[0]
    names = ", ".join(there)
    if asked is None:
        raise ChoiceError(f"{file} has several {what}s: name one with --{what}: {names}")
    if asked not in there:
        raise ChoiceError(f"{file} has no {what} {asked!r}; there are {names}")
    return asked
