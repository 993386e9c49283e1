"""Speed of environments on a server, as ratios to an echo of the same bytes and to the local batch.

`make bench-remote`, or `PYTHONPATH=tests/python python tests/long/remote_bench.py`. All
numbers are of one run, cases take turns, and ratios are taken round by round. Exits with 1 if a
target is missed.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import rodgym.remote
import rodgym.sb3
import zmq
from remote_helpers import Server, serving
from rodgym import _native
from rodgym.bench.measure import Ratio
from rodgym.bench.report import Target, table, targets_table
from rodgym.bench.session import machine
from rodgym.remote.wire import pack
from rodgym.runs import provenance
from rodgym.vector import RodVectorEnv

ENV = "rodgym/PendulumSwingUp-v0"
CONTEXT = multiprocessing.get_context("spawn")
#: Calls of one case before the next has its turn.
TURN = 50
CLIENTS = 16

Times = npt.NDArray[np.float64]


def take_turns(cases: Sequence[Callable[[], Any]], rounds: int) -> list[Times]:
    """Seconds of each call of each case: an array (rounds, TURN) a case."""
    seconds = np.empty((len(cases), rounds, TURN))
    for round_ in range(-1, rounds):
        for i, call in enumerate(cases):
            for j in range(TURN):
                began = time.perf_counter()
                call()
                # The first round warms up; its times are overwritten.
                seconds[i, round_, j] = time.perf_counter() - began
    return list(seconds)


def spread(values: Times) -> Ratio:
    """Median and quartiles of one number a round."""
    return Ratio(*(float(np.quantile(values, q)) for q in (0.5, 0.25, 0.75)))


def medians(seconds: Times) -> Times:
    """One number a round [us]."""
    return 1e6 * np.median(seconds, axis=1)


def stepper(env: Any, num_envs: int) -> Callable[[], Any]:
    """A step with no torque, after a reset."""
    env.reset(seed=0)
    action = np.zeros((num_envs, 1), dtype=np.float32)
    return lambda: env.step(action)


def echo(reply: list[bytes], port: Any) -> None:
    """Answers every message with the same frames: what the wire alone costs."""
    socket = zmq.Context().socket(zmq.ROUTER)
    port.put(socket.bind_to_random_port("tcp://127.0.0.1"))
    while True:
        identity = socket.recv_multipart()[0]
        socket.send_multipart([identity, *reply])


@contextlib.contextmanager
def echoing(request: list[Any], reply: list[bytes]) -> Iterator[Callable[[], Any]]:
    """A round trip of these frames, between two processes as well."""
    port = CONTEXT.Queue()
    process = CONTEXT.Process(target=echo, args=(reply, port), daemon=True)
    process.start()
    peer = zmq.Context.instance().socket(zmq.DEALER)
    peer.linger = 0
    peer.connect(f"tcp://127.0.0.1:{port.get()}")

    def ask() -> None:
        peer.send_multipart(request)
        peer.recv_multipart()

    yield ask
    peer.close()
    process.kill()


def frames_of_a_step(env: Any, num_envs: int) -> tuple[list[Any], list[bytes]]:
    """What travels in a step, both ways; the step is taken."""
    native = env._batch.native
    action = {"action": np.zeros((num_envs, 1), dtype=np.float32)}
    request = pack("step", 1, native._sid, native._progress.seq + 1, {}, action)
    socket = native.connection._socket
    socket.send_multipart(request)
    native._progress = native._progress._replace(seq=native._progress.seq + 1)
    return request, socket.recv_multipart()


def wire(server: Server, num_envs: int, rounds: int) -> tuple[list[Target], list[str]]:
    """A step against an echo of its bytes and a local step."""
    local = RodVectorEnv(ENV, num_envs, num_threads=1)
    remote = rodgym.remote.connect(server.address, ENV, num_envs)
    steps = [stepper(env, num_envs) for env in (local, remote)]
    request, reply = frames_of_a_step(remote, num_envs)
    socket = remote._batch.native.connection._socket

    def again() -> None:
        socket.send_multipart(request)
        socket.recv_multipart()

    with echoing(request, reply) as ask:
        whole_again = take_turns([again], rounds)[0]
        seconds = take_turns([ask, *steps], rounds)
    remote.close()
    raw, physics, whole = (medians(one) for one in seconds)
    cost = spread((whole - physics) / raw)
    row = [
        str(num_envs),
        *(f"{np.median(values):.0f}" for values in (raw, medians(whole_again), physics, whole)),
        str(cost),
        f"{np.median(physics / whole):.0%}",
    ]
    targets = []
    if num_envs == 64:
        note = f" ({np.median(whole):.0f} us against {np.median(2 * raw + physics):.0f})"
        targets.append(
            Target(
                "64 pendulums: step p50 - local step, in echoes of the same bytes",
                "<= 2.0",
                f"{cost}{note}",
                cost.median <= 2.0,
            )
        )
    if num_envs == 1024:
        share = spread(physics / whole)
        targets.append(
            Target(
                "1024 pendulums: throughput over local", ">= 0.6", str(share), share.median >= 0.6
            )
        )
    return targets, row


def curve(rounds: int) -> Target:
    """What encryption adds to a step whose reply has 4 kB."""
    num_envs = 30
    with tempfile.TemporaryDirectory() as folder:
        keys = Path(folder)
        for name in ("server", "me"):
            _native.serve(["keygen", str(keys / name)])
        (keys / "server/authorized/me.key").write_text((keys / "me/public.key").read_text())
        secure = {"keys": keys / "me", "server_key": keys / "server/public.key"}
        with serving() as plain, serving("--keys", str(keys / "server")) as encrypted:
            envs = [
                rodgym.remote.connect(plain.address, ENV, num_envs),
                rodgym.remote.connect(encrypted.address, ENV, num_envs, **secure),
            ]
            calls = [stepper(env, num_envs) for env in envs]
            size = sum(len(frame) for frame in frames_of_a_step(envs[0], num_envs)[1])
            without, with_ = (medians(one) for one in take_turns(calls, rounds))
            for env in envs:
                env.close()
    extra = spread(with_ - without)
    return Target(
        f"CURVE at {size / 1000:.1f} kB a reply", "<= 30 us", f"{extra} us", extra.median <= 30
    )


def one_of_many(address: str, rounds: int, barrier: Any, results: Any) -> None:
    """A client: the times of its steps."""
    env = rodgym.remote.connect(address, ENV, 64)
    call = stepper(env, 64)
    barrier.wait()
    results.put(take_turns([call], rounds)[0])
    barrier.wait()
    env.close()


def crowd(server: Server, rounds: int) -> Target:
    """Whether many clients are served alike."""
    barrier, results = CONTEXT.Barrier(CLIENTS), CONTEXT.Queue()
    clients = [
        CONTEXT.Process(target=one_of_many, args=(server.address, rounds, barrier, results))
        for _ in range(CLIENTS)
    ]
    for client in clients:
        client.start()
    samples = [results.get(timeout=600).ravel() for _ in clients]
    for client in clients:
        client.join()
    median = float(np.median(np.concatenate(samples)))
    worst = max(float(np.quantile(sample, 0.99)) for sample in samples)
    total = sum(64 / sample.mean() for sample in samples)
    return Target(
        f"{CLIENTS} clients of 64: worst client's p99 over the median step of all",
        "<= 5",
        f"{worst / median:.2f} ({1e6 * worst:.0f} us over {1e6 * median:.0f}; "
        f"{total / 1e3:.0f} k environment steps/s in all)",
        worst <= 5 * median,
    )


def training(server: Server, rounds: int) -> list[Target]:
    """PPO with the recipe's sizes, in process and over the wire by turns."""
    import torch
    from stable_baselines3 import PPO

    torch.set_num_threads(1)

    def learn(**place: str) -> tuple[float, dict[str, Any], list[float]]:
        env = rodgym.sb3.make_vec_env(ENV, 64, seed=3, max_episode_steps=200, **place)
        model = PPO(
            "MlpPolicy", env, n_steps=128, batch_size=1024, n_epochs=10, gamma=0.98,
            learning_rate=1e-3, policy_kwargs={"net_arch": [64, 64]}, seed=3, device="cpu",
        )  # fmt: skip
        began = time.perf_counter()
        model.learn(4 * 64 * 128)
        seconds = time.perf_counter() - began
        env.close()
        returns = [episode["r"] for episode in model.ep_info_buffer]
        return seconds, model.policy.state_dict(), returns

    ratios, equal = [], True
    for _ in range(rounds):
        here, weights, returns = learn()
        there, others, other_returns = learn(server=server.address)
        ratios.append(there / here)
        same = all(torch.equal(weights[name], others[name]) for name in weights)
        equal = equal and same and returns == other_returns
    slower = spread(np.array(ratios))
    return [
        Target(
            "SB3 PPO, 32 768 steps: time over the wire, over local",
            "<= 1.25",
            str(slower),
            slower.median <= 1.25,
        ),
        Target(
            "its weights and episode returns",
            "same bits",
            "same bits" if equal else "other bits",
            equal,
        ),
    ]


