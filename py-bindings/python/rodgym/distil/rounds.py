"""A round of lessons: the student looks, the teacher says what it would do, one of them drives.

Student and teacher see the same rods in two environments that differ in their sensors only: they
begin with the same seeds and take the same actions, so that their physics are the same to the bit,
and the rewards are compared at each step to make sure of that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from rodgym import machines
from rodgym.distil.lost import lose
from rodgym.distil.student import Student
from rodgym.errors import ParameterError
from rodgym.evaluation.conditions import make_batch
from rodgym.evaluation.policies import load_policy
from rodgym.evaluation.policy import Policy, ask

Rows = NDArray[np.float32]


def teacher_sight(spec: Mapping[str, Any]) -> dict[str, Any]:
    """Keywords by which an environment shows everything, without noise."""
    known = {keyword["name"] for keyword in spec["keywords"]}
    everything = {"observation": "full", "sensor_noise": {}}
    return {name: value for name, value in everything.items() if name in known}


class Pair:
    """The same rods, seen by a student and by its teacher.

    Arguments:
        env_id, env_kwargs: what the student plays in.
        count: rods side by side.
        sight: keywords that the teacher's environment has in place of the student's; None: it sees
            everything, without noise.

    Raises:
        ParameterError: sensor noise beside a disturbance of the torque. Both are drawn from one
            random stream, so that other sensors would mean another disturbance.
    """

    def __init__(
        self,
        env_id: str,
        env_kwargs: Mapping[str, Any],
        count: int,
        sight: Mapping[str, Any] | None = None,
    ) -> None:
        self.student = make_batch(env_id, count, env_kwargs)
        spec = machines.spec_of(self.student)
        view = teacher_sight(spec) if sight is None else dict(sight)
        disturbance = spec["config"].get("torque_disturbance", 0)
        if disturbance and any(spec["config"].get("sensor_noise", {}).values()):
            self.student.close()
            raise ParameterError(
                f"torque_disturbance = {disturbance!r} is not allowed beside sensor_noise: it must "
                "be 0 where a student is taught, because both draw from one random stream"
            )
        self.teacher = make_batch(env_id, count, {**env_kwargs, **view})
        self.num_envs = count

    def reset(self, seeds: list[int]) -> tuple[Rows, Rows]:
        """What the student and the teacher see of episodes that begin."""
        seen, _ = self.student.reset(seed=seeds)
        truth, _ = self.teacher.reset(seed=seeds)
        return seen, truth

    def step(self, action: Rows, running: NDArray[np.bool_]) -> tuple[Rows, Rows, Any]:
        """What both see next, and which episodes are over."""
        seen, reward, ended, cut, _ = self.student.step(action)
        truth, other, _, _, _ = self.teacher.step(action)
        assert np.array_equal(reward[running], other[running]), "the rods went two ways"
        return seen, truth, ended | cut

    def close(self) -> None:
        """Closes both."""
        self.student.close()
        self.teacher.close()


@dataclass(frozen=True)
class Lessons:
    """What n rods showed and what the teacher answered.

    ``frames`` (n, steps, frame) are the student's, ``answers`` (n, steps, action) the teacher's;
    ``alive`` (n, steps) is not set after an episode's end.
    """

    frames: torch.Tensor
    answers: torch.Tensor
    alive: torch.Tensor

    @property
    def steps(self) -> int:
        """Environment steps taken."""
        return int(self.alive.sum())


def teach(
    student: Student,
    teacher: str | Policy,
    pair: Pair,
    rng: np.random.Generator,
    guided: float,
    lost_samples: float = 0.0,
) -> Lessons:
    """Plays one episode with each rod of the pair.

    Arguments:
        teacher: a name or file for `load_policy`, or a policy.
        guided: share of the rods that the teacher drives.
        lost_samples: each rod loses its own share of the student's samples, drawn from 0 to this;
            never the first one.
    """
    count = pair.num_envs
    lecturer = load_policy(teacher, pair.teacher) if isinstance(teacher, str) else teacher
    seen, truth = pair.reset(rng.integers(2**63, size=count).tolist())
    by_teacher = np.arange(count) < round(guided * count)
    lost = rng.uniform(0, lost_samples, count)
    state, memory = torch.zeros(count, student.shape.state), None
    low, high = student.low.numpy(), student.high.numpy()
    running, start = np.ones(count, bool), np.ones(count, bool)
    frames: list[torch.Tensor] = []
    answers: list[torch.Tensor] = []
    alive: list[torch.Tensor] = []
    with torch.inference_mode():
        while running.any():
            answer, memory = ask(lecturer, truth, memory, start)
            answer = np.clip(np.asarray(answer, np.float32), low, high)
            if lost_samples and frames:
                seen = lose(seen, lost, rng)
            observation = torch.from_numpy(np.array(seen, np.float32))
            frames.append(student.frame(observation, state[:, student.shape.memory :]))
            action, state = student.step(observation, state)
            driven = np.where(by_teacher[:, None], answer, action.numpy())
            state = student.with_action(state, torch.from_numpy(driven))
            answers.append(torch.from_numpy(np.array(answer)))
            alive.append(torch.from_numpy(running.copy()))
            seen, truth, over = pair.step(driven, running)
            start = over
            running &= ~over
    return Lessons(torch.stack(frames, 1), torch.stack(answers, 1), torch.stack(alive, 1))
