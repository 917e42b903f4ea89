"""The antibody plant by sampling: every constraint kept, and no less recovered than by the nominal policy.

    python -m smpl.examples.plant_mpc --seeds 2000 2001

A decision a batch: plans of 25 h say what the next batch is run with (elution, flush, modifier) and when the columns
swap. Phases, swaps and events are simulated as they are; nothing of the plant is written again here.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

import smpl
from smpl.controllers import Policy, SamplingMPC
from smpl.evaluation import Episode, run_episode
from smpl.model import FloatArray

PERIOD, HORIZON = 20, 25
# Litres of flush and elution that plans begin with: the nominal ones, and shorter ones of which the product reaches the
# pool within the hour in which the pool begins to fill.
VOLUMES = ((750, 300), (500, 150), (450, 150))
# A batch that is to be in the pool at the end of the episode starts so many hours before.
LAST = 5
SPREAD = {"V_flush": 40.0, "V_elu": 20.0, "c_s_cex": 0.06, "c_s_elu": 0.01}


def plans(env: smpl.Env, horizon: int) -> FloatArray:
    """Sequences of actions (K, horizon, actions) to begin with: a swap every 20 h, a last one in time."""
    at = {name: i for i, name in enumerate(env.action_names)}
    base = np.tile(env.policy("nominal"), (horizon, 1))
    # The level of the buffer tank is controlled in the policy; a plan lets out what comes in.
    base[:, at["F_out"]] = base[:, at["F_2"]]
    steps = env.steps + np.arange(horizon)
    base[:, at["switch"]] = steps % PERIOD == PERIOD - 1
    found = []
    for flush, elution in VOLUMES:
        plan = base.copy()
        plan[:, at["V_flush"]], plan[:, at["V_elu"]] = flush, elution
        found.append(plan)
    if env.max_steps - LAST in steps:
        for plan in list(found):
            late = plan.copy()
            late[:, at["switch"]] = steps == env.max_steps - LAST
            found.append(late)
    return np.array(found)


def cost(found: Any, _: FloatArray) -> FloatArray:
    """Antibody that is not recovered, and a violation dearer than all of a batch."""
    return np.asarray(-found.rewards / 1e5 + 1e3 * found.violations.sum(axis=2))


def controller(samples: int = 12, iterations: int = 2) -> SamplingMPC:
    """The controller."""
    env = smpl.Env("mab_plant", normalize=False)
    spread = {name: SPREAD.get(name, 0.0) for name in env.action_names}
    return SamplingMPC(
        horizon=HORIZON, hold=HORIZON, every=PERIOD, samples=samples, iterations=iterations, method="cem", elites=0.25,
        deviation=spread, integer=["switch"], guess=plans, cost=cost,
    )  # fmt: skip


def told(name: str, seed: int, episode: Episode, seconds: float) -> str:
    """A line."""
    broken = f"violations {float(episode.costs.sum()):.3g}"
    end = episode.failure or "no failure"
    return (
        f"{seed} {name:8} {episode.total / 1e6:.4f} kg in the pool, {broken}, {end}, {episode.steps} h, {seconds:.0f} s"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints two lines a seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[2000])
    parser.add_argument("--steps", type=int, help="hours of an episode; all 200 if none")
    given = parser.parse_args(arguments)
    for seed in given.seeds:
        for name, make in (("nominal", lambda: Policy("nominal")), ("sampling", controller)):
            env = smpl.Env("mab_plant", normalize=False, max_steps=given.steps)
            begin = time.process_time()
            episode = run_episode(env, make(), seed)
            print(told(name, seed, episode, time.process_time() - begin), flush=True)


if __name__ == "__main__":
    main()
