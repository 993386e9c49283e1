"""One episode looked at closely: edge angles, action, the numbers of each step, pictures."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from rodgym import _checks as checks
from rodgym import machines
from rodgym.evaluation.conditions import conditions, make_single, needs_end
from rodgym.evaluation.design import Design
from rodgym.evaluation.episodes import begin
from rodgym.evaluation.policies import ready
from rodgym.evaluation.policy import Policy, ask, check_policy, label_of
from rodgym.extras import installed


@dataclass(frozen=True)
class Record:
    """An episode of T steps of one policy.

    ``spec`` is what the core says of the environment; ``time`` (T,) [s] is that at the end of each
    step; ``angles`` (T, edges) [rad] are those of `edge_angles` from the machine's rest,
    whatever the policy sees; ``metrics`` are (T,) each; ``frames`` are pictures, ``frame_dt``
    apart, the first one of the start. ``parameters`` are the episode's; ``estimates`` are what a
    policy that learns them has found by then: (T, 3), best value and the ends of an interval.
    """

    policy: str
    seed: int
    spec: Mapping[str, Any]
    time: NDArray[np.float64]
    rewards: NDArray[np.float64]
    actions: NDArray[np.float32]
    angles: NDArray[np.float64]
    metrics: Mapping[str, NDArray[np.float64]]
    frames: list[NDArray[np.uint8]]
    frame_dt: float
    #: As that of an `Evaluation`.
    design: str = ""
    parameters: Mapping[str, float] = field(default_factory=dict)
    estimates: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    def _repr_html_(self) -> str:
        """The episode as an animation, where a notebook shows this; needs pictures and Pillow."""
        words = f"{self.policy}, seed {self.seed}: return {self.rewards.sum():.1f}"
        if not self.frames or not installed("PIL"):
            return f"<p>{words}</p>"
        from PIL import Image

        from rodgym.report.gif import write_gif

        film = io.BytesIO()
        write_gif(film, [Image.fromarray(frame) for frame in self.frames], self.frame_dt)
        data = base64.b64encode(film.getvalue()).decode()
        return f'<p>{words}</p><img alt="{words}" src="data:image/gif;base64,{data}">'


def record(
    policy: str | Policy,
    env_id: str,
    seed: int = 0,
    *,
    env_kwargs: Mapping[str, Any] | None = None,
    name: str | None = None,
    design: Design | None = None,
    normalize: Any = None,
    frame_rate: float = 0.0,
    max_seconds: float = float("inf"),
) -> Record:
    """Plays one episode in a single environment. The policy sees it as a batch of one: (1, d).

    Parameters
    ----------
    design, normalize: as for `rodgym.evaluation.evaluate`
    frame_rate: pictures per second of simulated time; 0 draws none
    max_seconds: stops there, if the episode is longer

    Raises
    ------
    PolicyError, ParameterError: as `rodgym.evaluation.evaluate`
    """
    check_policy(policy)
    seed = checks.whole("seed", seed, 0, checks.SEEDS - 1, "a whole number from 0 to 2^64 - 1")
    frame_rate = checks.number("frame_rate", frame_rate, "pictures a second")
    if frame_rate < 0:
        raise checks.refused("frame_rate", frame_rate, "0 or more pictures a second")
    if not isinstance(max_seconds, int | float | np.number) or not max_seconds > 0:
        raise checks.refused("max_seconds", max_seconds, "more than 0 s")
    env_id, keywords = conditions(env_id, env_kwargs)
    mode = keywords.setdefault("render_mode", "rgb_array" if frame_rate else None)
    if frame_rate and mode != "rgb_array":
        raise checks.refused("render_mode", mode, "left out, or 'rgb_array', to have pictures")
    env = make_single(env_id, keywords)
    try:
        if max_seconds == float("inf"):
            needs_end(env)
        player = ready(policy, env, env_id, design, normalize)
        label = label_of(policy, name)
        episode = _record(player.policy, env, seed, label, frame_rate, max_seconds)
        return replace(episode, design=player.design)
    finally:
        env.close()


def _record(
    actor: Policy,
    env: gym.Env[Any, Any],
    seed: int,
    name: str,
    frame_rate: float,
    max_seconds: float,
) -> Record:
    spec = machines.spec_of(env)
    dt = float(spec["control_dt"])
    every = max(1, round(1 / (frame_rate * dt))) if frame_rate else 0
    observation, info = env.reset(seed=seed)
    drawn = {name: np.array([value]) for name, value in info.get("parameters", {}).items()}
    begin(actor, env, observation[np.newaxis], drawn)
    frames = [np.asarray(env.render())] if every else []
    state: Any = None
    start = np.ones(1, bool)
    rewards: list[float] = []
    actions: list[NDArray[np.float32]] = []
    angles: list[NDArray[np.float64]] = []
    metrics: dict[str, list[float]] = {}
    estimate = getattr(actor, "estimate", None)
    estimates: dict[str, list[NDArray[np.float64]]] = {}
    over = False
    while not over and len(rewards) * dt < max_seconds:
        (action,), state = ask(actor, observation[np.newaxis], state, start)
        start = np.zeros(1, bool)
        for key, row in (estimate(state) if estimate else {}).items():
            estimates.setdefault(key, []).append(row[0])
        observation, reward, terminated, truncated, info = env.step(action)
        over = terminated or truncated
        rewards.append(float(reward))
        actions.append(np.array(action, np.float32))
        angles.append(edge_angles(env.get_wrapper_attr("positions")))
        for key, value in info.items():
            if isinstance(value, float):
                metrics.setdefault(key, []).append(value)
        if every and len(rewards) % every == 0:
            frames.append(np.asarray(env.render()))
    return Record(
        policy=name,
        seed=seed,
        spec=spec,
        time=dt * np.arange(1, len(rewards) + 1, dtype=np.float64),
        rewards=np.array(rewards),
        actions=np.array(actions),
        angles=np.array(angles) - machines.of(spec).rest_angle,
        metrics={key: np.array(values) for key, values in metrics.items()},
        frames=frames,
        frame_dt=every * dt,
        parameters={name: float(value[0]) for name, value in drawn.items()},
        estimates={key: np.array(rows) for key, rows in estimates.items()},
    )


def edge_angles(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angle of each edge [rad]: 0 is hanging down, counter-clockwise positive, in (-pi, pi].

    ``positions`` (N, 2) are the rod's nodes [m].
    """
    edges = np.diff(positions, axis=0)
    angles: NDArray[np.float64] = np.arctan2(edges[:, 0], -edges[:, 1])
    return angles
