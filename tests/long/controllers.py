"""What the classical controllers are held to: `make controllers`.

Plays every claim on 100 seeds (`--seeds`), times `predict`, prints a table, and writes it to
docs/controllers.md (`--page`). Ends with an error if a claim does not hold.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from rodgym.evaluation import Evaluation, Policy, evaluate, load_policy
from rodgym.runs import provenance

DOCS = Path(__file__).parents[2] / "docs"
SWING_UP = "rodgym/PendulumSwingUp-v0"
BASE_ONLY = "rodgym/PendulumSwingUpBase-v0"
ANY_ANGLE = (-np.pi, np.pi)
NOISE = {"angle": 1e-3, "rate": 1e-2}
WIDTHS = (0.005, 0.006, 0.007, 0.0081, 0.009, 0.010, 0.012, 0.015)


class Blinded:
    """Takes a share of the samples away from a policy: it sees NaN there, never at the start."""

    def __init__(self, policy: Policy, share: float) -> None:
        self.policy, self.share = policy, share
        self.rng = np.random.default_rng(1)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, **kwargs: Any
    ) -> tuple[Any, Any]:
        lost = self.rng.random(len(observation)) < self.share
        seen = np.where(lost[:, None] & (state is not None), np.float32("nan"), observation)
        return self.policy.predict(seen, state, episode_start, **kwargs)


class Misled:
    """Turns the filter's first estimate of an LQG, the whole rod, by up to `angle` either way."""

    #: Where the estimate of the coordinates begins in the state: after steps, clock, two actions.
    FIRST = 4

    def __init__(self, policy: Policy, angle: float, edges: int = 6) -> None:
        self.policy, self.angle, self.edges = policy, angle, edges
        self.rng = np.random.default_rng(2)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, **kwargs: Any
    ) -> tuple[Any, Any]:
        first = state is None
        action, state = self.policy.predict(observation, state, episode_start, **kwargs)
        if first:
            # The first coordinate is that of the straight rod, angle times root of edges.
            error = self.rng.uniform(-self.angle, self.angle, len(observation))
            state[:, self.FIRST] += np.sqrt(self.edges) * error
        return action, state


@dataclass(frozen=True)
class Claim:
    """At least `least` of 100 episodes end upright."""

    what: str
    policy: str
    env_id: str
    least: int
    keywords: Mapping[str, Any] = field(default_factory=dict)
    spoilt: Any = None
    #: Another controller, which it must earn more than on the same seeds.
    above: str | None = None

    def check(self, seeds: int) -> Evaluation:
        """Plays the seeds from 0."""
        policy: Any = self.policy
        if self.spoilt is not None:
            env = gym.make_vec(self.env_id, num_envs=1, **self.keywords)
            policy = self.spoilt(load_policy(self.policy, env))
            env.close()
        return evaluate(policy, self.env_id, range(seeds), env_kwargs=self.keywords)


def state_feedback(width: float, least: int, anywhere: bool = False) -> Claim:
    keywords = {"width": width, **({"start_angle": ANY_ANGLE} if anywhere else {})}
    start = "any angle" if anywhere else "hanging"
    return Claim(f"`lqr`, {1e3 * width:g} mm, from {start}", "lqr", SWING_UP, least, keywords)


def output_feedback(
    width: float, least: int, what: str = "", spoilt: Any = None, **more: Any
) -> Claim:
    keywords = {"width": width, "sensor_noise": NOISE, **more}
    what = what or f"{more.get('nodes', 7)} nodes"
    what = f"`lqg`, {1e3 * width:g} mm, {what}"
    return Claim(what, "lqg", BASE_ONLY, least, keywords, spoilt)


def predictive(
    width: float, least: int, what: str, env_id: str = SWING_UP, above: str = "lqr", **more: Any
) -> Claim:
    keywords = {"width": width, **more}
    return Claim(f"`mpc`, {1e3 * width:g} mm, {what}", "mpc", env_id, least, keywords, above=above)


