"""Promise: docs/protocol.md is complete: a client written from it alone, in another language,
understands the golden frames and gets the same bits from a live server."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from conftest import SWING_UP
from remote_helpers import Proxy, need_server, serving

need_server()

from rodgym.vector import RodVectorEnv  # noqa: E402

CLIENTS = Path(__file__).parents[2] / "docs" / "clients"

needs_node = pytest.mark.skipif(
    shutil.which("node") is None, reason="Node is not installed (any version from 18 on)"
)


def node(*arguments: str) -> str:
    command = ["node", str(CLIENTS / "node" / "check.mjs"), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@needs_node
def test_the_golden_frames_are_understood():
    lines = len((CLIENTS / "golden.jsonl").read_text().splitlines())
    assert node("golden", str(CLIENTS / "golden.jsonl")) == f"{lines} exchanges understood\n"


@needs_node
@pytest.mark.parametrize("broken", [False, True])
def test_a_trajectory_equals_the_local_one(broken):
    with serving() as server:
        address = server.address
        if broken:
            # Every connection is cut somewhere in its replies.
            proxy = Proxy(address, iter([150, 700, 4500, 2500, 1700, 900]), "down")
            address = proxy.address
        host, port = address.removeprefix("tcp://").rsplit(":", 1)
        lines = [
            json.loads(line) for line in node("live", host, port, SWING_UP, "3", "12").splitlines()
        ]
    env = RodVectorEnv(SWING_UP, 2, max_episode_steps=5)
    observation, _ = env.reset(seed=3)
    assert lines[0]["obs"] == observation.tobytes().hex()
    for i, line in enumerate(lines[1:]):
        action = np.array([[math.sin(i)], [math.cos(i)]], dtype=np.float32)
        observation, reward, terminated, truncated, _ = env.step(action)
        assert line["obs"] == observation.tobytes().hex()
        assert line["reward"] == reward.tolist()
        assert [flag & 1 != 0 for flag in line["flags"]] == terminated.tolist()
        assert [flag & 2 != 0 for flag in line["flags"]] == truncated.tolist()
    assert len(lines) == 13
    if broken:
        assert proxy.cuts >= 3
        proxy.close()
