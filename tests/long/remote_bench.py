"""Speed of the remote protocol, as ratios to an echo of the same bytes and to the local batch.

All numbers of one run; `python tests/long/remote_bench.py`. Exits with 1 if a target is missed.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "python"))

import rodgym.remote
import zmq
from remote_helpers import serving
from rodgym import _native
from rodgym.remote.wire import pack
from rodgym.vector import RodVectorEnv

ENV = "rodgym/PendulumSwingUp-v0"


def times(call, count: int) -> np.ndarray:
    """Seconds of each call, after some to warm up."""
    for _ in range(count // 10 + 5):
        call()
    result = np.empty(count)
    for i in range(count):
        began = time.perf_counter()
        call()
        result[i] = time.perf_counter() - began
    return result


def echo(reply: list[bytes], port) -> None:
    """Answers every message with the same frames: what the wire alone costs."""
    socket = zmq.Context().socket(zmq.ROUTER)
    port.put(socket.bind_to_random_port("tcp://127.0.0.1"))
    while True:
        identity = socket.recv_multipart()[0]
        socket.send_multipart([identity, *reply])


def one(address: str, count: int, barrier, results) -> None:
    """One of many clients: its step times."""
    env = rodgym.remote.connect(address, ENV, 64)
    env.reset(seed=1)
    action = np.zeros((64, 1), dtype=np.float32)
    barrier.wait()
    results.put(times(lambda: env.step(action), count))
    barrier.wait()
    env.close()


def main() -> int:
    """Measures, prints a table, compares with the targets."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=3000)
    steps = parser.parse_args().steps
    context = multiprocessing.get_context("spawn")
    rows: list[tuple[str, str, bool]] = []

    with serving() as server:
        local = RodVectorEnv(ENV, 64, num_threads=1)
        remote = rodgym.remote.connect(server.address, ENV, 64)
        for env in (local, remote):
            env.reset(seed=0)
        action = np.zeros((64, 1), dtype=np.float32)
        native = remote._batch.native
        request = pack("step", 1, native._sid, 2, {}, {"action": action})
        socket = native.connection._socket
        socket.send_multipart(request)
        reply = socket.recv_multipart()
        native._seq += 1
        port = context.Queue()
        process = context.Process(target=echo, args=(reply, port), daemon=True)
        process.start()
        peer = zmq.Context.instance().socket(zmq.DEALER)
        peer.linger = 0
        peer.connect(f"tcp://127.0.0.1:{port.get()}")

        def ask() -> None:
            peer.send_multipart(request)
            peer.recv_multipart()

        wire, physics, whole = (
            np.median(times(call, steps)) * 1e6
            for call in (ask, lambda: local.step(action), lambda: remote.step(action))
        )
        process.kill()
        peer.close()
        rows.append(
            (
                "64 pendulums, step p50 <= 2 x echo + physics",
                f"{whole:.0f} us; echo {wire:.0f}, local step {physics:.0f}; "
                f"wire part {(whole - physics) / wire:.2f} x echo",
                whole <= 2 * wire + physics,
            )
        )
        size = sum(len(frame) for frame in reply)

        pair = (
            RodVectorEnv(ENV, 1024, num_threads=1),
            rodgym.remote.connect(server.address, ENV, 1024),
        )
        wide = np.zeros((1024, 1), dtype=np.float32)
        rates = []
        for env in pair:
            env.reset(seed=0)
            rates.append(1024 / np.median(times(lambda env=env: env.step(wide), steps // 10)))
        rows.append(
            (
                "1024 pendulums, throughput >= 60 % of local",
                f"{rates[1] / 1e3:.0f} of {rates[0] / 1e3:.0f} k/s: {rates[1] / rates[0]:.0%}",
                rates[1] >= 0.6 * rates[0],
            )
        )

        barrier, results = context.Barrier(16), context.Queue()
        crowd = [
            context.Process(target=one, args=(server.address, steps // 3, barrier, results))
            for _ in range(16)
        ]
        for member in crowd:
            member.start()
        samples = [results.get(timeout=300) for _ in crowd]
        for member in crowd:
            member.join()
        median = np.median(np.concatenate(samples))
        worst = max(np.quantile(sample, 0.99) for sample in samples)
        rows.append(
            (
                "16 clients of 64, worst p99 <= 5 x median",
                f"{median * 1e6:.0f} us, p99 {worst * 1e6:.0f} us: {worst / median:.1f} x",
                worst <= 5 * median,
            )
        )

    with tempfile.TemporaryDirectory() as folder:
        keys = Path(folder)
        for name in ("server", "me"):
            _native.serve(["keygen", str(keys / name)])
        (keys / "server/authorized/me.key").write_text((keys / "me/public.key").read_text())
        secure = {"keys": keys / "me", "server_key": keys / "server/public.key"}
        with serving() as plain, serving("--keys", str(keys / "server")) as curve:
            envs = [
                rodgym.remote.connect(plain.address, ENV, 30),
                rodgym.remote.connect(curve.address, ENV, 30, **secure),
            ]
            action = np.zeros((30, 1), dtype=np.float32)
            for env in envs:
                env.reset(seed=0)
            costs = [
                [np.median(times(lambda env=env: env.step(action), steps)) for env in envs]
                for _ in range(2)
            ]
        extra = min(curve - plain for plain, curve in costs) * 1e6
        rows.append(
            (
                f"CURVE at {30 * size // 64 / 1000:.1f} kB costs <= 30 us",
                f"{extra:.0f} us",
                extra <= 30,
            )
        )

    for what, measured, good in rows:
        print(f"{'ok    ' if good else 'MISSED'} {what}: {measured}")
    return 0 if all(good for *_, good in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
