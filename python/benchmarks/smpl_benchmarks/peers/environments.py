"""Steps a second of the environments that come with the package: the figures of the README's table.

Two cases: the nominal policy from the start of seed 0, and random actions of +-0.2 from sampled
starts, new episodes after ended ones included. Each is run by the model's own method, by `ida` and
by `auto`.
"""

from __future__ import annotations

from functools import partial

import numpy as np

import smpl
from smpl.controllers import Controller, Nominal, Policy
from smpl.registry import ENVIRONMENTS, GALLERY
from smpl.support.arguments import FloatArray
from smpl_benchmarks.peers.common import seconds, title

BATCH = 16
# Most steps of an episode that are taken: the start counts for as much as it does in a short one.
MOST_STEPS = 200
# Random actions: largest distance from the middle, of actions scaled to -1..1.
WIDTH = 0.2
METHODS = (None, "ida", "auto")


def main(repeats: int) -> None:
    """Prints two rows per environment, alone and in a batch on one thread, by each method."""
    title(
        f"Environments: steps a second on one thread, alone and {BATCH} together, by the model's method, ida and auto"
    )
    for name, model in (ENVIRONMENTS | GALLERY).items():
        actions = nominal_actions(smpl.Env(model, normalize=False))
        runs = [smpl.Env(model, normalize=False, method=method) for method in METHODS]
        cases = {
            "nominal policy": (episode, actions),
            f"random +-{WIDTH}": (episodes, random_actions(runs[0], MOST_STEPS)),
        }
        for case, (run, given) in cases.items():
            # In turn, so that all methods meet the same machine.
            alone = [len(given) / seconds(partial(run, env, given), repeats) for env in runs]
            batches = [batch_rate(env.model, method, given, repeats) for env, method in zip(runs, METHODS, strict=True)]
            rates = ", ".join(
                f"{label} {one:,.0f} steps/s alone, {many:,.0f} together"
                for label, one, many in zip(("default", *METHODS[1:]), alone, batches, strict=True)
            )
            print(f"  smpl/{name}-v0, {case}, {len(given)} steps: {rates}")


def random_actions(env: smpl.Env, steps: int) -> list[FloatArray]:
    """Random actions of up to `WIDTH` of half of their ranges around the middle."""
    middle, half = (env.action_low + env.action_high) / 2, (env.action_high - env.action_low) / 2
    return list(middle + np.random.default_rng(0).uniform(-WIDTH, WIDTH, (steps, len(half))) * half)


def episodes(env: smpl.Env, actions: list[FloatArray]) -> None:
    """As many steps from sampled starts; an ended episode is followed by another one."""
    env.reset(seed=0)
    for action in actions:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()


def nominal_actions(env: smpl.Env) -> list[FloatArray]:
    """Actions of the nominal policy, or nominal actions, for an episode or its first steps."""
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


def batch_rate(model: smpl.Model, method: str | None, actions: list[FloatArray], repeats: int) -> float:
    """Steps per second of a batch in one thread, with equal actions in its environments."""
    venv = smpl.VectorEnv(model, num_envs=BATCH, num_threads=1, normalize=False, method=method)

    def run() -> None:
        venv.reset(seed=0)
        for action in actions:
            venv.step(np.tile(action, (BATCH, 1)))

    rate = BATCH * len(actions) / seconds(run, repeats)
    venv.close()
    return rate
