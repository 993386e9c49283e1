"""Single environments: thin Gymnasium faces of the Rust core."""

from rodgym.envs.fin import FinEnv
from rodgym.envs.pendulum import PendulumEnv
from rodgym.envs.rod_env import RodEnv

__all__ = ["FinEnv", "PendulumEnv", "RodEnv"]
