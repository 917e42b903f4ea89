"""Replays of results: the episodes run again, and the scores compared (`smpl verify`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from smpl.deploy.contract import model_hash
from smpl.deploy.results import NAME, digest_of, read
from smpl.evaluate import compare_controllers
from smpl.support.arguments import as_count

# Relative tolerances of returns: of the same policy, and of an exported one.
SAME, EXPORTED = 1e-6, 1e-4


@dataclass(frozen=True)
class Replay:
    """Scores of a controller that were replayed.

    Attributes:
        name: of the controller.
        episodes: how many were compared.
        worst: largest relative difference of a return.
        difference: text about the first episode that differs; empty if none does.
        notes: other differences, as of the model or the policy file.
    """

    name: str
    episodes: int
    worst: float
    difference: str
    notes: tuple[str, ...]


def verify(
    result: str | Path,
    *,
    policy: str | None = None,
    controller: str | None = None,
    episodes: int | None = None,
    tolerance: float | None = None,
    workers: int | None = None,
) -> list[Replay]:
    """Run the episodes of a result again and compare returns, lengths and failures.

    Args:
        result: `result.json`, or the folder with it.
        policy: another file to run instead of the recorded policy, such as an exported one.
        controller: only the controller of this name; needed with `policy` if there are several.
        episodes: only so many, from the first; default: all.
        tolerance: of returns, relative to the recorded one or 1 if that is smaller; default: 1e-6,
            and 1e-4 with `policy`.
        workers: threads or processes; all processors if None.

    Raises:
        ValueError: the file is missing or not a result, an unknown controller, or a policy that
            cannot be replayed.
    """
    file = Path(result) / NAME if Path(result).is_dir() else Path(result)
    tree = read(file)
    chosen = _chosen(tree, policy, controller)
    count = min(tree["episodes"], as_count("episodes", episodes)) if episodes is not None else tree["episodes"]
    limit = (SAME if policy is None else EXPORTED) if tolerance is None else tolerance
    if not (np.isfinite(limit) and limit >= 0):
        raise ValueError(f"tolerance is {tolerance!r}, expected a number that is not negative")
    return [_replayed(tree, one, policy, count, limit, workers, file.parent) for one in chosen]


def _chosen(tree: Mapping[str, Any], policy: str | None, controller: str | None) -> list[Mapping[str, Any]]:
    every = tree["controllers"]
    names = ", ".join(one["name"] for one in every)
    if controller is not None:
        every = [one for one in every if one["name"] == controller]
        if not every:
            raise ValueError(f"the result has no controller {controller!r}; there are: {names}")
    if policy is not None and len(every) != 1:
        raise ValueError(f"the result has the controllers {names}; name the one of {policy} by --controller")
    return list(every)


def _replayed(
    tree: Mapping[str, Any], one: Mapping[str, Any], policy: str | None, count: int, limit: float,
    workers: int | None, folder: Path,
) -> Replay:  # fmt: skip
    spec, notes = (policy, []) if policy is not None else _located(one, folder)
    arguments: dict[str, Any] = {key: tuple(v) if isinstance(v, list) else v for key, v in tree["arguments"].items()}
    plan, scores = compare_controllers(
        tree["environment"], [spec], count, seed=tree["seed"], starts=tree["starts"], workers=workers, **arguments
    )
    if model_hash(plan.task.model) != tree["model_hash"]:
        notes.append(f"the model {tree['model']} has changed since the result was recorded")
    found = scores[0].summaries
    worst, difference = 0.0, ""
    for index, summary in enumerate(found):
        recorded = float(one["returns"][index])
        far = abs(summary.total - recorded) / max(abs(recorded), 1.0)
        worst = max(worst, far)
        if not difference:
            difference = _difference(one, index, summary, tree["seed"] + index, not far <= limit)
    return Replay(one["name"], len(found), worst, difference, tuple(notes))


def _difference(one: Mapping[str, Any], index: int, summary: Any, seed: int, far: bool) -> str:
    pairs = (
        ("steps", one["lengths"][index], summary.steps, one["lengths"][index] != summary.steps),
        ("failure", one["failures"][index] or "none", summary.failure or "none",
         one["failures"][index] != summary.failure),
        ("return", one["returns"][index], summary.total, far),
    )  # fmt: skip
    for what, recorded, found, differs in pairs:
        if differs:
            return f"episode {index} (seed {seed}): {what} {found}, recorded {recorded}"
    return ""


def _located(one: Mapping[str, Any], folder: Path) -> tuple[str, list[str]]:
    """The policy of a result, or one next to the result; a note if its file has changed."""
    spec = one["policy"]
    if spec is None:
        raise ValueError(f"{one['name']} was not made of a name or a file, so it cannot be replayed; pass --policy")
    if one["digest"] is None:
        return spec, []
    kind, colon, file = spec.rpartition(":")
    places = [path for path in (Path(file), folder / Path(file).name) if path.is_file()]
    if not places:
        raise ValueError(f"policy file {file!r} is not there, nor {Path(file).name!r} next to the result")
    specs = [f"{kind}{colon}{path}" for path in places]
    right = [place for place in specs if digest_of(place) == one["digest"]]
    return (right or specs)[0], [] if right else [f"the policy file {file} has changed since the result was recorded"]
