"""Goes on from a student by PPO: it now learns from the reward what the teacher did not know.

The actor begins as the student; the critic knows nothing yet and learns alone at first, because its
first wrong opinions would undo what the student can.
"""

from __future__ import annotations

import json
import time
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecFrameStack
from torch import nn

import rodgym.sb3
from rodgym.distil.dagger import VALIDATION_SEEDS
from rodgym.distil.policy import KIND, read
from rodgym.distil.student import Student
from rodgym.distil.tuning import Tuning
from rodgym.evaluation import evaluate
from rodgym.evaluation.policies import CARD, Policy, PolicyError, Stacked, find, read_card
from rodgym.progress import Bar
from rodgym.runs import Run, versions, write_csv
from rodgym.training.own_actions import OwnActions
from rodgym.training.staggered import Staggered

#: Stages that are validated.
VALIDATIONS = 20
CURVE = ("steps", "seconds", "cpu_seconds", "return", "return_low", "return_high")


@dataclass(frozen=True)
class FineTuning:
    """What came out: the stage that was best on the validation seeds; stage 0 is the student."""

    policy: Path
    seed: int
    columns: Sequence[str]
    curve: Sequence[Sequence[float]]
    best_steps: int
    steps: int
    seconds: float
    interrupted: bool


def fine_tune(
    source: str,
    run: Run,
    *,
    tuning: Tuning | None = None,
    steps: int | None = None,
    seed: int = 0,
    quiet: bool = False,
) -> FineTuning:
    """Trains PPO from a student's file and saves ``policy.zip``, a file of Stable-Baselines3.

    Ctrl-C ends it after the current step; the best stage is kept.

    Arguments:
        tuning: how PPO goes on; None: as the recipe by which the student was taught says.
        steps: environment steps, in place of those of `tuning`.

    Raises:
        PolicyError: no student, or one with a memory, which PPO has no place for.
    """
    torch.set_num_threads(1)
    path = find(source)
    card = read_card(path)
    if card.get("kind") != KIND:
        raise PolicyError(f"{path} is no student: PPO begins from what `rodgym distil` saved")
    student = read(path, card)
    if student.cell is not None:
        raise PolicyError(f"{path} is a gru: only an mlp can be fine-tuned")
    env_id, env_kwargs = card["env"], card["env_kwargs"]
    shape = student.shape
    tuning = tuning or Tuning().with_changes(card["recipe"].get("fine_tune", {}))
    tuning = tuning.with_changes({"steps": steps or tuning.steps})
    env: VecEnv = rodgym.sb3.make_vec_env(env_id, tuning.n_envs, seed, env_kwargs=dict(env_kwargs))
    # In step, all rods would swing up in one rollout and stand in the next seven.
    env = Staggered(env)
    env = OwnActions(env) if shape.own_actions else env
    env = VecFrameStack(env, shape.frames) if shape.frames > 1 else env
    hidden = list(shape.hidden)
    model = PPO(
        "MlpPolicy",
        env,
        learning_rate=tuning.rate,
        policy_kwargs={
            "net_arch": {"pi": hidden, "vf": hidden},
            "activation_fn": getattr(nn, shape.activation),
            "log_std_init": tuning.log_std_init,
        },
        seed=seed,
        device="cpu",
        **tuning.of_ppo(),
    )
    put(student, model)
    policy_file = run.file("policy.zip")
    interrupted = False
    with Bar("fine-tuning by PPO", tuning.steps, quiet) as bar:
        watch = Watch(env_id, env_kwargs, student, tuning, bar)
        try:
            model.learn(tuning.steps, callback=watch)
            watch.validate()
        except KeyboardInterrupt:
            interrupted = True
    env.close()
    if not watch.best:
        raise KeyboardInterrupt
    model.policy.load_state_dict(watch.best)
    about = {
        "env": env_id,
        "env_kwargs": env_kwargs,
        "algorithm": "PPO",
        "frame_stack": shape.frames,
        "own_actions": shape.own_actions,
        "student": {key: card[key] for key in ("teacher", "seed", "best_round", "recipe")},
        "recipe": tuning.as_dict(),
        "seed": seed,
        "steps": model.num_timesteps,
        "best_steps": watch.best_steps,
        "versions": versions(),
    }
    model.save(policy_file)
    with zipfile.ZipFile(policy_file, "a") as archive:
        archive.writestr(CARD, json.dumps(about, indent=2) + "\n")
    write_csv(run.file("learning_curve.csv"), watch.columns, watch.curve)
    return FineTuning(
        policy=policy_file,
        seed=seed,
        columns=watch.columns,
        curve=watch.curve,
        best_steps=watch.best_steps,
        steps=model.num_timesteps,
        seconds=time.perf_counter() - watch.began,
        interrupted=interrupted,
    )


