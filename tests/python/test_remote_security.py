"""Promise: with keys, only those whose key is there come in, only for as long, and nobody reaches
another's session."""

from __future__ import annotations

import shutil
import signal
import stat
import subprocess
import sys
import time

import numpy as np
import pytest
from conftest import SWING_UP
from remote_helpers import counter, need_server, serving, until

need_server()

import rodgym.remote  # noqa: E402
from rodgym import _native  # noqa: E402
from rodgym.errors import ParameterError  # noqa: E402
from rodgym.remote import (  # noqa: E402
    AuthenticationError,
    LimitError,
    RemoteTimeoutError,
    SessionLostError,
)
from rodgym.remote.connection import Address, Connection  # noqa: E402


def keygen(directory) -> None:
    assert _native.serve(["keygen", str(directory)]) == 0


@pytest.fixture
def keys(tmp_path):
    """A server's key directory with users ada and bob, whose directories are beside it."""
    for name in ("server", "ada", "bob", "eve"):
        keygen(tmp_path / name)
    for name in ("ada", "bob"):
        shutil.copy(tmp_path / name / "public.key", tmp_path / f"server/authorized/{name}.key")
    return tmp_path


def connect(server, keys, name, **arguments):
    return rodgym.remote.connect(
        server.address,
        SWING_UP,
        keys=keys / name,
        server_key=keys / "server/public.key",
        **{"timeout": 5.0, **arguments},
    )


def test_a_user_with_a_key_comes_in_and_is_known_by_name(keys):
    with serving("--keys", str(keys / "server"), bind="tcp://0.0.0.0:0") as server:
        port = server.address.rsplit(":", 1)[1]
        address = f"tcp://127.0.0.1:{port}"
        public = (keys / "server/public.key").read_text().split("public = ")[1].strip()
        about = rodgym.remote.ping(address, keys=keys / "ada", server_key=public)
        assert about["user"] == "ada"
        log = server.log
        assert "admitted" in log and "ada" in log


def test_a_stranger_is_refused_at_once_and_told_so(keys):
    with serving("--keys", str(keys / "server")) as server:
        began = time.monotonic()
        with pytest.raises(AuthenticationError, match="refused our key"):
            connect(server, keys, "eve", timeout=30.0)
        assert time.monotonic() - began < 5.0
        connect(server, keys, "ada").close()


def test_a_client_without_or_with_other_keys_is_told_what_is_wrong(keys):
    with serving("--keys", str(keys / "server")) as server:
        with pytest.raises(RemoteTimeoutError, match=r"handshake|closed the connection"):
            rodgym.remote.ping(server.address, timeout=1.5)
        with pytest.raises(RemoteTimeoutError, match=r"CURVE.*(handshake|closed the connection)"):
            rodgym.remote.ping(
                server.address,
                keys=keys / "ada",
                server_key=keys / "eve/public.key",
                timeout=1.5,
            )
    with pytest.raises(AuthenticationError, match="belong together"):
        rodgym.remote.ping(server.address, keys=keys / "ada")


def test_sessions_of_others_do_not_exist(keys):
    with serving("--keys", str(keys / "server")) as server:
        env = connect(server, keys, "ada")
        env.reset(seed=1)
        sid = env._batch.native._sid
        thief = Connection(
            Address(server.address, str(keys / "bob"), str(keys / "server/public.key"), 5.0)
        )
        for op in ("info", "get_state", "close", "step", "touch"):
            with pytest.raises(SessionLostError):
                thief.request(op, sid=sid, seq=2, arrays={"action": np.zeros((1, 1), "<f4")})
        thief.close()
        env.step(np.zeros((1, 1)))
        env.close()


def test_a_removed_key_loses_its_sessions_within_five_seconds(keys):
    with serving("--keys", str(keys / "server"), "--http", "127.0.0.1:0") as server:
        ada, bob = (connect(server, keys, name) for name in ("ada", "bob"))
        for env in (ada, bob):
            env.reset(seed=1)
        (keys / "server/authorized/ada.key").unlink()
        until(lambda: counter(server, "sessions_revoked_total") == 1, 5.0)
        with pytest.raises(AuthenticationError, match="removed"):
            ada.step(np.zeros((1, 1)))
        bob.step(np.zeros((1, 1)))
        with pytest.raises(AuthenticationError):
            connect(server, keys, "ada")
        # The key comes back: the old session does not.
        shutil.copy(keys / "ada/public.key", keys / "server/authorized/ada.key")
        time.sleep(1.5)
        with pytest.raises(SessionLostError):
            ada.step(np.zeros((1, 1)))
        connect(server, keys, "ada").close()
        bob.close()


