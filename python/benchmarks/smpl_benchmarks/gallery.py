"""`python -m smpl.benchmark gallery`: controllers of the gallery's plants on the same episodes.

Each plant runs with its nominal actions, with its baseline and with predictive control by sampling,
from the same starts and with the same disturbances. The controllers are not tuned: the budget of
`SamplingMPC` is the same for all plants.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from smpl._native import __version__
from smpl.collect import guarded, once
from smpl.controllers import Nominal, SamplingMPC, baseline, baselines
from smpl.envs import Env
from smpl.evaluation import evaluate
from smpl.model import compile as compile_model
from smpl.registry import GALLERY
from smpl.support.arguments import as_count
from smpl_benchmarks.pages import fill, grid
from smpl_benchmarks.significance import student
from smpl_benchmarks.subjects import one_of

# The budget of the sampling controller in each decision.
BUDGET = {"horizon": 15, "samples": 64, "iterations": 2, "hold": 3}
# Seed of the first episode.
SEED = 7000
CONTROLLERS = ("nominal", "baseline", "sampling")


def score(name: str, episodes: int, steps: int) -> dict[str, Any]:
    """Returns of all controllers on one plant.

    Args:
        name: of the environment in `GALLERY`.
        episodes: starts, the same for each controller.
        steps: control steps of an episode, if the plant's limit is not lower.

    Returns:
        The settings, and for each controller `returns` and `failures`.
    """
    found: dict[str, Any] = {"episodes": episodes, "steps": steps, "smpl": __version__}
    model = compile_model(GALLERY[name])
    for controller in CONTROLLERS:
        env = Env(model, max_steps=min(steps, model.max_steps), normalize=False)
        done = evaluate(env, _made(controller, GALLERY[name]), episodes, SEED)
        found[controller] = {
            "returns": [episode.total for episode in done],
            "failures": sum(bool(episode.failure) for episode in done),
        }
    return found


def _made(controller: str, model: str) -> Any:
    if controller == "nominal":
        return Nominal()
    return SamplingMPC(**BUDGET) if controller == "sampling" else baseline(model, *baselines(model))


def rows(results: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
    """Rows of the table: returns, and the improvement on the nominal actions with its interval."""
    found = []
    for name, one in results.items():
        row = [f"`smpl/{name}-v0`", f"{np.mean(one['nominal']['returns']):.4g}"]
        for controller in CONTROLLERS[1:]:
            row.append(f"{np.mean(one[controller]['returns']):.4g}")
            low, high = student(gains(one, controller))
            row.append(f"{low:+.3g} to {high:+.3g}" + (" **" if low > 0 else ""))
        failures = "/".join(str(one[controller]["failures"]) for controller in CONTROLLERS)
        found.append([*row, failures])
    return found


def gains(one: Mapping[str, Any], controller: str) -> Any:
    """Return minus that of the nominal actions, for each start."""
    return np.asarray(one[controller]["returns"]) - np.asarray(one["nominal"]["returns"])


def table(results: Mapping[str, Mapping[str, Any]]) -> str:
    """The table as Markdown, with a sentence that counts improved plants."""
    first = next(iter(results.values()))
    better = {
        controller: sum(student(gains(one, controller))[0] > 0 for one in results.values())
        for controller in CONTROLLERS[1:]
    }
    budget = ", ".join(f"{name} {value}" for name, value in BUDGET.items())
    missing = [f"`{name}`" for name in GALLERY if name not in results]
    left = f"Plants without a record: {', '.join(missing)} (`--env NAME` runs one).\n" if missing else ""
    head = ["environment", "nominal", "baseline", "its gain", "sampling", "its gain", "failures"]
    return (
        f"Mean return over {first['episodes']} episodes of at most {first['steps']} steps, "
        f"the same for all controllers; `SamplingMPC` with {budget}.\n"
        "Gains are the 95 % interval of the difference from nominal actions (Student, over episodes); "
        "`**` marks intervals above zero.\n"
        "`failures` counts failed episodes (nominal/baseline/sampling).\n"
        f"The baseline improves on nominal actions for {better['baseline']} of {len(results)} plants, "
        f"sampling for {better['sampling']}.\n{left}\n"
    ) + grid(head, rows(results), left=1)


def main(arguments: Sequence[str]) -> int:
    """Run what is not in the records yet, and write records and table."""
    parser = argparse.ArgumentParser(
        "python -m smpl.benchmark gallery", description="Nominal actions, baselines and sampling on the gallery."
    )
    once(parser)
    parser.add_argument("--env", action="append", metavar="NAME", help="a plant of the gallery; repeatable")
    parser.add_argument("--episodes", type=int, default=20, metavar="N", help="starts of each plant")
    parser.add_argument("--steps", type=int, default=60, metavar="N", help="control steps of an episode at most")
    parser.add_argument("--results", default="docs/results/gallery.json", metavar="FILE", help="records")
    parser.add_argument("--again", action="store_true", help="run plants that have records again")
    parser.add_argument("--page", metavar="FILE", help="put the table into the place <!-- table: scores --> of a page")
    given = parser.parse_args(list(arguments))

    def work() -> int:
        as_count("episodes", given.episodes, 2, "at least 2")
        as_count("steps", given.steps)
        names = given.env or list(GALLERY)
        for name in names:
            one_of("env", name, list(GALLERY))
        path = Path(given.results)
        results = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
        for name in names:
            if given.again or not _same(results.get(name), given.episodes, given.steps):
                results[name] = score(name, given.episodes, given.steps)
                _keep(path, {name: results[name] for name in GALLERY if name in results})
                print(f"{name}: " + "  ".join(rows({name: results[name]})[0][1:]), file=sys.stderr)
        shown = {name: results[name] for name in GALLERY if _same(results.get(name), given.episodes, given.steps)}
        if given.page is not None:
            fill(Path(given.page), {"scores": table(shown)})
        print(table(shown))
        return 0

    return guarded(work)


def _same(one: Mapping[str, Any] | None, episodes: int, steps: int) -> bool:
    return one is not None and (one["episodes"], one["steps"]) == (episodes, steps)


def _keep(path: Path, results: Mapping[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    temporary.replace(path)
