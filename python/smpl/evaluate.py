"""`python -m smpl.evaluate ENV --controller A --policy FILE --episodes N`: compares controllers."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from smpl.collect import add_environment, add_ray, environment, guarded, once
from smpl.deploy.results import record
from smpl.learning import Plan, Task
from smpl.learning.agents import Agent, agent
from smpl.learning.progress import Progress
from smpl.learning.reports import content, table, text_table, write
from smpl.learning.scores import Score, distinct, score, single
from smpl.support.arguments import as_count


def main(arguments: Sequence[str] | None = None) -> int:
    """Evaluate as the command line says; the exit status is 1 where it cannot be done."""
    parser = argparse.ArgumentParser("python -m smpl.evaluate", description="Controllers and policies side by side.")
    once(parser)
    add_environment(parser)
    parser.add_argument(
        "--policy", action="append", metavar="FILE", help="a learned policy: PPO:FILE.zip, FILE.d3, FILE.pt"
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="write report.json, report.md, report.html and result.json there"
    )
    parser.add_argument("--workers", type=int, metavar="W", help="threads or processes; default: all processors")
    add_ray(parser)
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    given = parser.parse_args(arguments)
    return guarded(lambda: _evaluate(given))


def compare_controllers(
    env: Any,
    controllers: Sequence[Any],
    episodes: int,
    *,
    seed: int = 0,
    starts: Any = None,
    workers: int | None = None,
    progress: bool = False,
    ray: str | None = None,
    **arguments: Any,
) -> tuple[Plan, list[Score]]:
    """Run the same episodes with each controller.

    Args:
        env: id, model's name, path, compiled model, or an environment without wrappers.
        controllers: see `smpl.learning.agent`.
        episodes, seed, starts: which episodes; episode i has the seed seed + i and the same start
            for all.
        workers: threads or processes; all processors if none.
        progress: show a progress bar.
        ray: address of a cluster of Ray that runs them, see `smpl.learning.cluster`.
        arguments: of the environment.

    Returns:
        The plan of the episodes and a score for each controller; `smpl.learning.reports` writes
        them.

    Raises:
        ValueError: an argument has an invalid value.
        RunError: an episode does not start, or its controller fails.
    """
    task = Task.of(env, **arguments)
    agents = [agent(one, task.model) for one in controllers]
    for one, name in zip(agents, distinct([one.name for one in agents]), strict=True):
        one.name = name
    plan = Plan.of(task, agents, episodes, seed=seed, starts=starts)
    if workers is not None:
        as_count("workers", workers)  # reported before an episode runs
    scores = []
    for number, one in enumerate(plan.agents):
        with Progress(progress, one.name, plan.episodes) as bar:
            scores.append(score(single(plan, number), workers, bar.add, ray=ray))
    return plan, scores


def _evaluate(given: argparse.Namespace) -> int:
    names: list[str | Agent] = [*(given.controller or []), *(given.policy or [])]
    plan, scores = compare_controllers(
        given.env,
        names or ["nominal"],
        given.episodes,
        seed=given.seed,
        starts=given.starts,
        workers=given.workers,
        progress=not given.quiet,
        ray=given.ray,
        **environment(given),
    )
    report = content(plan, scores) if given.out is None else write(given.out, replace(plan), scores)
    if given.out is not None:
        record(given.out, given.env, environment(given), given.starts, plan, scores)
    print(text_table(table(report)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
