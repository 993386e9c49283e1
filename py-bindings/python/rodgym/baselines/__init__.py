"""Classical controllers with the signature of a Stable-Baselines3 policy.

    controller = rodgym.baselines.Lqr.for_env(env)
    action, state = controller.predict(observation, state, episode_start)

The control laws are Rust (crate rodgym-baselines); this package gives them NumPy arrays.
"""

from rodgym._native import analyse, care, dare, thesis_run, upright
from rodgym.baselines.controller import (
    CONTROLLERS,
    AdaptiveGait,
    Controller,
    Gait,
    HybridLqr,
    Lqg,
    LqgAdaptive,
    Lqr,
    Mpc,
    ThesisLqg,
    ThesisLqr,
    load,
    make,
)

__all__ = [
    "CONTROLLERS",
    "AdaptiveGait",
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
    "load",
    "make",
    "thesis_run",
    "upright",
]
