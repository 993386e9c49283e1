"""The Stable-Baselines3 face of environments on a server; `rodgym.sb3.make_vec_env(server=...)`."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from rodgym._batch import SeededBatch
from rodgym._registration import REMOTE
from rodgym.remote.envs import RemoteSeededBatch, make_address
from rodgym.sb3 import RodVecEnv

if TYPE_CHECKING:
    from gymnasium.envs.registration import EnvSpec


class RemoteVecEnv(RodVecEnv):
    """A `rodgym.sb3.RodVecEnv` on a server; more arguments as for `RemoteVectorEnv`."""

    def __init__(
        self,
        server: str,
        env_id: str,
        n_envs: int = 1,
        *,
        keys: str | os.PathLike[str] | None = None,
        server_key: str | os.PathLike[str] | None = None,
        timeout: float = 60.0,
        recover: str = "raise",
        **kwargs: Any,
    ) -> None:
        self._remote = make_address(server, keys, server_key, timeout), recover
        super().__init__(env_id, n_envs, **kwargs)

    def _open(self, *args: Any) -> SeededBatch:
        return RemoteSeededBatch(*self._remote, *args)

    def _describe(self, env_id: str, kwargs: dict[str, Any]) -> EnvSpec | None:
        address, recover = self._remote
        where = {"server": address.server, "keys": address.keys, "server_key": address.server_key}
        there = {**where, "timeout": address.timeout, "recover": recover, "env_id": env_id}
        return super()._describe(REMOTE, {**there, **kwargs})

    def close(self) -> None:
        """Gives the session back."""
        self._batch.native.close()  # type: ignore[attr-defined]
