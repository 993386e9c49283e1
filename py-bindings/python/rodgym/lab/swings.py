"""Many swings of a pendulum at once, in one native batch: what differences are made of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rodgym import _native
from rodgym.errors import RodgymError
from rodgym.lab.tracks import Array

#: The task whose episodes never end by themselves.
ENVIRONMENT = "rodgym/PendulumSwingUp-v0"
#: Rods of one batch: a reset of one rod takes the longer the more there are.
RODS = 32


def swing(
    keywords: Mapping[str, Any],
    parameters: Mapping[str, Array],
    angles: Array,
    rates: Array,
    keep: Array,
    torques: Array | None = None,
) -> tuple[Array, Array]:
    """Positions and velocities of the nodes of n rods that swing, freely or driven.

    Parameters
    ----------
    keywords: of the environment, the same for all rods; rods are seen every `control_dt`
    parameters: those that differ from rod to rod, (n,) each
    angles, rates: of the edges at time 0, (n, edges)
    keep: which times are wanted, in steps of `control_dt`, rising, (k,)
    torques: on the base in each step [N m], (n, steps), at most the keyword `torque_limit`; None:
        none

    Returns
    -------
    Two arrays (n, k, nodes, 2), NaN from where a rod could not be simulated.
    """
    shape = (len(angles), len(keep), angles.shape[1] + 1, 2)
    positions, velocities = np.full(shape, np.nan), np.full(shape, np.nan)
    for first in range(0, len(angles), RODS):
        some = slice(first, first + RODS)
        own = {name: values[some] for name, values in parameters.items()}
        batch = started(keywords, own, angles[some], rates[some])
        own_torques = None if torques is None else torques[some] / keywords["torque_limit"]
        film(batch, keep, positions[some], velocities[some], own_torques)
    return positions, velocities


def started(
    keywords: Mapping[str, Any], parameters: Mapping[str, Array], angles: Array, rates: Array
) -> _native.Batch:
    """A batch of rods, each with its own parameters and start."""
    count = len(angles)
    batch = _native.Batch(ENVIRONMENT, count, dict(keywords), "Disabled", None, 1)
    for i in range(count):
        state = {"angles": angles[i].tolist(), "rates": rates[i].tolist()}
        own = {name: float(values[i]) for name, values in parameters.items()}
        batch.reset([0] * count, np.arange(count) == i, {"state": state, "parameters": own})
    return batch


def film(
    batch: _native.Batch,
    keep: Array,
    positions: Array,
    velocities: Array,
    actions: Array | None = None,
) -> None:
    """Fills in the nodes of all rods at the wanted steps; `actions` are (rods, steps)."""
    if actions is None:
        actions = np.zeros((batch.num_envs, int(keep[-1])))
    actions = actions.astype(np.float32)
    place = {int(step): i for i, step in enumerate(keep)}
    for step in range(int(keep[-1]) + 1):
        if step > 0:
            try:
                batch.step(np.ascontiguousarray(actions[:, step - 1 : step]))
            except RodgymError:  # Some rod has failed: the others are of no use without it.
                return
        if step in place:
            for i in range(batch.num_envs):
                positions[i, place[step]], velocities[i, place[step]] = batch.nodes(i)
