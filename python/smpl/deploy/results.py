"""Results that others can replay: episodes, scores and digests of an evaluation."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from smpl import _native
from smpl.deploy.contract import model_hash
from smpl.learning.plan import Plan
from smpl.learning.policy_files import FILES
from smpl.learning.scores import Score

FORMAT, NAME = 1, "result.json"
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
        plan, scores: as `compare_controllers` returns them; a controller that is not made of a
            text cannot be replayed.
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
