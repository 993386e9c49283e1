"""The Gymnasium faces of environments on a server."""

from __future__ import annotations

import os
from typing import Any

from rodgym._batch import SeededBatch
from rodgym.envs.rod_env import RodEnv
from rodgym.errors import ParameterError
from rodgym.remote.batch import RemoteBatch
from rodgym.remote.connection import Address
from rodgym.vector import RodVectorEnv


class RemoteSeededBatch(SeededBatch):
    """A `SeededBatch` on a server, with snapshots in few requests."""

    native: RemoteBatch  # type: ignore[assignment]

    def __init__(self, address: Address, recover: str, *args: Any) -> None:
        self._address, self._recover = address, recover
        super().__init__(*args)

    def _make(self, env_id: str, num_envs: int, kwargs: dict[str, Any], *rest: Any) -> Any:
        autoreset_mode, max_episode_steps, num_threads = rest
        return open_batch(
            self._address, self._recover, env_id, num_envs, kwargs, autoreset_mode,
            max_episode_steps, num_threads,
        )  # fmt: skip

    def get_state(self, indices: Any = None) -> list[bytes]:
        """Snapshots of all environments, or of those in `indices`."""
        if indices is None:
            return self.native.get_states(0, self.num_envs)
        return super().get_state(indices)


def open_batch(
    address: Address,
    recover: str,
    env_id: str,
    num_envs: int,
    kwargs: dict[str, Any],
    autoreset_mode: str,
    max_episode_steps: int | None,
    num_threads: int | None,
) -> RemoteBatch:
    """A batch on a server; refuses what is the server's to decide."""
    if num_threads is not None:
        raise ParameterError(f"num_threads = {num_threads} is not allowed: the server decides")
    return RemoteBatch(
        address, recover, env_id, num_envs, kwargs, autoreset_mode, max_episode_steps
    )


class RemoteVectorEnv(RodVectorEnv):
    """Many environments of one kind on a server.

    Everything is as in `rodgym.vector.RodVectorEnv`, to the bit.

    Arguments:
        server: `"tcp://host:port"` or `"ipc://path"`.
        env_id: id such as `"rodgym/PendulumSwingUp-v0"`.
        num_envs: number of environments.
        keys: directory with our `secret.key` (`rodgym serve keygen DIR`); `None`: no encryption.
        server_key: the server's public key (40 characters), or the path of its `public.key`.
        timeout: most time for one call, retries included [s].
        recover: what to do when the session is gone, because the server restarted or nobody used it
            for too long: `"raise"` a `SessionLostError`, or `"restart"`: make another one and bring
            it to the state of the lost one, so that the trajectory goes on unchanged.
        **kwargs: those of `RodVectorEnv` except `num_threads`, and keywords of the environment.
    """

    def __init__(
        self,
        server: str,
        env_id: str,
        num_envs: int = 1,
        *,
        keys: str | os.PathLike[str] | None = None,
        server_key: str | os.PathLike[str] | None = None,
        timeout: float = 60.0,
        recover: str = "raise",
        **kwargs: Any,
    ) -> None:
        self._remote = make_address(server, keys, server_key, timeout), recover
        super().__init__(env_id, num_envs, **kwargs)

    def _open(self, *args: Any) -> SeededBatch:
        return RemoteSeededBatch(*self._remote, *args)

    def close_extras(self, **kwargs: Any) -> None:
        """Gives the session back."""
        self._batch.native.close()  # type: ignore[attr-defined]


class RemoteEnv(RodEnv):
    """One environment on a server; arguments as for `RemoteVectorEnv`."""

    def __init__(
        self,
        server: str,
        env_id: str,
        *,
        keys: str | os.PathLike[str] | None = None,
        server_key: str | os.PathLike[str] | None = None,
        timeout: float = 60.0,
        recover: str = "raise",
        **kwargs: Any,
    ) -> None:
        self._remote = make_address(server, keys, server_key, timeout), recover
        super().__init__(env_id, **kwargs)

    def _open(self, env_id: str, kwargs: dict[str, Any]) -> Any:
        return open_batch(*self._remote, env_id, 1, kwargs, "Single", None, None)

    def close(self) -> None:
        """Closes the window, if there is one, and gives the session back."""
        super().close()
        self._batch.close()  # type: ignore[attr-defined]


def make_address(
    server: str,
    keys: str | os.PathLike[str] | None,
    server_key: str | os.PathLike[str] | None,
    timeout: float,
) -> Address:
    """The parts of an address as plain text."""
    text = [None if path is None else os.fspath(path) for path in (keys, server_key)]
    return Address(server, text[0], text[1], timeout)
