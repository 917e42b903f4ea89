"""`python -m smpl.benchmark --suite control --budget smoke`: the benchmark, one folder a run, resumed where it stopped.

A run is an environment, a controller and a seed. Its folder has `configuration.json` (what was run, by which versions)
and, when it is finished, `scores.json`. The command writes `table.md` and `table.json` over all runs.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
import platform
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from smpl._native import __version__
from smpl._registry import ENVIRONMENTS
from smpl.collect import guarded
from smpl.learning import Plan, Task
from smpl.learning.progress import Progress
from smpl.learning.reports import text_table
from smpl.learning.scores import score
from smpl.learning.statistics import bootstrap, interquartile_mean
from smpl.model import as_count

SUITES, BUDGETS = ("control",), ("smoke", "short", "paper")
# Seeds of a run are apart from those of the next by more episodes than any budget has.
_APART = 1_000_000


@dataclass(frozen=True)
class Subject:
    """An environment as the benchmark runs it.

    Attributes:
        arguments: of the environment.
        controllers: names; the published mean and deviation over steps, where the paper has them.
        episodes: a run of each budget.
    """

    arguments: dict[str, Any]
    controllers: dict[str, tuple[float, float] | None]
    episodes: dict[str, int]


_LONG = {"smoke": 1, "short": 5, "paper": 100}
_QUICK = {"smoke": 8, "short": 200, "paper": 1000}
SUBJECTS = {
    # Table 2 of the paper, whose figures belong to `setpoint_change` and `legacy`.
    "Reactor": Subject(
        {"scenario": "legacy", "reward": "setpoint_change"},
        {"pid": (-1.0823, 35.0924), "mpc": (-0.1912, 15.9328), "nominal": None, "random": None},
        _QUICK,
    ),
    "Beer": Subject(
        {"scenario": "legacy"}, {"profile": None, "isothermal": None, "nominal": None, "random": None}, _QUICK
    ),
    "PenSim": Subject({}, {"nominal": None, "random": None}, _LONG),
    "Atropine": Subject({}, {"mpc": None, "nominal": None}, _LONG),
    "MAb": Subject({}, {"nominal": None}, _LONG),
    "MAbPlant": Subject({}, {"nominal": None}, _LONG),
}
# Steps of an episode of the budget `smoke`, which shows only that everything runs.
_SMOKE_STEPS = 20


@dataclass(frozen=True)
class Run:
    """One run: all that its scores are a function of."""

    suite: str
    budget: str
    env: str
    controller: str
    number: int
    seed: int
    episodes: int
    arguments: dict[str, Any]

    def folder(self, out: Path) -> Path:
        """Where it is kept."""
        return out / self.suite / self.env / self.controller / f"seed-{self.number}"


def runs(suite: str, budget: str, env: str | None, seeds: int) -> list[Run]:
    """All runs of a suite.

    Raises:
        ValueError: no such suite, budget or environment.
    """
    _one_of("suite", suite, (*SUITES, "all"))
    _one_of("budget", budget, BUDGETS)
    if env is not None:
        env = env.removeprefix("smpl/").removesuffix("-v0")
        _one_of("env", env, tuple(ENVIRONMENTS))
    count = as_count("seeds", seeds)
    found = []
    for name in SUBJECTS if env is None else (env,):
        subject = SUBJECTS[name]
        arguments = {**subject.arguments, **({"max_steps": _SMOKE_STEPS} if budget == "smoke" else {})}
        for controller in subject.controllers:
            for number in range(count):
                seed, episodes = number * _APART, subject.episodes[budget]
                found.append(Run("control", budget, name, controller, number, seed, episodes, arguments))
    return found


def benchmark(
    out: str | os.PathLike[str],
    suite: str = "control",
    budget: str = "smoke",
    *,
    env: str | None = None,
    seeds: int | None = None,
    resume: bool = False,
    workers: int | None = None,
    progress: bool = False,
) -> dict[str, Any]:
    """Run a suite and write its table.

    Args:
        out: folder of the runs.
        suite, budget: what and how much.
        env: one environment in place of all.
        seeds: runs of each controller; 1 for `smoke`, else 3.
        resume: go on in a folder that has runs; those that are finished are not run again.
        workers: threads or processes; all processors if none.
        progress: show a progress bar.

    Returns:
        What `table.json` holds.

    Raises:
        ValueError: an argument is none of what it may be, or the folder has other runs.
    """
    folder = Path(out)
    every = runs(suite, budget, env, seeds if seeds is not None else (1 if budget == "smoke" else 3))
    if not resume and any(folder.glob("*/*/*/seed-*")):
        raise ValueError(f"{folder} has runs already: give --resume to go on, or another folder")
    skipped: dict[str, str] = {}
    with Progress(progress, suite, len(every)) as bar:
        for one in every:
            reason = _make(one, folder, workers)
            if reason:
                skipped[f"{one.env} {one.controller}"] = reason
            bar.add(1)
    table = _table(every, folder, skipped)
    _write(folder / "table.json", json.dumps(table, indent=1))
    _write(folder / "table.md", _markdown(table))
    return table


def _make(one: Run, out: Path, workers: int | None) -> str:
    """Run what is not finished; returns why it cannot be run, empty where it was.

    Raises:
        ValueError: its folder has another run.
    """
    folder = one.folder(out)
    configuration = {**asdict(one), "smpl": __version__}
    task = Task.of(f"smpl/{one.env}-v0", **one.arguments)
    configuration["checksum"] = task.checksum
    if (folder / "scores.json").is_file():
        there = json.loads((folder / "configuration.json").read_text(encoding="utf-8"))
        differing = [key for key, value in configuration.items() if there.get(key) != value]
        if differing:
            told = ", ".join(f"{key} {there.get(key)!r} there, {configuration[key]!r} here" for key in differing)
            raise ValueError(f"{folder} is another run ({told}): give another folder")
        return ""
    try:
        plan = Plan.of(task, one.controller, one.episodes, seed=one.seed)
    except (ImportError, NotImplementedError) as error:
        return str(error)
    folder.mkdir(parents=True, exist_ok=True)
    configuration["versions"] = {"python": platform.python_version(), "numpy": importlib.metadata.version("numpy")}
    _write(folder / "configuration.json", json.dumps(configuration, indent=1))
    begin = time.perf_counter()
    report = score(plan, workers, kept=0).report()
    report["seconds"] = time.perf_counter() - begin
    _write(folder / "scores.json", json.dumps(report, indent=1, allow_nan=False))
    return ""


def _table(every: Sequence[Run], out: Path, skipped: dict[str, str]) -> dict[str, Any]:
    """Scores of each controller over its seeds."""
    rows = []
    for env, controller in dict.fromkeys((one.env, one.controller) for one in every):
        if f"{env} {controller}" in skipped:
            rows.append({"env": env, "controller": controller, "skipped": skipped[f"{env} {controller}"]})
            continue
        mine = [one for one in every if (one.env, one.controller) == (env, controller)]
        rows.append({"env": env, "controller": controller, **_row(mine, out)})
    return {"suite": every[0].suite, "budget": every[0].budget, "smpl": __version__, "rows": rows}


def _row(mine: Iterable[Run], out: Path) -> dict[str, Any]:
    scores = [json.loads((one.folder(out) / "scores.json").read_text(encoding="utf-8")) for one in mine]
    returns = np.concatenate([one["returns"] for one in scores])
    steps = np.array([one["steps"] for one in scores], dtype=np.float64)
    means, deviations = (np.array([one[key] for one in scores]) for key in ("mean", "std"))
    mean = float((steps * means).sum() / steps.sum())
    variance = float((steps * (deviations**2 + (means - mean) ** 2)).sum() / steps.sum())
    first = next(iter(mine))
    return {
        "seeds": len(scores),
        "episodes": len(returns),
        "mean": mean,
        "std": float(np.sqrt(variance)),
        # Twenty steps of an episode compare with nothing.
        "published": None if first.budget == "smoke" else SUBJECTS[first.env].controllers[first.controller],
        "return_mean": float(returns.mean()),
        "return_interval": list(bootstrap(returns)),
        "return_iqm": float(interquartile_mean(returns)),
        "failures": sum(one["failures"] for one in scores),
        "successes": sum(one["successes"] for one in scores),
        "seconds": sum(one["seconds"] for one in scores),
    }


_HEADINGS = ("environment", "controller", "per step", "published", "return", "failures", "successes", "episodes", "s")


def _rows(table: dict[str, Any]) -> list[list[str]]:
    lines = [list(_HEADINGS)]
    for row in table["rows"]:
        if "skipped" in row:
            lines.append([row["env"], row["controller"], f"skipped: {row['skipped']}", *[""] * 6])
            continue
        low, high = row["return_interval"]
        published = "" if row["published"] is None else "{:.5g} ± {:.5g}".format(*row["published"])
        steps = f"{row['mean']:.5g} ± {row['std']:.5g}"
        returns = f"{row['return_mean']:.5g} ({low:.5g} to {high:.5g})"
        counts = [str(row[key]) for key in ("failures", "successes", "episodes")]
        lines.append([row["env"], row["controller"], steps, published, returns, *counts, f"{row['seconds']:.1f}"])
    return lines


def _markdown(table: dict[str, Any]) -> str:
    head, *body = [f"| {' | '.join(row)} |" for row in _rows(table)]
    text = f"Suite {table['suite']}, budget {table['budget']}, smpl {table['smpl']}."
    return "\n".join([text, "", head, "|" + " --- |" * len(_HEADINGS), *body]) + "\n"


def _write(path: Path, text: str) -> None:
    """Write a file, whole or not at all."""
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(text + ("" if text.endswith("\n") else "\n"), encoding="utf-8")
    temporary.replace(path)


def _one_of(what: str, value: str, known: Sequence[str]) -> None:
    if value not in known:
        raise ValueError(f"{what} is {value!r}; there are: {', '.join(known)}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark as the command line says; the exit status is 2 where it cannot be done."""
    parser = argparse.ArgumentParser("python -m smpl.benchmark", description="The benchmark.")
    parser.add_argument("--suite", default="control", help=f"one of {', '.join(SUITES)}, all")
    parser.add_argument("--budget", default="smoke", help=f"one of {', '.join(BUDGETS)}")
    parser.add_argument("--env", metavar="NAME", help="one environment in place of all")
    parser.add_argument("--seeds", type=int, metavar="N", help="runs of each controller")
    parser.add_argument("--out", default="benchmark", metavar="DIR", help="folder of the runs")
    parser.add_argument("--resume", action="store_true", help="go on in a folder that has runs")
    parser.add_argument("--workers", type=int, metavar="W", help="threads or processes; default: all processors")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    given = parser.parse_args(arguments)

    def work() -> int:
        found = benchmark(
            given.out, given.suite, given.budget, env=given.env, seeds=given.seeds, resume=given.resume,
            workers=given.workers, progress=not given.quiet,
        )  # fmt: skip
        print(text_table(_rows(found)))
        return 0

    return guarded(work)


if __name__ == "__main__":
    raise SystemExit(main())
