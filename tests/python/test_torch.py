"""Promise: gradients of PyTorch through steps are those of the core, and end with an episode."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from conftest import BALANCE, FINS, SWING_UP

torch = pytest.importorskip("torch")


def plan(steps, num_envs):
    angles = torch.arange(steps * num_envs, dtype=torch.float64)
    return (0.8 * torch.sin(angles)).reshape(steps, num_envs, 1)


UPRIGHT = {"state": {"angles": [2.0] * 6, "rates": [0.0] * 6}}


@pytest.mark.parametrize(("machine", "start"), [(SWING_UP, UPRIGHT), (FINS[0], None)])
def test_gradients_of_a_rollout_are_those_of_the_core(machine, start):
    from rodgym.torch import step

    envs = gym.make_vec(machine, num_envs=3)
    envs.reset(seed=1, options=start)
    # (Environments take actions in single precision.)
    actions = plan(6, 3).float().requires_grad_()
    exact = envs.unwrapped.rollout_gradient(actions.detach().numpy().swapaxes(0, 1))
    total, link = torch.zeros(()), None
    for row in actions:
        result = step(envs, row, link)
        link = result.link
        total = total + result.reward.sum()
    total.backward()
    np.testing.assert_allclose(total.item(), exact.rewards.sum(), rtol=1e-6)
    theirs = exact.actions.swapaxes(0, 1)
    np.testing.assert_allclose(actions.grad.numpy(), theirs, rtol=1e-4, atol=1e-6)


def test_observations_pass_gradients_too():
    from rodgym.torch import step

    envs = gym.make_vec(SWING_UP, num_envs=2)
    envs.reset(seed=1)
    actions = plan(1, 2)[0].requires_grad_()
    D = envs.unwrapped.step_jacobian(actions.detach().numpy()).D
    weights = torch.linspace(-1, 1, D.shape[1], dtype=torch.float64)
    (step(envs, actions).observation * weights).sum().backward()
    np.testing.assert_allclose(actions.grad.numpy()[:, 0], weights.numpy() @ D[:, :, 0].T)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_gradients_end_where_an_episode_does(mode):
    from rodgym.torch import step

    envs = gym.make_vec(BALANCE, num_envs=2, autoreset_mode=mode, max_episode_steps=3)
    envs.reset(seed=1)
    actions, link = plan(7, 2).requires_grad_(), None
    ends = []
    for row in actions:
        result = step(envs, row, link)
        link = result.link
        ends.append(bool(result.truncated.any()))
    assert ends.index(True) == 2
    result.observation.sum().backward()
    found = actions.grad.numpy()[:, 0, 0] != 0
    first = 4 if mode == "NextStep" else 6
    assert found[first:].all() and not found[:first].any()
