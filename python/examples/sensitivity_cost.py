"""Cost of derivatives of a control step, in plain steps.

    python python/examples/sensitivity_cost.py

On one thread, at states along an episode with the actions in the middle of their boxes.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence

import numpy as np

import smpl
from smpl.support.arguments import FloatArray

# Model, roles of the directions, points.
CASES = (
    ("reactor", ("state", "action"), 32),
    ("beer", ("state", "action"), 32),
    ("pensim", ("state", "action"), 16),
    ("atropine", ("action",), 8),
    ("mab", ("action",), 1),
)


def points(env: smpl.Env, count: int) -> tuple[FloatArray, FloatArray]:
    """States along an episode, and the action that led there."""
    env.reset(seed=0)
    action = (env.action_low + env.action_high) / 2
    states = []
    for _ in range(count):
        states.append(np.array(env.state))
        if any(env.step(action)[2:4]):
            break
    return np.array(states), action


def seconds(work: Callable[[], object], repetitions: int) -> float:
    """Processor time of the shortest of several runs."""
    work()
    times = []
    for _ in range(repetitions):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return min(times)


def measure(name: str, by: Sequence[str], count: int, repetitions: int = 3) -> tuple[int, float, float]:
    """Directions, processor seconds of a plain step, seconds of one with derivatives."""
    env = smpl.Env(name, normalize=False)
    model = env.model
    x, u = points(env, count)
    plain = seconds(lambda: model.step(x, u, threads=1), repetitions) / len(x)
    full = seconds(lambda: model.linearize_step(x, u, by=by, threads=1), repetitions) / len(x)
    directions = sum(len(getattr(model, f"{role}_names")) for role in by)
    return directions, plain, full


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=[])
    chosen = parser.parse_args(arguments).names
    print(f"{'model':10} {'directions':>10} {'step, ms':>10} {'with derivatives, ms':>21} {'ratio':>6}")
    for name, by, count in CASES:
        if not chosen or name in chosen:
            directions, plain, full = measure(name, by, count)
            print(f"{name:10} {directions:10} {1e3 * plain:10.3f} {1e3 * full:21.3f} {full / plain:6.1f}")


if __name__ == "__main__":
    main()
