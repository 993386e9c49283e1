"""A trained policy as one network with its preprocessing: frames, own actions, normalisation."""

from __future__ import annotations

from typing import Any

import torch
from torch import nn

from rodgym.distil.policy import StudentPolicy
from rodgym.distil.student import Shape, Student
from rodgym.evaluation.policies import Policy, PolicyError, Stacked


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


def answers(student: Student, observation: Any, state: Any) -> tuple[Any, Any]:
    """What the network itself answers, to compare with."""
    with torch.inference_mode():
        action, after = student.step(torch.from_numpy(observation), torch.from_numpy(state))
    return action.numpy(), after.numpy()
