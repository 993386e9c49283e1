"""The flexible fin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgym.machines.description import Column, Description, Floats, Picture, Task, Trace

if TYPE_CHECKING:
    from rodgym.evaluation import Evaluation, Record
    from rodgym.evaluation.score import Trajectories


def thrust(run: Trajectories) -> Floats:
    """Mean thrust [N]."""
    return run.mean(run.metrics["thrust"])


def power(run: Trajectories) -> Floats:
    """Mean input power [W]."""
    return run.mean(run.metrics["power"])


def efficiency(run: Trajectories) -> Floats:
    """Froude efficiency from start to end."""
    return run.last(run.metrics["efficiency"])


def beat(run: Trajectories) -> Floats:
    """Strongest frequency of the pitch over the second half of each episode [Hz]."""
    index = np.arange(len(run.alive))[:, None]
    window = run.alive & (index >= run.steps // 2)
    pitch = run.metrics["pitch"]
    mean = run.total(pitch, window) / window.sum(axis=0)
    # Padded with zeros: the peak of a short record is read between its own frequencies.
    length = 16 * len(pitch)
    spectrum = np.abs(np.fft.rfft(np.where(window, pitch - mean, 0.0), length, axis=0))
    return np.asarray(spectrum.argmax(axis=0) / (length * run.control_dt), np.float64)


def command(run: Trajectories) -> Floats:
    """Root mean square of the action, clipped as the environment clips it."""
    return run.rms(np.clip(run.actions[..., 0].astype(np.float64), -1, 1))


def youngs_modulus(run: Trajectories) -> Floats:
    """Young's modulus of each episode [Pa]."""
    return run.parameters["youngs_modulus"]


def tracking_error(run: Trajectories) -> Floats:
    """Root mean square of demanded minus smoothed thrust [N]."""
    return run.rms(run.metrics["demand"] - run.metrics["smooth_thrust"])


def speed(run: Trajectories) -> Floats:
    """Mean speed of the hull [m/s]."""
    return run.mean(run.metrics["hull_speed"])


COLUMNS = (
    Column("thrust", "thrust", "mean thrust over the episode", thrust, "mN", 1e3, 3),
    Column("power", "power", "mean input power over the episode", power, "mW", 1e3, 3, "low"),
    Column(
        "efficiency",
        "efficiency",
        "propulsive (Froude) efficiency over the episode: speed times impulse over work",
        efficiency,
        "%",
        100.0,
        1,
        "high",
    ),
    Column(
        "beat",
        "beat",
        "frequency that is strongest in the pitch over the second half of the episode",
        beat,
        "Hz",
    ),
    Column(
        "command",
        "command",
        "root mean square of the command, as a share of its limit",
        command,
        "%",
        100.0,
        1,
    ),
    Column(
        "youngs_modulus",
        "Young's modulus",
        "of the fin in this episode",
        youngs_modulus,
        "kPa",
        1e-3,
        digits=0,
    ),
)
TRACKING = Column(
    "tracking_error",
    "tracking error",
    "root mean square of demanded minus smoothed thrust over the episode",
    tracking_error,
    "mN",
    1e3,
    3,
    "low",
)
SPEED = Column(
    "speed", "speed", "mean speed of the hull over the episode", speed, "mm/s", 1e3, 1, "high"
)


def draw_gaits(path: Path, records: Sequence[Record], evaluations: Sequence[Evaluation]) -> None:
    """See `rodgym.machines.gaits`, which needs matplotlib."""
    from rodgym.machines import gaits

    gaits.draw(path, records, evaluations)


GAITS = Picture(
    "gaits.png",
    "How they beat",
    "Above, seed {seed}: pitch and thrust over the last 1.2 s. "
    "Below, a dot is one episode: how fast the fin beats, the efficiency of its thrust (Froude: "
    "speed times impulse over work) and the return, over its Young's modulus.",
    draw_gaits,
)


def controllers(spec: Mapping[str, Any]) -> tuple[str, ...]:
    """A gait looks at nothing: it fits every observation."""
    return ("gait",)


FIN = Description(
    "fin",
    word="fin",
    environment="rodgym.envs:FinEnv",
    simulation="rodgym.sim:Fin",
    columns=COLUMNS,
    traces=(
        Trace("torque", "torque [mN m]", 1e3),
        Trace("pitch", "pitch [rad]"),
        Trace("thrust", "thrust [mN]", 1e3),
        Trace("power", "power [mW]", 1e3),
    ),
    tasks={
        "efficiency": Task(columns=(TRACKING,)),
        "swim": Task(columns=(SPEED,), traces=(Trace("hull_speed", "hull speed [mm/s]", 1e3),)),
    },
    controllers=controllers,
    # A fin at rest lies along x.
    rest_angle=np.pi / 2,
    rest="downstream",
    ends=("nose", "tail"),
    # It beats too fast for a whole episode to be read.
    seconds=3.0,
    pictures=(GAITS,),
)
