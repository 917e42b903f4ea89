"""Places of the page on the origin of the records: texts, tuning, budgets, time of a run."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from smpl_benchmarks import configuration
from smpl_benchmarks.pages import grid
from smpl_benchmarks.records import Key, Result, earlier, kept
from smpl_benchmarks.subjects import SUBJECTS


def checks(records: Path | None, budget: str) -> str:
    """Returns of controls that were run with two texts of a model, on the same episodes."""
    path = (records or Path()) / f"{budget}-control.jsonl"
    before, now = earlier(path), kept(path)
    envs = dict.fromkeys([*SUBJECTS, *(key[0] for key in before)])
    lines = [_check(env, before, now) for env in envs if any(key[0] == env for key in before)]
    head = ["process", "rows", "episodes", "episodes with the same return", "largest relative difference of a return"]
    return grid(head, lines, left=2) if lines else "No control was run with two texts of its model."


def _check(env: str, before: Mapping[Key, Mapping[str, Any]], now: Mapping[Key, Mapping[str, Any]]) -> list[str]:
    keys = [key for key in before if key[0] == env and key in now]
    pairs = [(before[key]["scores"]["returns"], now[key]["scores"]["returns"]) for key in keys]
    counts = [min(len(old), len(new)) for old, new in pairs]
    old, new = (
        np.concatenate([np.array(pair[side][:count]) for pair, count in zip(pairs, counts, strict=True)])
        for side in (0, 1)
    )
    apart = np.abs(new - old) / np.maximum(np.maximum(np.abs(old), np.abs(new)), np.finfo(float).tiny)
    rows = ", ".join(dict.fromkeys(key[1] for key in keys))
    # Records keep eight digits.
    return [env, rows, str(len(old)), str(int((apart < 1e-7).sum())), f"{apart.max():.2g}"]


def tuning() -> str:
    """Adopted searches of hyperparameters, with the score before and after."""
    if importlib.util.find_spec("yaml") is None:
        return ""
    head = ["process", "row", "trials", "steps", "reward of a step, before", "after", "command"]
    lines = [
        [
            env, f"{name} ({suite})", str(about["trials"]), str(about["steps"]), f"{about['score_before']:.4g}",
            f"{about['score']:.4g}", f"`{about['command']}`",
        ]
        for env, suites in configuration.read()["tuned"].items()
        for suite, named in suites.items()
        for name, about in named.items()
    ]  # fmt: skip
    return grid(head, lines, left=2)


def cost(results: Sequence[Result]) -> str:
    """Minutes of wall time of a training with its scores: the shortest of the seeds."""
    learned = [one for one in results if one.run.suite != "control"]
    times: dict[tuple[str, str], dict[str, float]] = {}
    for one in learned:
        row = times.setdefault((one.run.suite, one.run.controller), {})
        minutes = float(one.scores["seconds"]) / 60
        row[one.run.env] = min(minutes, row.get(one.run.env, minutes))
    envs = [
        env for env in dict.fromkeys([*SUBJECTS, *chain(*times.values())]) if any(env in row for row in times.values())
    ]
    lines = [
        [suite, name, *(f"{row[env]:.1f}" if env in row else "" for env in envs)]
        for (suite, name), row in sorted(times.items())
    ]
    return grid(["suite", "row", *envs], lines, left=2) if lines else "No policy was trained."


def longer(records: Path | None) -> str:
    """Rows trained with the budget `paper`, compared with `short` on the common test episodes."""
    head = ["process", "row", "seeds", "steps", "return", "return with `short`", "paper - short, by seed"]
    lines = []
    for suite in ("offline", "online"):
        short, paper = (kept((records or Path()) / f"{budget}-{suite}.jsonl") for budget in ("short", "paper"))
        for env, name in dict.fromkeys(key[:2] for key in paper):
            pairs = [(paper[key], short[key]) for key in sorted(paper) if key[:2] == (env, name) and key in short]
            if pairs:
                lines.append([env, f"{name} ({suite})", *_longer(pairs)])
    return grid(head, lines, left=2) if lines else "No row was trained with the budget `paper`."


def _longer(pairs: Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]]) -> list[str]:
    count = min(len(one["scores"]["returns"]) for pair in pairs for one in pair)
    for pair in pairs:
        paper, short = (one["configuration"] for one in pair)
        if (paper["seed"], paper["arguments"]) != (short["seed"], short["arguments"]):
            raise ValueError(f"{short['env']} {short['controller']}: both budgets need the same test episodes")
    long, short = (
        np.array([pair[side]["scores"]["returns"][:count] for pair in pairs], dtype=np.float64) for side in (0, 1)
    )
    steps = int(pairs[0][0]["curve"]["steps"][-1])
    apart = ", ".join(f"{one:+.4g}" for one in (long - short).mean(axis=1))
    return [str(len(pairs)), f"{steps:,}", f"{long.mean():.5g}", f"{short.mean():.5g}", apart]
