"""`python -m smpl.benchmark tune --env NAME --algorithm NAME`, see `smpl_benchmarks.tuning`."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path

from smpl.collect import guarded, once
from smpl.learning.reports import text_table
from smpl_benchmarks.subjects import BUDGETS
from smpl_benchmarks.tuning import Search, Trial, best, tune, write


def main(arguments: Sequence[str]) -> int:
    """Tune as the command line says; the exit status is 1 where it cannot be done."""
    parser = argparse.ArgumentParser("python -m smpl.benchmark tune", description="Search hyperparameters.")
    once(parser)
    parser.add_argument("--suite", default="online", help="offline or online (default)")
    parser.add_argument("--env", required=True, metavar="NAME")
    parser.add_argument("--algorithm", required=True, metavar="NAME")
    parser.add_argument("--budget", default="short", help=f"of a training: {', '.join(BUDGETS)}")
    parser.add_argument("--trials", type=int, default=20, metavar="N", help="in all, those of earlier calls included")
    parser.add_argument("--steps", type=int, metavar="N", help="of a training, instead of the budget's")
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="trainings a trial")
    parser.add_argument("--episodes", type=int, metavar="N", help="that a policy is scored on")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the proposals and the trainings")
    parser.add_argument("--config", metavar="FILE", help="YAML over the configuration of the package")
    parser.add_argument("--study", type=Path, metavar="FILE", help="default: tuning/SUITE-ENV-ALGORITHM.sqlite3")
    parser.add_argument("--out", type=Path, default=Path("tuned.yaml"), metavar="FILE", help="default: tuned.yaml")
    parser.add_argument("--workers", type=int, metavar="W", help="threads or processes; default: all processors")
    parser.add_argument("--quiet", action="store_true", help="no line for each trial")
    given = parser.parse_args(arguments)
    command = shlex.join(["python", "-m", "smpl.benchmark", "tune", *_without_places(arguments)])
    return guarded(lambda: _tune(given, command))


def _tune(given: argparse.Namespace, command: str) -> int:
    search = Search.of(
        given.env, given.algorithm, suite=given.suite, budget=given.budget, seed=given.seed, seeds=given.seeds,
        steps=given.steps, episodes=given.episodes, config=given.config,
    )  # fmt: skip
    given.out.parent.mkdir(parents=True, exist_ok=True)  # reported now, not after hours
    study = given.study or Path("tuning") / f"{search.suite}-{search.env}-{search.algorithm}.sqlite3"
    on_trial = None if given.quiet else _tell
    trials = tune(search, study, given.trials, workers=given.workers, on_trial=on_trial)
    write(search, trials, command, given.out)
    ordered = sorted(trials, key=lambda one: (one.score is None, -(one.score or 0.0), one.number))
    print(text_table([["trial", "score", "ended", "hyperparameters"], *(_row(one) for one in ordered)]))
    print(f"best: trial {best(trials).number}, written to {given.out}")
    return 0


def _tell(trial: Trial) -> None:
    number, score, ended, hyper = _row(trial)
    print(f"trial {number}: {score or ended}  {hyper}", flush=True)


def _row(trial: Trial) -> list[str]:
    score = "" if trial.score is None else f"{trial.score:.6g}"
    text = ", ".join(f"{key}={value}" for key, value in trial.hyperparameters.items())
    return [str(trial.number), score, trial.ended, text or "(as in benchmark.yaml)"]


def _without_places(arguments: Sequence[str]) -> list[str]:
    """The arguments that say what is searched, without those that say where things are."""
    kept, left = [], iter(arguments)
    for one in left:
        name, equals, _ = one.partition("=")
        if name in ("--study", "--out", "--workers"):
            if not equals:
                next(left, None)
        elif one != "--quiet":
            kept.append(one)
    return kept