def late(modulus: float, delay: float) -> dict[str, float]:
    """Keywords of a rod whose motor is late."""
    return {"youngs_modulus": modulus, "actuator_delay": delay}


CLAIMS = (
    state_feedback(0.005, 95),
    *(state_feedback(width, 100) for width in (0.006, 0.007, 0.0081, 0.009)),
    *(state_feedback(width, 95) for width in (0.010, 0.012, 0.015)),
    *(
        state_feedback(width, 95, anywhere=True)
        for width in (0.005, 0.006, 0.007, 0.0081, 0.009, 0.010, 0.012, 0.015)
    ),
    # Below 6 mm the rod bends too far for a filter that sees its base alone: no promise, a number.
    output_feedback(0.005, 10),
    *(output_feedback(width, 98) for width in (0.006, 0.007, 0.0081, 0.009)),
    *(output_feedback(width, 95) for width in (0.010, 0.012)),
    *(output_feedback(w, 90, nodes=n) for n in (13, 31) for w in (0.006, 0.007, 0.0081, 0.009)),
    output_feedback(0.010, 90, nodes=31),
    *(
        output_feedback(width, 95, "from any angle", start_angle=ANY_ANGLE)
        for width in (0.007, 0.0081, 0.009)
    ),
    *(
        output_feedback(
            0.007, 98, f"{modulus / 1e6:g} MPa, {1e3 * delay:g} ms late", **late(modulus, delay)
        )
        for delay in (0.01, 0.02)
        for modulus in (7e6, 1e7, 1.3e7)
    ),
    output_feedback(0.007, 95, "7 MPa, 31 nodes", youngs_modulus=7e6, nodes=31),
    output_feedback(0.007, 95, "7 MPa, from any angle", youngs_modulus=7e6, start_angle=ANY_ANGLE),
    output_feedback(
        0.009, 95, "13 MPa, from any angle", youngs_modulus=1.3e7, start_angle=ANY_ANGLE
    ),
    *(
        output_feedback(
            width, 95, f"{share:.0%} of the samples lost", partial(Blinded, share=share)
        )
        for share in (0.25, 0.5)
        for width in (0.007, 0.009)
    ),
    *(
        output_feedback(
            width,
            95,
            f"first estimate up to {angle:g} rad off",
            partial(Misled, angle=angle),
        )
        for angle in (0.5, 1.5)
        for width in (0.007, 0.009)
    ),
    *(predictive(width, 100, "from hanging") for width in WIDTHS),
    *(predictive(width, 99, "from any angle", start_angle=ANY_ANGLE) for width in WIDTHS),
    *(
        predictive(0.007, 100, f"{limit:g} N m", torque_limit=limit)
        for limit in (0.04, 0.03, 0.025, 0.02)
    ),
    *(
        predictive(width, 98, "the filter of `lqg`", BASE_ONLY, "lqg", sensor_noise=NOISE)
        for width in (0.006, 0.007, 0.0081, 0.009, 0.010, 0.012)
    ),
)


