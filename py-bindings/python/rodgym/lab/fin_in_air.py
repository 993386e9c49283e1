"""E and damping of a fin that is pitched in air, as the thesis found them (3.4.1): by Nelder and
Mead's simplex on its cost (3.1). `fin_fit` has a method with intervals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from rodgym._checks import refused
from rodgym.lab.errors import FramesError
from rodgym.lab.fin_model import Recording
from rodgym.lab.nelder_mead import minimise
from rodgym.lab.tracks import Array, Tracks
from rodgym.sim import Fin

#: The thesis' start, first simplex and rounds.
THESIS = {"youngs_modulus": 2e6, "damping": 0.05}
SIMPLEX, ROUNDS = 0.7, 60
#: Frames a second, where an experiment does not say.
RATE = 30.0


@dataclass(frozen=True)
class Experiment:
    """A fin in air, at rest at first, pitched by its drive.

    Parameters
    ----------
    sideways: y of every node, nose first, at the end of each frame [m], NaN where it was lost,
        (frames, nodes)
    pitch: of the drive [rad] at the end of every physics step, as many steps in each frame
    rate: frames a second
    """

    #: Of the fin in the thesis' experiments.
    KEYWORDS: ClassVar[Mapping[str, Any]] = {
        "thesis": True,
        "stepper": "bdf2",
        "hydrodynamics": "air",
    }

    sideways: Array
    pitch: Array
    rate: float = RATE

    @property
    def steps(self) -> int:
        """Physics steps in a frame."""
        return len(self.pitch) // len(self.sideways)

    @property
    def step_time(self) -> float:
        """Duration of a physics step [s]."""
        return 1.0 / (self.rate * max(self.steps, 1))

    def recording(self, nodes: int) -> Recording:
        """The same as film and bench, of one clock, of a fin of so many nodes.

        Raises
        ------
        ParameterError, FramesError: arrays that are no such experiment
        """
        shape = np.shape(self.sideways)
        if len(shape) != 2 or shape[1] != nodes:
            raise refused("sideways", shape, f"(frames, {nodes} nodes)")
        if self.steps < 1 or len(self.pitch) % shape[0] or not np.isfinite(self.pitch).all():
            raise FramesError(
                f"{len(self.pitch)} pitches for {shape[0]} frames; there must be as many in each "
                "frame, all finite"
            )
        points = np.stack([np.full(shape, np.nan), self.sideways], axis=-1)
        frames = np.arange(1, shape[0] + 1, dtype=np.float64) / self.rate
        times = self.step_time * np.arange(len(self.pitch) + 1, dtype=np.float64)
        return Recording(Tracks(frames, points), times, np.append(0.0, self.pitch), clock=0.0)


def moved(pitch: Array, steps: int, fin: Mapping[str, Any], rate: float = RATE) -> Array:
    """Sideways positions of all nodes [m] at the end of every frame, (frames, nodes)."""
    plant = Fin(
        **{**Experiment.KEYWORDS, **fin},
        physics_dt=1.0 / (rate * steps),
    )
    seen = []
    for frame in np.reshape(pitch, (-1, steps)):
        plant.follow(frame)
        seen.append(plant.positions[:, 1])
    return np.array(seen)


def cost_of(gaps: Sequence[Array]) -> float:
    """The thesis' cost (3.1) [m]: of each experiment the root of the summed squares, summed up."""
    return float(sum(np.sqrt(np.nansum(gap**2)) for gap in gaps))


def fit_as_the_thesis(
    experiments: Sequence[Experiment], **known: Any
) -> tuple[dict[str, float], float]:
    """E [Pa] and zeta [kg/s] by Nelder and Mead's simplex on (3.1), and the cost [m]."""
    names, start = list(THESIS), np.array(list(THESIS.values()))

    def cost(x: Array) -> float:
        e, zeta = (float(value) for value in np.exp(x))
        if not (1e4 < e < 1e10 and zeta < 10.0):
            return 1e9
        fin = {**known, "youngs_modulus": e, "damping": zeta}
        return cost_of([o.sideways - moved(o.pitch, o.steps, fin, o.rate) for o in experiments])

    found = minimise(cost, np.log(start), SIMPLEX, ROUNDS)
    return dict(zip(names, (float(v) for v in np.exp(found)), strict=True)), cost(found)
