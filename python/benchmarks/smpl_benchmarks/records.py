"""Results of finished runs: in the folder of the run, or as a small file that a repository keeps.

A record has the configuration, the versions, the scores and the learning curve of a run, some kilobytes; networks,
checkpoints and data sets stay where they were made. `BUDGET/ENV/SUITE/NAME/seed-N.json` under one folder.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from smpl_benchmarks.subjects import Run
from smpl_benchmarks.training import curve

# What scores are kept; the returns of the episodes carry all that the intervals need.
_SCORES = (
    *("mean", "std", "steps", "returns", "failures", "failures_by_cause", "successes", "cost_mean", "settled"),
    *("settling_time", "latency_ms", "policy", "training_seconds", "seconds", "diverged"),
)
_CURVE = ("steps", "mean", "failures")
# What says which run it is; the rest of a configuration says by what it was made.
_MADE_BY = ("smpl", "checksum", "versions")


@dataclass(frozen=True)
class Result:
    """What a finished run has brought.

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
        """What of the configuration is not as the run would have it today; versions and the model's text apart."""
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
    """The result of a run as a record has it; none if there is no record.

    Raises:
        ValueError: the file is none.
    """
    path = place(run, records)
    if not path.is_file():
        return None
    found = _read(path)
    try:
        columns = found["curve"]
        rows = [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]
        return Result(run, {key: found["scores"][key] for key in found["scores"]}, rows, found["configuration"])
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"{path} is no record of a run: {type(error).__name__} {error}") from error


def place(run: Run, records: Path) -> Path:
    """The file of a run."""
    return records / run.budget / run.env / run.suite / run.controller / f"seed-{run.number}.json"


def keep(result: Result, records: Path) -> None:
    """Write the record of a run, whole or not at all; one that is there is replaced."""
    path = place(result.run, records)
    path.parent.mkdir(parents=True, exist_ok=True)
    content = {
        "configuration": dict(result.configuration),
        "scores": {key: _short(result.scores[key]) for key in _SCORES if key in result.scores},
        "curve": {key: [_short(row[key]) for row in result.curve] for key in _CURVE},
    }
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(_text(content), encoding="utf-8")
    temporary.replace(path)


def _read(path: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except ValueError as error:
        raise ValueError(f"{path} is damaged ({error}): remove it, and the run is made again") from error


def _short(value: Any) -> Any:
    """Numbers of lists with eight significant digits; what the statistics are made of stays as it is."""
    if isinstance(value, list):
        return [_short(float(f"{one:.8g}")) if isinstance(one, float) else one for one in value]
    return int(value) if isinstance(value, float) and value.is_integer() and abs(value) < 2**53 else value


def _text(content: Mapping[str, Mapping[str, Any]]) -> str:
    """JSON with a line for each key of the second level."""
    parts = []
    for name, values in content.items():
        lines = [f"  {json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in values.items()]
        parts.append(f" {json.dumps(name)}: {{\n" + ",\n".join(lines) + "\n }")
    return "{\n" + ",\n".join(parts) + "\n}\n"
