"""A controller's file: the same bits wherever it is read, and refused where it is none."""

from __future__ import annotations

import pickle
import shutil
import struct
import subprocess
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from rodgym import baselines
from rodgym.errors import ParameterError, SnapshotError

ROOT = Path(__file__).parents[2]
BASE = "rodgym/PendulumSwingUpBase-v0"
NOISE = {"angle": 1e-3, "rate": 1e-2}
CASES = [
    ("lqr", "rodgym/PendulumSwingUp-v0", {"nodes": 13}),
    ("lqr-hybrid", "rodgym/PendulumSwingUp-v0", {}),
    ("lqg", BASE, {"actuator_delay": 0.02, "sensor_noise": NOISE}),
    ("lqg-adaptive", BASE, {"sensor_noise": NOISE}),
    ("thesis-lqr", "rodgym/PendulumSwingUp-v0", {}),
    ("thesis-lqg", BASE, {}),
    ("gait-triangle", "rodgym/FinThrust-v0", {"youngs_modulus": 2.5e5}),
    ("gait-adaptive", "rodgym/FinThrust-v0", {"youngs_modulus": 2.5e5}),
]


@pytest.mark.parametrize(("name", "env_id", "keywords"), CASES, ids=lambda case: str(case))
def test_a_controller_from_a_file_takes_the_same_bits(name, env_id, keywords, tmp_path):
    env = gym.make(env_id, **keywords)
    made = baselines.make(name, env)
    read = baselines.load(made.save(tmp_path / "law"))
    assert type(read) is type(made) and repr(read) == repr(made)
    assert read.config == made.config and read.parameters == made.parameters
    read.fits(env)
    again = pickle.loads(pickle.dumps(read))
    observation, _ = env.reset(seed=1)
    states = [None, None, None]
    for _ in range(60):
        answers = [
            law.predict(observation, state)
            for law, state in zip((made, read, again), states, strict=True)
        ]
        actions, states = zip(*answers, strict=True)
        assert len({action.tobytes() for action in actions}) == 1
        assert len({state.tobytes() for state in states}) == 1
        observation, *_ = env.step(actions[0])


def test_what_is_no_controllers_file_is_refused(tmp_path):
    file = baselines.make("lqr", gym.make("rodgym/PendulumSwingUp-v0")).save(tmp_path / "law")
    whole = file.read_bytes()
    for data, words in [
        (b"", "0 bytes"),
        (b"PK\x03\x04 and so on, as a policy begins", "RODLAW"),
        (whole[:-1], "header"),
        (whole[:100] + bytes([whole[100] ^ 1]) + whole[101:], "damaged"),
        (whole[:6] + b"\x63" + whole[7:], "version 99"),
    ]:
        file.write_bytes(data)
        with pytest.raises(SnapshotError, match=words):
            baselines.load(file)
    with pytest.raises(FileNotFoundError):
        baselines.load(tmp_path / "none")
    with pytest.raises(ParameterError, match="data"):
        baselines.load.__globals__["_native"].Controller.load("text")


def test_a_program_in_c_takes_the_bits_of_python(tmp_path):
    """`baselines-c/tests/play.c` plays what Python saved, and writes the bits of its actions."""
    library = ROOT / "target/debug/deps/librodgym_controllers.a"
    if not library.exists() or shutil.which("cc") is None:
        pytest.skip("needs cc, and the library that `cargo test -p rodgym-controllers` builds")
    program = tmp_path / "play"
    source, header = ROOT / "baselines-c/tests/play.c", ROOT / "baselines-c/include"
    system = ["-lpthread", "-ldl", "-lm"]
    command = ["cc", "-std=c99", source, f"-I{header}", library, *system, "-o", program]
    subprocess.run(command, check=True)

    env = gym.make(BASE, sensor_noise=NOISE, youngs_modulus=8e6)
    law = baselines.make("lqg-adaptive", env)
    observation, _ = env.reset(seed=5)
    state, seen, wanted = None, [], []
    for _ in range(200):
        seen.append(observation)
        action, state = law.predict(observation, state)
        wanted.append(f"{struct.unpack('<I', struct.pack('<f', action[0]))[0]:08x}")
        observation, *_ = env.step(action)
    wanted += [f"{bits:016x}" for bits in state[0].view(np.uint64)]
    seen_file = tmp_path / "seen"
    seen_file.write_bytes(np.array(seen, np.float32).tobytes())
    played = subprocess.run(
        [program, law.save(tmp_path / "law"), seen_file], check=True, capture_output=True, text=True
    )
    assert played.stdout.split() == wanted
