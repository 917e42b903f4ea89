"""Results of finished runs: in the folder of the run, or as a line of a file of a repository.

A record has the configuration, the versions, the scores and the learning curve of a run.
Networks, checkpoints and data sets stay where they were made.
`BUDGET-SUITE.jsonl` in one folder has a line of JSON per run, ordered by environment, controller
and seed. `BUDGET-control-earlier.jsonl` has the first record of controls that were run again with
another text of the model. The page compares both, as learned policies have the former text.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from smpl_benchmarks.subjects import Run
from smpl_benchmarks.training import curve

# What scores are kept; the returns of the episodes carry all that the intervals need.
_SCORES = (
    *("mean", "std", "steps", "returns", "failures", "failures_by_cause", "successes", "cost_mean", "settled"),
    *("settling_time", "latency_ms", "policy", "training_seconds", "seconds", "diverged", "at_limit", "validation"),
)
_CURVE = ("steps", "mean", "failures")


Key = tuple[str, str, int]


@dataclass(frozen=True)
class Result:
    """Scores, learning curve and configuration of a finished run.

    Attributes:
        run: which.
        scores: as in `scores.json`.
        curve: rows of the learning curve, empty for a controller.
        configuration: what it was run with, and by which versions.
    """

    run: Run
    scores: Mapping[str, Any]
    curve: list[dict[str, float]]
    configuration: Mapping[str, Any]

    def differing(self) -> list[str]:
        """Keys of the configuration that differ from those of the run today."""
        here = json.loads(json.dumps(self.run.described()))
        return [key for key, value in here.items() if self.configuration.get(key) != value]


def in_folder(run: Run, out: Path) -> Result | None:
    """The result of a run in its folder; none if it is not finished."""
    folder = run.folder(out)
    if not (folder / "scores.json").is_file():
        return None
    scores, configuration = (_read(folder / f"{name}.json") for name in ("scores", "configuration"))
    return Result(run, scores, curve(folder), configuration)


def recorded(run: Run, records: Path) -> Result | None:
    """The result of a run as a record has it; None if there is no record.

    Raises:
        ValueError: a line of the file is not a record.
    """
    found = kept(place(run, records)).get(_key(run))
    if found is None:
        return None
    columns = found["curve"]
    rows = [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]
    return Result(run, dict(found["scores"]), rows, found["configuration"])


def place(run: Run, records: Path) -> Path:
    """The file with the record of a run."""
    return records / f"{run.budget}-{run.part}.jsonl"


def earlier(path: Path) -> Mapping[Key, Mapping[str, Any]]:
    """First records of the controls that were run again with another text of the model."""
    return kept(_earlier(path))


def keep(result: Result, records: Path) -> None:
    """Write the record of a run, whole or not at all; the run's former record is replaced.

    The first record of a control moves to the earlier ones if the text of the model has changed.
    """
    content = {
        "configuration": dict(result.configuration),
        "scores": {key: _short(result.scores[key]) for key in _SCORES if key in result.scores},
        "curve": {key: [_short(row[key]) for row in result.curve] for key in _CURVE},
    }
    records.mkdir(parents=True, exist_ok=True)
    with _alone(records):
        path, key = place(result.run, records), _key(result.run)
        every, before = kept(path), kept(_earlier(path))
        former = every.get(key, content)["configuration"]
        rewritten = former.get("checksum") != result.configuration.get("checksum")
        if rewritten and result.run.suite == "control" and key not in before:
            _write_lines(_earlier(path), {**before, key: every[key]})
        _write_lines(path, {**every, key: content})


def _earlier(path: Path) -> Path:
    return path.with_name(f"{path.stem}-earlier.jsonl")


def _write_lines(path: Path, every: Mapping[Key, Mapping[str, Any]]) -> None:
    text = "".join(json.dumps(every[key], allow_nan=False) + "\n" for key in sorted(every))
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(text, encoding="utf-8")
    temporary.replace(path)


def _key(run: Run) -> Key:
    return run.env, run.controller, run.number


def kept(path: Path) -> Mapping[Key, Mapping[str, Any]]:
    """Records of a file by environment, controller and number of the seed."""
    if not path.is_file():
        return {}
    about = path.stat()
    return _read_lines(path, about.st_mtime_ns, about.st_size)


@lru_cache(maxsize=16)
def _read_lines(path: Path, time: int, size: int) -> Mapping[Key, Mapping[str, Any]]:
    found: dict[Key, Mapping[str, Any]] = {}
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        try:
            record = json.loads(line)
            about, lengths = record["configuration"], {len(values) for values in record["curve"].values()}
            if len(lengths) > 1 or not isinstance(record["scores"], dict):
                raise ValueError("columns of different lengths")
            found[str(about["env"]), str(about["controller"]), int(about["number"])] = record
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            text = f"{type(error).__name__} {error}"
            raise ValueError(
                f"{path}, line {number}, is not a record of a run ({text}): remove the line, and the run is made again"
            ) from error
    return found


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Let one process at a time write into a folder."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _read(path: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except ValueError as error:
        raise ValueError(f"{path} is damaged ({error}): remove it, and the run is made again") from error


def _short(value: Any) -> Any:
    """Numbers of lists with eight significant digits; single numbers are unchanged."""
    if isinstance(value, list):
        return [_short(float(f"{one:.8g}")) if isinstance(one, float) else one for one in value]
    return int(value) if isinstance(value, float) and value.is_integer() and abs(value) < 2**53 else value
