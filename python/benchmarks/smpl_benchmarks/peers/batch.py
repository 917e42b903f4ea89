"""Batches: the reactor and the beer fermentation against EnvPool, a second core, rollouts.

EnvPool is the fastest vector environment of Python that we know. Its pendulum takes one explicit
Euler step, while the reactor is integrated to an error of 1e-6 of its ranges. It works in a
separate thread while the caller waits, so that processor time is that of the whole process. The two
take turns, some steps each: both meet the same machine.

Our two cases are near rest, the best case, and realistic. Near rest has actions within 0.02 of the
nominal ones, an error of 1e-6 and no time limit. Realistic has random actions of +-0.2, the model's
own method and tolerance, sampled starts, and episodes that end and begin again in the same step.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

import smpl
from smpl.support.arguments import FloatArray
from smpl_benchmarks.peers.common import at_least, environment, installed, title

COUNT, TURN = 256, 20
# Steps of a turn against the peer: whole episodes of all that are compared, so that starts count.
PERIOD = 200
MANY, MANY_STEPS = 4096, 10
PLANS, HORIZON = 1000, 100
RTOL = 1e-6
MODELS = ("reactor", "beer")

Clock = Callable[[], float]


def main(repeats: int) -> None:
    """Print all comparisons."""
    title(f"Batches of {COUNT} on one thread, an action each in each step")
    against_envpool(repeats)
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


def random_actions(env: smpl.VectorEnv) -> FloatArray:
    """Normalised actions of +-0.2, another one for each environment and step of a turn."""
    return np.random.default_rng(0).uniform(-0.2, 0.2, (PERIOD, env.num_envs, len(env.action_low)))


def largest_error(name: str) -> float:
    """Largest error of eight environments after `TURN` steps over ranges, by another method."""
    ends = []
    for rtol, method in ((RTOL, "auto"), (1e-11, "rosenbrock")):
        env = smpl.VectorEnv(compiled(name, rtol), 8, num_threads=1, method=method)
        env.reset(seed=0)
        for action in actions(env, TURN):
            env.step(action)
        ends.append(env.state)
    low, high = env.model.native.bounds("state")
    scale = np.where(np.isfinite(high - low), high - low, np.abs(ends[1]).max(axis=0))
    return float(np.max(np.abs(ends[0] - ends[1]) / scale))


def in_turn(steppers: Mapping[str, Callable[[int], None]], turns: int, clock: Clock) -> dict[str, float]:
    """Seconds of a step of each: the median of turns, each a mean over `PERIOD` steps."""
    times: dict[str, list[float]] = {name: [] for name in steppers}
    for _ in range(turns):
        for name, step in steppers.items():
            begin = clock()
            for k in range(PERIOD):
                step(k)
            times[name].append((clock() - begin) / PERIOD)
    return {name: float(np.median(each)) for name, each in times.items()}


def stepper(model: smpl.Model, choose: Callable[[smpl.VectorEnv], FloatArray]) -> Callable[[int], None]:
    """Steps a batch of a model from sampled starts; ended episodes begin again in the same step."""
    env = smpl.VectorEnv(model, COUNT, num_threads=1, autoreset_mode="same_step")
    given = choose(env)
    env.reset(seed=0)

    def step(k: int) -> None:
        env.step(given[k])

    return step


def pendulum() -> Callable[[int], None]:
    """Steps EnvPool's pendulum."""
    import envpool

    env = envpool.make("Pendulum-v1", "gymnasium", num_envs=COUNT, num_threads=1, seed=0)
    env.reset()
    torques = np.random.default_rng(0).uniform(-2, 2, (PERIOD, COUNT, 1)).astype(np.float32)

    def step(k: int) -> None:
        env.step(torques[k])

    return step


def against_envpool(repeats: int) -> None:
    """Time a step of each model in both cases, and over it that of the pendulum."""
    steppers = {}
    for name in MODELS:
        steppers[f"{name}, near rest"] = stepper(compiled(name), partial(actions, steps=PERIOD))
        steppers[f"{name}, realistic"] = stepper(smpl.Env(name, normalize=False).model, random_actions)
    ours = tuple(steppers)
    for name in MODELS:
        print(f"  {name}: largest error after {TURN} steps, in parts of the range {largest_error(name):.0e}")
    peer = "EnvPool Pendulum-v1"
    if installed(peer, "envpool"):
        steppers[peer] = pendulum()
    for what, clock in (("processor time", time.process_time), ("by the clock", time.perf_counter)):
        found = in_turn(steppers, 2 * repeats, clock)
        for name, each in found.items():
            print(f"  {name:21} {each * 1e6:8.1f} us a batch, {each / COUNT * 1e6:6.3f} us a step, {what}")
        for name in ours:
            if peer in found:
                at_least(f"{peer} over {name}, {what}", found[peer] / found[name], 1)


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
