"""`python -m smpl.benchmark controls --env ENV`: tune the controls on training starts."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from smpl.collect import guarded, once
from smpl.learning.agents import Agent
from smpl.learning.plan import Plan, Task
from smpl.learning.scores import score
from smpl.optimize.search import Search
from smpl.support.arguments import FloatArray
from smpl_benchmarks.controls import CONTROLS, FILE, made, tuned
from smpl_benchmarks.subjects import SUBJECTS, one_of

# Seed of the first training start; seeds of validation, data sets and searches begin at 5, 6 and 7
# hundred million.
TRAINING = 800_000_000


def tune(task: Task, env: str, name: str, folder: Path, workers: int | None = None, seed: int = 0) -> dict[str, Any]:
    """Search the numbers of a control: the highest mean return on the training starts.

    The numbers where the search begins are a candidate too, as a search can miss a narrow optimum.

    Args:
        task: environment of the scores.
        env, name: which control.
        folder: the search is kept there as `ENV-NAME.csv` and continued from it.
        workers: threads; all processors if None.
        seed: of the search.

    Returns:
        `point`, `value` (mean return on the training starts), `budget`, `names` and `seconds`.
    """
    control = CONTROLS[env][name]
    folder.mkdir(parents=True, exist_ok=True)
    low, high = np.array(control.low), np.array(control.high)
    start = (low + high) / 2 if control.start is None else np.array(control.start)
    search = Search(
        low, high, names=control.names, method=control.method, start=start, spread=control.spread, seed=seed,
        file=folder / f"{env}-{name}.csv",
    )  # fmt: skip
    began = time.perf_counter()

    def values(points: FloatArray) -> FloatArray:
        return np.array([_mean_return(task, made(task, env, name, one), control.starts, workers) for one in points])

    search.run(values, control.evaluations - 1)
    found, begin = search.best, (start, float(values(start[None])[0]))
    point, value = max(found, begin, key=lambda pair: pair[1])
    rounded = [float(f"{one:.6g}") for one in point]
    seconds = round(time.perf_counter() - began, 1)
    return {
        "point": rounded,
        "value": float(f"{value:.8g}"),
        "budget": control.budget,
        "names": list(control.names),
        "seconds": seconds,
    }


def _mean_return(task: Task, one: Agent, episodes: int, workers: int | None) -> float:
    return float(score(Plan.of(task, one, episodes, seed=TRAINING), workers, kept=0).returns.mean())


def main(arguments: Sequence[str]) -> int:
    """Tune controls as the command line says; the exit status is 1 if that is impossible."""
    parser = argparse.ArgumentParser("python -m smpl.benchmark controls", description="Tune the controls.")
    once(parser)
    parser.add_argument("--env", required=True, metavar="ENV", help=f"one of {', '.join(CONTROLS)}")
    parser.add_argument("--control", metavar="NAME", help="only this one")
    parser.add_argument("--search", default="controls", metavar="DIR", help="folder of the searches")
    parser.add_argument("--out", default=str(FILE), metavar="FILE", help="the numbers")
    parser.add_argument("--workers", type=int, metavar="W", help="threads; default: all processors")
    given = parser.parse_args(arguments)

    def work() -> int:
        one_of("env", given.env, tuple(CONTROLS))
        names = [name for name, one in CONTROLS[given.env].items() if one.names]
        if given.control is not None:
            one_of("control", given.control, names)
            names = [given.control]
        task = Task.of(f"smpl/{given.env}-v0", **SUBJECTS[given.env].arguments)
        for name in names:
            found = tune(task, given.env, name, Path(given.search), given.workers)
            every = tuned(Path(given.out))
            every.setdefault(given.env, {})[name] = found
            Path(given.out).write_text(json.dumps(every, indent=1, sort_keys=True) + "\n", encoding="utf-8")
            print(f"{given.env} {name}: {found['value']:.6g} at {found['point']} ({found['seconds']} s)", flush=True)
        return 0

    return guarded(work)
