"""Watches an agent on validation seeds as it learns, and keeps its best stage."""

from __future__ import annotations

import copy
import pickle
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

from rodgym.evaluation import Policy, evaluate
from rodgym.evaluation.policies import behind
from rodgym.progress import Bar
from rodgym.training import checkpoint
from rodgym.training.environments import returns_behind_wrappers
from rodgym.training.recipe import Recipe

#: Seeds that choose among the agent's stages. Tables are made on other ones (0 to 99 by default).
VALIDATION_SEEDS = range(10_000, 10_032)
#: How often the agent is validated during a training.
VALIDATIONS = 25
#: Longest time [s] between two checkpoints, as far as rollouts allow.
CHECKPOINT_SECONDS = 60.0
#: Columns of ``learning_curve.csv``, before the share of episodes that did their task, where the
#: machine has a column for it.
CURVE = ("steps", "seconds", "training_return", "return", "return_low", "return_high")


class Watch(BaseCallback):
    """Validates at regular steps, keeps the best stage, shows progress, ends on Ctrl-C.

    Between rollouts it hands itself to ``save``: at every validation, and every minute. Those in
    ``told`` get it at every validation.
    """

    def __init__(
        self,
        env_id: str,
        env_kwargs: Mapping[str, Any],
        recipe: Recipe,
        bar: Bar,
        interrupted: threading.Event,
        save: Callable[[Watch], None],
        told: Sequence[Callable[[Watch], None]] = (),
    ) -> None:
        super().__init__()
        self.env_id = env_id
        self.env_kwargs = env_kwargs
        self.recipe = recipe
        self.every = max(1, recipe.n_timesteps // VALIDATIONS)
        self.bar = bar
        self.interrupted = interrupted
        self.save = save
        self.told = told
        self.columns: tuple[str, ...] = CURVE
        self.curve: list[tuple[float, ...]] = []
        self.best_return = -np.inf
        self.best_steps = 0
        self.best_parameters: dict[str, torch.Tensor] = {}
        #: Those of `VecNormalize`, pickled as Stable-Baselines3 does it.
        self.best_statistics: bytes | None = None
        self.next = 0
        self.began = time.perf_counter()
        self.saved = self.began
        self._before: dict[str, Any] | None = None

    #: What a checkpoint keeps.
    KEPT = (
        "columns", "curve", "best_return", "best_steps", "best_parameters", "best_statistics",
        "next", "num_timesteps",
    )  # fmt: skip

    def state(self) -> dict[str, Any]:
        """All that a resumed training needs of the watch and of the streams that learning draws."""
        kept = {name: getattr(self, name) for name in self.KEPT}
        streams = checkpoint.random_streams()
        noise = checkpoint.exploration(self.model)
        added = copy.deepcopy(getattr(self.model, "action_noise", None))
        return {
            **kept, "seconds": self.seconds, "streams": streams, "noise": noise, "added": added
        }  # fmt: skip

    def resume(self, state: Mapping[str, Any]) -> None:
        """Goes on from `state` at the next start of a rollout."""
        for name in self.KEPT:
            setattr(self, name, state[name])
        self.began = time.perf_counter() - state["seconds"]
        self._before = dict(state)

    @property
    def seconds(self) -> float:
        """Wall time of the training, that before an interruption included."""
        return time.perf_counter() - self.began

    @property
    def last_return(self) -> float:
        """Mean return of the last validation."""
        return self.curve[-1][CURVE.index("return")]

    def _on_rollout_start(self) -> None:
        # Between rollouts, where the agent has just changed.
        if self._before is not None:
            # What was drawn since the start of this process was drawn before the checkpoint, too.
            checkpoint.set_random_streams(self._before["streams"])
            checkpoint.set_exploration(self.model, self._before["noise"])
            if self._before["added"] is not None:
                # In place: the rollout has it already, and it was reset.
                vars(self.model.action_noise).update(vars(self._before["added"]))
            self._before = None
        due = time.perf_counter() - self.saved > CHECKPOINT_SECONDS
        if self.num_timesteps >= self.next:
            self.next = self.num_timesteps + self.every
            self.validate()
            due = True
        if due:
            self.save(self)
            self.saved = time.perf_counter()

    def _on_step(self) -> bool:
        self.bar.at(self.num_timesteps)
        return not self.interrupted.is_set()

    def validate(self) -> None:
        """Plays the validation seeds with the present stage of the agent."""
        if self.recipe.wrappers():
            returns = returns_behind_wrappers(
                self.model, self.env_id, self.recipe, self.env_kwargs, VALIDATION_SEEDS
            )
            successes = {}
        else:
            actor = actor_of(self.model, self.recipe)
            result = evaluate(actor, self.env_id, VALIDATION_SEEDS, env_kwargs=self.env_kwargs)
            returns = result.columns["return"]
            successes = {c.name: result.mean(c.name) for c in result.described if c.success}
        self.columns = (*CURVE, *successes)
        recent = [episode["r"] for episode in self.model.ep_info_buffer or []]
        row = (
            self.num_timesteps,
            round(self.seconds, 2),
            float(np.mean(recent)) if recent else float("nan"),
            float(returns.mean()),
            float(returns.min()),
            float(returns.max()),
            *successes.values(),
        )
        self.curve.append(row)
        if returns.mean() > self.best_return:
            self._keep(float(returns.mean()))
        for name, value in zip(self.columns[3:], row[3:], strict=True):
            self.logger.record(f"validation/{name}", value)
        self.logger.dump(self.num_timesteps)
        for tell in self.told:
            tell(self)
        speed = self.num_timesteps / max(self.seconds, 1e-9)
        done = "".join(f", {name} {share:4.0%}" for name, share in successes.items())
        self.bar.say(f"return {returns.mean():.0f}{done}, {speed:,.0f} steps/s")

    def _keep(self, validated: float) -> None:
        """Copies the present stage: it is the best so far."""
        self.best_return = validated
        self.best_steps = self.num_timesteps
        state = self.model.policy.state_dict()
        self.best_parameters = {key: value.clone() for key, value in state.items()}
        normalize = self.model.get_vec_normalize_env()
        self.best_statistics = None if normalize is None else pickle.dumps(normalize)


def actor_of(model: BaseAlgorithm, recipe: Recipe) -> Policy:
    """The present agent behind what its recipe puts before it."""
    actions = int(model.action_space.shape[0]) if recipe.own_actions else 0  # type: ignore[index]
    return behind(model, recipe.frame_stack, actions, model.get_vec_normalize_env())
