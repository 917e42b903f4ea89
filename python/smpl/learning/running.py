"""Running the episodes of a plan, one by one or in a native batch; both give the same bits."""

from __future__ import annotations

import traceback
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from smpl._native import SimulationError
from smpl.episodes import Episode
from smpl.learning.plan import Plan
from smpl.loop import Batch, Job, Settings, Single, Stage, run_jobs

# Environments of a batch. It does not depend on the machine: what a network gives for a row may
# depend on how many.
SLOTS = 64


class RunError(RuntimeError):
    """An episode could not be run; the message names it."""


def batched(plan: Plan) -> bool:
    """True if all agents of a plan act on a whole batch at once."""
    return all(one.batched for one in plan.agents)


def run(plan: Plan, jobs: Sequence[Job], settings: Settings) -> Iterator[tuple[Job, Episode]]:
    """Run episodes; they come in the order in which they end.

    Raises:
        RunError: an episode does not start, or its controller fails or returns an invalid action.
    """
    if batched(plan):
        size = min(SLOTS, len(jobs)) if settings.batch else 1
        stage: Stage = Batch(plan.task.vector(size, settings.threads), settings.states)
    else:
        stage = Single(plan.task.env(), settings.states)
    yield from run_jobs(stage, plan.agents, jobs, settings, partial(_about, plan))


def drawn_parameters(plan: Plan) -> tuple[str, ...]:
    """Names of the parameters that differ between episodes: drawn by the model, or by the plan."""
    env = plan.task.env()
    values = []
    for seed in range(plan.seed, plan.seed + 4):
        env.reset(seed=seed)
        values.append(env._native.values("parameter"))
    varied = np.any(np.stack(values) != values[0], axis=0)
    names = zip(plan.task.model.parameter_names, varied, strict=True)
    return tuple(name for name, moves in names if moves or name in plan.randomize)


def _about(plan: Plan, job: Job, error: Exception) -> RunError:
    name, reason = plan.agents[job.agent].name, str(error)
    if not isinstance(error, (ValueError, SimulationError)):
        # A fault of the controller's own: what it is, and where.
        frame = traceback.extract_tb(error.__traceback__)[-1]
        reason = f"{type(error).__name__}: {error} ({Path(frame.filename).name}, line {frame.lineno})"
    return RunError(f"episode {job.index} (seed {job.seed}, controller {name}): {reason}")