def main() -> int:
    """Measures, prints a page, compares with the targets."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=40, help="turns of each case")
    parser.add_argument("--page", type=Path, help="also write the page there")
    arguments = parser.parse_args()
    rounds = arguments.rounds
    facts = {**provenance(), **machine()}
    targets: list[Target] = []
    rows = []
    with serving() as server:
        for num_envs in (1, 64, 1024, 4096):
            found, row = wire(server, num_envs, max(4, rounds * 64 // max(64, num_envs)))
            targets += found
            rows.append(row)
        targets.append(curve(rounds))
        targets.append(crowd(server, rounds))
        targets += training(server, max(2, rounds // 10))
    about = "; ".join(
        f"{key.replace('_', ' ')} {facts[key]}"
        for key in ("processor", "machine", "instruction_set", "load_average", "date")
    )
    header = (
        "environments", "echo [us]", "answered from memory [us]", "local step [us]",
        "remote step [us]", "wire part in echoes", "of local throughput",
    )  # fmt: skip
    page = "\n\n".join(
        [
            "# Measured speed of remote environments",
            f"`make bench-remote`: {about}; libzmq {zmq.zmq_version()}.",
            "Client and server on one machine, over TCP. The echo is a ZeroMQ ROUTER that answers "
            "with the frames of a step's reply and does nothing else. Medians of rounds in which "
            f"the cases take turns of {TURN} calls; ratios are of one round each, with quartiles "
            "in brackets. A load average near the number of cores means that others were at work. "
            "The local batch steps on one thread; the server has its defaults, so that a long step "
            "uses the cores that are idle.",
            "## Targets",
            targets_table(targets),
            "## A step over the wire",
            "*Answered from memory* is a request that the server has answered before: all of the "
            "protocol but no physics. *Wire part* is what a remote step takes beyond a local one.",
            table(header, rows),
        ]
    )
    print(page)
    if arguments.page:
        arguments.page.write_text(page + "\n")
    return 0 if all(target.reached for target in targets) else 1


if __name__ == "__main__":
    sys.exit(main())
