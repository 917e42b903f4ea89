"""Training in segments from checkpoints; a resumed run has the bits of an uninterrupted one."""

from __future__ import annotations

import csv
import json
import re
import shutil
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np

CURVE, STATE = "curve.csv", "progress.json"
COLUMNS = ("segment", "steps", "mean", "return_mean", "failures", "best", "seconds")
# How packages say that a network has diverged.
_NOT_FINITE = re.compile(r"\bnan\b|\binf\b|not finite|not a number", re.IGNORECASE)
# What `validate` gives of a policy: mean over steps, mean return, failures.
Validate = Callable[[Any], tuple[float, float, int]]


class Trainer(Protocol):
    """An algorithm of some package."""

    def begin(self, seed: int) -> None:
        """Make a new learner."""

    def load(self, folder: Path) -> None:
        """Make the learner of a checkpoint."""

    def train(self, steps: int, seed: int, progress: float) -> None:
        """Go on; all randomness comes from the seed."""

    def save(self, folder: Path) -> None:
        """Write a checkpoint: all that `load` needs."""

    def export(self, folder: Path) -> str:
        """Write the policy; returns its `--policy` with the name of the file (`PPO:policy.zip`)."""


def learn(trainer: Trainer, folder: Path, steps: int, segments: int, seed: int, validate: Validate) -> str:
    """Train, or go on where it stopped.

    Args:
        trainer: the algorithm.
        folder: of the run, for `curve.csv`, `progress.json`, `checkpoint-K` and the best policy.
        steps: in all.
        segments: how many pieces.
        seed: of the run.
        validate: scores a policy.

    Returns:
        The `--policy` of the best policy by its mean return in the validation, the earliest of
        equals. A learner that diverges after the first segment ends the run, and its best policy is
        that of the segments before.
    """
    state = _state(folder)
    for number in range(state["segments"], segments if "diverged" not in state else 0):
        began = time.perf_counter()
        if number:
            trainer.load(folder / f"checkpoint-{number}")
        else:
            trainer.begin(seed)
        share = steps // segments + (number < steps % segments)
        try:
            if share:
                trainer.train(share, segment_seed(seed, number), number / segments)
            _checkpoint(trainer, folder, number + 1)
            _follow(trainer, folder, state, number, share, validate, began)
        except Exception as error:
            if not (number and _NOT_FINITE.search(str(error))):
                raise
            _write(folder, state | {"diverged": number + 1})
            words = str(error).strip().splitlines()[-1]
            warnings.warn(f"{folder}: training diverged in segment {number + 1} of {segments}: {words}", stacklevel=2)
            break
        shutil.rmtree(folder / f"checkpoint-{number}", ignore_errors=True)
    return str(state["policy"])


def segment_seed(seed: int, number: int) -> int:
    """A 31-bit seed of one segment of a run."""
    return int(np.random.SeedSequence([seed, number, 7]).generate_state(1)[0] >> 1)


def diverged(folder: Path) -> int | None:
    """The segment in which the learner of a run diverged, counted from one; none if it did not."""
    found = _state(folder).get("diverged")
    return None if found is None else int(found)


def curve(folder: Path) -> list[dict[str, float]]:
    """The rows of a run's `curve.csv`."""
    path = folder / CURVE
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]


def _state(folder: Path) -> dict[str, Any]:
    path = folder / STATE
    if path.is_file():
        return dict(json.loads(path.read_text(encoding="utf-8")))
    return {"segments": 0, "steps": 0, "best": None, "policy": "", "rows": []}


def _checkpoint(trainer: Trainer, folder: Path, number: int) -> None:
    """A checkpoint, whole or absent."""
    temporary, target = folder / ".checkpoint.tmp", folder / f"checkpoint-{number}"
    for left in (temporary, target):
        shutil.rmtree(left, ignore_errors=True)
    temporary.mkdir()
    trainer.save(temporary)
    temporary.rename(target)


def _follow(
    trainer: Trainer, folder: Path, state: dict[str, Any], number: int, share: int, validate: Validate, began: float
) -> None:
    """Validate, keep the policy if it is the best so far, and write the curve and the state."""
    fresh = folder / "latest"
    fresh.mkdir(exist_ok=True)
    spec = trainer.export(fresh)
    prefix, _, name = spec.rpartition(":")
    mean, returns, failures = validate(f"{prefix}:{fresh / name}" if prefix else str(fresh / name))
    # By the return: a failure that comes early leaves the mean of the steps before it.
    if state["best"] is None or returns > state["best"]:
        for file in fresh.iterdir():
            (folder / f".{file.name}.tmp").write_bytes(file.read_bytes())
            (folder / f".{file.name}.tmp").replace(folder / file.name)
        state |= {"best": returns, "policy": spec}
    state |= {"segments": number + 1, "steps": state["steps"] + share}
    row = (number + 1, state["steps"], mean, returns, failures, state["best"], time.perf_counter() - began)
    state["rows"].append(dict(zip(COLUMNS, row, strict=True)))
    with (folder / CURVE).open("w", newline="", encoding="utf-8") as table:
        writer = csv.DictWriter(table, COLUMNS)
        writer.writeheader()
        writer.writerows(state["rows"])
    _write(folder, state)


def _write(folder: Path, state: dict[str, Any]) -> None:
    temporary = folder / f".{STATE}.tmp"
    temporary.write_text(json.dumps(state, indent=1) + "\n", encoding="utf-8")
    temporary.replace(folder / STATE)
