"""What derivatives of steps are called: see docs/derivatives.md."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from rodgym._checks import refused

Array = npt.NDArray[np.float64]


class Jacobian(NamedTuple):
    """Derivatives of a bare machine's state vector after some physics steps: s numbers."""

    #: (s, s), by the vector before them.
    A: Array
    #: (s, 1), by the input.
    B: Array
    #: (s, p), by the parameters that were named.
    P: Array


class StepJacobian(NamedTuple):
    """Derivatives of an environment's control step: of s numbers of state, o of observation and the
    reward, by the state, a numbers of action and p parameters.
    """

    #: (s, s), of the next state by the state.
    A: Array
    #: (s, a), of the next state by the action.
    B: Array
    #: (s, p), of the next state by the parameters that were named.
    P: Array
    #: (o, s), of the observation by the state.
    C: Array
    #: (o, a), of the observation by the action.
    D: Array
    #: (o, p), of the observation by the parameters.
    Q: Array
    #: (s,), of the reward by the state.
    reward_state: Array
    #: (a,), of the reward by the action.
    reward_action: Array
    #: (p,), of the reward by the parameters.
    reward_parameters: Array


class RolloutGradient(NamedTuple):
    """Gradients of a sum of rewards over t control steps."""

    #: (t,), the rewards themselves; 0 after the end of the episode.
    rewards: Array
    #: (t, a), by the actions.
    actions: Array
    #: (s,), by the state at the start.
    state: Array
    #: (p,), by the parameters that were named.
    parameters: Array


def names(parameters: Any) -> list[str]:
    """Names of parameters, as a list; which there are is asked elsewhere."""
    if isinstance(parameters, str) or not isinstance(parameters, Iterable):
        raise refused("parameters", parameters, "a sequence of names such as ['youngs_modulus']")
    listed = list(parameters)
    for name in listed:
        if not isinstance(name, str):
            raise refused("parameters", listed, "a sequence of names such as ['youngs_modulus']")
    return listed