def test_a_replaced_key_shuts_out_connections_made_with_the_old_one(keys):
    with serving("--keys", str(keys / "server")) as server:
        env = connect(server, keys, "ada")
        env.reset(seed=1)
        shutil.copy(keys / "eve/public.key", keys / "server/authorized/ada.key")
        time.sleep(2.0)
        with pytest.raises(AuthenticationError):
            env.step(np.zeros((1, 1)))


def test_limits_of_a_name_hold(keys):
    with (keys / "server/authorized/bob.key").open("a") as file:
        file.write("sessions = 1\nenvs = 4\n")
    with serving("--keys", str(keys / "server")) as server:
        with pytest.raises(LimitError, match="1 to 4"):
            connect(server, keys, "bob", num_envs=5)
        first = connect(server, keys, "bob", num_envs=4)
        with pytest.raises(LimitError, match="1 are allowed"):
            connect(server, keys, "bob")
        connect(server, keys, "ada", num_envs=5).close()
        first.close()


def test_the_program_makes_keys_and_serves(tmp_path):
    program = [sys.executable, "-m", "rodgym", "serve"]
    made = subprocess.run([*program, "keygen", str(tmp_path / "k")], capture_output=True, text=True)
    assert made.returncode == 0 and "public key" in made.stdout
    helped = subprocess.run([*program, "--help"], capture_output=True, text=True)
    assert "--insecure-no-auth" in helped.stdout
    wrong = subprocess.run([*program, "--bnid", "x"], capture_output=True, text=True)
    assert wrong.returncode == 1 and "--bnid" in wrong.stderr
    bind = ["--bind", "tcp://127.0.0.1:0", "--log", "error"]
    with subprocess.Popen([*program, *bind], stdout=subprocess.PIPE, text=True) as process:
        line = process.stdout.readline()
        assert rodgym.remote.ping(line.split()[-1])["user"] == "local"
        process.terminate()
        assert process.wait(10) == 0


def test_a_second_signal_stops_the_server_at_once_under_python_too():
    """Python's own handlers cannot run while Rust holds the thread."""
    program = [sys.executable, "-m", "rodgym", "serve", "--bind", "tcp://127.0.0.1:0"]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as process:
        assert "listens at" in process.stdout.readline()
        # Two of a kind could become one before they are seen.
        process.send_signal(signal.SIGTERM)
        process.send_signal(signal.SIGINT)
        assert process.wait(10) in (128 + signal.SIGTERM, 128 + signal.SIGINT)


def test_secret_keys_are_private_and_never_overwritten(keys):
    secret = keys / "server/secret.key"
    assert stat.S_IMODE(secret.stat().st_mode) == 0o600
    before = secret.read_text()
    assert _native.serve(["keygen", str(keys / "server")]) == 1
    assert secret.read_text() == before
    secret.chmod(0o640)
    with pytest.raises(AssertionError, match="chmod 600"):
        with serving("--keys", str(keys / "server")):
            pass
    secret.chmod(0o600)
    (keys / "ada/secret.key").chmod(0o644)
    with serving("--keys", str(keys / "server")) as server:
        with pytest.raises(ParameterError, match="chmod 600"):
            connect(server, keys, "ada")


def test_a_key_file_that_cannot_be_understood_admits_nobody(keys):
    (keys / "server/authorized/ada.key").write_text("public = short\n")
    (keys / "server/authorized/b b.key").write_text("nonsense\n")
    with serving("--keys", str(keys / "server")) as server:
        with pytest.raises(AuthenticationError):
            connect(server, keys, "ada")
        assert "ignored" in server.log
        connect(server, keys, "bob").close()


def test_encryption_leaves_the_trajectory_unchanged(keys):
    with serving("--keys", str(keys / "server")) as server:
        remote = connect(server, keys, "ada", num_envs=3)
        local = rodgym.vector.RodVectorEnv(SWING_UP, 3)
        assert np.array_equal(remote.reset(seed=5)[0], local.reset(seed=5)[0])
        for _ in range(5):
            action = np.full((3, 1), 0.5)
            assert np.array_equal(remote.step(action)[0], local.step(action)[0])
        remote.close()
