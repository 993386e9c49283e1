"""What is known before of parameters that a fit shall find."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rodgym._checks import number, refused

#: A value and its deviation as a share, by the parameter's name.
Priors = Mapping[str, tuple[float, float]]


def with_priors(
    start: Mapping[str, float] | None, priors: Priors | None, free: Sequence[str]
) -> tuple[dict[str, float], dict[str, float]]:
    """Where a fit starts, and deviations of logarithms, by name.

    Raises
    ------
    ParameterError: of a parameter that is not free, or no value and share above 0
    """
    found, doubts = dict(start or {}), dict[str, float]()
    for name, prior in (priors or {}).items():
        if name not in free or name in (start or {}):
            raise refused("prior", name, "a parameter that is free and has no start")
        try:
            value, share = prior
        except (TypeError, ValueError):
            raise refused("prior", {name: prior}, "a value and its deviation as a share") from None
        found[name] = number(name, value, "SI units")
        doubts[name] = number(f"deviation of {name}", share, "shares")
        if not doubts[name] > 0:
            raise refused("prior", {name: prior}, "a value and its deviation as a share, above 0")
    return found, doubts
