"""Helpers of the Python tests."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pytest
import rodgym

# A window's OpenGL driver may bring an LLVM that crashes PyTorch's Triton when imported later.
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")

SWING_UP = "rodgym/PendulumSwingUp-v0"
BALANCE = "rodgym/PendulumBalance-v0"
BASE = "rodgym/PendulumSwingUpBase-v0"


def ids_of(machine: str) -> tuple[str, ...]:
    """Every id of a machine, by the catalogue."""
    return tuple(i for i, entry in rodgym.ENVIRONMENTS.items() if entry.machine == machine)


PENDULUMS = ids_of("pendulum")
FINS = ids_of("fin")

#: Draws parameters, noise and starts, so that every random stream is in play.
RANDOM = {
    "randomize": {"width": (0.006, 0.009)},
    "sensor_noise": {"angle": 1e-3, "rate": 1e-2},
}
#: The same for fins.
RANDOM_FIN = {**RANDOM, "randomize": {"youngs_modulus": (2e5, 3e5)}}


def assert_same(ours: Any, theirs: Any, path: str = "result") -> None:
    """Equal to the bit: types, shapes, dtypes, keys and values, at every level."""
    if isinstance(theirs, dict):
        assert isinstance(ours, dict), path
        assert set(ours) == set(theirs), f"{path}: {sorted(ours)} != {sorted(theirs)}"
        for key in theirs:
            assert_same(ours[key], theirs[key], f"{path}[{key!r}]")
    elif isinstance(theirs, (list, tuple)):
        assert len(ours) == len(theirs), path
        for i, pair in enumerate(zip(ours, theirs, strict=True)):
            assert_same(*pair, f"{path}[{i}]")
    elif isinstance(theirs, np.ndarray) and theirs.dtype == object:
        assert ours.dtype == object and ours.shape == theirs.shape, path
        assert_same(list(ours), list(theirs), path)
    elif isinstance(theirs, np.ndarray):
        assert ours.dtype == theirs.dtype, f"{path}: {ours.dtype} != {theirs.dtype}"
        assert ours.shape == theirs.shape, f"{path}: {ours.shape} != {theirs.shape}"
        assert ours.tobytes() == theirs.tobytes(), f"{path}: {ours} != {theirs}"
    else:
        assert type(ours) is type(theirs), f"{path}: {type(ours)} != {type(theirs)}"
        # (A metric at a reset is NaN.)
        equal = ours == theirs or (theirs != theirs and ours != ours)
        assert equal, f"{path}: {ours} != {theirs}"


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def actions_for(rng: np.random.Generator, steps: int, num_envs: int) -> np.ndarray:
    """Random actions (steps, num_envs, 1), some beyond the space."""
    return rng.uniform(-1.2, 1.2, size=(steps, num_envs, 1)).astype(np.float32)