def actor_of(model: PPO) -> list[nn.Module]:
    """The layers of the actor."""
    policy: Any = model.policy
    return [*policy.mlp_extractor.policy_net, policy.action_net]


def put(student: Student, model: PPO) -> None:
    """Makes the actor the student; what normalises its frames goes into the first layer."""
    ours = [layer for layer in student.head if isinstance(layer, nn.Linear)]
    theirs = [layer for layer in actor_of(model) if isinstance(layer, nn.Linear)]
    with torch.no_grad():
        for own, other in zip(ours, theirs, strict=True):
            other.weight.copy_(own.weight)
            other.bias.copy_(own.bias)
        frames = student.shape.frames
        mean, scale = student.mean.repeat(frames), student.scale.repeat(frames)
        first = theirs[0]
        first.bias.sub_(first.weight @ (mean / scale))
        first.weight.div_(scale)


class Watch(BaseCallback):
    """Lets the critic learn alone at first, validates stages, keeps the best one."""

    def __init__(
        self, env_id: str, env_kwargs: Mapping[str, Any], student: Student, tuning: Tuning, bar: Bar
    ) -> None:
        super().__init__()
        self.env_id, self.env_kwargs = env_id, env_kwargs
        self.shape = student.shape
        self.alone = tuning.critic_alone * tuning.steps
        self.every = max(1, tuning.steps // VALIDATIONS)
        self.bar = bar
        self.columns: tuple[str, ...] = CURVE
        self.curve: list[tuple[float, ...]] = []
        self.best: dict[str, torch.Tensor] = {}
        self.best_steps = 0
        self.score = (-1.0, -np.inf)
        self.next = 0
        self.began, self.cpu = time.perf_counter(), time.process_time()

    def _on_rollout_start(self) -> None:
        learns = self.num_timesteps >= self.alone
        policy: Any = self.model.policy
        for layer in actor_of(self.model):  # type: ignore[arg-type]
            layer.requires_grad_(learns)
        policy.log_std.requires_grad_(learns)
        # The student first, and then whenever the actor may have changed.
        if self.num_timesteps == 0 or (learns and self.num_timesteps >= self.next):
            self.next = self.num_timesteps + self.every
            self.validate()

    def _on_step(self) -> bool:
        self.bar.at(self.num_timesteps)
        return True

    def validate(self) -> None:
        """Plays the validation seeds with the present stage."""
        model: Policy = self.model  # type: ignore[assignment]
        depth, own = self.shape.frames, self.shape.action if self.shape.own_actions else 0
        actor = Stacked(model, depth, own) if depth > 1 or own else model
        result = evaluate(actor, self.env_id, VALIDATION_SEEDS, env_kwargs=self.env_kwargs)
        returns = result.columns["return"]
        successes = {one.name: result.mean(one.name) for one in result.described if one.success}
        self.columns = (*CURVE, *successes)
        took = (time.perf_counter() - self.began, time.process_time() - self.cpu)
        seen = (float(returns.mean()), float(returns.min()), float(returns.max()))
        self.curve.append(
            (self.num_timesteps, *(round(one, 2) for one in took), *seen, *successes.values())
        )
        score = (min(successes.values(), default=1.0), float(returns.mean()))
        if score > self.score:
            self.score, self.best_steps = score, self.num_timesteps
            state = self.model.policy.state_dict()
            self.best = {name: value.clone() for name, value in state.items()}
        share = "".join(f", {name} {value:4.0%}" for name, value in successes.items())
        self.bar.say(f"return {returns.mean():.1f}{share}")
