"""How PPO goes on from a student: the entry `fine_tune` of a recipe."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rodgym.distil.checked import Checked, number, whole

#: Sizes that counts may have.
COUNTS = {"steps": 10**12, "n_envs": 1 << 16, "n_steps": 1 << 16, "n_epochs": 1000}


@dataclass(frozen=True)
class Tuning(Checked):
    """Careful steps of PPO, with little noise about what works already.

    Parameters
    ----------
    steps: environment steps in all
    n_envs: environments side by side
    learning_rate: of actor and critic once both learn; it falls to zero
    critic_rate: of the critic as long as it learns alone
    critic_alone: share of the steps in which it does
    log_std_init: logarithm of the standard deviation of the actions, at first
    n_steps, batch_size, n_epochs, gamma, gae_lambda, clip_range, ent_coef, max_grad_norm: of PPO in
        Stable-Baselines3
    """

    steps: int = 1_000_000
    n_envs: int = 128
    learning_rate: float = 5e-4
    critic_rate: float = 2e-3
    critic_alone: float = 0.2
    log_std_init: float = -2.5
    n_steps: int = 64
    batch_size: int = 2048
    n_epochs: int = 8
    gamma: float = 0.97
    gae_lambda: float = 0.9
    clip_range: float = 0.1
    ent_coef: float = 0.0
    max_grad_norm: float = 0.5

    called = "fine_tune"

    def __post_init__(self) -> None:
        for name, most in COUNTS.items():
            value = getattr(self, name)
            self._check(
                name, whole(value) and 1 <= value <= most, f"a whole number from 1 to {most}"
            )
        rollout = self.n_envs * self.n_steps
        size = self.batch_size
        self._check("batch_size", whole(size) and 2 <= size <= rollout, f"from 2 to {rollout}")
        for name in ("learning_rate", "critic_rate", "clip_range"):
            value = getattr(self, name)
            self._check(name, number(value) and 0 < value <= 1, "a number up to 1")
        for name in ("critic_alone", "gamma", "gae_lambda", "ent_coef"):
            value = getattr(self, name)
            self._check(name, number(value) and 0 <= value <= 1, "a number from 0 to 1")
        for name in ("log_std_init", "max_grad_norm"):
            self._check(name, number(getattr(self, name)), "a number")

    def of_ppo(self) -> dict[str, Any]:
        """Keywords of `stable_baselines3.PPO`."""
        names = (
            "n_steps", "batch_size", "n_epochs", "gamma", "gae_lambda", "clip_range", "ent_coef",
            "max_grad_norm",
        )  # fmt: skip
        return {name: getattr(self, name) for name in names}

    def rate(self, remaining: float) -> float:
        """The learning rate, by the share of the steps that remain."""
        return (
            self.critic_rate
            if remaining > 1 - self.critic_alone
            else self.learning_rate * remaining
        )
