"""Records of an evaluation's episodes, and scores from them."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from smpl._native import SimulationError
from smpl.controllers.safety import SafetyFilter, rates
from smpl.episodes import Episode
from smpl.learning.cluster import spread_on_ray
from smpl.learning.plan import Plan
from smpl.learning.running import batched, run
from smpl.learning.statistics import bootstrap, interquartile_mean, probability_of_improvement
from smpl.learning.workers import spread
from smpl.loop import Job, Settings
from smpl.support.arguments import FloatArray, as_count

# Episodes that are kept whole for the pictures, decisions whose times are kept, episodes a worker
# takes at a time.
KEPT, DECISIONS, CHUNK = 64, 20_000, 8
# Episodes of a piece that is run in a native batch.
_BATCH = 1024


@dataclass(frozen=True)
class Summary:
    """One episode in few numbers.

    Attributes:
        index, seed: which one.
        steps, total, mean, squares: number, sum and mean of its rewards, and their squared
            deviations from the mean.
        last: its last reward, which is the error reward where it failed.
        failure: identifier of the cause, empty for none; text: what the environment says.
        success: whether a success ended it.
        cost: sum of all violations over its steps; violations: the same by constraint.
        violated: steps with a violation.
        settling: time from which on the state stays near the steady one, NaN where it never does;
            none where the model has no steady state.
        start: observation of the reset, physical units.
        at_limit: share of the actions, over all steps and names, that are at a limit of the action
            box.
    """

    index: int
    seed: int
    steps: int
    total: float
    mean: float
    squares: float
    last: float
    failure: str
    text: str
    success: bool
    cost: float
    violations: dict[str, float]
    violated: int
    settling: float | None
    start: FloatArray
    at_limit: float = 0.0


@dataclass
class Score:
    """All episodes of one controller.

    Attributes:
        name: of the controller.
        summaries: in the order of the plan.
        kept: the first episodes, whole.
        latencies: seconds of decisions, the first of them.
        filtered: counts of a safety filter, see `SafetyFilter.counts`; None for another controller.
    """

    name: str
    summaries: list[Summary] = field(default_factory=list)
    kept: list[Episode] = field(default_factory=list)
    latencies: list[float] = field(default_factory=list)
    filtered: FloatArray | None = None

    @property
    def returns(self) -> FloatArray:
        """Sum of the rewards of each episode."""
        return np.array([one.total for one in self.summaries])

    def pooled(self) -> tuple[float, float, int]:
        """Mean and population deviation over all steps of all episodes, and their number."""
        steps = np.array([one.steps for one in self.summaries], dtype=np.float64)
        means = np.array([one.mean for one in self.summaries])
        count = float(steps.sum())
        middle = float((steps * means).sum() / count)
        squares = math.fsum(one.squares for one in self.summaries) + float((steps * (means - middle) ** 2).sum())
        return middle, math.sqrt(squares / count), int(count)

    def report(self) -> dict[str, Any]:
        """The numbers of `report.json`."""
        every, returns = self.summaries, self.returns
        middle, deviation, steps = self.pooled()
        means = np.array([one.mean for one in every])
        penalized = np.array([one.last if one.failure else one.mean for one in every])
        aimed = [one.settling for one in every if one.settling is not None]
        settled = [time for time in aimed if np.isfinite(time)]
        times = np.array(self.latencies) * 1e3
        return {
            "mean": middle,
            "std": deviation,
            "steps": steps,
            "episode_mean": float(means.mean()),
            "episode_std": float(means.std()),
            "penalized_episode_mean": float(penalized.mean()),
            "penalized_episode_std": float(penalized.std()),
            "return_mean": float(returns.mean()),
            "return_interval": list(bootstrap(returns)),
            "return_iqm": float(interquartile_mean(returns)),
            "return_iqm_interval": list(bootstrap(returns, interquartile_mean)),
            "returns": returns.tolist(),
            "lengths": [one.steps for one in every],
            "failures": sum(bool(one.failure) for one in every),
            "failures_by_cause": dict(Counter(one.failure for one in every if one.failure).most_common()),
            "successes": sum(one.success for one in every),
            "cost_mean": float(np.mean([one.cost for one in every])),
            "violations": {
                name: float(np.mean([one.violations[name] for one in every])) for name in every[0].violations
            },
            "violated_steps": float(sum(one.violated for one in every) / steps),
            "at_limit": float(sum(one.at_limit * one.steps for one in every) / steps),
            "settled": len(settled) if aimed else None,
            "settling_time": float(np.median(settled)) if settled else None,
            "latency_ms": float(np.median(times)) if len(times) else None,
            "latency_p99_ms": float(np.quantile(times, 0.99)) if len(times) else None,
            **({} if self.filtered is None else {"safety_filter": rates(self.filtered)}),
        }


def compare(score: Score, baseline: Score) -> dict[str, Any]:
    """Compares a controller with another on the same episodes, pair by pair.

    The regret is relative to the full-information controller.
    """
    difference = score.returns - baseline.returns
    regret = {"regret": float(-difference.mean()), "regret_interval": list(bootstrap(-difference))}
    return {
        "baseline": baseline.name,
        "difference": float(difference.mean()),
        "interval": list(bootstrap(difference)),
        "better": float(np.mean(difference > 0)),
        "probability_of_improvement": probability_of_improvement(score.returns, baseline.returns),
        **(regret if baseline.name == "full_information" else {}),
    }


def score(
    plan: Plan,
    workers: int | None = None,
    stepped: Callable[[int], None] | None = None,
    kept: int = KEPT,
    ray: str | None = None,
) -> Score:
    """Run the episodes of a plan with one agent.

    Args:
        plan: the episodes.
        workers: threads of the native batch, or processes; all processors if none.
        stepped: called with the number of episodes after each that has ended.
        kept: how many episodes to keep whole.
        ray: address of a cluster that runs them, see `smpl.learning.cluster`; the scores are the
            same to the bit.

    Raises:
        RunError: an episode could not be run.
    """
    count = as_count("workers", workers if workers is not None else os.cpu_count() or 1)
    found = Score(plan.agents[0].name)
    target = _target(plan)
    if ray is not None:
        ends = _ends(plan, _BATCH if batched(plan) else CHUNK)
        _gather(found, _ordered(ends, spread_on_ray(_work, (plan, target, kept), ends, ray)), stepped, kept)
        return found
    if batched(plan) or count == 1 or plan.episodes <= CHUNK:
        # In pieces: what is not kept is forgotten.
        ends = _ends(plan, _BATCH if batched(plan) else CHUNK)
        pieces: Iterable[Score] = (_piece(plan, first, last, count, target, kept) for first, last in ends)
        _gather(found, pieces, stepped, kept)
        return found
    ends = _ends(plan, CHUNK)
    _gather(found, _ordered(ends, spread(_work, (plan, target, kept), ends, count)), stepped, kept)
    return found


def _ends(plan: Plan, size: int) -> list[tuple[int, int]]:
    """Pieces of the plan, the same for any number of workers: batches may affect networks."""
    return [(first, min(first + size, plan.episodes)) for first in range(0, plan.episodes, size)]


def _work(shared: tuple[Plan, tuple[FloatArray, FloatArray] | None, int], ends: tuple[int, int]) -> Score:
    plan, target, kept = shared
    return _piece(plan, *ends, 1, target, kept)


def _ordered(ends: Sequence[tuple[int, int]], results: Iterator[tuple[Any, Score]]) -> Iterator[Score]:
    """The pieces in the order of `ends`, each as soon as those before it are there."""
    early: dict[tuple[int, int], Score] = {}
    coming = iter(ends)
    wanted = next(coming, None)
    for piece, result in results:
        early[piece] = result
        while wanted in early:
            yield early.pop(wanted)
            wanted = next(coming, None)


def _gather(found: Score, pieces: Iterable[Score], stepped: Callable[[int], None] | None, kept: int) -> None:
    for piece in pieces:
        found.summaries += piece.summaries
        found.kept += piece.kept[: max(0, kept - len(found.kept))]
        found.latencies += piece.latencies[: max(0, DECISIONS - len(found.latencies))]
        if piece.filtered is not None:
            found.filtered = piece.filtered + (0.0 if found.filtered is None else found.filtered)
        if stepped is not None:
            stepped(len(piece.summaries))


def _piece(
    plan: Plan, first: int, last: int, threads: int, target: tuple[FloatArray, FloatArray] | None, kept: int
) -> Score:
    """Episodes first, ..., last - 1."""
    found = Score(plan.agents[0].name)
    whole: list[tuple[int, Episode]] = []
    settings = Settings(target is not None, (), threads, found.latencies)
    chooser = plan.agents[0].chooser
    before = chooser.counts if isinstance(chooser, SafetyFilter) else None
    for job, one in run(plan, plan.jobs(first, last), settings):
        found.summaries.append(summary(plan, job, one, target))
        if job.index < kept:
            whole.append((job.index, one))
    if before is not None:
        found.filtered = chooser.counts - before
    found.summaries.sort(key=lambda one: one.index)
    found.kept = [one for _, one in sorted(whole, key=lambda pair: pair[0])]
    return found


def summary(plan: Plan, job: Job, one: Episode, target: tuple[FloatArray, FloatArray] | None) -> Summary:
    """The numbers of an episode."""
    middle = float(one.rewards.mean())
    violations = {} if one.details is None else one.details.violations
    return Summary(
        job.index,
        int(job.seed or 0),
        one.steps,
        float(one.rewards.sum()),
        middle,
        float(((one.rewards - middle) ** 2).sum()),
        float(one.rewards[-1]),
        one.failure.partition(":")[0].strip(),
        one.failure,
        one.success,
        float(one.costs[1:].sum()),
        {name: float(values[1:].sum()) for name, values in violations.items()},
        int(np.count_nonzero(one.costs[1:])),
        None if target is None else settling_time(one, *target),
        physical(plan, one.observations[0]),
        _at_limit(plan, one),
    )


def _at_limit(plan: Plan, one: Episode) -> float:
    """Share of the actions of an episode at a limit, within a millionth of the box's width."""
    if one.applied is None:
        return 0.0
    low, high = plan.task.model.native.bounds("action")
    near = np.minimum(one.applied - low, high - one.applied) <= 1e-6 * (high - low)
    return float(np.mean(near)) if near.size else 0.0


