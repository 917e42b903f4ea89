"""Train PPO of Stable-Baselines3 on the reactor (extra `sb3`).

The published reward divides by the squared distance of the start, so that a few starts near the
set-point outweigh all others by orders of magnitude. `D_rel` is a lower bound of that distance.
Observations and rewards are normalised by their running moments, and a discount of 0.95, two
minutes, is as far as an action reaches.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.sb3 import SB3VecEnv

SETTINGS = {"D_rel": 0.3}
GAMMA = 0.95
Policy = Callable[[npt.NDArray[np.float32]], npt.NDArray[Any]]


@dataclass(frozen=True)
class Result:
    """Episodes of a policy: mean return, mean length, share that ends in a failure."""

    mean_return: float
    mean_length: float
    failures: float


def train(total_timesteps: int = 60_000, num_envs: int = 16, n_steps: int = 128, seed: int = 0) -> tuple[Any, Policy]:
    """Train and return the algorithm and its greedy policy.

    Args:
        total_timesteps: steps of all environments together; none are made for 0.
        num_envs: environments stepped together.
        n_steps: steps of each between two updates.
        seed: of the environments and of the algorithm.
    """
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

    torch.set_num_threads(1)  # networks this small only wait for each other
    env = SB3VecEnv("reactor", num_envs, settings=SETTINGS)
    env.seed(seed)
    normalised = VecNormalize(VecMonitor(env), gamma=GAMMA)
    algorithm = PPO(
        "MlpPolicy",
        normalised,
        n_steps=n_steps,
        batch_size=num_envs * n_steps // 8,
        gamma=GAMMA,
        learning_rate=1e-3,
        policy_kwargs={"log_std_init": -0.5},
        seed=seed,
        device="cpu",
    )
    if total_timesteps > 0:
        algorithm.learn(total_timesteps)

    def policy(observations: npt.NDArray[np.float32]) -> npt.NDArray[Any]:
        return np.asarray(algorithm.predict(normalised.normalize_obs(observations), deterministic=True)[0])

    return algorithm, policy


def evaluate(policy: Policy, episodes: int = 100, seed: int = 10_000) -> Result:
    """Run a policy from as many starts, one episode each."""
    env = SB3VecEnv("reactor", episodes, settings=SETTINGS)
    env.seed(seed)
    observations: Any = env.reset()
    returns, lengths, failed = np.zeros(episodes), np.zeros(episodes), np.zeros(episodes, dtype=bool)
    running = np.ones(episodes, dtype=bool)
    while running.any():
        observations, rewards, done, infos = env.step(policy(observations))
        returns += rewards * running
        lengths += running
        for i in np.flatnonzero(done & running):
            failed[i] = bool(infos[i]["failure"])
        running &= ~done
    return Result(float(returns.mean()), float(lengths.mean()), float(failed.mean()))


def main() -> None:
    """Train and print what the policy earns before and after."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--steps", type=int, default=60_000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    for name, steps in (("untrained", 0), (f"after {arguments.steps} steps", arguments.steps)):
        found = evaluate(train(steps, seed=arguments.seed)[1])
        print(
            f"{name}: return {found.mean_return:.2f}, {found.mean_length:.0f} steps an episode,"
            f" {found.failures:.0%} end in a failure"
        )


if __name__ == "__main__":
    main()
