"""The local environments with a server as their backend, under the names that users type."""

from __future__ import annotations

import os
import sys
from typing import Any

import gymnasium as gym
from gymnasium.wrappers import TimeLimit

from rodgym.envs.rod_env import RodEnv
from rodgym.remote.server import Server
from rodgym.vector import RodVectorEnv

Path = str | os.PathLike[str]


class RemoteVectorEnv(RodVectorEnv):
    """Many environments of one kind on a server.

    Everything is as in `rodgym.vector.RodVectorEnv`, to the bit.

    Arguments:
        server, keys, server_key, timeout, recover: see `Server`.
        env_id: id such as `"rodgym/PendulumSwingUp-v0"`.
        num_envs: number of environments.
        **kwargs: those of `RodVectorEnv` except `num_threads`, and keywords of the environment.
    """

    def __init__(
        self,
        server: str,
        env_id: str,
        num_envs: int = 1,
        *,
        keys: Path | None = None,
        server_key: Path | None = None,
        timeout: float = 60.0,
        recover: str = "raise",
        **kwargs: Any,
    ) -> None:
        backend = Server(server, keys, server_key, timeout, recover)
        super().__init__(env_id, num_envs, backend=backend, **kwargs)


class RemoteEnv(RodEnv):
    """One environment on a server; arguments as for `RemoteVectorEnv`."""

    def __init__(
        self,
        server: str,
        env_id: str,
        *,
        keys: Path | None = None,
        server_key: Path | None = None,
        timeout: float = 60.0,
        recover: str = "raise",
        **kwargs: Any,
    ) -> None:
        super().__init__(
            env_id, backend=Server(server, keys, server_key, timeout, recover), **kwargs
        )


def make(**kwargs: Any) -> gym.Env[Any, Any]:
    """What `gym.make("rodgym/Remote-v0", ...)` calls: the environment with its own time limit.

    The limit is known only now, when the server has told it, while Gymnasium looks for one in the
    registry. What the caller of `gym.make` asked for goes first, and Gymnasium keeps that to
    itself; therefore the look at its variables.
    """
    env = RemoteEnv(**kwargs)
    asked = sys._getframe(1).f_locals
    spec = asked.get("env_spec")
    # The spec of an environment that was made before says all, a missing limit included.
    made_before = spec is not None and "env_id" in spec.kwargs
    limit = env.core_spec["default_max_episode_steps"]
    if limit is None or made_before or asked.get("max_episode_steps") is not None:
        return env
    return TimeLimit(env, limit)
