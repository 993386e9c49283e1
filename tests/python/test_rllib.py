"""RLlib learns in native batches, and its episodes are those of single environments."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from argparse import Namespace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from conftest import RANDOM, SWING_UP
from ray_helpers import need_ray, short_folder
from remote_helpers import serving

need_ray("ray.rllib", "RLlib pins Gymnasium, so it has an environment of its own: make ray")

import rllib_ppo  # noqa: E402
import rodgym.evaluation  # noqa: E402
import rodgym.ray  # noqa: E402

# RLlib's own.
pytestmark = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::UserWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
EXAMPLE = Path(rllib_ppo.__file__)


@pytest.fixture(scope="module")
def cluster():
    import torch

    torch.set_num_threads(1)
    with short_folder() as folder, rodgym.ray.cluster("local", 2, _temp_dir=folder):
        rodgym.ray.register()
        yield


def asked(**changes):
    return Namespace(**{"runners": 1, "envs": 64, "server": None, **changes})


def test_ppo_raises_the_return_in_native_batches(cluster):
    config = rllib_ppo.config(asked())
    # Every iteration plays 64 episodes to their end.
    config.environment(env_config={"max_episode_steps": 250})
    algorithm = config.training(train_batch_size_per_learner=64 * 250).build_algo()
    (runner,) = algorithm.env_runner_group.foreach_env_runner(
        lambda r: (
            type(r.env.unwrapped).__name__,
            r.env.num_envs,
            r.env.unwrapped.num_threads,
            os.environ["OMP_NUM_THREADS"],
        ),
        local_env_runner=False,
    )
    assert runner == ("RodVectorEnv", 64, 1, "1")

    def score():
        policy = rodgym.ray.ModulePolicy(algorithm.get_module())
        kwargs = {"max_episode_steps": 250}
        return rodgym.evaluation.evaluate(policy, SWING_UP, range(20), env_kwargs=kwargs)

    untrained = score().mean("return")
    returns = []
    for _ in range(6):
        found = algorithm.train()["env_runners"]
        if "episode_return_mean" in found:
            returns.append(found["episode_return_mean"])
    print("returns:", [round(value, 1) for value in returns])
    trained = score().mean("return")
    algorithm.stop()
    assert returns[-1] > 1.2 * returns[0]
    assert trained > untrained and trained > returns[0]


@pytest.mark.parametrize("where", ["local", "server"])
def test_episodes_are_those_of_single_environments(cluster, where):
    """Every observation, reward and flag, over two resets: no step is lost to the autoreset."""
    envs, steps = 3, 20
    short = {"max_episode_steps": steps, **RANDOM}
    with serving() if where == "server" else contextlib.nullcontext() as server:
        config = rllib_ppo.config(asked(runners=0, envs=envs))
        config.environment(env_config={**short, **({"server": server.address} if server else {})})
        # RLlib stores what its network drew; else it would also scale [-1, 1] to [-1, 1] and round.
        config.environment(normalize_actions=False, clip_actions=True)
        algorithm = config.debugging(seed=11).build_algo()
        episodes = algorithm.env_runner.sample(num_timesteps=2 * envs * steps, explore=True)
        algorithm.stop()
    assert len(episodes) >= 2 * envs
    words = np.random.SeedSequence(11).generate_state(envs, np.uint64)
    for seed in (words >> np.uint64(1)).tolist():
        env = gym.make(SWING_UP, **short)
        observation, _ = env.reset(seed=seed)
        for _ in range(2):
            (episode,) = [e for e in episodes if (e.get_observations(0) == observation).all()]
            assert len(episode) == steps and episode.is_truncated and not episode.is_terminated
            for t in range(steps):
                observation, reward, *_ = env.step(np.clip(episode.get_actions(t), -1, 1))
                assert (episode.get_observations(t + 1) == observation).all()
                assert episode.get_rewards(t) == reward
            observation, _ = env.reset()


def test_the_example_trains_on_a_server_and_meets_the_lqr():
    with serving() as server, short_folder() as folder:
        command = [sys.executable, str(EXAMPLE), "--iterations", "1", "--seeds", "2", "--envs", "8"]
        command += ["--server", server.address]
        done = subprocess.run(
            command, capture_output=True, text=True, env={**os.environ, "RAY_TMPDIR": folder}
        )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].startswith("iteration   1     8192 steps")
    lqr, ppo = ([c for c in lines if c.startswith(name)] for name in ("LQR", "RLlib PPO"))
    assert len(ppo) == len(lqr) == 1
    assert float(lqr[0].split()[1]) > 400


def test_the_example_explains_itself():
    command = [sys.executable, str(EXAMPLE), "--help"]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "--server" in text and "LQR" in text
