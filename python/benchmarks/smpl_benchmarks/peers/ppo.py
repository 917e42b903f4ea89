"""Frames per second of PPO's collection: the native batch against Stable-Baselines3."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium

from smpl_benchmarks.peers.common import installed, title

ENVIRONMENTS, STEPS = 16, 128


def main(repeats: int) -> None:
    """Times `collect_rollouts` of PPO on the reactor with network; one thread of torch."""
    title(f"PPO's collection on the reactor, {ENVIRONMENTS} environments")
    if not installed("Stable-Baselines3", "stable_baselines3"):
        return
    import torch
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

    from smpl.sb3 import SB3VecEnv

    torch.set_num_threads(1)
    identifier = "smpl:smpl/Reactor-v0"
    makers: dict[str, Callable[[], Any]] = {
        "SB3VecEnv": lambda: SB3VecEnv("smpl/Reactor-v0", ENVIRONMENTS),
        "DummyVecEnv": lambda: make_vec_env(identifier, ENVIRONMENTS, vec_env_cls=DummyVecEnv),
        "SubprocVecEnv": lambda: SubprocVecEnv([partial(gymnasium.make, identifier)] * ENVIRONMENTS),
    }
    rates = {}
    for name, make in makers.items():
        rates[name] = _rate(make(), repeats)
        print(f"  {name:14} {rates[name]:8.0f} frames/s", flush=True)
    for name in ("DummyVecEnv", "SubprocVecEnv"):
        print(f"  native batch against {name}: {rates['SB3VecEnv'] / rates[name]:.1f} times")


def _rate(env: Any, repeats: int) -> float:
    """Median frames per second of a rollout, after one that is not counted."""
    from stable_baselines3 import PPO

    model = PPO("MlpPolicy", env, n_steps=STEPS, batch_size=512, seed=0, device="cpu")
    _, callback = model._setup_learn(STEPS * ENVIRONMENTS, None)
    times = []
    for _ in range(repeats + 1):
        begin = time.perf_counter()
        model.collect_rollouts(env, callback, model.rollout_buffer, STEPS)
        times.append(time.perf_counter() - begin)
    env.close()
    return STEPS * ENVIRONMENTS / statistics.median(times[1:])
