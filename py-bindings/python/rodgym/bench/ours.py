"""Cases of rodgym, all through the public Python calls."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from rodgym._registration import ENVIRONMENTS
from rodgym.bench.measure import Case

SWING_UP = "rodgym/PendulumSwingUp-v0"
FIN = "rodgym/FinThrust-v0"

#: Steppers beside the default one: name, id, keywords.
VARIANTS: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("implicit 1 ms", SWING_UP, {"stepper": "implicit", "physics_dt": 1e-3}),
    ("backward Euler 0.1 ms (thesis)", SWING_UP, {"thesis": True}),
    ("21 nodes", SWING_UP, {"nodes": 21}),
    ("31 nodes", SWING_UP, {"nodes": 31}),
    ("101 nodes", SWING_UP, {"nodes": 101}),
    ("1e9 Pa", SWING_UP, {"youngs_modulus": 1e9}),
    ("1e9 Pa, no damping", SWING_UP, {"youngs_modulus": 1e9, "bending_damping": 0.0}),
    ("steel, 2e11 Pa", SWING_UP, {"youngs_modulus": 2e11}),
    ("backward Euler", FIN, {"stepper": "backward_euler"}),
)


def machines() -> list[tuple[str, str, dict[str, Any]]]:
    """Every environment with its default stepper, then the other steppers: name, id, keywords."""
    defaults: list[tuple[str, str, dict[str, Any]]] = [(short(i), i, {}) for i in ENVIRONMENTS]
    return defaults + [(f"{short(i)}, {what}", i, kwargs) for what, i, kwargs in VARIANTS]


def short(env_id: str) -> str:
    """``PendulumSwingUp`` of ``rodgym/PendulumSwingUp-v0``."""
    return env_id.rpartition("/")[2].partition("-v")[0]


def batch(name: str, env_id: str, num_envs: int, threads: int = 1, **kwargs: Any) -> Case:
    """``step`` of a batch made by ``gym.make_vec``, random actions, autoreset on."""
    env = gym.make_vec(env_id, num_envs=num_envs, num_threads=threads, **kwargs)
    env.reset(seed=0)
    shape = env.action_space.shape
    rng = np.random.default_rng(0)
    actions = [rng.uniform(-1.0, 1.0, shape).astype(np.float32) for _ in range(16)]
    turn = 0

    def run(count: int) -> None:
        nonlocal turn
        for _ in range(count):
            turn = (turn + 1) % 16
            env.step(actions[turn])

    return Case(name, num_envs, run, alone=threads == 1)


def single(name: str, env_id: str, *, wrapped: bool, **kwargs: Any) -> Case:
    """``step`` of one environment made by ``gym.make``: as it comes, or its ``unwrapped``."""
    env: Any = gym.make(env_id, max_episode_steps=1 << 40, **kwargs)
    env.reset(seed=0)
    env = env if wrapped else env.unwrapped
    rng = np.random.default_rng(0)
    actions = [rng.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32) for _ in range(16)]

    def run(count: int) -> None:
        for i in range(count):
            env.step(actions[i % 16])

    return Case(name, 1, run)


#: Steps of control whose costs separate physics from what is around it [s].
SHORT, LONG = 0.01, 0.04


def layer_cases(num_envs: int) -> list[Case]:
    """Batches whose steps differ in the number of physics steps alone."""
    return [
        batch(f"PendulumSwingUp, step of {1e3 * dt:g} ms", SWING_UP, num_envs, control_dt=dt)
        for dt in (SHORT, LONG)
    ]


def layer_share(
    short: npt.NDArray[np.float64], long: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Batch layer over bare physics, a number a round, from costs of `layer_cases`.

    The long step has the physics of the short one four times, and Python call, observation, reward
    and reset once: the difference of the costs is bare physics, what remains is the layer.
    """
    physics = (long - short) / (LONG / SHORT - 1.0)
    return (short - physics) / physics
