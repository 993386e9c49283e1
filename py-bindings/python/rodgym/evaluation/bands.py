"""A standard evaluation in three bands: nominal, from other starts, of other rods.

Nominal episodes are nearly all the same. In the two other bands a hundred seeds are a hundred
different episodes: ``starts`` begins anywhere, ``rods`` draws machines about the nominal one. What
the bands of a machine are stands in its description (`rodgym.machines`).

>>> from rodgym.evaluation import band_keywords
>>> band_keywords("starts", "rodgym/PendulumSwingUp-v0")["start_rate"]
(-5.0, 5.0)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rodgym import machines
from rodgym._checks import refused
from rodgym.evaluation.conditions import conditions, spec_for

#: Names of the bands, the same for every machine of ours.
BANDS = ("nominal", "starts", "rods")


def bands(spec: Mapping[str, Any]) -> dict[str, str]:
    """The bands of an environment by name, each with its conditions in words."""
    nominal = {BANDS[0]: "as the environment is registered"}
    return {**nominal, **{band.name: band.text for band in machines.of(spec).bands}}


def band_keywords(
    band: str, env_id: str, env_kwargs: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """The keywords with which an environment is played in a band.

    Keywords that are given stay as they are: a band changes what nobody has asked for. So a
    parameter that an environment draws already goes on being drawn as it was.

    Arguments:
        band: `"nominal"`, `"starts"` or `"rods"`.
        env_id: environment.
        env_kwargs: its keywords beside the band's, about which rods are drawn.

    Raises:
        ParameterError: the machine has no such band.
    """
    env_id, keywords = conditions(env_id, env_kwargs)
    if band == BANDS[0]:
        return keywords
    spec = spec_for(env_id, keywords)
    found = {one.name: one for one in machines.of(spec).bands}
    if band not in found:
        raise refused("band", band, f"one of {', '.join(bands(spec))}")
    added = found[band].keywords(spec)
    if drawn := added.get("randomize"):
        keywords["randomize"] = {**drawn, **spec["config"]["randomize"]}
    return {**added, **keywords}
