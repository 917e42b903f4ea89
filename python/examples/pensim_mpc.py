"""PenSim by sampling: plans around the recipe compared with the recipe, from the same starts.

    python python/examples/pensim_mpc.py --out pensim_mpc --seeds 10
    python python/examples/pensim_mpc.py --out pensim_mpc --table  # prints the table only

Every batch is a row of `pensim_mpc.csv`, so that what was stopped goes on. The controller sees the
state, not the parameters that the seed draws nor the disturbances to come.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import smpl
from full_information import COLUMNS, FIRST_SEED, Row, read, write
from smpl.controllers import SamplingMPC, baseline
from smpl.controllers.pensim import Recipe
from smpl.evaluation import run_episode
from smpl.support.arguments import FloatArray

CONTROLLERS = ("recipe", "sampling")
# Deviations of the samples; the steps that a plan looks ahead and is followed.
SPREAD = {"discharge": 1.0, "Fs": 6.0, "Foil": 1.0, "Fg": 5.0, "pressure": 0.05, "Fw": 15.0}
HORIZON, EVERY = 100, 25


def sampling(env: smpl.Env) -> SamplingMPC:
    """Plans of 20 h that begin at the recipe and change every 5 h, 16 samples a decision."""
    recipe = Recipe(env.model).actions_of_steps

    def follow(env: smpl.Env, horizon: int) -> FloatArray:
        return np.asarray(recipe[np.minimum(env.steps + np.arange(horizon), len(recipe) - 1)])

    return SamplingMPC(
        horizon=HORIZON, hold=EVERY, every=EVERY, samples=16, iterations=1, method="cem", elites=0.2, guess=follow,
        deviation=SPREAD,
    )  # fmt: skip


def played(controller: str, seed: int, steps: int | None) -> Row:
    """A batch as a row; seconds are those of the processor."""
    env = smpl.Env("pensim", normalize=False, max_steps=steps)
    begin = time.process_time()
    made: Any = baseline("pensim", "recipe") if controller == "recipe" else sampling(env)
    episode = run_episode(env, made, seed)
    values = (
        "pensim", controller, seed, f"{episode.total:.12g}", episode.steps, f"{episode.costs.sum():.6g}",
        episode.failure, f"{time.process_time() - begin:.1f}",
    )  # fmt: skip
    return dict(zip(COLUMNS, map(str, values), strict=True))


def table(rows: Sequence[Row]) -> str:
    """The table of what is there, in Markdown."""
    found = {(row["controller"], row["seed"]): row for row in rows}
    lines = ["| seed | recipe, kg | sampling, kg | gain | a batch |", "|" + " --- |" * 5]
    yields = []
    for seed in sorted({row["seed"] for row in rows}, key=int):
        pair = [found.get((one, seed)) for one in CONTROLLERS]
        if pair[0] is None or pair[1] is None:
            continue
        old, new = (float(one["return"]) for one in pair if one is not None)
        yields.append((old, new))
        lines.append(f"| {seed} | {old:.0f} | {new:.0f} | {_gain(old, new)} | {float(pair[1]['seconds']):.0f} s |")
    if yields:
        old, new = np.mean(yields, axis=0)
        lines.append(f"| mean | {old:.0f} | {new:.0f} | {_gain(old, new)} | |")
    return "\n".join(lines)


def _gain(old: float, new: float) -> str:
    return f"{new / old - 1:.1%}" if old else "none"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what is not there yet, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("pensim_mpc"), metavar="DIR", help="folder of pensim_mpc.csv")
    parser.add_argument("--seeds", type=int, default=10, metavar="N", help=f"{FIRST_SEED}, {FIRST_SEED + 1} and so on")
    parser.add_argument("--steps", type=int, metavar="N", help="of a batch; all 1150 if none")
    parser.add_argument("--table", action="store_true", help="run nothing")
    given = parser.parse_args(arguments)
    file = given.out / "pensim_mpc.csv"
    rows = read(file)
    for seed in range(FIRST_SEED, FIRST_SEED + (0 if given.table else given.seeds)):
        for one in CONTROLLERS:
            if not any((row["controller"], row["seed"]) == (one, str(seed)) for row in rows):
                rows.append(played(one, seed, given.steps))
                write(file, rows)
    print(table(rows))


if __name__ == "__main__":
    main()
