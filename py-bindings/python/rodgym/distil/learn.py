"""Fits a student to the answers of its teacher."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import torch
from torch import nn
from torch.nn.utils import clip_grad_norm_

from rodgym.distil.rounds import Lessons
from rodgym.distil.student import Student

#: Norm that gradients are cut to: recurrent nets have a steep one now and then.
GRADIENT = 1.0

Batches = Iterator[tuple[torch.Tensor, torch.Tensor]]


def windows(lessons: Sequence[Lessons], frames: int, size: int, chance: torch.Generator) -> Batches:
    """Endless minibatches for an mlp: windows (size, frames, frame) that end at random steps, and
    the answers there. What comes before an episode is zeros.
    """
    shown, answers, alive = joined(lessons)
    padded = nn.functional.pad(shown, (0, 0, frames - 1, 0))
    view = padded.unfold(1, frames, 1).transpose(2, 3)
    rods, steps = alive.nonzero(as_tuple=True)
    while True:
        chosen = torch.randint(len(rods), (size,), generator=chance)
        rod, step = rods[chosen], steps[chosen]
        yield view[rod, step], answers[rod, step]


def episodes(lessons: Sequence[Lessons], size: int, chance: torch.Generator) -> Batches:
    """Endless minibatches for a gru: `size` whole episodes, answers NaN after their end."""
    shown, answers, alive = joined(lessons)
    answers = torch.where(alive[..., None], answers, torch.nan)
    while True:
        chosen = torch.randint(len(shown), (size,), generator=chance)
        yield shown[chosen], answers[chosen]


def joined(lessons: Sequence[Lessons]) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """All rods one below the other, the shorter lessons filled up."""
    longest = max(one.frames.shape[1] for one in lessons)

    def filled(tensor: torch.Tensor) -> torch.Tensor:
        rest = tensor.new_zeros(len(tensor), longest - tensor.shape[1], *tensor.shape[2:])
        return torch.cat([tensor, rest], 1)

    return (
        torch.cat([filled(one.frames) for one in lessons]),
        torch.cat([filled(one.answers) for one in lessons]),
        torch.cat([filled(one.alive) for one in lessons]),
    )


def fit(
    student: Student,
    optimizer: torch.optim.Optimizer,
    batches: Batches,
    count: int,
    on_step: Callable[[int], None] = lambda done: None,
) -> float:
    """Takes `count` steps of the optimizer; returns the mean squared error."""
    total = 0.0
    for done in range(count):
        on_step(done)
        shown, answers = next(batches)
        there = ~answers.isnan()
        error = torch.where(there, student(shown) - answers, 0.0)
        loss = error.square().sum() / there.sum()
        optimizer.zero_grad()
        loss.backward()
        clip_grad_norm_(student.parameters(), GRADIENT)
        optimizer.step()
        total += float(loss.detach())
    return total / count
