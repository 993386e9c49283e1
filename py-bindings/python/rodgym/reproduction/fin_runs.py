"""The fin driven by sinusoids, and what one period yields: the measurements of chapter 3."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rodgym.lab.fin_in_air import moved
from rodgym.sim import Fin

Array = npt.NDArray[np.float64]

AMPLITUDES = (4.0, 6.0, 8.0, 10.0)
FREQUENCIES = (0.5, 1.0, 1.5, 2.0)
#: Periods of a run (the first is a ramp) and steps of a period.
PERIODS, STEPS = 5, 400
#: Water, flow and geometry of thesis (3.2).
DENSITY, LENGTH, HEIGHT = 1000.0, 0.14, 0.115
#: Physics steps from frame to frame in air.
PER_FRAME = 12


@dataclass(frozen=True)
class Period:
    """The last period of a run."""

    amplitude: float
    frequency: float
    flow: float
    thrust: Array
    power: Array
    tail: Array

    @property
    def mean_thrust(self) -> float:
        """Mean thrust [N]."""
        return float(self.thrust.mean())

    @property
    def efficiency(self) -> float:
        """Froude efficiency U T / P."""
        return self.flow * self.mean_thrust / float(self.power.mean())

    @property
    def strouhal(self) -> float:
        """Strouhal number f W / U (thesis 3.2), W the tail's peak-to-peak travel."""
        return self.frequency * float(np.ptp(self.tail)) / self.flow

    @property
    def thrust_coefficient(self) -> float:
        """T / (rho U^2 L h / 2) (thesis 3.2)."""
        return self.mean_thrust / (0.5 * DENSITY * self.flow**2 * LENGTH * HEIGHT)

    @property
    def second_harmonic(self) -> tuple[float, float]:
        """The thrust at twice the drive's frequency.

        Its amplitude [N], and the drive phase in [0, 180) degrees where it peaks.
        """
        phase = 2 * np.pi * np.arange(1, STEPS + 1) / STEPS
        coefficient = 2 * np.mean(self.thrust * np.exp(2j * phase))
        return float(abs(coefficient)), float(np.degrees(np.angle(coefficient)) / 2 % 180)


def drive(amplitude: float, frequency: float, t: npt.NDArray[np.floating[Any]]) -> Array:
    """Pitch [rad] of a sinusoid (degrees, Hz) that sets in smoothly over its first period."""
    x = np.minimum(t * frequency, 1.0)
    ramp = x**3 * (10 - 15 * x + 6 * x**2)
    return ramp * np.radians(amplitude) * np.sin(2 * np.pi * frequency * t)


def period(amplitude: float, frequency: float, **fin: Any) -> Period:
    """Runs the thesis' fin with these changes and returns its last period."""
    dt = 1.0 / (frequency * STEPS)
    plant = Fin(thesis=True, stepper="bdf2", physics_dt=dt, **fin)
    pitch = drive(amplitude, frequency, np.arange(1, PERIODS * STEPS + 1) * dt)
    trace = plant.follow(pitch)
    thrust, power, tail = (trace[name][-STEPS:] for name in ("thrust", "power", "tail"))
    return Period(amplitude, frequency, plant.parameters["flow_speed"], thrust, power, tail)


def in_air(amplitude: float, frequency: float, frames: int, **fin: Any) -> Array:
    """Sideways positions of all nodes [m] at 30 frames a second in air, (frames, nodes)."""
    return moved(pitched(amplitude, frequency, frames), PER_FRAME, fin)


def pitched(amplitude: float, frequency: float, frames: int) -> Array:
    """Pitch [rad] of such a run at the end of every physics step."""
    t = np.arange(1, frames * PER_FRAME + 1) / (30 * PER_FRAME)
    return drive(amplitude, frequency, t)
