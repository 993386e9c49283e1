"""From `rod.yml` to an environment that moves like the rod that was filmed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rodgym.lab.errors import RecordingError


def keywords(path: Path | str, spread: bool = True) -> dict[str, Any]:
    """Keywords of an environment with the fitted rod: `gym.make(id, **keywords("fit/rod.yml"))`.

    The parameters are those that make an environment of so many nodes move as the rod did. The file
    is read here, also where a server computes the environment.

    Parameters
    ----------
    spread: episodes draw each parameter from its 95 % interval; else all have the best values

    Raises
    ------
    RecordingError: no such file of a fit, or one that does not tell all that an environment needs
    """
    import yaml

    path = Path(path)
    try:
        rod = yaml.safe_load(path.read_text(encoding="utf-8"))
        vague, known, best = rod["not_identifiable"], dict(rod["known"]), rod["parameters"]
        nodes, same = int(rod["equivalent"]["nodes"]), dict(rod["equivalent"]["parameters"])
        # The interval of the equivalent value is as wide as that of the rod's own.
        ends = {
            name: [same[name] * best[name][end] / best[name]["value"] for end in ("low", "high")]
            for name in same
        }
    except (yaml.YAMLError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise RecordingError(f"{path} is no rod.yml of a fit") from error
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error
    if vague:
        raise RecordingError(
            f"{path} does not tell {' and '.join(vague)}: measure it and fit again with --known"
        )
    known.pop("nodes", None)
    drawn = {"randomize": {name: ("log_uniform", *pair) for name, pair in ends.items()}}
    return {"nodes": nodes, **known, **same, **(drawn if spread else {})}
