"""What a saved policy's file says, read without the library that wrote it."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

from rodgym.evaluation.policy import PolicyError

#: Member of a saved policy's zip file that says how it was trained.
CARD = "rodgym.json"
#: Statistics of a `VecNormalize`, beside a policy or as a member of its file.
STATISTICS = "vecnormalize.pkl"
#: What only the files of one algorithm hold, where the policy's module does not tell.
MARKS = {"clip_range": "PPO", "use_rms_prop": "A2C", "gae_lambda": "A2C", "cg_max_steps": "TRPO"}
#: Packages that have algorithms.
LIBRARIES = ("stable_baselines3", "sb3_contrib")


def read_card(path: Path) -> dict[str, Any]:
    """What a saved policy says of its training: ``env``, ``env_kwargs``, ``algorithm``, ...

    Of a file that Stable-Baselines3 wrote alone, nothing but the algorithm. The card of an ONNX
    file lies beside it: ``policy.json`` of ``policy.onnx``.
    """
    try:
        if path.suffix == ".onnx":
            return dict(json.loads(path.with_suffix(".json").read_text(encoding="utf-8")))
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            if CARD in names:
                card = json.loads(archive.read(CARD))
            else:
                card = {"algorithm": _algorithm(json.loads(archive.read("data")))}
    except (zipfile.BadZipFile, KeyError, ValueError, TypeError, FileNotFoundError) as error:
        raise PolicyError(
            f"{path} is not a policy saved by rodgym or Stable-Baselines3 ({error})"
        ) from error
    if not isinstance(card, dict):
        raise PolicyError(f"{path}: its {CARD} is no JSON object")
    return card


def _algorithm(data: dict[str, Any]) -> str:
    """The algorithm of a file, by the module of its policy and by what its data holds."""
    module = str(data.get("policy_class", {}).get("__module__", ""))
    family = module.split(".")[1] if module.split(".")[0] in LIBRARIES else "common"
    if family == "td3":  # DDPG is a TD3 without delay and noise.
        return "TD3" if data.get("policy_delay", 2) > 1 else "DDPG"
    if family == "common":
        if "lstm" in str(data.get("policy_class", {})).lower():
            return "RecurrentPPO"
        return next((name for mark, name in MARKS.items() if mark in data), "unknown")
    named = {"ppo_recurrent": "RecurrentPPO", "ppo_mask": "MaskablePPO", "crossq": "CrossQ"}
    return named.get(family, family.upper())


def statistics_file(path: Path) -> Path | None:
    """The statistics that lie beside a saved policy: in its folder, or where rl_zoo3 keeps them."""
    places = [path.parent / STATISTICS, path.with_suffix("") / STATISTICS]
    if path.stem == "best_model":
        places += sorted(path.parent.glob(f"*/{STATISTICS}"))
    return next((place for place in places if place.is_file()), None)
