"""The network of a student: what it is shown, what it remembers, what it answers.

A student sees at each step one *frame*: the observation, and beside it, where `own_actions` is set,
the action that led to it. A lost sample (NaN) is shown as zeros, and so is what came before an
episode's beginning. What it remembers of an episode is one row of numbers, zero at the beginning:

    mlp: the last `frames` - 1 frames, oldest first, then its last action
    gru: the `units` of the recurrent layer, then its last action
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import nn

#: Networks that a student may have.
NETS = ("mlp", "gru")
#: Activations of the hidden layers.
ACTIVATIONS = ("Tanh", "ReLU", "ELU")


@dataclass(frozen=True)
class Shape:
    """All that fixes a student's parameters in number and meaning.

    Parameters
    ----------
    observation, action: numbers of each
    net: `mlp` over the last frames, or `gru`
    frames: frames that an mlp sees at once
    own_actions: whether a frame has the action that led to its observation
    hidden: sizes of the hidden layers
    activation: class of `torch.nn` between them
    units: size of the recurrent layer of a gru
    """

    observation: int
    action: int
    net: str = "mlp"
    frames: int = 24
    own_actions: bool = True
    hidden: tuple[int, ...] = (256, 256)
    activation: str = "Tanh"
    units: int = 128

    @property
    def frame(self) -> int:
        """Numbers of one frame."""
        return self.observation + (self.action if self.own_actions else 0)

    @property
    def seen(self) -> int:
        """Numbers that enter the net at once."""
        return self.frame * self.frames if self.net == "mlp" else self.frame

    @property
    def memory(self) -> int:
        """Numbers that are remembered beside the last action."""
        return self.seen - self.frame if self.net == "mlp" else self.units

    @property
    def state(self) -> int:
        """Numbers that are remembered in all."""
        return self.memory + self.action

    def as_dict(self) -> dict[str, Any]:
        """For a card."""
        return {**asdict(self), "hidden": list(self.hidden)}

    @classmethod
    def of(cls, given: dict[str, Any]) -> Shape:
        """From a card."""
        return cls(**{**given, "hidden": tuple(given["hidden"])})


class Student(nn.Module):
    """Frames to actions. `mean` and `scale` normalise a frame; `low` and `high` clip the action."""

    mean: torch.Tensor
    scale: torch.Tensor
    low: torch.Tensor
    high: torch.Tensor

    def __init__(self, shape: Shape, low: Sequence[float], high: Sequence[float]) -> None:
        super().__init__()
        self.shape = shape
        self.register_buffer("mean", torch.zeros(shape.frame))
        self.register_buffer("scale", torch.ones(shape.frame))
        self.register_buffer("low", torch.as_tensor(np.asarray(low, np.float32)))
        self.register_buffer("high", torch.as_tensor(np.asarray(high, np.float32)))
        recurrent = shape.net == "gru"
        self.cell = nn.GRU(shape.frame, shape.units, batch_first=True) if recurrent else None
        sizes = (shape.seen if self.cell is None else shape.units, *shape.hidden)
        layers: list[nn.Module] = []
        for before, after in pairwise(sizes):
            layers += [nn.Linear(before, after), getattr(nn, shape.activation)()]
        self.head = nn.Sequential(*layers, nn.Linear(sizes[-1], shape.action))

    def normalise(self, frames: torch.Tensor) -> None:
        """Takes mean and scale from frames (n, frame); what never changes is left as it is."""
        deviation, mean = torch.std_mean(frames.double(), 0)
        varies = deviation > 1e-6
        self.mean.copy_(torch.where(varies, mean, 0.0))
        self.scale.copy_(torch.where(varies, deviation, 1.0))

    def forward(self, frames: torch.Tensor) -> torch.Tensor:
        """Actions before they are clipped.

        Of an mlp for windows (n, frames, frame), (n, action); of a gru for episodes from their
        beginning (n, steps, frame), (n, steps, action).
        """
        inputs = (frames - self.mean) / self.scale
        if self.cell is None:
            return self.head(inputs.flatten(1))  # type: ignore[no-any-return]
        return self.head(self.cell(inputs)[0])  # type: ignore[no-any-return]

    def step(
        self, observation: torch.Tensor, state: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Clipped actions (n, a) for observations (n, d), and the next state (n, `shape.state`)."""
        memory, last = state.split([self.shape.memory, self.shape.action], 1)
        frame = self.frame(observation, last)
        if self.cell is None:
            window = torch.cat([memory, frame], 1)
            action = self(window.unflatten(1, (self.shape.frames, self.shape.frame)))
            memory = window[:, self.shape.frame :]
        else:
            inputs = (frame - self.mean) / self.scale
            seen, hidden = self.cell(inputs[:, None], memory[None].contiguous())
            action, memory = self.head(seen[:, 0]), hidden[0]
        action = action.clamp(self.low, self.high)
        return action, torch.cat([memory, action], 1)

    def frame(self, observation: torch.Tensor, last: torch.Tensor) -> torch.Tensor:
        """What one step shows, (n, frame): a lost sample is zeros."""
        seen = torch.where(observation.isnan().any(1, keepdim=True), 0.0, observation)
        return torch.cat([seen, last], 1) if self.shape.own_actions else seen

    def with_action(self, state: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
        """A state whose last action was another one, by another hand."""
        return torch.cat([state[:, : self.shape.memory], action], 1)
