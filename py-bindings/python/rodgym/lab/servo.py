"""The servo of a fin's drive from what it was told and what it did: gain and cut-off."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rodgym.errors import RodgymError
from rodgym.lab.errors import FramesError, MisfitError, RecordingError
from rodgym.lab.gauss_newton import Kinds, Prior, solve
from rodgym.lab.result import Interval
from rodgym.lab.tracks import Array
from rodgym.lab.trust import VAGUE, interval
from rodgym.sim import Fin

if TYPE_CHECKING:
    from rodgym.lab.fin_model import Recording

#: What is found, as keywords of the environments, and where the fit starts.
SERVO = {"actuator_gain": 1.0, "command_cutoff": 3.0}
#: The least and the most that is believed.
LOWS, HIGHS = (0.1, 0.3), (5.0, 30.0)
#: Deviations before the fit: of both logarithms, and of the pitch's zero [rad].
BEFORE = (1.0, 1.0, 0.05)
#: Step of the differences, and the least noise of the pitch that is believed [rad].
STEP, FLOOR = 1e-4, 1e-6
#: What is off by more than this share of what the pitch changes by is no such servo.
WRONG = 0.1
#: Samples are this even, as a share of their distance.
EVEN = 0.01


def fit_servo(recordings: Sequence[Recording]) -> dict[str, Interval]:
    """`actuator_gain` and `command_cutoff` [Hz] of the servo that followed the commands.

    Parameters
    ----------
    recordings: those with a `command`, held from sample to sample, are used; the zero of their
        pitch is found, too

    Raises
    ------
    RecordingError: none has a command, or the commands do not tell the servo
    MisfitError: no such servo follows the commands so
    FramesError: a command that does not belong to the bench's times, or these are not even
    """
    told = [one for one in recordings if one.command is not None]
    if not told:
        raise RecordingError("no recording has the servo's command")
    for one in told:
        checked(one)
    seen = np.concatenate([one.pitch for one in told])

    def pitch(x: Array) -> Array:
        gain, cutoff = (float(v) for v in np.exp(x[:2]))
        try:
            return np.concatenate([driven(one, gain, cutoff) for one in told]) + x[2]
        except RodgymError:
            return np.full(len(seen), np.nan)

    def residuals(x: Array) -> tuple[Array, Array]:
        base = pitch(x)
        slopes = [(pitch(x + STEP * way) - base) / STEP for way in np.eye(len(x))]
        return base - seen, np.stack(slopes, axis=1)

    start = np.append(np.log(list(SERVO.values())), 0.0)
    found = solve(
        residuals,
        start,
        Prior(start, np.array(BEFORE)),
        (np.append(np.log(LOWS), -1.0), np.append(np.log(HIGHS), 1.0)),
        np.array([0.3, 0.3, 0.1]),
        FLOOR,
        kinds=Kinds(np.zeros(len(seen), int), (FLOOR,)),
    )
    off, moves = float(np.sqrt(np.mean(found.residuals**2))), float(np.std(seen))
    if off > WRONG * moves and any(np.any(one.command) for one in told):
        raise MisfitError(
            f"no servo of the environments follows the commands so: the pitch is off by {off:.2g} "
            f"rad where it changes by {moves:.2g} rad. Leave the command out, or compare the clocks"
        )
    deviations = np.sqrt(np.diag(found.covariance))
    if vague := [n for n, d in zip(SERVO, deviations, strict=False) if d > VAGUE]:
        raise RecordingError(
            f"the commands do not tell {' and '.join(vague)}: command faster and farther"
        )
    return {
        name: interval(float(x), float(d))
        for name, x, d in zip(SERVO, found.x, deviations, strict=False)
    }


def checked(one: Recording) -> None:
    """Refuses a command that is none of this bench.

    Raises
    ------
    FramesError: what is wrong
    """
    command, gaps = np.asarray(one.command), np.diff(one.times)
    if command.shape != np.shape(one.times) or not np.isfinite(command).all():
        raise FramesError(
            f"{len(command)} commands for {len(one.times)} times of the bench; there must be as "
            "many, all finite"
        )
    if np.ptp(gaps) > EVEN * np.median(gaps):
        raise FramesError("the servo is fitted to even samples: resample the bench (lab.cells)")


def driven(one: Recording, gain: float, cutoff: float) -> Array:
    """The pitch at the bench's times [rad] of a servo that starts at rest where it was told to."""
    assert one.command is not None
    step = float(np.median(np.diff(one.times)))
    fin = Fin(hydrodynamics="air", actuator_gain=gain, command_cutoff=cutoff, physics_dt=step)
    straight, angle = fin.positions, gain * float(one.command[0])
    c, s = np.cos(angle), np.sin(angle)
    fin.set_state(straight @ np.array([[c, s], [-s, c]]))
    pivot = fin.config["geometry"]["pivot"]
    found = [angle]
    for command in one.command[:-1]:
        fin.drive(float(command))
        edge = fin.positions[pivot + 1] - fin.positions[pivot]
        found.append(float(np.arctan2(edge[1], edge[0])))
    return np.array(found)
