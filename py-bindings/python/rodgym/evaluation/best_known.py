"""Best known returns: the best that anybody has found for an environment, by whatever means.

They are kept in ``zoo/best_known.json``, a list of ``{"id": ..., "config": {...}, "return": ...,
"source": ...}``, where ``config`` has the keywords that differ from the environment's defaults.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from rodgym import RodgymError, _native
from rodgym.evaluation.origin import DERIVED
from rodgym.zoo import ZOO

FILE = ZOO / "best_known.json"


def best_known(spec: Mapping[str, Any]) -> float | None:
    """The best known mean return of an environment; None where none is kept for its keywords."""
    if not FILE.is_file():
        return None
    for entry in json.loads(FILE.read_text(encoding="utf-8")):
        if entry["id"] != spec["id"]:
            continue
        try:
            config = _native.Batch(entry["id"], 1, entry["config"]).spec["config"]
        except RodgymError:  # A keyword that this version does not have.
            continue
        if all(config[key] == spec["config"].get(key) for key in config if key not in DERIVED):
            return float(entry["return"])
    return None
