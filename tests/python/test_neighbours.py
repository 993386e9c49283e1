"""Promise: libraries of others work on these environments as their own users would write it.

`make neighbours` has them in an environment of its own; elsewhere each test is skipped by the name
of the package that is missing.
"""

from __future__ import annotations

import importlib
import os
import runpy
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import rodgym

SWING_UP = "rodgym/PendulumSwingUp-v0"
#: What LeRobot loads from a repository.
HUB = Path(__file__).parents[2] / "packaging" / "envhub" / "env.py"

pytestmark = pytest.mark.filterwarnings("ignore")


def need(name: str):
    """The module; where `make neighbours` runs, its absence is a failure."""
    if os.environ.get("RODGYM_NEED_NEIGHBOURS"):
        return importlib.import_module(name)
    return pytest.importorskip(name, reason=f"needs {name}: make neighbours")


def test_torchrl_rolls_out_single_environments_and_native_batches():
    envs = need("torchrl.envs")
    env = envs.GymEnv("rodgym:" + SWING_UP)
    path = env.rollout(20)
    assert path["observation"].shape == (20, 18) and path["next", "reward"].shape == (20, 1)
    batch = envs.GymWrapper(gym.make_vec(SWING_UP, num_envs=4, autoreset_mode="Disabled"))
    assert batch.rollout(10, break_when_any_done=False)["observation"].shape[:2] == (4, 10)


def test_minari_collects_episodes_with_their_infos(tmp_path, monkeypatch):
    minari, _ = need("minari"), need("jax")  # Its collector needs JAX.
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    env = minari.DataCollector(gym.make(SWING_UP, max_episode_steps=15), record_infos=True)
    for seed in range(2):
        env.reset(seed=seed)
        for _ in range(15):
            env.step(env.action_space.sample())
    data = env.create_dataset(dataset_id="rodgym/random-v0", algorithm_name="random")
    env.close()
    assert data.total_episodes == 2 and data.total_steps == 30
    assert {"tip_height", "reward_terms"} <= set(data[0].infos)
    assert data.recover_environment().spec.id == SWING_UP


def test_tianshou_collects_from_its_vector_of_environments():
    data, env = need("tianshou.data"), need("tianshou.env")
    vector = env.DummyVectorEnv([lambda: gym.make("rodgym:" + SWING_UP, max_episode_steps=10)] * 2)
    vector.seed([0, 1])
    observations, _ = vector.reset()
    assert np.shape(observations) == (2, 18)
    buffer = data.VectorReplayBuffer(40, 2)
    for _ in range(12):
        actions = np.zeros((2, 1), np.float32)
        after, rewards, terminated, truncated, _ = vector.step(actions)
        buffer.add(
            data.Batch(
                obs=observations,
                act=actions,
                rew=rewards,
                terminated=terminated,
                truncated=truncated,
                obs_next=after,
                info=[{}, {}],
            )
        )
        observations = after
        if (ended := np.flatnonzero(truncated)).size:
            observations[ended], _ = vector.reset(ended)
    assert len(buffer) == 24


def test_skrl_wraps_the_native_batch():
    wrappers = need("skrl.envs.wrappers.torch")
    import torch

    env = wrappers.wrap_env(gym.make_vec(SWING_UP, num_envs=3), wrapper="gymnasium")
    assert env.num_envs == 3
    observations, _ = env.reset()
    assert observations.shape == (3, 18)
    observations, rewards, terminated, *_ = env.step(torch.zeros((3, 1)))
    assert rewards.shape == (3, 1) and terminated.shape == (3, 1)


def test_rl_zoo3_trains_by_its_own_command_line(tmp_path):
    need("rl_zoo3")
    recipe = tmp_path / "ppo.yml"
    recipe.write_text(
        f"{SWING_UP}:\n  n_timesteps: 256\n  policy: MlpPolicy\n  n_envs: 2\n  n_steps: 64\n"
        "  batch_size: 32\n  n_epochs: 1\n"
    )
    command = [
        *(sys.executable, "-m", "rl_zoo3.train", "--algo", "ppo", "--env", SWING_UP),
        *("--gym-packages", "rodgym", "--conf-file", str(recipe), "--log-folder", str(tmp_path)),
        *("--env-kwargs", "width:0.0081", "--eval-freq", "-1", "--verbose", "0"),
    ]
    ran = subprocess.run(command, cwd=tmp_path, text=True, capture_output=True)
    assert ran.returncode == 0, ran.stderr[-2000:]
    assert list(tmp_path.rglob("*.zip"))


def test_what_is_handed_to_the_hub_makes_every_environment(monkeypatch):
    """EnvHub calls `make_env` of a file; it needs no package of LeRobot's."""
    names = runpy.run_path(str(HUB))
    suites = names["make_env"](n_envs=2)
    assert [env.spec.id for env in suites["rodgym"].values()] == list(rodgym.ENVIRONMENTS)
    for env in suites["rodgym"].values():
        env.reset(seed=0)
        assert env.step(np.zeros((2, 1)))[1].shape == (2,)
    monkeypatch.setenv("RODGYM_TASK", SWING_UP)
    (env,) = names["make_env"]()["rodgym"].values()
    for _ in range(2):
        env.reset(seed=0)
        for _ in range(env.max_episode_steps):
            *_, infos = env.step(np.zeros((1, 1)))
        assert infos["final_info"]["tip_height"].shape == (1,)
