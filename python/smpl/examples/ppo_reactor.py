"""Train PPO of Stable-Baselines3 on the reactor (extra `sb3`): `python -m smpl.examples.ppo_reactor`."""

from __future__ import annotations

import argparse
from typing import Any

from smpl.sb3 import SB3VecEnv


def train(total_timesteps: int = 200_000, num_envs: int = 16, n_steps: int = 128, seed: int = 0) -> Any:
    """Train and return the policy.

    Args:
        total_timesteps: steps of all environments together.
        num_envs: environments stepped together.
        n_steps: steps of each between two updates.
        seed: of the environments and of the algorithm.
    """
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor

    env = VecMonitor(SB3VecEnv("reactor", num_envs, reward="setpoint_change"))
    model = PPO("MlpPolicy", env, n_steps=n_steps, batch_size=num_envs * n_steps // 4, seed=seed, device="cpu")
    return model.learn(total_timesteps)


def main() -> None:
    """Train and print the mean reward of ten greedy episodes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=200_000)
    arguments = parser.parse_args()
    from stable_baselines3.common.evaluation import evaluate_policy

    model = train(arguments.steps)
    mean, deviation = evaluate_policy(model, SB3VecEnv("reactor", 1), n_eval_episodes=10)
    print(f"return over 10 episodes: {mean:.3f} +- {deviation:.3f}")


if __name__ == "__main__":
    main()
