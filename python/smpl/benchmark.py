"""`python -m smpl.benchmark --suite control --budget smoke`: the benchmark, one folder a run, resumed where it stopped.

A run is an environment, a controller or an algorithm, and a seed. Its folder has `configuration.json` (what was run,
by which versions), what training needs to go on, and, when it is finished, `scores.json`. The command writes `table.md`
and `table.json` over all runs, and figures.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from smpl._native import __version__
from smpl._registry import ENVIRONMENTS
from smpl.collect import add_ray, guarded
from smpl.learning import Plan, Task, configuration
from smpl.learning.cluster import spread_on_ray
from smpl.learning.curves import draw
from smpl.learning.learned import PUBLISHED, train_and_score, versions
from smpl.learning.progress import Progress
from smpl.learning.reports import text_table
from smpl.learning.scores import score
from smpl.learning.statistics import bootstrap, interquartile_mean
from smpl.model import as_count

SUITES, BUDGETS = ("control", "offline", "online"), ("smoke", "short", "paper")
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
        {"pid": (-1.0823, 35.0924), "mpc": (-0.1912, 15.9328), "oracle": None, "nominal": None, "random": None},
        _QUICK,
    ),
    "Beer": Subject(
        {"scenario": "legacy"},
        {"profile": None, "isothermal": None, "oracle": None, "nominal": None, "random": None},
        _QUICK,
    ),
    "PenSim": Subject({}, {"recipe": None, "oracle": None, "nominal": None, "random": None}, _LONG),
    "Atropine": Subject({}, {"mpc": None, "zero": None, "oracle": None, "nominal": None}, _LONG),
    "MAb": Subject({}, {"mpc": None, "empc": None, "oracle": None, "nominal": None}, _LONG),
    "MAbPlant": Subject({}, {"oracle": None, "nominal": None}, _LONG),
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
    settings: dict[str, Any] = field(default_factory=dict)

    def folder(self, out: Path) -> Path:
        """Where it is kept."""
        return out / self.suite / self.env / self.controller / f"seed-{self.number}"


def runs(
    suite: str,
    budget: str,
    env: str | None,
    seeds: int,
    algorithms: Sequence[str] = (),
    config: str | os.PathLike[str] | None = None,
) -> list[Run]:
    """All runs of a suite, with `algorithms` only those of these controllers and algorithms.

    Raises:
        ValueError: no such suite, budget, environment or algorithm.
        ImportError: the suite needs PyYAML.
    """
    _one_of("suite", suite, (*SUITES, "all"))
    _one_of("budget", budget, BUDGETS)
    if env is not None:
        env = env.removeprefix("smpl/").removesuffix("-v0")
        _one_of("env", env, tuple(ENVIRONMENTS))
    count = as_count("seeds", seeds)
    chosen = SUITES if suite == "all" else (suite,)
    given = configuration.read(config) if chosen != ("control",) else {}
    known, found = set(), []
    for part in chosen:
        for name in SUBJECTS if env is None else (env,):
            listed = SUBJECTS[name].controllers if part == "control" else configuration.algorithms(given, part)
            known |= set(listed)
            for one in listed:
                if not algorithms or one in algorithms:
                    settings = configuration.settings(given, part, name, one, budget) if part != "control" else {}
                    found += [_run(part, budget, name, one, number, settings) for number in range(count)]
    for one in algorithms:
        _one_of("algorithm", one, sorted(known))
    return found


def _run(suite: str, budget: str, env: str, controller: str, number: int, settings: dict[str, Any]) -> Run:
    subject = SUBJECTS[env]
    arguments = {**subject.arguments, **({"max_steps": _SMOKE_STEPS} if budget == "smoke" else {})}
    return Run(suite, budget, env, controller, number, number * _APART, subject.episodes[budget], arguments, settings)


def benchmark(
    out: str | os.PathLike[str],
    suite: str = "control",
    budget: str = "smoke",
    *,
    env: str | None = None,
    seeds: int | None = None,
    resume: bool = False,
    algorithms: Sequence[str] = (),
    config: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    progress: bool = False,
    ray: str | None = None,
    run_nothing: bool = False,
) -> dict[str, Any]:
    """Run a suite and write its table and figures.

    Args:
        out: folder of the runs.
        suite, budget: what and how much.
        env: one environment in place of all.
        seeds: runs of each controller; 1 for `smoke`, else 3.
        resume: go on in a folder that has runs; those that are finished are not run again.
        algorithms: names of controllers and algorithms; all if empty.
        config: a YAML file over the configuration of the package, see `smpl.learning.configuration`.
        workers: threads or processes; all processors if none.
        progress: show a progress bar.
        ray: address of a cluster of Ray that makes the runs, see `smpl.learning.cluster`.
        run_nothing: make table and figures of the runs that are finished, whatever others there are.

    Returns:
        What `table.json` holds.

    Raises:
        ValueError: an argument is none of what it may be, or the folder has other runs.
    """
    folder = Path(out)
    count = seeds if seeds is not None else (1 if budget == "smoke" else 3)
    every = runs(suite, budget, env, count, algorithms, config)
    if run_nothing:
        every = _finished(every, folder)
    if not (resume or run_nothing) and any(folder.glob("*/*/*/seed-*")):
        raise ValueError(f"{folder} has runs already: give --resume to go on, or another folder")
    skipped: dict[str, str] = {}
    with Progress(progress, suite, len(every)) as bar:
        for one, reason in _made(every, folder, workers, ray):
            if reason:
                skipped[f"{one.suite} {one.env} {one.controller}"] = reason
            bar.add(1)
    return _report(every, folder, skipped)


def _finished(every: Sequence[Run], out: Path) -> list[Run]:
    found = [one for one in every if (one.folder(out) / "scores.json").is_file()]
    if not found:
        raise ValueError(f"{out} has no finished run of this suite, budget and environment")
    return found


def _report(every: Sequence[Run], out: Path, skipped: dict[str, str]) -> dict[str, Any]:
    """Write table and figures."""
    table = _table(every, out, skipped)
    _write(out / "table.json", json.dumps(table, indent=1))
    _write(out / "table.md", _markdown(table))
    draw(table, out)
    return table


def _made(every: Sequence[Run], out: Path, workers: int | None, ray: str | None) -> Iterator[tuple[Run, str]]:
    """Make the runs, here or on a cluster; yields each with why it cannot be made, empty where it was."""
    if ray is None:
        for one in every:
            yield one, _make(one, out, workers)
        return
    left = [i for i, one in enumerate(every) if not (one.folder(out) / "scores.json").is_file()]
    for one in every:
        if (one.folder(out) / "scores.json").is_file():
            yield one, _make(one, out, workers)
    begun = {i: _contents(every[i].folder(out)) for i in left}
    for i, (reason, files) in spread_on_ray(_make_elsewhere, (tuple(every), begun), left, ray):
        _place(every[i].folder(out), files)
        yield every[i], reason


def _make_elsewhere(shared: tuple[tuple[Run, ...], dict[int, dict[str, bytes]]], number: int) -> Any:
    """Make a run on a machine of a cluster: what is there of it comes along, and its files go back."""
    every, begun = shared
    with tempfile.TemporaryDirectory() as place:
        folder = every[number].folder(Path(place))
        _place(folder, begun[number])
        reason = _make(every[number], Path(place), 1)
        return reason, _contents(folder)


def _contents(folder: Path) -> dict[str, bytes]:
    """Files of a run by their paths; what was not finished writing is left out."""
    found = [file for file in sorted(folder.rglob("*")) if file.is_file()]
    names = {file.relative_to(folder).as_posix(): file for file in found}
    return {name: file.read_bytes() for name, file in names.items() if not name.startswith(".")}


def _place(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write the files of a run; its scores, which say that it is finished, come last."""
    for name in sorted(files, key=lambda name: name == "scores.json"):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_name(f".{path.name}.tmp")
        temporary.write_bytes(files[name])
        temporary.replace(path)


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
        _same(folder, configuration)
        return ""
    configuration["versions"] = versions()
    begin = time.perf_counter()
    try:
        if one.suite == "control":
            plan = Plan.of(task, one.controller, one.episodes, seed=one.seed)
            _describe(folder, configuration)
            report = score(plan, workers, kept=0).report()
            report["seconds"] = time.perf_counter() - begin
        else:
            _describe(folder, configuration)
            report = _learned(one, task, folder, out / "data", workers)
    except (ImportError, NotImplementedError) as error:
        return str(error)
    _write(folder / "scores.json", json.dumps(report, indent=1, allow_nan=False))
    return ""


