"""Who plays: what a report says of each policy beside its scores."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rodgym import machines
from rodgym.baselines import Controller
from rodgym.evaluation.design import EachEpisode
from rodgym.evaluation.origin import shown
from rodgym.evaluation.policies import find, ready
from rodgym.evaluation.policy import PolicyError
from rodgym.evaluation.saved import read_card

#: Arguments of an algorithm that are no hyperparameters.
NO_HYPERPARAMETERS = (
    "policy", "env", "seed", "device", "verbose", "tensorboard_log", "_init_setup_model",
)  # fmt: skip
#: Units of what designs settle on (`rodgym.baselines.Controller.parameters`).
UNITS = {
    "angle_weight": "1/rad^2",
    "rate_weight": "s^2/rad^2",
    "torque_weight": "1/(N m)^2",
    "most_torque": "N m",
    "switch_angle": "rad",
    "swing_amplitude": "N m",
    "swing_frequency": "rad/s",
    "angle_noise": "rad",
    "rate_noise": "rad/s",
    "frequency": "Hz",
}
#: Keywords of an environment that bound its actuator.
LIMITS = ("torque_limit", "pitch_limit", "command_cutoff", "actuator_delay", "control_dt")


@dataclass(frozen=True)
class Player:
    """A policy in words: what it is, and its numbers by name."""

    name: str
    text: str
    facts: Mapping[str, str]
    #: Every hyperparameter of a training: its value, and whether that is the library's default.
    hyperparameters: Mapping[str, tuple[str, bool]]


def describe(entrant: Any, env: Any, env_id: str) -> Player:
    """What there is to say of an entrant of a comparison."""
    spec = machines.spec_of(env)
    units = {about["name"]: about["unit"] for about in (*spec["keywords"], *spec["parameters"])}
    limits = {name: spec["config"][name] for name in LIMITS if spec["config"].get(name)}
    policy = ready(entrant.policy, env, env_id, entrant.design, entrant.normalize).policy
    if isinstance(policy, Controller):
        facts = {
            "designed for": words(policy.design, units),
            "limits": words(limits, units),
            **{
                name.replace("_", " "): f"{value:.4g} {UNITS.get(name, '')}".strip()
                for name, value in policy.parameters.items()
            },
        }
        return Player(entrant.name, first_paragraph(type(policy)), facts, {})
    if isinstance(policy, EachEpisode):
        facts = {
            "designed for": f"the {' and '.join(policy.drawn)} of every episode",
            "limits": words(limits, units),
        }
        return Player(entrant.name, first_paragraph(policy.law), facts, {})
    model: Any = policy
    behind = []
    while hasattr(model, "policy") and not hasattr(model, "get_env"):
        behind.append(type(model).__name__.lower())
        model = model.policy
    cards = [card_of(source, env) for source in (entrant.policy, *entrant.others)]
    return trained(entrant, model, behind, cards)


def trained(entrant: Any, model: Any, behind: list[str], cards: list[dict[str, Any]]) -> Player:
    """A trained policy, or one of somebody's own: where it comes from, and how it was trained.

    Several trainings of one recipe have a card each.
    """
    card = cards[0]
    facts = {}
    if "env" in card:
        keywords = card.get("env_kwargs") or {}
        facts["trained in"] = " ".join([card["env"], *([words(keywords)] if keywords else [])])
    for key, what in (("steps", "steps"), ("best_steps", "kept at step"), ("seed", "seed")):
        values = [one[key] for one in cards if key in one]
        if values:
            texts = [str(v) if key == "seed" else f"{v:,}" for v in values]
            facts[what] = "; ".join(dict.fromkeys(texts) if key == "steps" else texts)
    if behind:
        facts["sees"] = f"observations {' and '.join(behind)}"
    if card.get("versions"):
        facts["trained with"] = ", ".join(f"{k} {v}" for k, v in card["versions"].items())
    if not hasattr(model, "get_env"):
        return Player(entrant.name, first_paragraph(type(model)), facts, {})
    chosen = hyperparameters(model, card.get("recipe") or {})
    return Player(entrant.name, first_paragraph(type(model)), facts, chosen)


def card_of(source: Any, env: Any) -> dict[str, Any]:
    """The card of a saved policy; empty for a model in memory and for a class of somebody's own."""
    try:
        return read_card(find(source, env)) if isinstance(source, str) else {}
    except PolicyError:
        return {}


def hyperparameters(model: Any, recipe: Mapping[str, Any]) -> dict[str, tuple[str, bool]]:
    """Every hyperparameter, those that nobody chose included.

    What a recipe says comes first (a schedule is a function in the model), then what the model
    holds.
    """
    signature = inspect.signature(type(model).__init__).parameters
    result = {}
    for name, parameter in signature.items():
        if name in ("self", *NO_HYPERPARAMETERS) or parameter.kind is parameter.VAR_KEYWORD:
            continue
        default = parameter.default
        held = getattr(model, name, default)
        # (Stable-Baselines3 makes an empty dictionary of None.)
        chosen = recipe.get(name, default if callable(held) or held == {} else held)
        result[name] = shown(chosen), name not in recipe and chosen == default
    for name in ("n_envs", "frame_stack", "own_actions", "normalize"):
        if name in recipe:
            result[name] = shown(recipe[name]), False
    return result


def words(values: Mapping[str, Any], units: Mapping[str, str] | None = None) -> str:
    """Keywords in a line, with their units."""
    units = units or {}
    return ", ".join(
        f"{name} = {shown(value)} {units.get(name, '')}".strip() for name, value in values.items()
    )


def first_paragraph(kind: type) -> str:
    """The first paragraph of a class's documentation, in one line."""
    return " ".join((inspect.getdoc(kind) or kind.__name__).split("\n\n")[0].split())
