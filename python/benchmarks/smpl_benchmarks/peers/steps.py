"""A step of training: best and realistic case of the small models, with the peers of the same run.

`python -m smpl.bench steps` prints one table. `python -m smpl_benchmarks.peers.steps --write docs`,
with `python/benchmarks` in `PYTHONPATH`, writes it into the book.

The best case is near rest: actions within 0.02 of the nominal ones, a tolerance of 1e-6, no time
limit. The realistic case has the model's own method and tolerance, random actions of +-0.2 (of
-1..1), sampled starts, and episodes that end and begin again in the same step.

EnvPool is the fastest vector environment of Python that we know. Its pendulum takes one explicit
Euler step. It works in a separate thread while the caller waits, so that processor time is that of
the whole process. All take turns, so that they meet the same machine. Actions are drawn beforehand:
drawing one from a space of Gymnasium takes several times as long as a step.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import smpl
from smpl.support.arguments import FloatArray
from smpl_benchmarks.peers.batch import RTOL, actions, compiled
from smpl_benchmarks.peers.common import installed, title
from smpl_benchmarks.peers.episodes import Case, compare, episodes, ranges, reference_method

COUNT, PERIOD = 256, 200
# Steps of a turn of single environments.
SINGLE = 1000
MODELS = ("reactor", "beer")
# Episodes and steps of each by which errors of the realistic case are found.
CHECKED = {"reactor": (100, 100), "beer": (10, 200), "pensim": (3, 1150)}
WIDTH, NARROW = 0.2, 0.02
TIGHT = 1e-12
ENVPOOL, PENDULUM = "EnvPool, `Pendulum-v1`", "Gymnasium, `Pendulum-v1`"
BEGIN, END = "<!-- steps -->\n", "<!-- end of steps -->\n"

Stepper = Callable[[], None]
Seconds = dict[str, float]


def main(repeats: int) -> None:
    """Print the table."""
    title("A step: best and realistic case, one thread, processor time")
    print("\n".join(table(repeats)))


def table(repeats: int) -> list[str]:
    """Lines of the table, in Markdown."""
    together = in_turn(batches(), COUNT * PERIOD, 2 * repeats)
    single = in_turn(singles(), SINGLE, 2 * repeats)
    lines = [
        "| a step of | best case | times as fast as the peer | realistic | times as fast | largest errors |",
        "|---|---|---|---|---|---|",
    ]
    for name in MODELS:
        near, random = largest_error(name), realistic_error(name)
        lines.append(row(f"{name}, batch of {COUNT}", cases(together, name, ENVPOOL), f"{near:.0e}, {random:.0e}"))
    if ENVPOOL in together:
        lines.append(row(f"{ENVPOOL}, batch of {COUNT}", (together[ENVPOOL],) * 2, ""))
    for name in ("smpl/Reactor-v0", "smpl/Beer-v0"):
        lines.append(row(f'`gymnasium.make("{name}")`', cases(single, name, PENDULUM), ""))
    lines.append(row(PENDULUM, (single[PENDULUM],) * 2, ""))
    pensim = cases(single, "smpl/PenSim-v0", "")
    lines.append(row('`gymnasium.make("smpl/PenSim-v0")`', pensim, f", {realistic_error('pensim'):.0e}"))
    return lines


def cases(found: Seconds, name: str, peer: str) -> tuple[float, ...]:
    """Seconds of both cases, and how many times as long the peer takes, where it is there."""
    both = found[f"{name}, near rest"], found[f"{name}, realistic"]
    return (*both, *(found[peer] / each for each in both)) if peer in found else both


def row(what: str, numbers: tuple[float, ...], errors: str) -> str:
    """A line of the table: seconds, then ratios if there are any."""
    best, realistic = (f"{each * 1e6:.3g} µs" for each in numbers[:2])
    ratios = [f"{each:.2g}" for each in numbers[2:]] or ["", ""]
    return f"| {what} | {best} | {ratios[0]} | {realistic} | {ratios[1]} | {errors.removeprefix(', ')} |"


def in_turn(steppers: Mapping[str, Stepper], steps: int, turns: int) -> Seconds:
    """Seconds of a step of each: the median of turns, each of so many steps."""
    times: dict[str, list[float]] = {name: [] for name in steppers}
    for _ in range(turns):
        for name, turn in steppers.items():
            begin = time.process_time()
            turn()
            times[name].append((time.process_time() - begin) / steps)
    return {name: float(np.median(each)) for name, each in times.items()}


def batches() -> dict[str, Stepper]:
    """Turns of batches: both cases of each model, and the peer if it is installed."""
    found = {}
    for name in MODELS:
        found[f"{name}, near rest"] = batch(compiled(name), partial(actions, steps=PERIOD))
        found[f"{name}, realistic"] = batch(smpl.Env(name, normalize=False).model, random_actions)
    if installed("EnvPool", "envpool"):
        found[ENVPOOL] = pendulum()
    return found


def batch(model: smpl.Model, choose: Callable[[smpl.VectorEnv], FloatArray]) -> Stepper:
    """Steps a batch of a model from sampled starts; ended episodes begin again in the same step."""
    env = smpl.VectorEnv(model, COUNT, num_threads=1, autoreset_mode="same_step")
    given = choose(env)
    env.reset(seed=0)

    def turn() -> None:
        for action in given:
            env.step(action)

    return turn


def random_actions(env: smpl.VectorEnv) -> FloatArray:
    """Normalised actions of +-0.2, another one for each environment and step of a turn."""
    return np.random.default_rng(0).uniform(-WIDTH, WIDTH, (PERIOD, env.num_envs, len(env.action_low)))


def pendulum() -> Stepper:
    """Steps EnvPool's pendulum."""
    import envpool

    env = envpool.make("Pendulum-v1", "gymnasium", num_envs=COUNT, num_threads=1, seed=0)
    env.reset()
    torques = np.random.default_rng(0).uniform(-2, 2, (PERIOD, COUNT, 1)).astype(np.float32)

    def turn() -> None:
        for torque in torques:
            env.step(torque)

    return turn


