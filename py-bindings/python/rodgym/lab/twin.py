"""From `rod.yml` to an environment that moves like the rod that was filmed."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rodgym._checks import refused
from rodgym.lab.errors import RecordingError
from rodgym.lab.fin_result import FinFit
from rodgym.lab.result import Fit

#: Half of a 95 % interval in deviations.
WIDE = 1.96
#: Correlations that are no further from 0 than this are left out.
NOTHING = 1e-3

#: A fitted rod: its file, what the file holds, or the fit itself.
Rod = str | os.PathLike[str] | Mapping[str, Any] | Fit | FinFit


def keywords(rod: Rod, spread: bool = True) -> dict[str, Any]:
    """Keywords of an environment with the fitted rod: what `gym.make(id, rod="fit/rod.yml")` uses.

    The parameters are those that make an environment of so many nodes move as the rod did. The file
    is read here, also where a server computes the environment.

    Parameters
    ----------
    rod: the file that a fit has written, what such a file holds, or the fit
    spread: every episode draws its parameters from the fit's ellipsoid: logarithms are normal with
        the covariance that the fit has found; else all have the best values

    Raises
    ------
    RecordingError: no such file of a fit, or one that does not tell all that an environment needs
    """
    content, name = _content(rod)
    try:
        vague, known, best = (
            content["not_identifiable"],
            dict(content["known"]),
            content["parameters"],
        )
        equivalent = content["equivalent"]
        same = dict(equivalent["parameters"])
        # (None: of a machine whose nodes are its geometry's.)
        count = equivalent["nodes"]
        nodes = {} if count is None else {"nodes": int(count)}
        drawn = _ellipsoid(content, same, best)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise RecordingError(f"{name} is no rod.yml of a fit") from error
    if vague:
        raise RecordingError(
            f"{name} does not tell {' and '.join(vague)}: measure it and fit again with --known"
        )
    known.pop("nodes", None)
    return {**nodes, **known, **same, **({"randomize": drawn} if spread else {})}


def expanded(given: Mapping[str, Any]) -> dict[str, Any]:
    """Keywords of an environment in which `rod` may stand; the other keywords come on top.

    Raises
    ------
    RecordingError: the file of the rod cannot be used
    """
    rest = dict(given)
    rod = rest.pop("rod", None)
    return rest if rod is None else {**keywords(rod), **rest}


def _content(rod: Rod) -> tuple[Mapping[str, Any], str]:
    """What the file holds, and how errors name it."""
    if isinstance(rod, Fit | FinFit):
        return rod.as_dict(), "the fit"
    if isinstance(rod, Mapping):
        return rod, "the rod"
    if not isinstance(rod, str | os.PathLike):
        raise refused("rod", rod, "the path of a rod.yml, what it holds, or a fit")
    import yaml

    path = Path(rod)
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path} is no rod.yml of a fit") from error
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error
    return content, str(path)


def _ellipsoid(
    content: Mapping[str, Any], same: Mapping[str, float], best: Mapping[str, Any]
) -> dict[str, list[Any]]:
    """How episodes draw the parameters, as the keyword `randomize` has it.

    The logarithm of an equivalent value is as uncertain as that of the rod's own.
    """
    deviations = {
        name: math.log(best[name]["high"] / best[name]["low"]) / (2 * WIDE) for name in same
    }
    covariance = content.get("covariance_of_logarithms") or {"names": [], "matrix": []}
    names, matrix = list(covariance["names"]), covariance["matrix"]
    drawn: dict[str, list[Any]] = {}
    for name, deviation in deviations.items():
        others = {}
        for other in drawn:
            if name in names and other in names:
                i, j = names.index(name), names.index(other)
                correlation = matrix[i][j] / math.sqrt(matrix[i][i] * matrix[j][j])
                if abs(correlation) > NOTHING:
                    others[other] = max(-1.0, min(1.0, float(correlation)))
        drawn[name] = ["log_normal", float(same[name]), deviation, *([others] if others else [])]
    return drawn
