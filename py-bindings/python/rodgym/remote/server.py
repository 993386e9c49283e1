"""A server as the backend of the local environments."""

from __future__ import annotations

import os
from typing import Any

from rodgym._registration import REMOTE
from rodgym.errors import ParameterError
from rodgym.remote.address import Address
from rodgym.remote.batch import RemoteBatch


class Server:
    """A `rodgym serve` that computes batches.

    Arguments:
        server: `"tcp://host:port"` or `"ipc://path"`.
        keys: directory with our `secret.key` (`rodgym serve keygen DIR`); `None`: no encryption.
        server_key: the server's public key (40 characters), or the path of its `public.key`.
        timeout: most time for one call, retries included [s].
        recover: what to do when the session is gone, because the server restarted or nobody used it
            for too long: `"raise"` a `SessionLostError`, or `"restart"`: make another one and bring
            it to the state of the lost one, so that the trajectory goes on unchanged.
    """

    def __init__(
        self,
        server: str,
        keys: str | os.PathLike[str] | None = None,
        server_key: str | os.PathLike[str] | None = None,
        timeout: float = 60.0,
        recover: str = "raise",
    ) -> None:
        self.address = Address(server, keys, server_key, timeout)
        self.recover = recover

    def open(
        self,
        env_id: str,
        num_envs: int,
        kwargs: dict[str, Any],
        autoreset_mode: str,
        max_episode_steps: int | None,
        num_threads: int | None,
    ) -> RemoteBatch:
        """See `Backend.open`; refuses what is the server's to decide."""
        if num_threads is not None:
            raise ParameterError(f"num_threads = {num_threads} is not allowed: the server decides")
        return RemoteBatch(
            self.address, self.recover, env_id, num_envs, kwargs, autoreset_mode, max_episode_steps
        )

    def registered(self, env_id: str, kwargs: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        """See `Backend.registered`."""
        address = self.address
        where = {"server": address.server, "keys": address.keys, "server_key": address.server_key}
        there = {**where, "timeout": address.timeout, "recover": self.recover, "env_id": env_id}
        return REMOTE, {**there, **kwargs}
