"""Writes a policy as an ONNX file, and beside it a JSON file that says what its numbers mean."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rodgym import machines
from rodgym._plain import plain
from rodgym.distil.student import Student
from rodgym.evaluation.conditions import conditions, make_single
from rodgym.evaluation.policies import find, load_policy, read_card
from rodgym.export.graph import model_of
from rodgym.export.network import check_same, network_of
from rodgym.runs import versions


def export(
    source: str,
    path: Path,
    env_id: str | None = None,
    env_kwargs: dict[str, Any] | None = None,
) -> Path:
    """Writes `path` (`.onnx`) and the sidecar of the same name (`.json`); returns the sidecar.

    Arguments:
        source: a trained policy, as `load_policy` takes it.
        env_id, env_kwargs: the environment, in place of the one that the policy was trained in.

    Raises:
        PolicyError: no such policy, or one that is no network.
    """
    card: dict[str, Any] = {}
    if env_id is None:
        card = read_card(find(source))
        env_id, env_kwargs = card["env"], {**card.get("env_kwargs", {}), **(env_kwargs or {})}
    env_id, keywords = conditions(env_id, env_kwargs)
    env = make_single(env_id, keywords)
    try:
        policy = load_policy(source, env)
        network = network_of(policy)
        check_same(network, policy, env.observation_space)
        spec = machines.spec_of(env)
        card = card or read_card(find(source, env))
    finally:
        env.close()
    model = model_of(network)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(model.SerializeToString())
    about = {**card, "env": env_id, "env_kwargs": plain(keywords), **described(network, spec)}
    about["versions"] = versions()
    sidecar = path.with_suffix(".json")
    sidecar.write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")
    return sidecar


def described(network: Student, spec: dict[str, Any]) -> dict[str, Any]:
    """What a program needs to know that runs the file."""
    shape = network.shape
    parameters = {one["name"]: one["unit"] for one in spec["parameters"]}
    return {
        "kind": "onnx",
        "period": {"value": spec["control_dt"], "unit": "s"},
        "inputs": {
            "observation": {
                "shape": ["n", shape.observation],
                "type": "float32",
                "order": spec["observation"]["names"],
                "unit": "1: each number is divided by what its name says",
                "low": plain(spec["observation"]["low"]),
                "high": plain(spec["observation"]["high"]),
                "lost_sample": "NaN",
            },
            "state": {
                "shape": ["n", shape.state],
                "type": "float32",
                "initial": 0.0,
                "next": "next_state",
                "order": memory_of(network),
            },
        },
        "outputs": {
            "action": {
                "shape": ["n", shape.action],
                "type": "float32",
                "order": spec["action"]["names"],
                "unit": "1: each number is divided by what its name says",
                "low": network.low.tolist(),
                "high": network.high.tolist(),
            },
            "next_state": {"shape": ["n", shape.state], "type": "float32"},
        },
        "parameters": {
            name: {"value": plain(spec["config"][name]), "unit": unit}
            for name, unit in parameters.items()
        },
    }


def memory_of(network: Student) -> str:
    """The state, in words."""
    shape = network.shape
    parts = []
    if network.cell is not None:
        parts.append(f"{shape.units} units of a GRU")
    elif shape.memory:
        frame = "an observation" + (" and the action before it" if shape.own_actions else "")
        parts.append(f"the last {shape.frames - 1} frames, oldest first, each {frame}")
    return ", then ".join([*parts, "the last action"])
