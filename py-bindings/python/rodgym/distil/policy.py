"""A student as a policy among others, and its file.

The file is a zip archive with a card (`rodgym.json`), which says how the student was made, and its
parameters (`student.npz`).
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from rodgym.distil.student import Shape, Student
from rodgym.evaluation.policy import AnyEnv, PolicyError
from rodgym.evaluation.saved import CARD
from rodgym.evaluation.stepped import Rows, Stepped, check_sizes

#: Member of a student's file that holds its parameters.
PARAMETERS = "student.npz"
#: What a card calls this kind of file.
KIND = "student"


class StudentPolicy(Stepped):
    """A student that plays."""

    def __init__(self, student: Student, card: Mapping[str, Any] | None = None) -> None:
        super().__init__(self._forward, student.shape.observation, student.shape.state)
        self.student = student
        self.card = dict(card or {})

    def _forward(self, observation: Rows, state: Rows) -> tuple[Rows, Rows]:
        with torch.inference_mode():
            action, after = self.student.step(
                torch.from_numpy(observation), torch.from_numpy(state)
            )
        return action.numpy(), after.numpy()


def save(student: Student, path: Path, card: Mapping[str, Any], half: bool = False) -> None:
    """Writes a student's file; with `half` its weights in 16 bits."""
    tensors = {name: value.numpy() for name, value in student.state_dict().items()}
    if half:
        tensors = {name: value.astype(np.float16) for name, value in tensors.items()}
    parameters = io.BytesIO()
    np.savez(parameters, **tensors)  # type: ignore[arg-type]
    about = {"kind": KIND, **card, "student": student.shape.as_dict()}
    partial = path.with_name(path.name + ".part")
    with zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(CARD, json.dumps(about, indent=2) + "\n")
        archive.writestr(PARAMETERS, parameters.getvalue())
    partial.replace(path)


def read(path: Path, card: Mapping[str, Any]) -> Student:
    """The student of a file whose card has been read.

    Raises:
        PolicyError: its parameters are missing or not those that the card speaks of.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            arrays = np.load(io.BytesIO(archive.read(PARAMETERS)), allow_pickle=False)
            shape = Shape.of(card["student"])
            student = Student(shape, [0.0] * shape.action, [0.0] * shape.action)
            tensors = {name: torch.from_numpy(arrays[name].astype(np.float32)) for name in arrays}
            student.load_state_dict(tensors)
    except (zipfile.BadZipFile, KeyError, ValueError, TypeError, RuntimeError) as error:
        raise PolicyError(f"{path} holds no student: {error}") from error
    return student.eval()


def load(path: Path, card: Mapping[str, Any], env: AnyEnv) -> StudentPolicy:
    """The policy of a student's file, for `env`.

    Raises:
        PolicyError: a damaged file, or a student of other observations or actions.
    """
    torch.set_num_threads(1)
    student = read(path, card)
    check_sizes(path, card, env, student.shape.observation, student.shape.action)
    return StudentPolicy(student, card)
