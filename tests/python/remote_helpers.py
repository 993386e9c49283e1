"""A server process for tests, and a proxy that cuts connections where it is told."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rodgym import _native
from rodgym.errors import RodgymError

RUN = "import sys; from rodgym import _native; sys.exit(_native.serve(sys.argv[1:]))"


def need_server() -> None:
    """Skips the module where the extension was built without the server (feature `server`)."""
    pytest.importorskip("zmq")
    pytest.importorskip("msgpack")
    try:
        _native.serve(["--version"])
    except RodgymError as error:
        if os.environ.get("RODGYM_NEED_SERVER"):
            raise
        pytest.skip(str(error), allow_module_level=True)


class Server:
    """`rodgym serve` in a process of its own."""

    def __init__(self, *arguments: str, bind: str = "tcp://127.0.0.1:0") -> None:
        self.arguments = arguments
        self.bind = bind
        self.stderr = tempfile.TemporaryFile("w+")
        try:
            self.start()
        except BaseException:
            self.stop()
            raise

    def start(self) -> None:
        command = [sys.executable, "-c", RUN, "--bind", self.bind, *self.arguments]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=self.stderr, text=True
        )
        assert self.process.stdout is not None
        with self.process.stdout as lines:
            line = lines.readline()
            assert "listens at" in line, line + self.log
            # The same port again after a restart.
            self.bind = self.address = line.split()[-1]
            if "--http" in self.arguments:
                self.http = lines.readline().split()[-1].removesuffix("/metrics")

    @property
    def log(self) -> str:
        self.stderr.seek(0)
        return self.stderr.read()

    def send(self, number: int) -> None:
        self.process.send_signal(number)

    def wait(self, timeout: float = 20.0) -> int:
        return self.process.wait(timeout)

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def stop(self) -> None:
        if self.process.poll() is None:
            self.send(signal.SIGTERM)
            try:
                self.wait()
            except subprocess.TimeoutExpired:
                self.kill()
        self.stderr.close()

    def memory(self) -> int:
        """Resident memory [bytes]."""
        for line in Path(f"/proc/{self.process.pid}/status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                return int(line.split()[1]) * 1024
        raise AssertionError("no VmRSS")

    def descriptors(self) -> int:
        return len(os.listdir(f"/proc/{self.process.pid}/fd"))


@contextlib.contextmanager
def serving(*arguments: str, bind: str = "tcp://127.0.0.1:0") -> Iterator[Server]:
    server = Server(*arguments, bind=bind)
    try:
        yield server
    finally:
        server.stop()


class Proxy:
    """Passes bytes on and breaks each connection after a number of bytes of its own."""

    def __init__(self, target: str, budgets: Iterator[int], direction: str) -> None:
        host, port = target.removeprefix("tcp://").rsplit(":", 1)
        self.target = (host, int(port))
        self.budgets = budgets
        self.direction = direction
        self.cuts = 0
        #: Bytes that the last connection to end has passed on, by direction.
        self.passed = {"up": 0, "down": 0}
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"tcp://127.0.0.1:{self.listener.getsockname()[1]}"
        self.closed = False
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while not self.closed:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return
            try:
                server = socket.create_connection(self.target)
            except OSError:
                client.close()
                continue
            budget = next(self.budgets, 1 << 40)
            up, down = (budget, 1 << 40) if self.direction == "up" else (1 << 40, budget)
            for way, *arguments in (("up", client, server, up), ("down", server, client, down)):
                thread = threading.Thread(target=self._pass, args=(way, *arguments), daemon=True)
                thread.start()

    def _pass(self, way: str, source: socket.socket, sink: socket.socket, budget: int) -> None:
        passed = 0
        with contextlib.suppress(OSError):
            while budget > 0 and (data := source.recv(min(65536, budget))):
                sink.sendall(data)
                budget -= len(data)
                passed += len(data)
            if budget <= 0:
                self.cuts += 1
        self.passed[way] = passed
        for end in (source, sink):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def close(self) -> None:
        self.closed = True
        self.listener.close()


def counter(server: Server, name: str) -> int:
    """One number of a server with `--http`."""
    with urllib.request.urlopen(f"{server.http}/metrics", timeout=5) as page:
        lines = page.read().decode().splitlines()
    return int(next(line for line in lines if line.startswith(f"rodgym_{name} ")).split()[1])


def until(condition: Any, seconds: float = 10.0) -> None:
    """Waits for a condition."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.05)
