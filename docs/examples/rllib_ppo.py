"""PPO of Ray RLlib swings the rod up, then meets the LQR on the same seeds under the same score.

Every env runner steps one native batch of rods. With --server the rods live on a rodgym server
(`rodgym serve`) instead, and the runners only ask for actions.

    pip install "rodgym[rllib]"
    python docs/examples/rllib_ppo.py --runners 2
"""

from __future__ import annotations

import argparse

import gymnasium as gym
import rodgym.evaluation
import rodgym.ray
import torch
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

ENV = "rodgym/PendulumSwingUp-v0"


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--iterations", type=int, default=60, help="of 8192 steps (default 60)")
    parser.add_argument(
        "--runners", type=int, default=1, help="env runners, a CPU each (default 1)"
    )
    parser.add_argument("--envs", type=int, default=64, help="rods of a runner (default 64)")
    parser.add_argument("--server", help="address such as tcp://127.0.0.1:5555 (default: none)")
    parser.add_argument("--ray", default="local", help="cluster: local, auto, ray://HOST:10001")
    parser.add_argument("--seeds", type=int, default=100, help="episodes to compare (default 100)")
    return parser.parse_args()


def config(args: argparse.Namespace) -> PPOConfig:
    """The numbers are those of our own recipe for Stable-Baselines3 (rodgym/zoo/ppo.yml)."""
    return (
        PPOConfig()
        .environment(ENV, env_config={"server": args.server} if args.server else {})
        .env_runners(
            num_env_runners=args.runners,
            num_envs_per_env_runner=args.envs,
            # One native batch; the default would step `envs` single environments one by one.
            gym_env_vectorize_mode=gym.VectorizeMode.VECTOR_ENTRY_POINT,
            rollout_fragment_length="auto",
        )
        .training(
            train_batch_size_per_learner=8192,
            minibatch_size=1024,
            num_epochs=10,
            gamma=0.98,
            lambda_=0.95,
            lr=1e-3,
            clip_param=0.2,
            # RLlib's defaults suit returns near 1; ours reach 500.
            vf_clip_param=float("inf"),
            vf_loss_coeff=0.5,
            use_kl_loss=False,
            grad_clip=0.5,
        )
        .rl_module(
            model_config=DefaultModelConfig(
                fcnet_hiddens=[64, 64], fcnet_activation="tanh", vf_share_layers=False
            )
        )
        .debugging(seed=0, log_level="ERROR")
    )


def main() -> None:
    args = arguments()
    # The learner's, in this process: such small networks are slower on more.
    torch.set_num_threads(1)
    with rodgym.ray.cluster(args.ray):
        rodgym.ray.register()
        algorithm = config(args).build_algo()
        for i in range(1, args.iterations + 1):
            found = algorithm.train()["env_runners"]
            mean = found.get("episode_return_mean", float("nan"))
            steps = int(found["num_env_steps_sampled_lifetime"])
            print(f"iteration {i:3d}  {steps:7d} steps  return {mean:6.1f}", flush=True)
        policy = rodgym.ray.ModulePolicy(algorithm.get_module())
        seeds = range(args.seeds)
        results = [
            rodgym.evaluation.evaluate(policy, ENV, seeds, name="RLlib PPO"),
            rodgym.evaluation.evaluate("lqr", ENV, seeds, name="LQR"),
        ]
        algorithm.stop()
    print(rodgym.evaluation.comparison_table(results))


if __name__ == "__main__":
    main()
