"""Promise: results do not depend on the instruction set; `RODGYM_ISA` chooses one."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from rodgym import _native

#: Every stepper and every random draw, in batches that leave lanes empty.
PROGRAM = """
import hashlib, gymnasium as gym, numpy as np, rodgym
random = {"randomize": {"width": (0.006, 0.009)}, "sensor_noise": {"angle": 1e-3, "rate": 1e-2}}
digest = hashlib.sha256()
pendulum, fins = "rodgym/PendulumSwingUp-v0", ("rodgym/FinThrust-v0", "rodgym/FinSwim-v0")
cases = [(pendulum, random), (pendulum, {"stepper": "implicit", "physics_dt": 1e-3})]
cases += [(pendulum, {"stepper": word}) for word in ("bdf2", "tr_bdf2", "esdirk3")]
cases += [(pendulum, {"thesis": True}), *((fin, {}) for fin in fins)]
for id, kwargs in cases:
    env = gym.make_vec(id, num_envs=21, max_episode_steps=12, **kwargs)
    digest.update(env.reset(seed=3)[0].tobytes())
    for action in np.random.default_rng(0).uniform(-1, 1, (30, 21, 1)):
        observation, reward = env.step(action)[:2]
        digest.update(observation.tobytes() + reward.tobytes())
print(rodgym._native.instruction_set(), digest.hexdigest())
"""


def run(isa: str, program: str = PROGRAM) -> str:
    """What a program prints in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "RODGYM_ISA": isa},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


def test_same_bits_with_every_instruction_set():
    used, expected = run("baseline").split()
    assert used == "baseline"
    for isa in _native.INSTRUCTION_SETS[1:]:
        assert run(isa).split() == [isa, expected]


def test_no_name_means_the_fastest():
    assert run("").split()[0] == _native.INSTRUCTION_SETS[-1]


@pytest.mark.parametrize("code", ["rodgym._native.instruction_set()", "gym.make(id)"])
def test_an_unknown_name_is_refused_with_those_that_the_machine_has(code):
    program = f"""
import gymnasium as gym, rodgym
id = "rodgym/PendulumSwingUp-v0"
try:
    {code}
except rodgym.RodgymError as error:
    print(error)
"""
    said = run("mmx", program)
    assert "RODGYM_ISA = mmx" in said
    assert all(f"'{isa}'" in said for isa in _native.INSTRUCTION_SETS)
