"""Where a server is and how to reach it."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from typing import Any

from rodgym import _checks as checks

#: A host is a name, numbers, or an IPv6 address in brackets; `*` is for servers only.
_TCP = re.compile(r"tcp://(\[[^\[\]\s]+\]|[^\[\]\s/:*;]+):(\d{1,5})")
_IPC = re.compile(r"ipc://.+")


@dataclass(frozen=True)
class Address:
    """Where a server is and how to reach it.

    Raises:
        ParameterError: no address, or a timeout that is none; nothing was tried then.
    """

    #: `tcp://host:port` or `ipc://path`.
    server: str
    #: Directory with our `secret.key`; None: without encryption.
    keys: str | os.PathLike[str] | None = None
    #: The server's public key or the path of its `public.key`.
    server_key: str | os.PathLike[str] | None = None
    #: Most time for one request, retries included [s].
    timeout: float = 60.0

    def __post_init__(self) -> None:
        _check_server(self.server)
        seconds = checks.number("timeout", self.timeout, "s")
        if isinstance(self.timeout, bool) or seconds <= 0.0:
            raise checks.refused("timeout", self.timeout, "a number above 0, in s")
        object.__setattr__(self, "timeout", seconds)
        for name in ("keys", "server_key"):
            object.__setattr__(self, name, _path(name, getattr(self, name)))


def _check_server(server: Any) -> None:
    allowed = "an address such as 'tcp://host:5555' or 'ipc:///path/of/socket'"
    if not isinstance(server, str):
        raise checks.refused("server", server, allowed)
    if (match := _TCP.fullmatch(server)) and 1 <= int(match[2]) <= 65535:
        return
    if _IPC.fullmatch(server):
        return
    if "://" not in server:
        missing = "'tcp://' is missing"
    elif not server.startswith(("tcp://", "ipc://")):
        missing = "it begins with neither 'tcp://' nor 'ipc://'"
    elif server.startswith("ipc://"):
        missing = "the path is missing"
    elif re.search(r":\d+$", server) is None:
        missing = "the port is missing"
    elif match is None:
        missing = "what stands between 'tcp://' and the port is no host"
    else:
        missing = "the port is none of 1 to 65535"
    raise checks.refused("server", server, f"{allowed}: {missing}")


def _path(name: str, path: Any) -> str | None:
    """A path as plain text, which pickles and stands in specs."""
    if path is None:
        return None
    if not isinstance(path, str | os.PathLike):
        raise checks.refused(name, path, "a path")
    return str(os.fspath(path))
