"""Starting a cluster on this machine, or joining one."""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import ray

from rodgym.errors import RodgymError

#: Environment of workers: one of our processes keeps one core busy, so that libraries below NumPy
#: and PyTorch must not start a thread for every core of the machine in each of them.
WORKER_ENV = {"OMP_NUM_THREADS": "1"}

#: Most time to reach a cluster's address [s].
TIMEOUT = 10.0


class ClusterError(RodgymError, ConnectionError):
    """A Ray cluster that cannot be reached."""


@contextmanager
def cluster(address: str = "local", workers: int | None = None, **options: Any) -> Iterator[None]:
    """Inside, this process is the driver of a Ray cluster whose workers have `WORKER_ENV`.

    A process that has called `ray.init` already stays with its cluster, whatever `address` is.

    Arguments:
        address: `"local"` starts a cluster on this machine, for this user (Ray checks a token of
            his), and stops it at the end; `"auto"`, `"host:6379"` or `"ray://host:10001"` join one.
        workers: CPUs of a local cluster; `None`: as many as the machine has.
        **options: of `ray.init`.

    Raises:
        ClusterError: nothing answers at the address.
    """
    if ray.is_initialized():
        yield
        return
    if address == "local":
        # Ray would tell its makers about every cluster.
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        # Ray warns that only this user may use the cluster, which is what we want.
        logging.getLogger("ray._private.authentication").setLevel(logging.ERROR)
        options = {"num_cpus": workers, "include_dashboard": False, **options}
    else:
        _knock(address)
    quiet = {"logging_level": "warning", "log_to_driver": False}
    options = {**quiet, "runtime_env": {"env_vars": WORKER_ENV}, **options}
    try:
        ray.init(address, **options)
    except ConnectionError as error:
        raise ClusterError(f"no Ray cluster at {address!r}: {error}") from error
    try:
        yield
    finally:
        ray.shutdown()


def _knock(address: str) -> None:
    """Refuses an address where nothing listens; Ray would try for minutes."""
    host, colon, port = address.rpartition("://")[2].rpartition(":")
    if not colon:
        return
    try:
        socket.create_connection((host, int(port)), TIMEOUT).close()
    except (OSError, ValueError) as error:
        raise ClusterError(f"no Ray cluster at {address!r}: {error}") from error
