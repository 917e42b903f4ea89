"""The antibody plant by sampling, with all constraints kept.

    python python/examples/plant_mpc.py --seeds 2000 2001

The controller is that of `smpl.controllers.plant`, which is its full-information controller too.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

import smpl
from smpl.controllers import Policy
from smpl.controllers.plant import plant_mpc
from smpl.evaluation import Episode, run_episode


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
        for name in ("nominal", "sampling"):
            env = smpl.Env("mab_plant", normalize=False, max_steps=given.steps)
            begin = time.process_time()
            episode = run_episode(env, Policy("nominal") if name == "nominal" else plant_mpc(env), seed)
            print(told(name, seed, episode, time.process_time() - begin), flush=True)


if __name__ == "__main__":
    main()
