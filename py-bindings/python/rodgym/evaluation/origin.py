"""What a trained policy was trained for, and how that differs from where it plays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rodgym import RodgymError, _native
from rodgym._registration import ENVIRONMENTS, REMOTE
from rodgym.evaluation.policy import PolicyError

#: Keywords that say where a server's environment is, not what.
PLACE = ("server", "env_id", "keys", "server_key", "timeout", "recover")
#: Keywords that follow from the others where they are not given.
DERIVED = ("stepper", "physics_dt")


@dataclass(frozen=True)
class Origin:
    """The environment of a training: its id and, where the core can say them, task and keywords."""

    env_id: str
    machine: str | None = None
    task: str | None = None
    config: Mapping[str, Any] | None = None

    @classmethod
    def of_spec(cls, spec: Mapping[str, Any], env_id: str | None = None) -> Origin:
        """From an environment's `core_spec`; `env_id` where it is registered by another name."""
        return cls(env_id or spec["id"], spec["machine"], spec["task"], spec["config"])

    @classmethod
    def of_card(cls, card: Mapping[str, Any]) -> Origin | None:
        """From what a saved policy says of its training; None where it says nothing."""
        if not isinstance(card.get("env"), str):
            return None
        keywords = dict(card.get("env_kwargs") or {})
        env_id = str(keywords.get("env_id", card["env"]) if card["env"] == REMOTE else card["env"])
        if env_id not in ENVIRONMENTS:
            # One of somebody's own: its card may say which task of ours it is.
            return cls(env_id, card.get("machine"), card.get("task"))
        entry = ENVIRONMENTS[env_id]
        given = {k: v for k, v in keywords.items() if k not in (*PLACE, "max_episode_steps")}
        try:
            config = _native.Batch(env_id, 1, given).spec["config"]
        except RodgymError:  # A keyword that this version does not have.
            config = None
        return cls(env_id, entry.machine, entry.task, config)

    def differences(self, spec: Mapping[str, Any], env_id: str) -> str:
        """What was otherwise in the training than it is where the policy plays; empty: nothing.

        Raises
        ------
        PolicyError: it was trained for another task or machine
        """
        if self.task is not None and (self.machine, self.task) != (spec["machine"], spec["task"]):
            raise PolicyError(
                f"it was trained for the task {self.task!r} of a {self.machine} ({self.env_id}), "
                f"but the task of {env_id} is {spec['task']!r} of a {spec['machine']}"
            )
        # Ids of Gymnasium may name the module to import: `module:id`.
        here = spec["id"] if env_id == REMOTE else env_id.rpartition(":")[2]
        there = self.env_id.rpartition(":")[2]
        config = spec["config"] if self.config is None else self.config
        changed = [key for key in config if config[key] != spec["config"].get(key)]
        # Scheme and step follow from the other keywords, unless they alone differ.
        changed = [key for key in changed if key not in DERIVED] or changed
        words = [f"{key}={shown(config[key])}" for key in changed]
        return ", ".join([*([] if here == there else [there]), *words])


def shown(value: Any) -> str:
    """A keyword's value, as short as it can be read."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {shown(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(shown(one) for one in value) + "]"
    return str(value)