def singles() -> dict[str, Stepper]:
    """Turns of environments that `gymnasium.make` returns, with their wrappers."""
    found = {PENDULUM: single(gymnasium.make("Pendulum-v1"), 1.0)}
    for name in ("smpl/Reactor-v0", "smpl/Beer-v0", "smpl/PenSim-v0"):
        found[f"{name}, near rest"] = single(gymnasium.make(name, normalize="nominal"), NARROW)
        found[f"{name}, realistic"] = single(gymnasium.make(name), WIDTH)
    return found


def single(env: gymnasium.Env[Any, Any], width: float) -> Stepper:
    """Steps one environment with actions of a part of its box; ended episodes begin again."""
    space = env.action_space
    assert isinstance(space, gymnasium.spaces.Box)
    low, high = space.low, space.high
    draws = np.random.default_rng(0).uniform(-width, width, (SINGLE, *space.shape))
    given = ((low + high) / 2 + draws * (high - low) / 2).astype(space.dtype)
    env.reset(seed=0)

    def turn() -> None:
        for action in given:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

    return turn


def largest_error(name: str) -> float:
    """Largest error of eight environments near rest after 20 steps, in parts of the ranges."""
    ends = []
    for rtol, method in ((RTOL, "auto"), (1e-11, "rosenbrock")):
        env = smpl.VectorEnv(compiled(name, rtol), 8, num_threads=1, method=method)
        env.reset(seed=0)
        for action in actions(env, 20):
            env.step(action)
        ends.append(env.state)
    low, high = env.model.native.bounds("state")
    scale = np.where(np.isfinite(high - low), high - low, np.abs(ends[1]).max(axis=0))
    return float(np.max(np.abs(ends[0] - ends[1]) / scale))


def realistic_error(name: str) -> float:
    """Largest error of whole random episodes over ranges, by `rosenbrock` at 1e-12."""
    seeds, steps = CHECKED[name]
    case = Case(name, f"random +-{WIDTH}", seeds, steps, ())
    exact, _ = episodes(case, reference_method(name), TIGHT)
    found, _ = episodes(case, None, None)
    return compare(found, exact, ranges(name, exact)).running


def write(folder: Path, repeats: int) -> None:
    """Put the table into the book at this folder."""
    page = folder / "performance.md"
    before, begin, rest = page.read_text().partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        sys.exit(f"{page} has no lines `{BEGIN.strip()}` and `{END.strip()}`")
    page.write_text(before + BEGIN + "\n" + "\n".join(table(repeats)) + "\n\n" + END + after)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m smpl_benchmarks.peers.steps", description="Steps of training.")
    parser.add_argument("--write", metavar="FOLDER", type=Path, help="the folder of the book, to be written")
    parser.add_argument("--repeats", type=int, default=5, help="half the number of turns")
    arguments = parser.parse_args()
    if arguments.write is None:
        main(arguments.repeats)
    else:
        write(arguments.write, arguments.repeats)
