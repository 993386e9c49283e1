"""Infos of a batch, as Gymnasium's `VectorEnv._add_info` would build them from single environments.

Each key comes with a mask `_key` of the environments that have it, at every level; entries of the
others are zero; a key that no environment has is absent. Every array is the caller's own.

`np.count_nonzero` asks the same as `any()` in a tenth of the time.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rodgym._batch import Flags, Floats, Result


class InfoBuilder:
    """Builds the infos of one kind of environment."""

    def __init__(self, about: dict[str, Any]) -> None:
        self._terms: list[str] = about["reward_terms"]
        self._metrics: list[str] = about["metrics"]
        self._parameters: list[str] = [parameter["name"] for parameter in about["parameters"]]

    def reset(self, result: Result) -> dict[str, Any]:
        """Infos of a reset."""
        infos: dict[str, Any] = {}
        self._add_parameters(infos, result)
        return infos

    def step(self, result: Result) -> dict[str, Any]:
        """Infos of a step in mode NextStep or Disabled: each has stepped or has begun."""
        infos: dict[str, Any] = {}
        self._add_step(infos, result.terms, result.stepped, result.solver_failure)
        self._add_parameters(infos, result)
        return infos

    def same_step(self, result: Result) -> dict[str, Any]:
        """Infos of a step in mode SameStep: those of an ending step are in `final_info`."""
        ended = result.began
        if not np.count_nonzero(ended):
            return self.step(result)
        infos: dict[str, Any] = {}
        final: dict[str, Any] = {}
        rows = ended[:, np.newaxis]
        self._add_step(
            infos, np.where(rows, 0.0, result.terms), ~ended, result.solver_failure & ~ended
        )
        self._add_step(
            final, np.where(rows, result.terms, 0.0), ended, result.solver_failure & ended
        )
        final_obs = np.full(len(ended), None, dtype=object)
        for i in np.flatnonzero(ended):
            final_obs[i] = result.final_observation[i].copy()
        infos["final_obs"], infos["_final_obs"] = final_obs, ended.copy()
        infos["final_info"], infos["_final_info"] = final, ended.copy()
        self._add_parameters(infos, result)
        return infos

    def _add_step(self, infos: dict[str, Any], terms: Floats, mask: Flags, failed: Flags) -> None:
        if not np.count_nonzero(mask):
            return
        columns = np.ascontiguousarray(terms.T)
        count = len(self._terms)
        infos["reward_terms"] = _table(self._terms, columns[:count], mask)
        infos["_reward_terms"] = mask.copy()
        infos.update(_table(self._metrics, columns[count:], mask))
        if np.count_nonzero(failed):
            infos["solver_failure"], infos["_solver_failure"] = failed.copy(), failed.copy()

    def _add_parameters(self, infos: dict[str, Any], result: Result) -> None:
        if np.count_nonzero(result.began):
            columns = np.ascontiguousarray(result.parameters.T)
            infos["parameters"] = _table(self._parameters, columns, result.began)
            infos["_parameters"] = result.began.copy()


def _table(names: list[str], columns: Floats, mask: Flags) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for name, column in zip(names, columns, strict=True):
        table[name] = column
        table[f"_{name}"] = mask.copy()
    return table
