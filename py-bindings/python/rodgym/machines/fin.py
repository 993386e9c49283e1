"""The flexible fin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgym.machines.description import (
    GAIN,
    NOISE,
    Band,
    Column,
    Description,
    Floats,
    Picture,
    Quantity,
    Task,
    Trace,
    factor,
    lag,
)

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


def any_pitch(spec: Mapping[str, Any]) -> dict[str, Any]:
    """Straight fins at any pitch that the servo is told."""
    limit = spec["config"]["pitch_limit"]
    return {"start_pitch": (-limit, limit)}


def other_fins(spec: Mapping[str, Any]) -> dict[str, Any]:
    """Fins and water about the nominal ones."""
    shares = {"youngs_modulus": 0.3, "added_mass_coefficient": 0.15, "drag_coefficient": 0.15}
    values = {name: spec["config"][name] for name in shares}
    return {
        "randomize": {
            name: ((1 - share) * values[name], (1 + share) * values[name])
            for name, share in shares.items()
        }
    }


BANDS = (
    Band("starts", "from any pitch within the servo's limit", any_pitch),
    Band(
        "rods",
        "Young's modulus +-30 %, added mass and drag of the water +-15 %, drawn each episode",
        other_fins,
    ),
)


def command_noise(spec: Mapping[str, Any], value: float) -> dict[str, Any]:
    """Noise of the command, drawn each step, before its low-pass."""
    return {"command_disturbance": value}


def quantities(spec: Mapping[str, Any]) -> tuple[Quantity, ...]:
    """Material, water, hull and servo; nothing stands that could be pushed over."""
    water = (
        (
            factor("hull_mass", "hull's mass / nominal", 0.75, 1.25),
            factor("hull_drag_area", "hull's drag area / nominal", 0.75, 1.25),
        )
        if spec["task"] == "swim"
        else (factor("flow_speed", "speed of the water / nominal", 0.75, 1.25),)
    )
    return (
        factor("youngs_modulus", "Young's modulus / nominal", 0.5, 2.0, logarithmic=True),
        factor("density", "density / nominal", 0.75, 1.25),
        factor("added_mass_coefficient", "added mass / nominal", 0.75, 1.25),
        factor("drag_coefficient", "drag across / nominal", 0.75, 1.25),
        *water,
        NOISE,
        Quantity("command_noise", "noise of the command", 0.0, 0.2, 0.0, command_noise),
        GAIN,
        Quantity("actuator_delay", "delay of the servo [ms]", 0.0, 80.0, 0.0, lag),
    )


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
    bands=BANDS,
    quantities=quantities,
    # A fin at rest lies along x.
    rest_angle=np.pi / 2,
    rest="downstream",
    ends=("nose", "tail"),
    # It beats too fast for a whole episode to be read.
    seconds=3.0,
    pictures=(GAITS,),
)
