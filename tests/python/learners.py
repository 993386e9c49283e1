"""Models of Stable-Baselines3 after a few steps, and what Stable-Baselines3 itself says of them."""

from __future__ import annotations

from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy


def learn(venv, algorithm=PPO, steps=256, **keywords):
    """A model after a few steps: its statistics and its last observation are there."""
    if algorithm is PPO:
        keywords = {"n_steps": 32, "batch_size": 64, "n_epochs": 1, **keywords}
    return algorithm("MlpPolicy", venv, seed=0, device="cpu", **keywords).learn(steps)


def judged_by_sb3(model, venv, seed=0):
    """Returns of one episode an environment, by Stable-Baselines3's own evaluation."""
    venv.training = False
    venv.seed(seed)
    returns, _ = evaluate_policy(
        model, venv, n_eval_episodes=venv.num_envs, return_episode_rewards=True, warn=False
    )
    return sorted(returns)
