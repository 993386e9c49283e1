"""Environments on a server, with the faces of the local ones.

```python
venv = rodgym.remote.connect("tcp://host:5555", "rodgym/PendulumSwingUp-v0", num_envs=64)
venv = gym.make_vec("rodgym/Remote-v0", num_envs=64, server="tcp://host:5555",
                    env_id="rodgym/PendulumSwingUp-v0")
sb3  = rodgym.sb3.make_vec_env("rodgym/PendulumSwingUp-v0", n_envs=64, server="tcp://host:5555")
```

Trajectories equal the local ones to the bit. A step is carried out exactly once, however often the
connection breaks. Needs `pip install "rodgym[remote]"`.
"""

from __future__ import annotations

from typing import Any

try:
    import msgpack  # noqa: F401
    import zmq  # noqa: F401
except ImportError as error:  # pragma: no cover
    raise ImportError(
        'rodgym.remote needs pyzmq and msgpack: pip install "rodgym[remote]"'
    ) from error

from rodgym.remote.address import Address
from rodgym.remote.envs import RemoteEnv, RemoteVectorEnv
from rodgym.remote.errors import (
    AuthenticationError,
    LimitError,
    RemoteError,
    RemoteTimeoutError,
    SessionLostError,
    VersionError,
)
from rodgym.remote.ping import ping
from rodgym.remote.server import Server

__all__ = [
    "Address",
    "AuthenticationError",
    "LimitError",
    "RemoteEnv",
    "RemoteError",
    "RemoteTimeoutError",
    "RemoteVectorEnv",
    "Server",
    "SessionLostError",
    "VersionError",
    "connect",
    "ping",
]


def connect(server: str, env_id: str, num_envs: int = 1, **kwargs: Any) -> RemoteVectorEnv:
    """Makes a batch on a server: see `RemoteVectorEnv` for its arguments."""
    return RemoteVectorEnv(server, env_id, num_envs, **kwargs)
