"""Requests and replies as frames: a msgpack map, then one raw little-endian frame an array."""

from __future__ import annotations

from typing import Any, NamedTuple

import msgpack
import numpy as np
import numpy.typing as npt

from rodgym.remote.errors import RemoteError

#: The protocol version that this client speaks.
VERSION = 1

Arrays = dict[str, npt.NDArray[Any]]

_DTYPES = {text: np.dtype(text) for text in ("<f4", "<f8", "<u4", "<u8", "|u1", "|b1")}


class Reply(NamedTuple):
    """A reply taken apart."""

    rid: int
    ok: bool
    #: Last sequence number that was carried out, where there is a session.
    seq: int | None
    #: Changes when the server restarts.
    epoch: str
    err: dict[str, Any] | None
    #: Read-only views of the frames.
    arrays: Arrays
    p: dict[str, Any]


def pack(
    op: str, rid: int, sid: str | None, seq: int | None, p: dict[str, Any], arrays: Arrays
) -> list[Any]:
    """The frames of a request; arrays become C-order little-endian."""
    header: dict[str, Any] = {"v": VERSION, "op": op, "rid": rid}
    if sid is not None:
        header["sid"] = sid
    if seq is not None:
        header["seq"] = seq
    if p:
        header["p"] = p
    frames: list[Any] = [b""]
    if arrays:
        described = header["arr"] = []
        for name, array in arrays.items():
            array = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
            described.append((name, array.dtype.str, array.shape))
            frames.append(array.data if array.size else b"")
    frames[0] = msgpack.packb(header)
    return frames


def unpack(frames: list[bytes]) -> Reply:
    """A reply from its frames.

    Raises:
        RemoteError: what came is not a reply of this protocol.
    """
    try:
        header = msgpack.unpackb(frames[0])
        arrays = {}
        for (name, dtype, shape), frame in zip(header.get("arr", ()), frames[1:], strict=True):
            arrays[name] = np.frombuffer(frame, _DTYPES[dtype]).reshape(shape)
        return Reply(
            header["rid"],
            header["ok"],
            header.get("seq"),
            header.get("epoch", ""),
            header.get("err"),
            arrays,
            header.get("p", {}),
        )
    except (KeyError, ValueError, TypeError, AttributeError, msgpack.UnpackException) as error:
        raise RemoteError(f"the server's reply cannot be read: {error!r}", "bad_reply") from error
