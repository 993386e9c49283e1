"""A trained policy as one network with its preprocessing: frames, own actions, normalisation."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from torch import nn

from rodgym.distil.policy import StudentPolicy
from rodgym.distil.student import Shape, Student
from rodgym.evaluation.adapters import Stacked
from rodgym.evaluation.policy import Policy, PolicyError


def network_of(policy: Policy) -> Student:
    """The network of a student, or of a policy of Stable-Baselines3, which becomes one.

    Raises:
        PolicyError: neither of them, or layers that are not one after the other.
    """
    if isinstance(policy, StudentPolicy):
        return policy.student
    depth, own_actions, model = 1, 0, policy
    if isinstance(policy, Stacked):
        depth, own_actions, model = policy.depth, policy.own_actions, policy.policy
    layers = actor_layers(model)
    linear = [layer for layer in layers if isinstance(layer, nn.Linear)]
    space: Any = model.action_space  # type: ignore[attr-defined]
    size = int(space.shape[0])
    observation = linear[0].in_features // depth - own_actions
    shape = Shape(observation, size, frames=depth, own_actions=bool(own_actions), hidden=(1,))
    student = Student(shape, space.low.tolist(), space.high.tolist())
    student.head = nn.Sequential(*layers)
    return student.eval()


def actor_layers(model: Any) -> list[nn.Module]:
    """The layers from what a model of Stable-Baselines3 sees to the mean of its actions."""
    inner: Any = getattr(model, "policy", None)
    actor: Any = getattr(inner, "actor", None)
    if hasattr(inner, "mlp_extractor"):
        layers = [*inner.mlp_extractor.policy_net, inner.action_net]
    elif hasattr(actor, "latent_pi"):
        mean = actor.mu if isinstance(actor.mu, nn.Sequential) else [actor.mu]
        layers = [*actor.latent_pi, *mean, nn.Tanh()]
    elif isinstance(getattr(actor, "mu", None), nn.Sequential):
        layers = [*actor.mu]
    else:
        raise PolicyError(
            f"{type(model).__name__} cannot be exported: it must be a student or a policy of "
            "Stable-Baselines3 whose layers follow one another"
        )
    return [layer for layer in layers if not isinstance(layer, nn.Flatten | nn.Identity)]


def check_same(network: Student, policy: Policy, space: gym.spaces.Box) -> None:
    """Plays both on random observations: what stands before a policy and is not exported shows.

    Raises:
        PolicyError: they answer differently.
    """
    rng = np.random.default_rng(0)
    mine, theirs = StudentPolicy(network), policy
    own: Any = None
    other: Any = None
    for _ in range(2 * network.shape.frames + 4):
        seen = rng.uniform(space.low, space.high, (8, *space.shape)).astype(np.float32)
        (action, own), (wanted, other) = (
            mine.predict(seen, own, np.zeros(8, bool)),
            theirs.predict(seen, other, np.zeros(8, bool), deterministic=True),
        )
        if not np.allclose(action, wanted, rtol=0, atol=1e-4):
            raise PolicyError(
                "this policy cannot be exported: its layers alone answer otherwise than it does "
                "(was it trained behind VecNormalize, or has it a memory of its own?)"
            )
