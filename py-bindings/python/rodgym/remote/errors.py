"""What can go wrong between a client and its server."""

from rodgym import errors
from rodgym.errors import RodgymError

#: The class that a local environment would raise, by the protocol's word for the core's error.
_LOCAL: dict[str, type[RodgymError]] = {
    "unknown_env": errors.UnknownEnvError,
    "unknown_keyword": errors.UnknownKeywordError,
    "unknown_parameter": errors.ParameterError,
    "parameter": errors.ParameterError,
    "shape": errors.ShapeError,
    "action": errors.ActionError,
    "needs_reset": errors.ResetNeededError,
    "not_reset": errors.ResetNeededError,
    "index": errors.EnvIndexError,
    "snapshot": errors.SnapshotError,
    "solver": errors.SolverError,
}


class RemoteError(RodgymError):
    """The server refused a request, or its answer cannot be read.

    `code` is the protocol's word (docs/protocol.md), `retry` what a client may try.
    """

    def __init__(
        self, message: str, code: str = "", retry: str = "never", after_ms: int | None = None
    ) -> None:
        super().__init__(message)
        self.code = code
        self.retry = retry
        self.after_ms = after_ms


class RemoteTimeoutError(RemoteError, TimeoutError):
    """No answer within the deadline; the message tells what the socket saw last."""


class AuthenticationError(RemoteError):
    """The server refused our key, or it was removed."""


class VersionError(RemoteError):
    """Client and server have no protocol version in common."""


class LimitError(RemoteError):
    """The server grants no more: too many sessions, environments or bytes."""


class UnsendableError(LimitError):
    """No message can hold this request; nothing was sent."""


class SessionLostError(RemoteError):
    """The session is gone: the server restarted, or nobody used it for too long."""


def local_error(kind: str, message: str) -> RodgymError:
    """What a local environment would have raised."""
    return _LOCAL.get(kind, RodgymError)(message)
