"""Classical controllers with the signature of a Stable-Baselines3 policy.

    controller = rodgym.baselines.Lqr.for_env(env)
    action, state = controller.predict(observation, state, episode_start)

The control laws are Rust (crate rodgym-baselines); this package gives them NumPy arrays.
"""

from rodgym._native import analyse, care, dare, thesis_run, upright
from rodgym.baselines.controller import (
    CONTROLLERS,
    Controller,
    Gait,
    HybridLqr,
    Lqg,
    LqgAdaptive,
    Lqr,
    Mpc,
    ThesisLqg,
    ThesisLqr,
    make,
)

__all__ = [
    "CONTROLLERS",
    "Controller",
    "Gait",
    "HybridLqr",
    "Lqg",
    "LqgAdaptive",
    "Lqr",
    "Mpc",
    "ThesisLqg",
    "ThesisLqr",
    "analyse",
    "care",
    "dare",
    "make",
    "thesis_run",
    "upright",
]
