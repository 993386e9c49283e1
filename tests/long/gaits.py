"""Gaits for fins whose stiffness nobody measured: `make gaits` writes docs/gaits.md.

The best fixed gaits, `gait-adaptive` and the policy that PPO learned play the same episodes. What
is written is how much more they return, and how near the adaptive gait's estimate of the stiffness
is.

The gait was tuned on seeds 5000 to 5299; those reported here were looked at once.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from rodgym import baselines
from rodgym.evaluation import evaluate
from rodgym.machines import spec_of
from rodgym.runs import provenance

DOCS = Path(__file__).parents[2] / "docs"
THRUST = "rodgym/FinThrust-v0"
FIRST_SEED = 4000
STIFFNESS = ("log_uniform", 3e4, 3e6)
DRAWN = {"randomize": {"youngs_modulus": STIFFNESS}}
#: Where a gait plays: what the page says, id, keywords, and who plays beside `gait-sine` and
#: `gait-adaptive`.
CASES: tuple[tuple[str, str, Mapping[str, Any], tuple[str, ...]], ...] = (
    ("`FinThrust`", THRUST, {}, ("gait", "zoo")),
    (
        "`FinThrust`, noise of 10 mrad and 0.1 rad/s",
        THRUST,
        {"sensor_noise": {"angle": 1e-2, "rate": 1e-1}},
        (),
    ),
    (
        "`FinThrust`, flow 0.02 to 0.08 m/s and density +-10 % drawn too",
        THRUST,
        {
            "randomize": {
                "youngs_modulus": STIFFNESS,
                "flow_speed": (0.02, 0.08),
                "density": (990.0, 1210.0),
            }
        },
        (),
    ),
    ("`FinEfficiency`, stiffness drawn likewise", "rodgym/FinEfficiency-v0", DRAWN, ()),
    ("`FinSwim`, stiffness drawn likewise", "rodgym/FinSwim-v0", DRAWN, ()),
)
#: Steps after which the estimate is read.
STEPS = (10, 15, 20, 40, 100, 200)
QUARTERS = 4
#: What is measured stands for the words in capitals.
PAGE = """<!-- Written by tests/long/gaits.py. -->

# Gaits for fins that nobody measured