def predict_times(repeats: int) -> list[tuple[str, float, float]]:
    """CPU time of `predict` [us]: for one environment, and each of many (1024; 16 plans)."""
    rows = []
    for name, env_id in [
        ("lqr", SWING_UP),
        ("lqr-hybrid", SWING_UP),
        ("lqg", BASE_ONLY),
        ("mpc", SWING_UP),
    ]:
        times = []
        for count in (1, 1024 if name != "mpc" else 16):
            env = gym.make_vec(env_id, num_envs=count, sensor_noise=NOISE)
            law = load_policy(name, env)
            observation, _ = env.reset(seed=0)
            running = np.zeros(count, bool)
            state: Any = None
            spent = 0.0
            calls = max(10, repeats // count // (10 if name == "mpc" else 1))
            for call in range(calls + 1):
                before = time.process_time()
                action, state = law.predict(observation, state, running)
                # The first call starts the episodes: no prediction yet.
                spent += (time.process_time() - before) * (call > 0)
                observation, *_ = env.step(action)
            times.append(1e6 * spent / calls / count)
            env.close()
        rows.append((name, times[0], times[1]))
    return rows


def verdict(claim: Claim, result: Evaluation) -> tuple[bool, str]:
    """Whether it holds, and its row of the table. Fewer seeds may miss one episode more."""
    seeds = len(result.seeds)
    upright = int(result.columns["upright"].sum())
    allowed = (100 - claim.least) * seeds / 100 + (0 if seeds >= 100 or claim.least == 100 else 1)
    holds = seeds - upright <= allowed
    wanted, earned = f"{claim.least} %", ""
    if claim.above:
        other = evaluate(claim.above, claim.env_id, result.seeds, env_kwargs=dict(claim.keywords))
        holds &= result.mean("return") > other.mean("return")
        wanted += f", above `{claim.above}`"
        earned = f" ({result.mean('return'):.2f} against {other.mean('return'):.2f})"
    seconds = result.mean("time_to_upright")
    effort, sway = 1e3 * result.mean("effort"), np.degrees(result.mean("sway"))
    mark = "" if holds else " **missed**"
    row = (
        f"| {claim.what} | {wanted} | {upright} of {seeds}{earned}{mark} | {seconds:.2f} s "
        f"| {effort:.1f} mN m | {sway:.2f} deg |"
    )
    return holds, row


def page(rows: Sequence[str], times: Sequence[tuple[str, float, float]], seeds: int) -> str:
    """The text of docs/controllers.md."""
    facts = provenance()
    versions = ", ".join(f"{name} {value}" for name, value in facts["versions"].items())
    timing = "\n".join(f"| `{n}` | {one:.0f} us | {many:.1f} us |" for n, one, many in times)
    claims = "\n".join(rows)
    return f"""# The classical controllers, measured

Written by `make controllers` on {facts["date"]} ({facts["machine"]}; {versions}).

Each row is a claim: how often a controller should bring the rod up (*wanted*), and how often it
did (*upright*). A row is {seeds} episodes of 5 s, with the seeds from 0 on. The motor gives at most
0.05 N m, unless the row names another limit, and gets a new torque every 10 ms. `lqg` sees the
angle and the rate of the base, with noise of 1 mrad and 10 mrad/s; the others see every edge. Where
a claim says that one controller earns more than another, the brackets hold both mean returns.
[Controllers](baselines.md) explains what they are.

| controller, rod, start | wanted | upright | time | torque (rms) | sway |
|---|---|---|---|---|---|
{claims}

*Upright*, *time*, *torque* and *sway* are what `rodgym evaluate` prints. It plays the same
episodes: `rodgym evaluate lqg --env rodgym/PendulumSwingUpBase-v0 --env-arg nodes=31 --env-arg
'sensor_noise={{"angle": 1e-3, "rate": 1e-2}}'`. Where samples are lost, each environment loses its
own, at random. A wrong first estimate turns the whole rod that the filter believes in; the
filter is as sure of it as of a right one.

The next table has the CPU time of one call of `predict` from Python:

| controller | one environment | 1024 (`mpc`: 16) in one call, each |
|---|---|---|
{timing}
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--page", type=Path, default=DOCS / "controllers.md")
    parser.add_argument("--only", metavar="NAME", help="claims of this controller; no page")
    arguments = parser.parse_args()
    rows, missed = [], 0
    claims = [claim for claim in CLAIMS if arguments.only in (None, claim.policy)]
    for claim in claims:
        holds, row = verdict(claim, claim.check(arguments.seeds))
        rows.append(row)
        missed += not holds
        print(row, flush=True)
    if arguments.only:
        print(f"{missed} of {len(claims)} claims missed")
        return 1 if missed else 0
    times = predict_times(repeats=20 * arguments.seeds)
    for name, one, many in times:
        print(f"{name}: {one:.0f} us a call, {many:.1f} us each of many", flush=True)
    arguments.page.write_text(page(rows, times, arguments.seeds), encoding="utf-8")
    print(f"{missed} of {len(CLAIMS)} claims missed; wrote {arguments.page}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
