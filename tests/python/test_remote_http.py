"""Promise: the local port tells health and counters, the live page shows the rods moving, and
neither is there for other machines or other pages."""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import threading
import time
import urllib.error
import urllib.request

import numpy as np
import pytest
from conftest import SWING_UP
from remote_helpers import need_server, serving, until

need_server()

import rodgym.remote  # noqa: E402

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


def get(url: str, **headers: str) -> tuple[int, str]:
    request = urllib.request.Request(url, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=5) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


def metric(text: str, name: str) -> float:
    lines = [line for line in text.splitlines() if line.startswith(f"rodgym_{name} ")]
    assert len(lines) == 1, name
    return float(lines[0].split()[1])


@pytest.fixture(scope="module")
def server():
    with serving("--http", "127.0.0.1:0", "--live") as server:
        yield server


def test_health_and_counters(server):
    env = rodgym.remote.connect(server.address, SWING_UP, 8)
    env.reset(seed=0)
    before = get(f"{server.http}/metrics")[1]
    for _ in range(5):
        env.step(np.zeros((8, 1)))
    assert get(f"{server.http}/healthz") == (200, "ok\n")
    assert get(f"{server.http}/readyz") == (200, "ready\n")
    after = get(f"{server.http}/metrics")[1]
    assert metric(after, "env_steps_total") - metric(before, "env_steps_total") == 40
    assert metric(after, "step_seconds_count") - metric(before, "step_seconds_count") == 5
    assert metric(after, "sessions") == 1
    env.close()
    assert metric(get(f"{server.http}/metrics")[1], "sessions") == 0
    assert get(f"{server.http}/nothing")[0] == 404


def test_pages_of_other_sites_cannot_read_the_port(server):
    assert get(f"{server.http}/metrics", Host="evil.example:80")[0] == 403
    assert get(f"{server.http}/metrics", Host="localhost:1234")[0] == 200


def test_the_port_is_for_this_machine_and_the_page_is_off_by_default():
    with pytest.raises(AssertionError, match="this machine only"):
        with serving("--http", "0.0.0.0:0"):
            pass
    with serving("--http", "127.0.0.1:0") as server:
        assert get(f"{server.http}/live")[0] == 404
        assert get(f"{server.http}/events")[0] == 404


@pytest.fixture
def moving(server):
    """A session that steps in the background."""
    env = rodgym.remote.connect(server.address, SWING_UP, 2)
    env.reset(seed=0)
    stop = threading.Event()

    def play() -> None:
        while not stop.is_set():
            env.step(np.ones((2, 1)))
            time.sleep(0.01)

    thread = threading.Thread(target=play)
    thread.start()
    yield env
    stop.set()
    thread.join()
    env.close()


def tip(event: dict) -> tuple[float, ...]:
    if not event["shown"]:
        return ()
    scene = event["shown"][0]["scenes"][0]
    return scene["x"][-1], scene["y"][-1]


def test_events_show_the_rods_moving(server, moving):
    seen = []
    with urllib.request.urlopen(f"{server.http}/events", timeout=5) as stream:
        while len({tip(event) for event in seen}) < 5:
            line = stream.readline().decode()
            if line.startswith("data: "):
                seen.append(json.loads(line[6:]))
    shown = [event["shown"][0] for event in seen if event["shown"]]
    assert shown[-1]["id"] == SWING_UP and shown[-1]["envs"] == 2
    assert moving._batch.native._sid not in json.dumps(seen), "session numbers are secrets"
    assert seen[-1]["sessions"] == 1 and seen[-1]["rate"] > 0


class Browser:
    """Headless Chromium, spoken to over its debugging pipe (JSON between zero bytes)."""

    def __init__(self, page: str, profile: str) -> None:
        theirs_in, self.out = os.pipe()
        self.into, theirs_out = os.pipe()
        flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=900,600"]
        # Nothing but our page is to be asked for.
        flags += ["--no-first-run", "--disable-background-networking", "--disable-sync"]
        flags += ["--disable-component-update"]

        def descriptors() -> None:
            os.dup2(theirs_in, 3)
            os.dup2(theirs_out, 4)

        self.process = subprocess.Popen(
            [CHROMIUM, *flags, f"--user-data-dir={profile}", "--remote-debugging-pipe"],
            close_fds=False,
            preexec_fn=descriptors,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(theirs_in)
        os.close(theirs_out)
        self.buffer = b""
        self.number = 0
        self.session: str | None = None
        target = self.ask("Target.createTarget", url=page)["targetId"]
        self.session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]

    def ask(self, method: str, **parameters: object) -> dict:
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.out, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self.buffer:
                assert select.select([self.into], [], [], 60)[0], "Chromium does not answer"
                self.buffer += os.read(self.into, 1 << 20)
            answer, self.buffer = self.buffer.split(b"\0", 1)
            if json.loads(answer).get("id") == self.number:
                return json.loads(answer)["result"]

    def evaluate(self, expression: str) -> object:
        return self.ask("Runtime.evaluate", expression=expression)["result"].get("value")

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self.out)
        os.close(self.into)


@pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium for the live page (Debian: apt-get install chromium)"
)
def test_the_live_page_draws_moving_rods_in_a_browser(server, moving, tmp_path):
    browser = Browser(f"{server.http}/live", str(tmp_path / "profile"))
    try:
        until(lambda: browser.evaluate("document.querySelectorAll('canvas').length") == 1, 30)
        text = browser.evaluate("document.body.innerText")
        for word in (SWING_UP.removeprefix("rodgym/"), "environment steps / s", "2 environments"):
            assert word in text
        picture = "document.querySelector('canvas').toDataURL()"
        pictures = set()
        until(lambda: pictures.add(browser.evaluate(picture)) or len(pictures) > 3, 30)
        # The colours of a bent rod, orange or blue, are on the canvas, not only its frame.
        drawn = """(() => {
            const canvas = document.querySelector('canvas');
            const { width, height } = canvas;
            const all = canvas.getContext('2d').getImageData(0, 0, width, height).data;
            let count = 0;
            for (let i = 0; i < all.length; i += 4) {
                const [red, green, blue] = all.slice(i, i + 3);
                count += red > blue + 80 || (blue > red + 80 && blue > green + 50);
            }
            return count;
        })()"""
        until(lambda: browser.evaluate(drawn) > 100, 30)
        (tmp_path / "live.png").write_bytes(
            base64.b64decode(browser.ask("Page.captureScreenshot")["data"])
        )
    finally:
        browser.close()
