"""Draws the pictures of this folder: `python docs/images/draw.py` (extra `render`).

Looping GIFs of each machine at work, and a still of each.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import rodgym.baselines
from PIL import Image
from rodgym.report.gif import write_gif

HERE = Path(__file__).parent
SWING_UP = "rodgym/PendulumSwingUp-v0"
#: A command that is read from the clock [s] and the observation.
Policy = Callable[[float, Any], Any]


def film(env_id: str, policy: Policy, size: tuple[int, int], steps: range) -> list[Image.Image]:
    """Pictures of an episode after each of `steps`; every step is drawn, for trails and traces."""
    env = gym.make(env_id, render_mode="rgb_array", render_size=size)
    control_dt = env.unwrapped.control_dt
    observation, _ = env.reset(seed=1)
    frames = []
    for step in range(steps.stop):
        frame = env.render()
        if step in steps:
            frames.append(Image.fromarray(frame))
        observation, *_ = env.step(policy(step * control_dt, observation))
    env.close()
    return frames


def controller(name: str, env_id: str) -> Policy:
    """A controller by its name, with its memory."""
    made, memory = rodgym.baselines.make(name, gym.make(env_id)), [None]

    def policy(_: float, observation: Any) -> Any:
        action, memory[0] = made.predict(observation, memory[0])
        return action

    return policy


def sine(amplitude: float, frequency: float) -> Policy:
    """A pitch command of this amplitude, in parts of the pitch limit, and frequency [Hz]."""
    return lambda time, _: np.array([amplitude * np.sin(2 * np.pi * frequency * time)], np.float32)


def write(name: str, frames: list[Image.Image], frame_dt: float, still: int, hold: float) -> None:
    """Writes `name`.gif and `name`.png, its frame number `still`."""
    path = HERE / f"{name}.gif"
    write_gif(path, frames, frame_dt, hold)
    frames[still].save(HERE / f"{name}.png", optimize=True)
    print(f"{path.name}: {len(frames)} frames, {path.stat().st_size / 1024:.0f} KiB")


if __name__ == "__main__":
    swing = film(SWING_UP, controller("lqr", SWING_UP), (400, 400), range(0, 161, 2))
    write("pendulum", swing, frame_dt=0.05, still=22, hold=1.2)
    for name, env_id, regulator in (
        ("balance", "rodgym/PendulumBalance-v0", "lqr"),
        ("base", "rodgym/PendulumSwingUpBase-v0", "lqg"),
    ):
        frames = film(env_id, controller(regulator, env_id), (400, 400), range(0, 121, 2))
        write(name, frames, frame_dt=0.05, still=22, hold=1.2)
    # Two whole periods of 0.8 s, once the start is forgotten.
    gait = sine(0.8, 1.25)
    for name, env_id in (
        ("fin", "rodgym/FinThrust-v0"),
        ("efficiency", "rodgym/FinEfficiency-v0"),
        ("swim", "rodgym/FinSwim-v0"),
    ):
        write(name, film(env_id, gait, (560, 316), range(120, 160)), 0.04, still=6, hold=0.0)
