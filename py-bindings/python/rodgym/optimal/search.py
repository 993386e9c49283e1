"""The search for the actions of an episode; its inner loop is Rust (crate rodgym-baselines)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, cast

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from rodgym import _native
from rodgym._checks import number, numbers, refused, seed, whole
from rodgym._plant import Plant
from rodgym.errors import ParameterError, ShapeError

Array = npt.NDArray[np.float64]

#: Control steps that a start pushes one way, and by which the horizon grows.
PUSH = 15
MORE = 20
#: Seconds between two looks at the clock, and at Ctrl-C.
LOOK = 0.1


@dataclass(frozen=True)
class Quadratic:
    """A cost that is summed over the control steps, instead of the task's reward.

    After each step, with x the positions [m] and velocities [m/s] of the nodes that move, as
    `get_vector()` begins, and a the action: (x - target)' state (x - target) / 2 + action a^2 / 2.
    """

    #: (x,), where x should be.
    target: npt.ArrayLike
    #: (x,) or (x, x), its weights, symmetric.
    state: npt.ArrayLike
    #: Weight of the action, above 0.
    action: float = 0.04
    #: Weights that come to `state` after the last step, of either shape; none: 0.
    last: npt.ArrayLike | None = None

    def native(self) -> tuple[Array, Array, float, Array]:
        """As the search has it."""
        target = numbers("target", self.target)
        last = np.zeros(target.size) if self.last is None else numbers("last", self.last)
        if target.ndim != 1:
            raise ShapeError(f"target has shape {target.shape}, but one dimension is needed")
        state = numbers("state", self.state)
        x = target.size
        for name, weights in (("state", state), ("last", last)):
            if weights.shape not in ((x,), (x, x)):
                raise ShapeError(
                    f"{name} has shape {weights.shape}, but ({x},) or ({x}, {x}) is needed"
                )
        return target, state.ravel(), number("action", self.action, "no unit"), last.ravel()


@dataclass(frozen=True)
class Attempt:
    """What came of one start."""

    #: The sum of rewards, from where the environment is.
    total: float
    #: The cost that was made small: the sum of rewards with the opposite sign, or that of the
    #: `Quadratic`; of the steps so far, where the search did not come to its end.
    loss: float
    #: Control steps that were looked at: all of them, unless the time was over.
    horizon: int
    iterations: int
    seconds: float
    #: Whether the search ended by itself.
    done: bool
    #: (horizon, 1), float32.
    actions: npt.NDArray[np.float32]
    #: (horizon,).
    rewards: Array


@dataclass(frozen=True)
class Optimized:
    """The best of all attempts. It is a local optimum: the best that was found, and no bound."""

    best: Attempt
    #: All of them, in the order of the starts.
    attempts: tuple[Attempt, ...]

    @property
    def actions(self) -> npt.NDArray[np.float32]:
        """The actions (t, 1), float32: what the environment takes, row by row."""
        return self.best.actions

    @property
    def rewards(self) -> Array:
        """The rewards (t,) that the environment then pays, to the last bit."""
        return self.best.rewards

    @property
    def total(self) -> float:
        """Their sum."""
        return self.best.total


Progress = Callable[[int, dict[str, Any]], None]


def optimize(
    env: gym.Env[Any, Any],
    steps: int | None = None,
    *,
    cost: Quadratic | None = None,
    starts: int | Sequence[npt.ArrayLike] = 2,
    time_limit: float = 60.0,
    seed: int = 0,
    levels: int = 0,
    progress: Progress | None = None,
) -> Optimized:
    """Searches for the actions that earn the most from where an environment is; it stays there.

    Iterated linear-quadratic regulators on exact derivatives, actions kept within their bounds,
    over a horizon that grows in stages. docs/best-known.md says how well it does. Noise of sensors
    plays no part; a torque that disturbs the motor is what the next steps would draw.

    Arguments:
        env: an environment with derivatives, which was reset.
        steps: control steps; None: to the time limit of an episode.
        cost: what to make small; None: the task's own reward with the opposite sign.
        starts: how many starts: the first two push one way and the other, the rest with a drawn
            share of the motor; or the first actions of each, (t,) or (t, 1).
        time_limit: seconds for all starts together, each of which gets its share of what is left;
            the first iteration is made in any case.
        seed: of the starts that are drawn.
        levels: where not 0, actions are whole multiples of 1 / levels, so that few bits keep them.
        progress: called with the number of the start and where it stands, a dictionary of
            `horizon`, `iterations`, `loss`, `done` and `seconds`, some ten times a second.

    Raises:
        ParameterError: a machine without derivatives, a reward that is no sum of squares (give a
            cost), arguments that are not allowed.
        SolverError: the solver gives up on the way.
    """
    inner = env.unwrapped
    if not isinstance(inner, Plant):
        raise refused("env", env, "an environment of rodgym")
    if steps is None:
        limit = inner.core_spec["default_max_episode_steps"]
        steps = env.spec.max_episode_steps if env.spec and env.spec.max_episode_steps else limit
    steps = whole("steps", steps, 1, 10**6, "a whole number from 1 to 1000000")
    levels = whole("levels", levels, 0, 2**24, "a whole number from 0 to 16777216")
    seconds = number("time_limit", time_limit, "seconds")
    if seconds < 0:
        raise refused("time_limit", time_limit, "at least 0 s")
    quadratic = None
    if cost is not None:
        if not isinstance(cost, Quadratic):
            raise refused("cost", cost, "a Quadratic, or None")
        quadratic = cost.native()
    given = _starts(starts, steps, seed)
    batch, index = _local(inner)
    end = time.monotonic() + seconds
    attempts = []
    for k, actions in enumerate(given):
        search = _native.Search(
            batch, index, steps, actions,
            first=PUSH, more=MORE, levels=levels, quadratic=quadratic,
        )  # fmt: skip
        began = time.monotonic()
        own = began + (end - began) / (len(given) - k)
        while True:
            status = search.iterate(max(0.0, min(LOOK, own - time.monotonic())))
            spent = time.monotonic() - began
            if progress is not None:
                progress(k, {**status, "seconds": spent})
            if status["done"] or began + spent >= own:
                break
        attempts.append(
            Attempt(
                float(search.rewards.sum()), status["loss"], status["horizon"],
                status["iterations"], spent, status["done"],
                search.actions.astype(np.float32)[:, None], search.rewards,
            )
        )  # fmt: skip
    # (A horizon that is not the whole one has a loss that compares with nothing.)
    best = min(attempts, key=lambda attempt: (-attempt.horizon, attempt.loss))
    return Optimized(best, tuple(attempts))


def _local(env: Plant) -> tuple[_native.Batch, int]:
    """Where the environment is, in this process."""
    batch = env._batch
    if isinstance(batch, _native.Batch):
        return batch, env._index
    twin: _native.Batch = cast(Any, batch).twin(env._index)
    return twin, 0


def _starts(starts: int | Sequence[npt.ArrayLike], steps: int, of: int) -> list[Array]:
    """The first actions of every attempt."""
    if isinstance(starts, str | bytes) or not np.iterable(starts):
        count = whole("starts", starts, 1, 10_000, "a whole number from 1 to 10000, or actions")
        draw = np.random.default_rng(seed(of))
        shares = [1.0, -1.0, *draw.uniform(-1.0, 1.0, max(0, count - 2))]
        return [np.full(min(PUSH, steps), share) for share in shares[:count]]
    given = []
    for one in starts:  # type: ignore[union-attr]
        actions = numbers("starts", one)
        if actions.ndim == 2 and actions.shape[1] == 1:
            actions = actions[:, 0]
        if actions.ndim != 1 or not 1 <= actions.size <= steps:
            raise ShapeError(
                f"starts has an array of shape {actions.shape}, but (t,) or (t, 1) is needed, "
                f"t from 1 to {steps}"
            )
        if not (np.abs(actions) <= 1.0).all():
            raise ParameterError("starts has actions that are not allowed: they must be in [-1, 1]")
        given.append(actions)
    if not given:
        raise refused("starts", starts, "at least one start")
    return given
