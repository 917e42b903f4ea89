"""Results that others can replay: episodes, scores and digests of an evaluation, see `smpl verify`."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from smpl import _native
from smpl._arguments import as_count
from smpl.deploy.contract import model_hash
from smpl.evaluate import compare_controllers
from smpl.learning.plan import Plan
from smpl.learning.scores import Score
from smpl.policies import FILES

FORMAT, NAME = 1, "result.json"
# Relative tolerances of returns: of the same policy, and of an exported one.
SAME, EXPORTED = 1e-6, 1e-4
_KEYS = ("environment", "arguments", "model", "model_hash", "versions", "episodes", "seed", "starts", "controllers")
_SCORES = ("name", "policy", "digest", "returns", "lengths", "failures")


def record(
    folder: Path, env: str, arguments: Mapping[str, Any], starts: str | None, plan: Plan, scores: Sequence[Score]
) -> Path:
    """Write `result.json`.

    Args:
        folder: where it goes.
        env: id, name or path of the environment; arguments: those of `Task.of`.
        starts: text of the starts, as the command line has it.
        plan, scores: as `compare_controllers` returns them; a controller that is not made of a text cannot be replayed.
    """
    model = plan.task.model
    tree = {
        "smpl_result": FORMAT,
        "environment": env,
        "arguments": {key: value for key, value in arguments.items() if value is not None},
        "model": model.name,
        "model_hash": model_hash(model),
        "level": model.level,
        "reward": model.reward,
        "versions": {
            "smpl": _native.__version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "gymnasium": gymnasium.__version__,
        },
        "episodes": plan.episodes,
        "seed": plan.seed,
        "starts": starts,
        "controllers": [
            {
                "name": score.name,
                "policy": None if one.origin is None else one.origin[0],
                "digest": None if one.origin is None else digest_of(one.origin[0]),
                "returns": score.returns.tolist(),
                "lengths": [summary.steps for summary in score.summaries],
                "failures": [summary.failure for summary in score.summaries],
            }
            for one, score in zip(plan.agents, scores, strict=True)
        ],
    }
    file = folder / NAME
    file.write_text(json.dumps(tree, indent=1) + "\n", encoding="utf-8")
    return file


def digest_of(policy: str) -> str | None:
    """SHA-256 of the file of a policy; None of a controller by its name."""
    file = Path(policy.rpartition(":")[2])
    if file.suffix not in FILES or not file.is_file():
        return None
    return hashlib.sha256(file.read_bytes()).hexdigest()


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
        policy: another file to run in place of the recorded policy, such as an exported one.
        controller: only the controller of this name; needed with `policy` if the result has several.
        episodes: only so many, from the first; default: all.
        tolerance: of returns, relative to the recorded one or 1 if that is smaller; default: 1e-6, and 1e-4 with
            `policy`.
        workers: threads or processes; all processors if None.

    Raises:
        ValueError: the file is missing or not a result, an unknown controller, or a policy that cannot be replayed.
    """
    file = Path(result) / NAME if Path(result).is_dir() else Path(result)
    tree = read(file)
    chosen = _chosen(tree, policy, controller)
    count = min(tree["episodes"], as_count("episodes", episodes)) if episodes is not None else tree["episodes"]
    limit = (SAME if policy is None else EXPORTED) if tolerance is None else tolerance
    if not (np.isfinite(limit) and limit >= 0):
        raise ValueError(f"tolerance is {tolerance!r}, expected a number that is not negative")
    return [_replayed(tree, one, policy, count, limit, workers, file.parent) for one in chosen]


def read(file: Path) -> dict[str, Any]:
    """The content of a result file.

    Raises:
        ValueError: it is missing, not a result, or of a later format.
    """
    if not file.is_file():
        raise ValueError(f"result {str(file)!r} is not there; `python -m smpl.evaluate ... --out DIR` writes one")
    try:
        tree = json.loads(file.read_text(encoding="utf-8"))
        if tree.get("smpl_result") != FORMAT:
            raise ValueError(f"`smpl_result` is {tree.get('smpl_result')!r}, expected {FORMAT}")
        missing = [key for key in _KEYS if key not in tree]
        for one in tree.get("controllers", ()):
            missing += [f"controllers: {key}" for key in _SCORES if key not in one]
        if missing:
            raise ValueError(f"`{missing[0]}` is missing")
        for one in tree["controllers"]:
            for key in ("returns", "lengths", "failures"):
                if len(one[key]) != tree["episodes"]:
                    raise ValueError(f"{one['name']} has {len(one[key])} {key}, expected {tree['episodes']}")
    except (ValueError, TypeError, AttributeError, UnicodeDecodeError) as error:
        raise ValueError(f"{file} is not a result: {error}") from error
    return dict(tree)


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
    """The policy of a result: where it was, else next to the result; and a note if its file has changed."""
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
