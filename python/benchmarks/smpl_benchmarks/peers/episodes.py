"""Errors of whole episodes by method and tolerance, which decide the models' methods.

Episodes have sampled starts and random actions and end as they end. The reference is `rosenbrock`
at 1e-12, or `ida` for models that `rosenbrock` refuses. Two other solutions bound its error: `ida`
at 1e-12 over the whole episodes and, where SciPy is installed, LSODA over single control steps from
the reference's state. An error is the largest one of all states and steps over the range of the
state: its declared bounds, or its range in the reference. The state of a failing step exceeds the
bounds, so its error has a separate column.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

import smpl
from smpl.support.arguments import FloatArray
from smpl_benchmarks.peers.common import installed, scenario, title

TIGHT = 1e-12
# Share of the action box, to both sides of its middle; `recipe`: actions of the model's policy, off
# by up to 1 %.
WIDTHS = {"random +-0.2": 0.2, "random +-1": 1.0, "recipe +-1 %": 0.0}
# Models whose control steps change no states but by their equations, and how many steps are
# compared with LSODA. The section `pensim` compares PenSim's.
PLAIN, CHECKED = ("reactor", "beer"), 100


@dataclass(frozen=True)
class Case:
    """Episodes of a model, and the methods and tolerances that are compared."""

    model: str
    actions: str
    seeds: int
    steps: int
    rtols: tuple[float, ...]


CASES = (
    *(Case("reactor", actions, 500, 100, (5e-10, 1e-9, 1e-8, 1e-6)) for actions in ("random +-0.2", "random +-1")),
    *(Case("beer", actions, 50, 200, (1e-8, 1e-7, 1e-6, 1e-5)) for actions in ("random +-0.2", "random +-1")),
    Case("pensim", "random +-0.2", 10, 1150, (1e-8, 1e-7, 1e-6)),
    Case("pensim", "recipe +-1 %", 2, 1150, (1e-8, 1e-7, 1e-6)),
    *(Case(model, "random +-0.2", 2, 10, (1e-8,)) for model in ("atropine", "mab", "mab_plant")),
)


@dataclass(frozen=True)
class Episode:
    """States after each step with the start, failures, and whether the episode terminated."""

    states: FloatArray
    end: tuple[str, ...] | None


@dataclass(frozen=True)
class Errors:
    """Largest errors over the ranges, and the number of episodes with equal ends and causes."""

    running: float
    failing: float
    same: int


def main(_repeats: int) -> None:
    """Print a table for each model and kind of actions."""
    title("Errors over whole episodes, in parts of the ranges of the states")
    for case in CASES:
        table(case)


def table(case: Case) -> None:
    """Print the errors of a case by method and tolerance."""
    exact, _ = episodes(case, reference_method(case.model), TIGHT)
    failed = sum(1 for one in exact if one.end and one.end[0])
    steps = sum(len(one.states) - 1 for one in exact)
    size = ranges(case.model, exact)
    print(f"  {case.model}, {case.actions}: {case.seeds} episodes of {steps} steps, {failed} end by failure")
    if distance := lsoda(case, size):
        print(f"    largest distance of a control step from SciPy's LSODA at 1e-12: {distance:.0e}")
    print("    | method | rtol | error | of failing steps | same end | us a step |\n    |---|---|---|---|---|---|")
    for method, rtol in runs(case):
        try:
            found, seconds = episodes(case, method, rtol)
        except ValueError:
            continue  # a method that refuses the model
        errors = compare(found, exact, size)
        name, tolerance = method or "by default", "" if rtol is None else f"{rtol:.0e}"
        same = f"{errors.same} of {case.seeds}"
        cells = (name, tolerance, f"{errors.running:.0e}", f"{errors.failing:.0e}", same, f"{seconds * 1e6:.0f}")
        print("    | " + " | ".join(cells) + " |", flush=True)


def runs(case: Case) -> Iterator[tuple[str | None, float | None]]:
    """Methods and tolerances that are compared; none: those of the model."""
    yield None, None
    yield "ida", TIGHT
    for method in ("auto", "explicit", "rosenbrock", "ida"):
        if method != "explicit" or len(case.rtols) > 1:  # the large models are too stiff
            yield from ((method, rtol) for rtol in case.rtols)


@cache
def reference_method(model: str) -> str:
    """`rosenbrock`, or `ida` where that refuses the model."""
    try:
        environment(model, "rosenbrock", TIGHT)
    except ValueError:
        return "ida"
    return "rosenbrock"


@cache
def environment(model: str, method: str | None, rtol: float | None) -> smpl.Env:
    """An environment in physical units by a method and a tolerance, or those of the model."""
    with scenario("" if rtol is None else f"solver: {{rtol: {rtol!r}, max_steps: 1000000}}\n") as path:
        return smpl.Env(model, normalize=False, scenario=path, method=method, observation="full")


def episodes(case: Case, method: str | None, rtol: float | None) -> tuple[list[Episode], float]:
    """All episodes of a case, and the processor time of a step."""
    env = environment(case.model, method, rtol)
    begin = time.thread_time()
    found = [episode(case, env, seed) for seed in range(case.seeds)]
    return found, (time.thread_time() - begin) / sum(len(one.states) - 1 for one in found)


def episode(case: Case, env: smpl.Env, seed: int) -> Episode:
    """One episode; its start, disturbances and actions belong to the seed."""
    env.reset(seed=seed)
    states, end = [env.state], None
    for action in actions(case, env, seed):
        _, _, terminated, truncated, info = env.step(action)
        states.append(env.state)
        if terminated or truncated:
            # The failures without the values that their messages quote.
            end = (*(part.split(" = ")[0] for part in info["failure"].split("; ")), str(terminated))
            break
    return Episode(np.array(states), end)


def actions(case: Case, env: smpl.Env, seed: int) -> Iterator[FloatArray]:
    """Actions of an episode: uniform in a part of the box, or the recipe with small errors."""
    draw = np.random.default_rng(seed)
    low, high = env.action_low, env.action_high
    width = WIDTHS[case.actions] * (high - low) / 2
    for _ in range(case.steps):
        if width.any():
            yield (low + high) / 2 + draw.uniform(-1, 1, len(low)) * width
        else:
            recipe = env.native.policy(env.model.native.policies[0])
            yield np.clip(recipe * (1 + 0.01 * draw.uniform(-1, 1, len(low))), low, high)


def ranges(model: str, exact: list[Episode]) -> FloatArray:
    """Ranges of the states: declared, or what they cover in the reference."""
    low, high = environment(model, reference_method(model), TIGHT).model.native.bounds("state")
    running = np.concatenate([one.states for one in exact])
    covered = running.max(axis=0) - running.min(axis=0)
    size = np.where(np.isfinite(high - low), high - low, covered)
    return np.where(size > 0, size, 1.0)


def compare(found: list[Episode], exact: list[Episode], size: FloatArray) -> Errors:
    """Errors of episodes against those of the reference, up to the earlier end of both."""
    running, failing, same = 0.0, 0.0, 0
    for one, other in zip(found, exact, strict=True):
        steps = min(len(one.states), len(other.states))
        each = np.max(np.abs(one.states[:steps] - other.states[:steps]) / size, axis=1)
        alike = len(one.states) == len(other.states) and one.end == other.end
        same += alike
        failed = not alike or bool(one.end and one.end[0])
        running = max(running, float(each[: steps - failed].max()))
        failing = max(failing, float(each[-1])) if failed else failing
    return Errors(running, failing, same)


def lsoda(case: Case, size: FloatArray) -> float | None:
    """Largest distance of control steps of the reference from those of SciPy's LSODA."""
    env = environment(case.model, reference_method(case.model), TIGHT)
    if case.model not in PLAIN or not installed("SciPy", "scipy"):
        return None
    from scipy.integrate import solve_ivp

    native = env.model.native
    worst, steps, seed = 0.0, 0, 0
    while steps < CHECKED and seed < case.seeds:
        env.reset(seed=seed)
        for action in actions(case, env, seed):
            before, begin = env.state, env.time
            _, _, terminated, truncated, info = env.step(action)
            if info["failure"] or steps == CHECKED:
                break
            u, given = np.asarray(action), in_force(env)
            rates = partial(native.rhs, u=u, given=given)
            span = (begin, begin + env.model.step)
            result = solve_ivp(rates, span, before, method="LSODA", rtol=1e-12, atol=1e-14 * size)
            worst = max(worst, float(np.max(np.abs(result.y[:, -1] - env.state) / size)))
            steps += 1
            if terminated or truncated:
                break
        seed += 1
    return worst


def in_force(env: smpl.Env) -> list[tuple[str, int, float]]:
    """Parameters, discrete variables and disturbances of the last step, for the native module."""
    roles = ("parameter", "discrete", "disturbance")
    return [(role, at, float(value)) for role in roles for at, value in enumerate(env.native.values(role))]
