"""A teacher of two: one policy swings the rod up, another one holds it there."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgym import machines
from rodgym.evaluation.policies import load_policy
from rodgym.evaluation.policy import AnyEnv, PolicyError


class HandOver:
    """Swings up by a policy that learned from the reward, and holds by a regulator.

    The reward hardly minds a rod that sways at the top, so a policy that learned from it does
    sway. A regulator does not, but is up later. Each rod is handed over once all its edges are
    within 26 degrees of upright and turn slowly, and is given back when an edge leaves 46 degrees.

    Parameters
    ----------
    env: environment of a pendulum whose sensors are ``full``
    swing, hold: policies by name, see `rodgym.evaluation.policies.load_policy`

    Raises
    ------
    PolicyError: another machine or other sensors
    """

    #: Cosines of those angles.
    NEAR, FAR = 0.9, 0.7
    #: The largest mean rate of the edges at which a rod is handed over, in units of 10 rad/s.
    SLOW = 0.3

    def __init__(self, env: AnyEnv, swing: str = "zoo:sighted", hold: str = "lqr") -> None:
        names = machines.spec_of(env)["observation"]["names"]
        self._cosines = [i for i, name in enumerate(names) if name.startswith("cos(theta_")]
        self._rates = [i for i, name in enumerate(names) if name.startswith("rate of theta_")]
        if len(self._cosines) < 2:
            raise PolicyError("a teacher that hands over must see every edge: observation='full'")
        self.swing, self.hold = load_policy(swing, env), load_policy(hold, env)

    def predict(
        self,
        observation: NDArray[Any],
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[Any], Any]:
        """Actions (n, 1) for observations (n, d), and the state of both and who has each rod."""
        seen = np.atleast_2d(observation)
        by_swing, by_hold, held = state or (None, None, np.zeros(len(seen), bool))
        if episode_start is not None:
            held = held & ~np.asarray(episode_start, bool)
        up = -seen[:, self._cosines].max(axis=1)
        slow = np.abs(seen[:, self._rates].mean(axis=1)) < self.SLOW
        held = np.where(held, up > self.FAR, (up > self.NEAR) & slow)
        swung, by_swing = self.swing.predict(observation, by_swing, episode_start, deterministic)
        upheld, by_hold = self.hold.predict(observation, by_hold, episode_start, deterministic)
        action = np.where(held[:, None], np.atleast_2d(upheld), np.atleast_2d(swung))
        return action.reshape(np.shape(swung)), (by_swing, by_hold, held)
