"""Where a distillation stands after a round: enough to go on to the same student, to the bit."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch

from rodgym.distil.rounds import Lessons
from rodgym.runs import Run, RunError

#: File in a run's folder; a distillation that has come to its end has none.
NAME = "distil.checkpoint"


@dataclass
class Progress:
    """What the rounds so far have made.

    ``about`` says which distillation it is. ``best`` are the parameters of the round that is kept,
    ``score`` its share of successes and mean return on the validation seeds.
    """

    about: dict[str, Any]
    rounds: int = 0
    steps: int = 0
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    student: dict[str, torch.Tensor] = field(default_factory=dict)
    optimizer: dict[str, Any] = field(default_factory=dict)
    lessons: list[Lessons] = field(default_factory=list)
    columns: list[str] = field(default_factory=list)
    curve: list[list[float]] = field(default_factory=list)
    best: dict[str, torch.Tensor] = field(default_factory=dict)
    best_round: int = 0
    score: tuple[float, float] = (-1.0, float("-inf"))

    def save(self, run: Run) -> None:
        """Writes it, all or nothing: a kill in the midst of it leaves the round before."""
        path = run.file(NAME)
        partial = path.with_name(f"{NAME}.part")
        torch.save({**vars(self), "lessons": [asdict(one) for one in self.lessons]}, partial)
        partial.replace(path)

    @classmethod
    def load(cls, run: Run) -> Progress:
        """Reads what `save` wrote.

        Raises:
            RunError: there is none, or it is damaged.
        """
        path: Path = run.path / NAME
        if not path.is_file():
            raise RunError(f"{path} is not there: no distillation of this name can be resumed")
        try:
            saved = torch.load(path, weights_only=True)
            return cls(**{**saved, "lessons": [Lessons(**one) for one in saved["lessons"]]})
        except Exception as error:
            raise RunError(f"{path} cannot be read: {error}") from error
