"""Steps a second of the environments that come with the package: the figures of the README's table."""

from __future__ import annotations

from functools import partial

import numpy as np

import smpl
from smpl._arguments import FloatArray
from smpl._registry import ENVIRONMENTS
from smpl.bench.common import seconds, title
from smpl.controllers import Controller, Nominal, Policy

BATCH = 16
# Most steps of an episode that are taken: the start counts for as much as it does in a short one.
MOST_STEPS = 200


def main(repeats: int) -> None:
    """Print a row for each environment: alone, and in a batch on one thread."""
    title(f"Environments: steps a second on one thread, nominal policy; alone, and {BATCH} together")
    for name, model in ENVIRONMENTS.items():
        env = smpl.Env(model, normalize=False)
        actions = nominal_actions(env)
        alone = len(actions) / seconds(partial(episode, env, actions), repeats)
        batch = batch_rate(env.model, actions, repeats)
        print(f"  smpl/{name}-v0: {len(actions)} steps; {alone:,.0f} steps/s alone, {batch:,.0f} steps/s together")


def nominal_actions(env: smpl.Env) -> list[FloatArray]:
    """Actions of the nominal policy, or the nominal actions, to the end of an episode or to its first steps."""
    env.reset(seed=0)
    player: Controller = Policy("nominal") if "nominal" in env.model.policies else Nominal()
    player.reset(env)
    actions: list[FloatArray] = []
    ended = False
    while not ended and len(actions) < MOST_STEPS:
        actions.append(np.array(player.action(env), dtype=np.float64))
        _, _, terminated, truncated, _ = env.step(actions[-1])
        ended = terminated or truncated
    return actions


def episode(env: smpl.Env, actions: list[FloatArray]) -> None:
    """A start and the steps behind it."""
    env.reset(seed=0)
    for action in actions:
        env.step(action)


def batch_rate(model: smpl.Model, actions: list[FloatArray], repeats: int) -> float:
    """Steps a second of equal environments, one after another in one thread."""
    venv = smpl.VectorEnv(model, num_envs=BATCH, num_threads=1, normalize=False)

    def run() -> None:
        venv.reset(seed=0)
        for action in actions:
            venv.step(np.tile(action, (BATCH, 1)))

    rate = BATCH * len(actions) / seconds(run, repeats)
    venv.close()
    return rate