def _describe(folder: Path, configuration: dict[str, Any]) -> None:
    """Write what a run is.

    Raises:
        ValueError: it has begun as another run.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "configuration.json"
    if path.is_file() and (folder / "progress.json").is_file():
        _same(folder, configuration)
    _write(path, json.dumps(configuration, indent=1))


def _same(folder: Path, configuration: dict[str, Any]) -> None:
    there = json.loads((folder / "configuration.json").read_text(encoding="utf-8"))
    here = json.loads(json.dumps(configuration))
    differing = [key for key, value in here.items() if key != "versions" and there.get(key) != value]
    if differing:
        told = ", ".join(f"{key} {there.get(key)!r} there, {here[key]!r} here" for key in differing)
        raise ValueError(f"{folder} is another run ({told}): give another folder")


def _learned(one: Run, task: Task, folder: Path, data: Path, workers: int | None) -> dict[str, Any]:
    scored = {"seed": one.seed, "episodes": one.episodes}
    return train_and_score(
        one.suite, task, one.controller, one.number, scored, one.settings, folder, data, workers
    )  # fmt: skip


def _table(every: Sequence[Run], out: Path, skipped: dict[str, str]) -> dict[str, Any]:
    """Scores of each controller over its seeds."""
    rows = []
    for which in dict.fromkeys((one.env, one.suite, one.controller) for one in every):
        env, suite, controller = which
        row: dict[str, Any] = {"env": env, "suite": suite, "controller": controller}
        if f"{suite} {env} {controller}" in skipped:
            rows.append({**row, "skipped": skipped[f"{suite} {env} {controller}"]})
            continue
        rows.append({**row, **_row([one for one in every if (one.env, one.suite, one.controller) == which], out)})
    rows.sort(key=lambda row: list(SUBJECTS).index(row["env"]))
    suites = list(dict.fromkeys(one.suite for one in every))
    return {"suite": ", ".join(suites), "budget": every[0].budget, "smpl": __version__, "rows": rows}


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
        "published": None if first.budget == "smoke" else _published(first),
        "return_mean": float(returns.mean()),
        "return_interval": list(bootstrap(returns)),
        "return_iqm": float(interquartile_mean(returns)),
        "failures": sum(one["failures"] for one in scores),
        "successes": sum(one["successes"] for one in scores),
        "seconds": sum(one["seconds"] for one in scores),
    }


def _published(one: Run) -> tuple[float, float] | None:
    if one.suite == "control":
        return SUBJECTS[one.env].controllers[one.controller]
    # The row of the paper stands beside the algorithm, whichever package runs it.
    plain = one.controller.removesuffix("-2022").removeprefix("RLlib-")
    # Its figures belong to the original's behaviour.
    legacy = one.arguments.get("scenario") == "legacy"
    return PUBLISHED.get((one.suite, one.env, plain)) if legacy else None


_HEADINGS = (
    "environment",
    "suite",
    "controller",
    "per step",
    "published",
    "return",
    "failures",
    "successes",
    "episodes",
    "s",
)


def _rows(table: dict[str, Any]) -> list[list[str]]:
    lines = [list(_HEADINGS)]
    for row in table["rows"]:
        if "skipped" in row:
            lines.append([row["env"], row["suite"], row["controller"], f"skipped: {row['skipped']}", *[""] * 6])
            continue
        low, high = row["return_interval"]
        published = "" if row["published"] is None else "{:.5g} ± {:.5g}".format(*row["published"])
        steps = f"{row['mean']:.5g} ± {row['std']:.5g}"
        returns = f"{row['return_mean']:.5g} ({low:.5g} to {high:.5g})"
        counts = [str(row[key]) for key in ("failures", "successes", "episodes")]
        lines.append(
            [row["env"], row["suite"], row["controller"], steps, published, returns, *counts, f"{row['seconds']:.1f}"]
        )
    return lines


def _markdown(table: dict[str, Any]) -> str:
    head, *body = [f"| {' | '.join(row)} |" for row in _rows(table)]
    text = f"Suites: {table['suite']}; budget {table['budget']}, smpl {table['smpl']}."
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
    parser.add_argument("--algorithm", action="append", default=[], metavar="NAME", help="only this one; repeatable")
    parser.add_argument("--config", metavar="FILE", help="YAML over the configuration of the package")
    parser.add_argument("--out", default="benchmark", metavar="DIR", help="folder of the runs")
    parser.add_argument("--resume", action="store_true", help="go on in a folder that has runs")
    parser.add_argument("--table", action="store_true", help="run nothing: table and figures of what is finished")
    parser.add_argument("--workers", type=int, metavar="W", help="threads or processes; default: all processors")
    add_ray(parser)
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    given = parser.parse_args(arguments)

    def work() -> int:
        found = benchmark(
            given.out, given.suite, given.budget, env=given.env, seeds=given.seeds, resume=given.resume,
            algorithms=given.algorithm, config=given.config, workers=given.workers,
            ray=given.ray, run_nothing=given.table, progress=not given.quiet,
        )  # fmt: skip
        print(text_table(_rows(found)))
        return 0

    return guarded(work)


if __name__ == "__main__":
    raise SystemExit(main())
