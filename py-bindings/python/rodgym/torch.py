"""Steps of a batch that PyTorch differentiates: see docs/derivatives.md. Needs torch."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from gymnasium.vector import AutoresetMode

from rodgym.vector import RodVectorEnv


class Link(NamedTuple):
    """What one step hands to the next, so that gradients go through both.

    Gradients are by the plants' state vectors; the numbers of `state` themselves are zero.
    """

    #: (num_envs, s)
    state: torch.Tensor
    #: (num_envs,): the next step of these environments begins an episode.
    ended: npt.NDArray[np.bool_]


class Step(NamedTuple):
    """What a step returns: the tensors have the type of the actions."""

    #: (num_envs, o)
    observation: torch.Tensor
    #: (num_envs,)
    reward: torch.Tensor
    terminated: npt.NDArray[np.bool_]
    truncated: npt.NDArray[np.bool_]
    infos: dict[str, Any]
    #: For the next step.
    link: Link


def step(envs: RodVectorEnv, actions: torch.Tensor, link: Link | None = None) -> Step:
    """One control step of a batch, through which gradients go back to the actions and, by `link`,
    to the steps before.

    Exact derivatives of the step, computed on the CPU beside it. They end where an episode does:
    what comes after an autoreset depends on nothing before it.

    Arguments:
        envs: a batch that `gym.make_vec` made.
        actions: (num_envs, a), on the CPU.
        link: of the step before; None where gradients shall begin.

    Raises:
        ShapeError, ActionError: no actions; nothing changes then.
    """
    inner: RodVectorEnv = envs.unwrapped  # type: ignore[assignment]
    given = actions.detach().numpy()
    jacobian = inner.step_jacobian(given)
    observation, reward, terminated, truncated, infos = envs.step(given)
    ended = terminated | truncated
    mode = inner.autoreset_mode
    begins = np.zeros_like(ended) if link is None else link.ended
    n, s = jacobian.reward_state.shape
    # Of these nothing depends on what came before, and of those only the reward does.
    cut = begins if mode == AutoresetMode.NEXT_STEP else np.zeros_like(ended)
    renewed = cut | (ended if mode == AutoresetMode.SAME_STEP else False)
    matrices = [
        _kept(jacobian.A, renewed), _kept(jacobian.B, renewed),
        _kept(jacobian.C, renewed), _kept(jacobian.D, renewed),
        _kept(jacobian.reward_state, cut), _kept(jacobian.reward_action, cut),
    ]  # fmt: skip
    before = torch.zeros(n, s, dtype=torch.float64) if link is None else link.state
    seen = torch.from_numpy(observation).to(actions.dtype)
    paid = torch.from_numpy(reward).to(actions.dtype)
    state, seen, paid = _Step.apply(before, actions, seen, paid, *matrices)  # type: ignore[no-untyped-call]
    next_ended = ended if mode == AutoresetMode.NEXT_STEP else np.zeros_like(ended)
    return Step(seen, paid, terminated, truncated, infos, Link(state, next_ended))


def _kept(array: npt.NDArray[np.float64], cut: npt.NDArray[np.bool_]) -> torch.Tensor:
    """Derivatives, zero in the rows that are cut."""
    array[cut] = 0.0
    return torch.from_numpy(array)


class _Step(torch.autograd.Function):
    """A step of which all is known: its results and its derivatives."""

    @staticmethod
    def forward(ctx: Any, state: Any, actions: Any, seen: Any, paid: Any, *matrices: Any) -> Any:
        ctx.save_for_backward(*matrices)
        ctx.types = actions.dtype
        return torch.zeros_like(state), seen.clone(), paid.clone()

    @staticmethod
    def backward(ctx: Any, by_state: Any, by_seen: Any, by_paid: Any) -> Any:  # type: ignore[override]
        A, B, C, D, reward_state, reward_action = ctx.saved_tensors
        by_state, by_seen = by_state.double().unsqueeze(1), by_seen.double().unsqueeze(1)
        by_paid = by_paid.double().unsqueeze(1)
        state = (by_state @ A + by_seen @ C).squeeze(1) + by_paid * reward_state
        actions = (by_state @ B + by_seen @ D).squeeze(1) + by_paid * reward_action
        return (state, actions.to(ctx.types), None, None, *[None] * 6)
