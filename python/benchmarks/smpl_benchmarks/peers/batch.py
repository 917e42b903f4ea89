"""Batches of the reactor: a second core, and rollouts. The section `steps` compares with peers."""

from __future__ import annotations

import os
import time

import numpy as np

import smpl
from smpl.support.arguments import FloatArray
from smpl_benchmarks.peers.common import at_least, environment, title

MANY, MANY_STEPS = 4096, 10
PLANS, HORIZON = 1000, 100
RTOL = 1e-6


def main(repeats: int) -> None:
    """Print all comparisons."""
    title(f"Two threads, {MANY} environments")
    two_cores(repeats)
    title(f"Rollouts: {PLANS} action sequences of {HORIZON} steps, one thread")
    rollouts(repeats)


def compiled(name: str, rtol: float = RTOL) -> smpl.Model:
    """A model at a tolerance and without a time limit."""
    return environment(name, rtol).model


def actions(env: smpl.VectorEnv, steps: int, width: float = 0.02) -> FloatArray:
    """Normalised actions near the nominal ones, another one for each environment and step."""
    low, high = env.action_low, env.action_high
    nominal = 2 * (env.model.native.defaults("action") - low) / (high - low) - 1
    shape = (steps, env.num_envs, len(low))
    return np.clip(nominal + np.random.default_rng(0).uniform(-width, width, shape), -1, 1)


def two_cores(repeats: int) -> None:
    """Wall time of the same steps on one thread and on two, and the additional work."""
    if (os.cpu_count() or 1) < 2:
        print("  skipped: there is one processor")
        return
    model = compiled("reactor")
    envs = {n: smpl.VectorEnv(model, MANY, num_threads=n, method="auto") for n in (1, 2)}
    times: dict[int, list[tuple[float, float]]] = {n: [] for n in envs}
    given = actions(envs[1], MANY_STEPS)
    for _ in range(repeats):
        for n, env in envs.items():
            env.reset(seed=0)
            for action in given:
                begin = time.perf_counter(), time.process_time()
                env.step(action)
                times[n].append((time.perf_counter() - begin[0], time.process_time() - begin[1]))
    (one, work), (two, shared) = (np.median(each, axis=0) for each in times.values())
    least, least_of_two = (np.min(each, axis=0)[0] for each in times.values())
    ratio = least / least_of_two
    print(f"  a step of all: one thread {one * 1e3:.2f} ms, two {two * 1e3:.2f} ms; least {ratio:.2f} times")
    print(f"  processor time {work * 1e3:.2f} ms, with two threads {shared * 1e3:.2f} ms")
    at_least("one thread over two", float(one / two), 1.9)


def rollouts(repeats: int) -> None:
    """Time of the same trajectories by a rollout and by a vector environment."""
    model = compiled("reactor")
    env = smpl.VectorEnv(model, PLANS, num_threads=1, method="auto", normalize=False)
    nominal = model.native.defaults("action")
    width = 0.02 * (env.action_high - env.action_low)
    given = nominal + np.random.default_rng(0).uniform(-1, 1, (PLANS, HORIZON, len(nominal))) * width
    start = model.native.defaults("state")
    times: dict[str, list[float]] = {"rollout": [], "steps": []}
    for _ in range(repeats):
        begin = time.thread_time()
        result = model.rollout(start, given, method="auto", threads=1)
        times["rollout"].append(time.thread_time() - begin)
        env.reset(seed=0, options={"state": start})
        by_step = np.moveaxis(given, 1, 0)
        begin = time.thread_time()
        states = [np.empty(0)]
        for action in by_step:
            env.step(action)
            states.append(env.state)
        times["steps"].append(time.thread_time() - begin)
    one, other = (float(np.median(each)) for each in times.values())
    per = 1e6 / (PLANS * HORIZON)
    print(f"  rollout {one * per:.3f} us a step, vector environment {other * per:.3f} us, states kept by both")
    same = np.array_equal(result.states[:, 1], states[1])
    print(f"  the first states are {'equal to the bit' if same else 'not equal'}")
    at_least("steps of a vector environment over a rollout", other / one, 1.5)
