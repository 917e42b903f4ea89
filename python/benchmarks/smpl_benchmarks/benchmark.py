"""`python -m smpl.benchmark --suite control --budget smoke`: the benchmark, one folder per run.

A run is an environment, a controller or an algorithm, and a seed. Its folder has
`configuration.json` (settings and versions), the checkpoints of training, and, when it is finished,
`scores.json`. The command resumes unfinished runs. It writes `table.md` and `table.json` over all
runs, and figures; with `--results` also a record of each run, small enough for a repository.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from smpl._native import __version__
from smpl.collect import add_ray, guarded, once
from smpl.learning import Plan, Task
from smpl.learning.cluster import spread_on_ray
from smpl.learning.progress import Progress
from smpl.learning.reports import text_table
from smpl.learning.scores import score
from smpl.support.arguments import as_count
from smpl_benchmarks import controls, gallery, release, tune, tune_controls
from smpl_benchmarks.common import MOST_SEEDS, SEEDS
from smpl_benchmarks.curves import draw
from smpl_benchmarks.data_curve import DATA, ENV, data_runs
from smpl_benchmarks.historical import __main__ as historical
from smpl_benchmarks.learned import train_and_score, validator, versions
from smpl_benchmarks.pages import markdown, place_in, places_of
from smpl_benchmarks.places import places
from smpl_benchmarks.records import Result, in_folder, keep, recorded
from smpl_benchmarks.subjects import BUDGETS, SUBJECTS, SUITES, Run, runs
from smpl_benchmarks.tables import lines, remarks, table
from smpl_benchmarks.tracks import RESIDUAL, TRACKS, of_controls

__all__ = ["SUBJECTS", "Run", "benchmark", "main", "runs"]


def benchmark(
    out: str | os.PathLike[str],
    suite: str = "control",
    budget: str = "smoke",
    *,
    env: str | Sequence[str] | None = None,
    seeds: int | None = None,
    resume: bool = False,
    algorithms: Sequence[str] = (),
    config: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    progress: bool = False,
    ray: str | None = None,
    run_nothing: bool = False,
    results: str | os.PathLike[str] | None = None,
    track: str = RESIDUAL,
) -> dict[str, Any]:
    """Run a suite and write its table and figures.

    Args:
        out: folder of the runs.
        suite, budget: what and how much.
        env: processes to run, all by default: one of the package or of `config`, the path of a
            model, an id, or several.
        seeds: runs of each controller; 1 for `smoke`, else 3.
        resume: go on in a folder that has runs; those that are finished are not run again.
        algorithms: names of controllers and algorithms; all if empty.
        config: a YAML file over the configuration of the package, see
            `smpl_benchmarks.configuration`.
        workers: threads or processes; all processors if none.
        progress: show a progress bar.
        ray: address of a cluster of Ray that makes the runs, see `smpl.learning.cluster`.
        run_nothing: make table and figures of the finished runs only.
        results: folder of records of finished runs; with `resume`, runs with a record are not run
            again.
        track: see `smpl_benchmarks.tracks`.

    Returns:
        What `table.json` holds.

    Raises:
        ValueError: an argument is not valid, or the folder has other runs.
    """
    folder, records = Path(out), None if results is None else Path(results)
    if workers is not None:
        as_count("workers", workers)
    count = seeds if seeds is not None else (1 if budget == "smoke" else 3)
    every = (
        data_runs(budget, env, count, algorithms, config)
        if suite == DATA
        else runs(suite, budget, env, count, algorithms, config, track)
    )
    if run_nothing:
        every = [one for one in every if _result(one, folder, records) is not None]
        if not every:
            raise ValueError(f"{results or out} has no finished run of this suite, budget and environment")
    elif not resume and any(folder.glob("*/*/*/seed-*")):
        raise ValueError(f"{folder} has runs already: give --resume to go on, or another folder")
    skipped: dict[str, str] = {}
    made = ((one, "") for one in every) if run_nothing else _made(every, folder, records, workers, ray, resume)
    with Progress(progress, suite, len(every)) as bar:
        for one, reason in made:
            if reason:
                skipped[f"{one.suite} {one.env} {one.controller}"] = reason
            elif records is not None:
                _record(one, folder, records)
            bar.add(1)
    return _report(every, folder, records, skipped)


def _result(one: Run, out: Path, records: Path | None) -> Result | None:
    """The result of a run by its folder or by its record; None if it is not finished."""
    found = in_folder(one, out)
    return recorded(one, records) if found is None and records is not None else found


def finished(
    suite: str,
    env: str | Sequence[str] | None,
    config: str | os.PathLike[str] | None,
    budget: str,
    records: str | os.PathLike[str] | None,
    out: Path,
) -> list[Result]:
    """Finished results of a suite in all its tracks, in the folder `out` or by their record."""
    kept = None if records is None else Path(records)
    if suite == DATA:
        every = [*data_runs(budget, env, config=config), *runs("control", budget, env or ENV, SEEDS)]
    else:
        every = runs(suite, budget, env, MOST_SEEDS, config=config)
    if suite == "all" and ENV in {one.env for one in every}:
        every += data_runs(budget, config=config)
    envs = [name for name in SUBJECTS if name in {one.env for one in every}]
    for track, about in TRACKS.items():
        names = [name for name in envs if name in (about.processes or SUBJECTS)]
        if suite in ("online", "all") and about.learners and track != RESIDUAL and names:
            every += runs("online", budget, names, SEEDS, about.learners, config, track)
            if of_controls(track) == track:
                every += runs("control", budget, names, SEEDS, (), config, track)
    return [found for one in every if (found := _result(one, out, kept)) is not None]


def _record(one: Run, out: Path, records: Path) -> None:
    """Keep the result of a run that is finished in its folder, unless it is kept already."""
    found = in_folder(one, out)
    if found is not None:
        before = recorded(one, records)
        if before is None or before.configuration != found.configuration:
            keep(found, records)


def _report(every: Sequence[Run], out: Path, records: Path | None, skipped: dict[str, str]) -> dict[str, Any]:
    """Write table and figures."""
    found = {one.name: _result(one, out, records) for one in every}
    results = {name: one for name, one in found.items() if one is not None}
    content = table(every, results, skipped, _changed(results))
    out.mkdir(parents=True, exist_ok=True)
    _write(out / "table.json", json.dumps(content, indent=1))
    text = f"Suites: {content['suite']}; budget {content['budget']}, smpl {content['smpl']}."
    _write(out / "table.md", f"{text}\n\n{markdown(content)}")
    draw(results.values(), content, out)
    return content


def _changed(results: Mapping[str, Result]) -> dict[str, list[str]]:
    """Settings of each result that differ from those of a run of today."""
    checksums: dict[str, str] = {}
    found = {}
    for name, one in results.items():
        about = json.dumps([one.run.env, one.run.arguments], sort_keys=True)
        if about not in checksums:
            checksums[about] = one.run.task().checksum
        differing = one.differing()
        # The checksum is of the arguments too.
        other = "arguments" not in differing and one.configuration.get("checksum") != checksums[about]
        found[name] = [*differing, *["model"] * other]
    return found


def _made(
    every: Sequence[Run], out: Path, records: Path | None, workers: int | None, ray: str | None, resume: bool
) -> Iterator[tuple[Run, str]]:
    """Make the runs, here or on a cluster; yields each with the reason if it cannot be made.

    With `resume`, a run whose record has the settings of today is not made again, even if the text
    of the model has changed.
    """
    left = []
    for i, one in enumerate(every):
        known = recorded(one, records) if resume and records is not None else None
        if in_folder(one, out) is None and known is not None and not known.differing():
            yield one, ""
        elif ray is None or in_folder(one, out) is not None:
            yield one, _make(one, out, workers)
        else:
            left.append(i)
    if not left:
        return
    begun = {i: _contents(every[i].folder(out)) for i in left}
    for i, (reason, files) in spread_on_ray(_make_elsewhere, (tuple(every), begun), left, str(ray)):
        _place(every[i].folder(out), files)
        yield every[i], reason


def _make_elsewhere(shared: tuple[tuple[Run, ...], dict[int, dict[str, bytes]]], number: int) -> Any:
    """Make a run on a machine of a cluster: it gets the files of the run and returns new ones."""
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
    """Run an unfinished run; returns the reason if it cannot be run, otherwise an empty text.

    Raises:
        ValueError: its folder has another run.
    """
    folder = one.folder(out)
    configuration = {**one.described(), "smpl": __version__}
    task = one.task()
    configuration["checksum"] = task.checksum
    if (folder / "scores.json").is_file():
        _same(folder, configuration)
        return ""
    configuration["versions"] = versions()
    begin = time.perf_counter()
    try:
        if one.suite == "control":
            controller = _controller(one, task)
            plan = Plan.of(task, controller, one.episodes, seed=one.seed, randomize=one.settings.get("randomize"))
            _describe(folder, configuration)
            report = score(plan, workers, kept=0).report()
            report["seconds"] = time.perf_counter() - begin
            report |= _validated(one, task, controller, workers)
        else:
            _describe(folder, configuration)
            report = _learned(one, task, folder, out / "data", workers)
    except (ImportError, NotImplementedError) as error:
        return str(error)
    _write(folder / "scores.json", json.dumps(report, indent=1, allow_nan=False))
    return ""


def _controller(one: Run, task: Task) -> Any:
    """The controller of a run of the suite `control`."""
    if "control" in one.settings:
        return controls.made(task, one.env, one.controller, one.settings["control"].get("point", ()))
    return one.settings.get("controller", one.controller)


def _validated(one: Run, task: Task, controller: Any, workers: int | None) -> dict[str, Any]:
    """Scores of a control on the validation episodes, once for all its blocks.

    Empty if rows are not selected.
    """
    episodes = SUBJECTS[one.env].validation if one.env in SUBJECTS and one.budget == "short" else 0
    if one.number or not episodes or one.controller in SUBJECTS[one.env].few:
        return {}
    mean, returned, failures = validator(task, episodes, workers)(controller)
    return {"validation": {"mean": mean, "return": returned, "failures": failures, "episodes": episodes}}


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
    algorithm = one.settings.get("algorithm", one.controller)
    return train_and_score(
        one.suite, task, algorithm, one.number, scored, one.settings, folder, data, workers
    )  # fmt: skip


def _write(path: Path, text: str) -> None:
    """Write a file, whole or not at all."""
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(text + ("" if text.endswith("\n") else "\n"), encoding="utf-8")
    temporary.replace(path)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark as the command line says; the exit status is 1 where it cannot be done."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words[:1] == ["tune"]:
        return tune.main(words[1:])
    if words[:1] == ["historical"]:
        return historical.main(words[1:])
    if words[:1] == ["controls"]:
        return tune_controls.main(words[1:])
    if words[:1] == ["release"]:
        return release.main(words[1:])
    if words[:1] == ["gallery"]:
        return gallery.main(words[1:])
    parser = argparse.ArgumentParser(
        "python -m smpl.benchmark",
        description="The benchmark.",
        epilog="tune --help: search hyperparameters; controls --help: tune controls; release --help: data sets; "
        "gallery --help: controllers of the gallery",
    )
    once(parser)
    parser.add_argument("--suite", default="control", help=f"one of {', '.join(SUITES)}, all, {DATA}")
    parser.add_argument("--budget", default="smoke", help=f"one of {', '.join(BUDGETS)}")
    parser.add_argument(
        "--env", action="append", metavar="ENV", help="instead of all: a process, or the path of a model; repeatable"
    )
    parser.add_argument("--track", default=RESIDUAL, help=f"one of {', '.join(TRACKS)}")
    parser.add_argument("--seeds", type=int, metavar="N", help="runs of each controller")
    parser.add_argument("--algorithm", action="append", default=[], metavar="NAME", help="only this one; repeatable")
    parser.add_argument("--config", metavar="FILE", help="YAML over the configuration of the package")
    parser.add_argument("--out", default="benchmark", metavar="DIR", help="folder of the runs")
    parser.add_argument("--resume", action="store_true", help="go on in a folder that has runs")
    parser.add_argument("--table", action="store_true", help="run nothing: table and figures of what is finished")
    parser.add_argument("--results", metavar="DIR", help="records of finished runs, which a repository keeps")
    parser.add_argument("--page", metavar="FILE", help="put the table into the places <!-- table --> of a page")
    parser.add_argument("--workers", type=int, metavar="W", help="threads or processes; default: all processors")
    add_ray(parser)
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    given = parser.parse_args(words)

    def work() -> int:
        if given.page is not None:
            places_of(Path(given.page))  # fails now, not after hours
        found = benchmark(
            given.out, given.suite, given.budget, env=given.env, seeds=given.seeds, resume=given.resume,
            algorithms=given.algorithm, config=given.config, workers=given.workers,
            ray=given.ray, run_nothing=given.table, progress=not given.quiet, results=given.results,
            track=given.track,
        )  # fmt: skip
        if given.page is not None:
            results = finished(given.suite, given.env, given.config, given.budget, given.results, Path(given.out))
            place_in(Path(given.page), found, places(results, given.results and Path(given.results), given.budget))
        print(text_table(lines(found)) + remarks(found))
        return 0

    return guarded(work)


if __name__ == "__main__":
    raise SystemExit(main())
