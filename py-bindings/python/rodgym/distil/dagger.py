"""Teaches a student by DAgger: it drives, the teacher says what it would have done, it learns that.

Ross, Gordon, Bagnell, "A reduction of imitation learning and structured prediction to no-regret
online learning", 2011. The student sees what its environment shows; the teacher sees everything.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from rodgym import _checks as checks
from rodgym._plain import plain
from rodgym.distil.checkpoint import NAME, Progress
from rodgym.distil.learn import episodes, fit, windows
from rodgym.distil.lost import Lossy
from rodgym.distil.policy import StudentPolicy, save
from rodgym.distil.recipe import Recipe, load_recipe
from rodgym.distil.rounds import Pair, teach
from rodgym.distil.student import Shape, Student
from rodgym.evaluation import evaluate
from rodgym.evaluation.conditions import conditions
from rodgym.evaluation.policy import Policy
from rodgym.progress import Bar
from rodgym.runs import Run, RunError, versions, write_csv

#: Seeds that choose among the rounds; those of a training, and more of them, because one rod in a
#: hundred counts.
VALIDATION_SEEDS = range(10_000, 10_128)
#: Columns of ``learning_curve.csv`` before the share of episodes that did their task.
CURVE = (
    "round", "steps", "seconds", "cpu_seconds", "error", "return", "return_low", "return_high",
)  # fmt: skip


@dataclass(frozen=True)
class Distillation:
    """What came out: the round that was best on the validation seeds, saved, and all rounds.

    ``curve`` has the columns named ``columns``; ``seconds`` and ``cpu_seconds`` include validation;
    ``interrupted`` says that Ctrl-C ended it early.
    """

    policy: Path
    recipe: Recipe
    seed: int
    columns: Sequence[str]
    curve: Sequence[Sequence[float]]
    best_round: int
    rounds: int
    steps: int
    seconds: float
    cpu_seconds: float
    interrupted: bool


def distil(
    env_id: str,
    run: Run,
    *,
    recipe: Recipe | None = None,
    teacher: Policy | None = None,
    seed: int = 0,
    env_kwargs: Mapping[str, Any] | None = None,
    quiet: bool = False,
    resume: bool = False,
    force: bool = False,
) -> Distillation:
    """Teaches a student and saves ``policy.zip`` and ``learning_curve.csv`` in the run's folder.

    Ctrl-C ends it with the best round so far. After that or a kill, `resume` goes on after the last
    whole round, to the same student that an undisturbed distillation makes.

    Arguments:
        resume: go on where the run was stopped.
        force: replace what an earlier run of this name left.
        teacher: a policy in place of the one that the recipe names.
        env_kwargs: keywords of the student's environment, on top of the recipe's.

    Raises:
        RecipeError: values of the recipe that are not allowed.
        RunError: nothing to resume, a distillation of other settings, or an earlier run that
            neither `resume` nor `force` speaks of.
        ParameterError: keywords of the environment that are not allowed.
    """
    recipe = recipe or load_recipe(env_id)
    seed = checks.whole("seed", seed, 0, 2**32 - 1, "a whole number from 0 to 2^32 - 1")
    env_id, kwargs = conditions(env_id, {**recipe.env_kwargs, **checks.mapping("", env_kwargs)})
    # The networks are small: a second thread costs more in waiting than it gains.
    torch.set_num_threads(1)
    name = recipe.teacher if teacher is None else type(teacher).__name__
    about: dict[str, Any] = {
        "env": env_id,
        "env_kwargs": plain(kwargs),
        "algorithm": "DAgger",
        "teacher": name,
        "recipe": recipe.as_dict(),
        "seed": seed,
    }
    progress = Progress(about)
    if not (resume or force):
        run.keep_policy()
        if (run.path / NAME).exists():
            raise RunError(
                f"{run.path / NAME} is there from a distillation that was stopped: --resume goes "
                "on with it, --force begins anew"
            )
    if resume:
        progress = Progress.load(run)
        if progress.about != about:
            wrong = next(key for key in about if progress.about.get(key) != about[key])
            raise RunError(
                f"{run.path / NAME} is of another distillation: its {wrong} is "
                f"{progress.about.get(wrong)!r}, not {about[wrong]!r}"
            )
    school = School(env_id, kwargs, recipe, teacher or recipe.teacher, seed, progress)
    interrupted = False
    title = f"distilling {name}"
    with Bar(title, recipe.rounds * recipe.lessons[0], quiet) as bar:
        try:
            while progress.rounds < recipe.rounds:
                school.round(bar)
                progress.save(run)
        except KeyboardInterrupt:
            interrupted = True
        finally:
            school.close()
    if not progress.best:
        raise KeyboardInterrupt
    path = run.file("policy.zip")
    school.student.load_state_dict(progress.best)
    card = {
        **about,
        "steps": progress.steps,
        "rounds": progress.rounds,
        "best_round": progress.best_round,
        "versions": versions(),
    }
    save(school.student, path, card)
    write_csv(run.file("learning_curve.csv"), progress.columns, progress.curve)
    if not interrupted:
        (run.path / NAME).unlink(missing_ok=True)
    return Distillation(
        policy=path,
        recipe=recipe,
        seed=seed,
        columns=progress.columns,
        curve=progress.curve,
        best_round=progress.best_round,
        rounds=progress.rounds,
        steps=progress.steps,
        seconds=progress.seconds,
        cpu_seconds=progress.cpu_seconds,
        interrupted=interrupted,
    )


@dataclass
class School:
    """The student, its rods and its teacher, through one round after the other."""

    env_id: str
    env_kwargs: Mapping[str, Any]
    recipe: Recipe
    teacher: str | Policy
    seed: int
    progress: Progress
    pairs: list[Pair] = field(init=False)
    student: Student = field(init=False)
    optimizer: torch.optim.Optimizer = field(init=False)

    def __post_init__(self) -> None:
        recipe, progress = self.recipe, self.progress
        counts = divided(recipe.rods, len(recipe.variants))
        self.pairs = [
            Pair(self.env_id, {**self.env_kwargs, **variant}, count, recipe.sight)
            for variant, count in zip(recipe.variants, counts, strict=True)
        ]
        env: Any = self.pairs[0].student
        done = env.single_action_space
        shape = Shape(
            env.single_observation_space.shape[0],
            done.shape[0],
            recipe.net,
            recipe.frames if recipe.net == "mlp" else 1,
            recipe.own_actions,
            recipe.hidden,
            recipe.activation,
            recipe.units,
        )
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self.seed)
            self.student = Student(shape, done.low, done.high)
        self.optimizer = torch.optim.Adam(self.student.parameters(), lr=recipe.learning_rate[0])
        if progress.rounds:
            self.student.load_state_dict(progress.student)
            self.optimizer.load_state_dict(progress.optimizer)

    def close(self) -> None:
        """Closes the environments."""
        for pair in self.pairs:
            pair.close()

    def round(self, bar: Bar) -> None:
        """Plays, learns, validates, and notes all of it; a round depends on the seed and on the
        rounds before it alone.
        """
        recipe, progress, student = self.recipe, self.progress, self.student
        wall, cpu = time.perf_counter(), time.process_time()
        number = progress.rounds
        rng = np.random.default_rng([self.seed, number])
        guided = recipe.guided[number] if number < len(recipe.guided) else 0.0
        new = [
            teach(student, self.teacher, pair, rng, guided, recipe.lost_samples)
            for pair in self.pairs
        ]
        if number == 0:
            student.normalise(torch.cat([one.frames[one.alive] for one in new]))
        lessons = (progress.lessons + new)[-recipe.keep * len(self.pairs) :]
        chance = torch.Generator().manual_seed(int(rng.integers(2**63)))
        count, size = recipe.lessons
        if recipe.net == "mlp":
            batches = windows(lessons, recipe.frames, size, chance)
        else:
            batches = episodes(lessons, size, chance)
        for group in self.optimizer.param_groups:
            group["lr"] = falling(recipe.learning_rate, number, recipe.rounds)
        done = number * count
        error = fit(student, self.optimizer, batches, count, lambda k: bar.at(done + k))
        returns, successes = self.validate()
        progress.rounds += 1
        progress.lessons = lessons
        progress.steps += sum(one.steps for one in new)
        progress.student = copied(student)
        progress.optimizer = self.optimizer.state_dict()
        score = (min(successes.values(), default=1.0), float(returns.mean()))
        if score > progress.score:
            progress.score, progress.best_round = score, progress.rounds
            progress.best = progress.student
        progress.seconds += time.perf_counter() - wall
        progress.cpu_seconds += time.process_time() - cpu
        progress.columns = [*CURVE, *successes]
        seen = (returns.mean(), returns.min(), returns.max(), *successes.values())
        took = (round(progress.seconds, 2), round(progress.cpu_seconds, 2))
        progress.curve.append(
            [progress.rounds, progress.steps, *took, error, *(float(value) for value in seen)]
        )
        share = "".join(f", {name} {share:4.0%}" for name, share in successes.items())
        bar.say(f"round {progress.rounds}: return {returns.mean():.0f}{share}")

    def validate(self) -> tuple[np.ndarray, dict[str, float]]:
        """Returns on the validation seeds, and the share of episodes that did their task."""
        recipe = self.recipe
        policy: Policy = StudentPolicy(self.student)
        if recipe.lost_samples:
            policy = Lossy(policy, recipe.lost_samples, self.seed)
        results, first = [], 0
        for variant, count in zip(
            recipe.variants, divided(len(VALIDATION_SEEDS), len(recipe.variants)), strict=True
        ):
            seeds = VALIDATION_SEEDS[first : first + count]
            keywords = {**self.env_kwargs, **variant}
            results.append(evaluate(policy, self.env_id, seeds, env_kwargs=keywords))
            first += count
        columns = [one.name for one in results[0].described if one.success]
        joined = {
            name: np.concatenate([result.columns[name] for result in results])
            for name in ("return", *columns)
        }
        return joined["return"], {name: float(joined[name].mean()) for name in columns}


def copied(student: Student) -> dict[str, torch.Tensor]:
    """The parameters as they are now."""
    return {name: value.clone() for name, value in student.state_dict().items()}


def divided(total: int, parts: int) -> list[int]:
    """`total` in nearly equal parts."""
    return [total // parts + (i < total % parts) for i in range(parts)]


def falling(rates: Sequence[float], number: int, rounds: int) -> float:
    """The learning rate of a round: by the same factor from round to round."""
    first, last = rates
    return float(first * (last / first) ** (number / max(1, rounds - 1)))
