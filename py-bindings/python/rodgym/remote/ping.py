"""Asking a server about itself."""

from __future__ import annotations

from typing import Any

from rodgym.remote.address import Address
from rodgym.remote.connection import Connection
from rodgym.remote.errors import VersionError
from rodgym.remote.wire import VERSION, reading


def ping(
    server: str, *, keys: str | None = None, server_key: str | None = None, timeout: float = 5.0
) -> dict[str, Any]:
    """Versions, limits, features, build and epoch of a server, our name there, and its `ids`.

    Raises:
        RemoteTimeoutError: no answer; the message tells what the socket saw.
        VersionError: no protocol version in common.
    """
    connection = Connection(Address(server, keys, server_key, timeout))
    try:
        about = connection.request("hello", p={"versions": [VERSION, VERSION]}).p
        with reading():
            low, high = about["versions"]
            spoken = low <= VERSION <= high
        if not spoken:
            raise VersionError(
                f"the server speaks {low} to {high}, this client {VERSION}", "version"
            )
        ids = connection.request("list").p
        with reading():
            return {**about, "epoch": connection.epoch, "ids": ids["ids"]}
    finally:
        connection.close()
