"""Requests and replies as frames: a msgpack map, then one raw little-endian frame an array."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from types import NoneType
from typing import Any, NamedTuple

import msgpack
import numpy as np
import numpy.typing as npt

from rodgym.remote.errors import RemoteError, UnsendableError

#: The protocol version that this client speaks.
VERSION = 1

#: Lists of so many numbers travel as arrays.
LONG = 16

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

    def array(self, name: str, dtype: str, *shape: int | None) -> npt.NDArray[Any]:
        """The array of this name; a None in the shape fits any size.

        Raises:
            RemoteError: it is missing or another one.
        """
        array = self.arrays.get(name)
        if array is None:
            raise damaged(f"it has no array {name!r}")
        fits = array.shape == shape or (
            len(shape) == array.ndim
            and all(
                expected in (None, size) for expected, size in zip(shape, array.shape, strict=True)
            )
        )
        if array.dtype != _DTYPES[dtype] or not fits:
            raise damaged(f"{name!r} has type {array.dtype} and shape {array.shape}")
        return array

    def maybe(self, name: str, dtype: str, *shape: int | None) -> npt.NDArray[Any] | None:
        """The array of this name; None where the reply has none."""
        return self.array(name, dtype, *shape) if name in self.arrays else None


#: Types of a reply's fields.
_KINDS: tuple[type | tuple[type, ...], ...] = (
    int,
    bool,
    (int, NoneType),
    str,
    (dict, NoneType),
    dict,
    dict,
)


def own(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """An array to hand over: a copy that may be written to, in this machine's order of bytes.

    (A frame of libzmq's own could be handed over without a copy; but freeing one swallows Ctrl-C.)
    """
    return array.astype(array.dtype.newbyteorder("="))


def damaged(what: object) -> RemoteError:
    """The error for a reply that is none."""
    return RemoteError(f"the server's reply cannot be read: {what}", "bad_reply", "same")


@contextlib.contextmanager
def reading() -> Iterator[None]:
    """Whatever taking a reply apart stumbles over is the reply's fault.

    Raises:
        RemoteError: something is missing, or of another type.
    """
    try:
        yield
    except (LookupError, ValueError, TypeError, AttributeError, OverflowError) as error:
        raise damaged(repr(error)) from error


def split_lists(values: dict[str, Any], path: str = "kwargs:") -> tuple[dict[str, Any], Arrays]:
    """Keywords without their long lists of numbers, and these as arrays: a header is short.

    A dot leads into a dictionary: `kwargs:geometry.widths`.
    """
    rest: dict[str, Any] = {}
    arrays: Arrays = {}
    for name, value in values.items():
        if isinstance(value, dict):
            rest[name], inner = split_lists(value, f"{path}{name}.")
            arrays |= inner
        elif isinstance(value, list) and len(value) >= LONG and _numbers(value):
            arrays[path + name] = np.array(value, dtype=np.float64)
        else:
            rest[name] = value
    return rest, arrays


def _numbers(values: list[Any]) -> bool:
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)


def pack(
    op: str, rid: int, sid: str | None, seq: int | None, p: dict[str, Any], arrays: Arrays
) -> list[Any]:
    """The frames of a request; arrays become C-order little-endian.

    Raises:
        UnsendableError: a value that msgpack cannot say.
    """
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
    try:
        frames[0] = msgpack.packb(header)
    except (ValueError, TypeError, OverflowError) as error:
        raise UnsendableError(f"'{op}' cannot be sent: {error}", "bad_header") from error
    return frames


def unpack(frames: Sequence[Any]) -> Reply:
    """A reply from its frames.

    Raises:
        RemoteError: what came is not a reply of this protocol.
    """
    try:
        header = msgpack.unpackb(frames[0])
    except (ValueError, TypeError, msgpack.UnpackException) as error:
        raise damaged(repr(error)) from error
    with reading():
        arrays = {}
        for (name, dtype, shape), frame in zip(header.get("arr", ()), frames[1:], strict=True):
            for size in shape:
                if not isinstance(size, int) or size < 0:
                    raise ValueError(f"shape {shape!r}")
            arrays[name] = np.frombuffer(frame, _DTYPES[dtype]).reshape(shape)
        reply = Reply(
            header["rid"],
            header["ok"],
            header.get("seq"),
            header.get("epoch", ""),
            header.get("err"),
            arrays,
            header.get("p", {}),
        )
        for name, value, kind in zip(Reply._fields, reply, _KINDS, strict=True):
            if not isinstance(value, kind):
                raise TypeError(f"{name} = {value!r}")
    return reply
