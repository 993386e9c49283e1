"""First-order learning: a policy that learns from the derivatives of the rod itself.

Short-horizon actor-critic (SHAC; Xu et al. 2022, arXiv 2204.07137) on `rodgym.torch.step`. The
actor plays a short window, what it earned there goes back through reward, rod and policy, and a
critic says what comes after the window's end: gradients through a whole swing-up would explode.
Compare with PPO, which sees rewards alone: `rodgym train`.

shac.py --steps 400000 --out shac.csv
"""

from __future__ import annotations

import argparse
import csv
import time
from copy import deepcopy
from pathlib import Path

import gymnasium as gym
import numpy as np
import rodgym  # noqa: F401  (registers the environments)
import torch
from rodgym.torch import step
from torch import nn

ENV = "rodgym/PendulumSwingUp-v0"
GAMMA = 0.99
#: Weight of longer returns in the critic's targets.
LAMBDA = 0.95
#: How much of the slow critic stays at each update; it says what comes after a window.
SLOW = 0.4


def network(inputs: int, outputs: int) -> nn.Sequential:
    """Two hidden layers, smooth ones: derivatives go through them."""
    layers: list[nn.Module] = []
    for _ in range(2):
        layers += [nn.Linear(inputs, 64), nn.ELU(), nn.LayerNorm(64)]
        inputs = 64
    return nn.Sequential(*layers, nn.Linear(inputs, outputs))


class Actor(nn.Module):
    """A normal distribution about the network's answer, squashed into [-1, 1]."""

    def __init__(self, observations: int, actions: int) -> None:
        super().__init__()
        self.mean = network(observations, actions)
        self.log_std = nn.Parameter(torch.full((actions,), -1.0))

    def forward(self, observation: torch.Tensor, noisy: bool = True) -> torch.Tensor:
        mean = self.mean(observation)
        if noisy:
            # The noise is drawn, and then a constant: gradients go to mean and spread.
            mean = mean + self.log_std.exp() * torch.randn_like(mean)
        return torch.tanh(mean)


class Window:
    """What happened in a window of steps, for the critic: rows of time, columns of environments."""

    def __init__(self) -> None:
        self.observations: list[torch.Tensor] = []
        self.rewards: list[torch.Tensor] = []
        #: What the slow critic says of the state after each step.
        self.after: list[torch.Tensor] = []
        #: Where an episode, or the window, is cut after the step.
        self.cut: list[torch.Tensor] = []
        #: Steps that only reset an environment: no action was taken.
        self.resets: list[torch.Tensor] = []

    def targets(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Observations and their returns, TD(lambda), without the steps that only reset."""
        returns, later = [], self.after[-1]
        for reward, after, cut in zip(
            reversed(self.rewards), reversed(self.after), reversed(self.cut), strict=True
        ):
            later = torch.where(cut, after, (1 - LAMBDA) * after + LAMBDA * later)
            later = reward + GAMMA * later
            returns.append(later)
        taken = ~torch.stack(self.resets)
        return torch.stack(self.observations)[taken], torch.stack(returns[::-1])[taken]


def play(envs, observation, reset, actor, slow, length: int):
    """Plays a window; returns the actor's loss, the window, and where it stopped."""
    window, link = Window(), None
    n = observation.shape[0]
    discount, loss = torch.ones(n), torch.zeros(())
    for t in range(length):
        window.observations.append(observation.detach())
        window.resets.append(reset)
        result = step(envs, actor(observation), link)
        observation, link = result.observation, result.link
        ended = torch.from_numpy(result.terminated | result.truncated)
        cut = ended if t < length - 1 else torch.ones(n, dtype=torch.bool)
        value = slow(observation).squeeze(1)
        loss = loss - (discount * result.reward).sum() / (n * length)
        # A time limit is no end in the critic's eyes (and a swing-up has no other).
        loss = loss - (GAMMA * discount * value * cut).sum() / (n * length)
        discount = torch.where(cut, torch.ones(n), GAMMA * discount)
        # (In this mode the step after an episode's end resets the environment, and earns nothing.)
        discount = torch.where(reset, torch.ones(n), discount)
        window.rewards.append(result.reward.detach())
        window.after.append(value.detach())
        window.cut.append(cut | reset)
        reset = ended
    return loss, window, observation.detach(), reset


def fit(critic, optimizer, window: Window, rounds: int = 16, parts: int = 4) -> None:
    """Teaches the critic the returns of a window."""
    observations, targets = window.targets()
    for _ in range(rounds):
        for part in torch.randperm(len(targets)).chunk(parts):
            error = critic(observations[part]).squeeze(1) - targets[part]
            optimizer.zero_grad()
            (error**2).mean().backward()
            nn.utils.clip_grad_norm_(critic.parameters(), 1.0)
            optimizer.step()


@torch.no_grad()
def score(actor: Actor, seeds: range) -> float:
    """Mean return of whole episodes without noise."""
    envs = gym.make_vec(ENV, num_envs=len(seeds))
    observation, _ = envs.reset(seed=list(seeds))
    total = np.zeros(len(seeds))
    for _ in range(500):
        action = actor(torch.from_numpy(observation), noisy=False)
        observation, reward, *_ = envs.step(action.numpy())
        total += reward
    envs.close()
    return float(total.mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=400_000, help="environment steps")
    parser.add_argument("--num-envs", type=int, default=32)
    parser.add_argument("--window", type=int, default=32, help="steps of a window")
    parser.add_argument("--rate", type=float, default=2e-3, help="learning rate at the start")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="the curve: steps, seconds, return")
    args = parser.parse_args()
    torch.manual_seed(args.seed)
    envs = gym.make_vec(ENV, num_envs=args.num_envs)
    size = envs.single_observation_space.shape[0]
    actor, critic = Actor(size, 1), network(size, 1)
    slow = deepcopy(critic).requires_grad_(False)
    actor_optimizer = torch.optim.Adam(actor.parameters(), args.rate, betas=(0.7, 0.95))
    critic_optimizer = torch.optim.Adam(critic.parameters(), args.rate, betas=(0.7, 0.95))
    # Training seeds are far from those that are scored.
    first, _ = envs.reset(seed=1_000_000 + 1000 * args.seed)
    observation, reset = torch.from_numpy(first), torch.zeros(args.num_envs, dtype=torch.bool)
    done, spent, curve, next_score = 0, 0.0, [], 0
    while done < args.steps:
        began = time.perf_counter()
        for optimizer in (actor_optimizer, critic_optimizer):
            optimizer.param_groups[0]["lr"] = args.rate * (1 - 0.9 * done / args.steps)
        loss, window, observation, reset = play(envs, observation, reset, actor, slow, args.window)
        actor_optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(actor.parameters(), 1.0)
        actor_optimizer.step()
        fit(critic, critic_optimizer, window)
        with torch.no_grad():
            for old, new in zip(slow.parameters(), critic.parameters(), strict=True):
                old.lerp_(new, 1 - SLOW)
        done += args.num_envs * args.window
        spent += time.perf_counter() - began
        if done >= next_score:
            curve.append((done, spent, score(actor, range(20))))
            print("{:9,} steps {:6.1f} s: return {:.1f}".format(*curve[-1]), flush=True)
            next_score += args.steps // 20
    print(f"{done:,} steps, {spent:.1f} s: return {score(actor, range(100)):.2f} on seeds 0 to 99")
    if args.out:
        with args.out.open("w", newline="") as file:
            csv.writer(file).writerows([("steps", "seconds", "return"), *curve])


if __name__ == "__main__":
    main()
