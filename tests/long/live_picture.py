"""Draws docs/images/live.png, the server's live page with some sessions on it: needs Chromium.

`PYTHONPATH=tests/python python tests/long/live_picture.py`, from an environment with the server
(`make server`).
"""

from __future__ import annotations

import base64
import contextlib
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import rodgym.remote
from remote_helpers import serving
from rodgym.errors import RodgymError
from rodgym.remote.connection import Address, Connection
from test_remote_http import Browser

PICTURE = Path(__file__).parents[2] / "docs" / "images" / "live.png"
SESSIONS = (
    ("rodgym/PendulumSwingUp-v0", 1, {}),
    ("rodgym/PendulumSwingUp-v0", 4, {"width": 0.009}),
    ("rodgym/PendulumSwingUp-v0", 64, {"nodes": 31}),
    ("rodgym/FinThrust-v0", 2, {}),
    ("rodgym/FinSwim-v0", 1, {}),
    ("rodgym/PendulumBalance-v0", 2, {}),
)


def play(env: rodgym.remote.RemoteVectorEnv, stop: threading.Event) -> None:
    """Sways with a phase of its own in each environment, in real time."""
    env.reset(seed=1)
    dt, phase = env.config["control_dt"], np.arange(env.num_envs)[:, np.newaxis]
    step = 0
    while not stop.wait(dt):
        env.step(np.sin(2 * np.pi * 1.1 * step * dt + phase).astype(np.float32))
        step += 1
    env.close()


def main() -> None:
    """Plays for some seconds, then takes the picture."""
    stop = threading.Event()
    with serving("--http", "127.0.0.1:0", "--live") as server:
        threads = []
        for env_id, num_envs, kwargs in SESSIONS:
            env = rodgym.remote.connect(server.address, env_id, num_envs, **kwargs)
            threads.append(threading.Thread(target=play, args=(env, stop)))
            threads[-1].start()
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
            browser = Browser(f"{server.http}/live", profile)
            size = {"width": 1180, "height": 930, "deviceScaleFactor": 1, "mobile": False}
            browser.ask("Emulation.setDeviceMetricsOverride", **size)
            stranger = Connection(Address(server.address))
            for _ in range(6):
                time.sleep(2.0)
                with contextlib.suppress(RodgymError):
                    stranger.request("info", sid="0" * 32)
            picture = browser.ask("Page.captureScreenshot")["data"]
            browser.close()
        stop.set()
        for thread in threads:
            thread.join()
    PICTURE.write_bytes(base64.b64decode(picture))


if __name__ == "__main__":
    main()