`gait-adaptive` feels how stiff a fin is while it beats, and takes the gait that suits it
([baselines.md](baselines.md#gaits-of-the-fin)).
Each of the seeds SEEDS is another fin, of 3e4 to 3e6 Pa. These seeds were not used for any choice;
the gait was tuned on others (5000 to 5299).
`gait-sine` is the best fixed sinusoid for the drawn fins, `gait` the best of three waveforms, `zoo`
the policy that PPO learned.
In brackets: 95 % intervals of the bootstrap over episodes.
Measured on WHEN.

TABLE

In `FinThrust` the adaptive gait returns TIMES times as much as the best fixed sinusoid (95 %
interval of the ratio of the mean returns).

## By stiffness

`FinThrust`, mean returns:

QUARTERS

## The estimate

`FinThrust`: how far the estimate of Young's modulus is off, and how often its interval, which is to
hold nine of ten, holds the truth. A step is 40 ms; the command's low-pass lets the fin move from
the eighth step on.

ESTIMATES
"""


def returns(policy: str, env_id: str, keywords: Mapping[str, Any], seeds: range) -> NDArray[Any]:
    """Return of each episode."""
    result = evaluate(policy, env_id, seeds, env_kwargs=keywords)
    return np.asarray(result.columns["return"], float)


def ratio(ours: NDArray[Any], theirs: NDArray[Any], resamples: int = 10_000) -> NDArray[Any]:
    """Ratio of the mean returns over the same episodes, and its 95 % interval (bootstrap)."""
    drawn = np.random.default_rng(0).integers(len(ours), size=(resamples, len(ours)))
    ratios = ours[drawn].mean(1) / theirs[drawn].mean(1)
    return np.array([ours.mean() / theirs.mean(), *np.quantile(ratios, (0.025, 0.975))])


def more(ours: NDArray[Any], theirs: NDArray[Any], resamples: int = 10_000) -> NDArray[Any]:
    """Difference of the mean returns over the same episodes, and its 95 % interval (bootstrap)."""
    off = ours - theirs
    drawn = np.random.default_rng(0).integers(len(off), size=(resamples, len(off)))
    return np.array([off.mean(), *np.quantile(off[drawn].mean(1), (0.025, 0.975))])


def spec_for(env_id: str) -> Any:
    env = gym.make_vec(env_id, num_envs=1)
    try:
        return spec_of(env)
    finally:
        env.close()


def table(seeds: range) -> tuple[list[str], dict[str, NDArray[Any]]]:
    """The table of returns, and the returns of the first case by policy."""
    lines = ["| environment | policy | return | more than `gait-sine` | times `gait-sine` |"]
    lines.append("|---" * 5 + "|")
    first: dict[str, NDArray[Any]] = {}
    for what, env_id, keywords, others in CASES:
        sine = returns("gait-sine", env_id, keywords, seeds)
        for policy in ("gait-sine", *others, "gait-adaptive"):
            got = sine if policy == "gait-sine" else returns(policy, env_id, keywords, seeds)
            beside = " | "
            if policy != "gait-sine":
                off, least, most = more(got, sine)
                beside = f"{off:+.1f} ({least:+.1f} to {most:+.1f}) | "
                value, low, high = ratio(got, sine)
                # (Where the sinusoid may as well return nothing, no number of times says much.)
                if sine.mean() > 3 * sine.std() / np.sqrt(len(sine)):
                    beside += f"{value:.2f} ({low:.2f} to {high:.2f})"
            lines.append(f"| {what} | `{policy}` | {got.mean():.1f} | {beside} |")
            if env_id == THRUST and not keywords:
                first[policy] = got
            print(lines[-1], flush=True)
    return lines, first


def estimates(seeds: range, law: baselines.AdaptiveGait) -> tuple[list[str], NDArray[Any]]:
    """The table of estimates in `FinThrust`, and the stiffness of every episode."""
    env = gym.make_vec(THRUST, num_envs=len(seeds))
    observation, info = env.reset(seed=list(seeds))
    truth = np.asarray(info["parameters"]["youngs_modulus"], float)
    state: Any = None
    lines = ["| after | off by, median | off by, nine of ten | within the interval | high / low |"]
    lines.append("|---" * 5 + "|")
    for step in range(1, max(STEPS) + 1):
        action, state = law.predict(observation, state)
        if step in STEPS:
            value, low, high = law.estimate(state)["youngs_modulus"].T
            off = np.abs(value / truth - 1)
            held = int(((low <= truth) & (truth <= high)).sum())
            lines.append(
                f"| {step} steps | {np.median(off):.1%} | {np.quantile(off, 0.9):.1%} | "
                f"{held} of {len(seeds)} | {np.median(high / low):.2f} |"
            )
        observation, *_ = env.step(action)
    env.close()
    return lines, truth


def quarters(played: Mapping[str, NDArray[Any]], truth: NDArray[Any]) -> list[str]:
    """Mean returns by quarter of the stiffnesses, softest first."""
    edges = np.geomspace(STIFFNESS[1], STIFFNESS[2], QUARTERS + 1)
    heads = [f"{low:.2g} to {high:.2g} Pa" for low, high in pairwise(edges)]
    lines = ["| policy | " + " | ".join(heads) + " |", "|---" * (QUARTERS + 1) + "|"]
    for policy, got in played.items():
        cells = [
            f"{got[(low <= truth) & (truth <= high)].mean():.1f}" for low, high in pairwise(edges)
        ]
        lines.append(f"| `{policy}` | " + " | ".join(cells) + " |")
    return lines


def page(seeds: range) -> str:
    facts = provenance()
    versions = ", ".join(f"{name} {value}" for name, value in facts["versions"].items())
    lines, played = table(seeds)
    found, truth = estimates(seeds, baselines.AdaptiveGait(spec_for(THRUST)))
    _, low, high = ratio(played["gait-adaptive"], played["gait-sine"])
    parts = {
        "TABLE": "\n".join(lines),
        "QUARTERS": "\n".join(quarters(played, truth)),
        "ESTIMATES": "\n".join(found),
        "SEEDS": f"{seeds[0]} to {seeds[-1]}",
        "WHEN": f"{facts['date']} ({facts['machine']}; {versions})",
        "TIMES": f"{low:.2f} to {high:.2f}",
    }
    text = PAGE
    for name, part in parts.items():
        text = text.replace(name, part)
    return text


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=FIRST_SEED)
    parser.add_argument("--page", type=Path, default=DOCS / "gaits.md")
    given = parser.parse_args(arguments)
    given.page.write_text(page(range(given.first, given.first + given.seeds)), encoding="utf-8")
    print(f"wrote {given.page}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
