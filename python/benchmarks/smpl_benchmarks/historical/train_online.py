"""Trains an algorithm of Ray 2.6.3 in the environment `online` (Python 3.10, with smpl)."""

import argparse
import functools
import importlib
import json
import random
from pathlib import Path
from typing import Any

import numpy as np
import ray
import torch
from ray.tune.registry import register_env

CONFIGURATIONS = {
    "PG-2022": ("pg", "PGConfig"),
    "A3C-2022": ("a3c", "A3CConfig"),
    "ARS-2022": ("ars", "ARSConfig"),
    "DDPG-2022": ("ddpg", "DDPGConfig"),
    "IMPALA-2022": ("impala", "ImpalaConfig"),
    "PPO-2022": ("ppo", "PPOConfig"),
    "SAC-2022": ("sac", "SACConfig"),
}


def main() -> None:
    """Go on from a checkpoint, or begin; write the next checkpoint and the policy."""
    parser = argparse.ArgumentParser()
    parser.add_argument("request", type=Path)
    given = json.loads(parser.parse_args().request.read_text())
    torch.set_num_threads(1)
    random.seed(given["seed"])
    np.random.seed(given["seed"] % 2**32)  # noqa: NPY002 (what Ray draws from)
    torch.manual_seed(given["seed"])
    ray.init(num_cpus=3, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
    register_env("smpl", _environment)
    module, name = CONFIGURATIONS[given["algorithm"]]
    config = getattr(importlib.import_module(f"ray.rllib.algorithms.{module}"), name)()
    # Algorithms that gather from workers need one; the others run here.
    workers = 1 if module in ("a3c", "ars", "impala") else 0
    config = config.environment("smpl", env_config=given["env"]).framework("torch").debugging(seed=given["seed"])
    config = config.resources(num_gpus=0).rollouts(num_rollout_workers=workers)
    config = config.training(**given["hyperparameters"])
    if hasattr(config, "rl_module") and module in ("ppo", "impala"):
        config = config.rl_module(_enable_rl_module_api=False).training(_enable_learner_api=False)
    if module == "a3c":
        # Its thread of sampling and the gradients of the same worker disturb each other: rows get
        # lost.
        config = config.training(sample_async=False)
    algo = config.build()
    if module == "a3c":
        # It asks without waiting, and sends the worker the weights each time that there is no
        # answer.
        algo.workers.fetch_ready_async_reqs = functools.partial(algo.workers.fetch_ready_async_reqs, timeout_seconds=60)
    if given["before"]:
        algo.load_checkpoint(given["before"])
    first = _steps(algo)
    while given["steps"] and _steps(algo) - first < given["steps"]:
        algo.train()
    after = Path(given["after"])
    algo.save_checkpoint(str(after))
    width = int(np.prod(algo.get_policy().observation_space.shape))
    example = torch.zeros((2, width), dtype=torch.float32)
    torch.jit.trace(_Mean(algo, module).eval(), example, check_trace=False).save(str(after / "policy.pt"))
    ray.shutdown()


def _environment(given: "dict[str, Any]") -> Any:
    from smpl_benchmarks.rllib import make

    return make(**given)


def _steps(algo: Any) -> int:
    return int(algo._counters["num_env_steps_sampled"]) + int(getattr(algo, "timesteps_so_far", 0) or 0)


class _Mean(torch.nn.Module):  # type: ignore[misc]
    """The action that a policy takes without exploring."""

    def __init__(self, algo: Any, kind: str) -> None:
        super().__init__()
        policy = algo.get_policy()
        self.model, self.kind = policy.model, kind
        found = getattr(policy, "observation_filter", None)
        self.moments = getattr(found, "running_stats", None) or getattr(found, "rs", None)

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        if self.moments is not None:
            mean = torch.as_tensor(np.asarray(self.moments.mean), dtype=torch.float32)
            std = torch.as_tensor(np.asarray(self.moments.std), dtype=torch.float32)
            observations = (observations - mean) / (std + 1e-8)
        given = {"obs": observations, "obs_flat": observations, "is_training": False}
        out, _ = self.model(given, [], None)
        if self.kind == "ddpg":
            return self.model.get_policy_output(out)
        if self.kind == "sac":
            out = self.model.get_action_model_outputs(out)[0]
            return torch.tanh(out[:, : out.shape[1] // 2])
        return out if self.kind == "ars" else out[:, : out.shape[1] // 2]


if __name__ == "__main__":
    main()