def settling_time(one: Episode, steady: FloatArray, width: FloatArray) -> float:
    """Time after which all states stay within `width` of the steady state; else NaN.

    Raises:
        ValueError: the states were not kept.
    """
    if one.states.shape[1] != len(steady):
        raise ValueError(f"the episode has {one.states.shape[1]} states, expected {len(steady)}")
    near = np.all(np.abs(one.states - steady) <= width, axis=1)
    if one.failure or not near[-1]:
        return float("nan")
    away = np.flatnonzero(~near)
    return float(one.times[0 if not len(away) else away[-1] + 1] - one.times[0])


def _target(plan: Plan) -> tuple[FloatArray, FloatArray] | None:
    """Steady state and the width around it, 2 % of each state's range; else None."""
    env = plan.task.env()
    env.reset(seed=0, options={"start": "nominal"})
    try:
        steady = env.steady_state
    except SimulationError:  # a `steady` block without a solution, which no episode needs
        return None
    if steady is None:
        return None
    low, high = env.model.native.bounds("state")
    extent = np.where(np.isfinite(high - low), high - low, np.abs(steady))
    return np.asarray(steady), 0.02 * extent


def physical(plan: Plan, observations: Any) -> FloatArray:
    """Observations in physical units."""
    low, high = plan.task.model.native.bounds("observation")
    values = np.asarray(observations, dtype=np.float64)
    if not plan.task.arguments.get("normalize", True):
        return values
    finite = np.isfinite(low) & np.isfinite(high)
    scaled = np.where(finite, low, 0.0) + (values + 1) / 2 * np.where(finite, high - low, 0.0)
    return np.where(finite, scaled, values)


def single(plan: Plan, number: int) -> Plan:
    """The same episodes with one of the plan's agents."""
    return replace(plan, agents=(plan.agents[number],), weights=(1.0,))


def distinct(names: Sequence[str]) -> list[str]:
    """Names made different by a number where they are the same."""
    seen: Counter[str] = Counter()
    result = []
    for name in names:
        seen[name] += 1
        result.append(name if seen[name] == 1 else f"{name} {seen[name]}")
    return result
