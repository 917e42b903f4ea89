"""Benchmarks against peers on the reactor: `python -m smpl.bench`.

Control steps of 0.1 min with an action that changes at every step, the shape of reinforcement learning. Every
integrator runs at several tolerances; its error is measured against a tight reference and its time is read off at a
common error, so that nobody is fast by being wrong. Times are medians of several runs in processor time of one thread.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import smpl
from smpl.model import FloatArray

Step = Callable[[FloatArray, FloatArray], FloatArray]

STATE = np.array([0.8778252005501434, 51.34660619295078, 0.659])
RANGES = np.array([1.0, 100.0, 1.0])
STEP = 0.1
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)


@dataclass(frozen=True)
class Peer:
    """An integrator: its name and how to make its step for a relative tolerance."""

    name: str
    make: Callable[[float], Step]


@dataclass(frozen=True)
class Run:
    """One integrator at one tolerance."""

    rtol: float
    error: float
    seconds: float


def rates(x: FloatArray, u: FloatArray) -> FloatArray:
    """Right-hand side of the reactor, per min, as a user of SciPy would write it."""
    c_A, T, h = x
    area = np.pi * 0.219**2
    dilution = 0.1 / (area * h + 1e-8)
    rate = 7.2e10 * np.exp(-8750 / (T + 273.15)) * c_A
    heat = 1000 * 0.239
    return np.array(
        [
            dilution * (1.0 - c_A) - rate,
            dilution * (76.85 - T) + 5e4 / heat * rate + 2 * 54.94 / (0.219 * heat) * (u[0] - T),
            (0.1 - u[1]) / area,
        ]
    )


def controls(steps: int) -> FloatArray:
    """Random actions under which the reactor stays away from ignition for 100 steps."""
    generator = np.random.default_rng(0)
    return np.stack([generator.uniform(22, 30, steps), 0.1 + 0.02 * np.sign(np.sin(np.arange(steps) * 0.7))], axis=1)


def simulate(step: Step, actions: FloatArray) -> FloatArray:
    """States after each step."""
    x = STATE.copy()
    states = np.empty((len(actions), 3))
    for i, u in enumerate(actions):
        x = step(x, u)
        states[i] = x
    return states


def reference(actions: FloatArray) -> FloatArray:
    """Tight solution by SciPy's Radau."""
    from scipy.integrate import solve_ivp

    def step(x: FloatArray, u: FloatArray) -> FloatArray:
        result = solve_ivp(lambda _, y: rates(y, u), (0.0, STEP), x, method="Radau", rtol=1e-12, atol=1e-14)
        return np.asarray(result.y[:, -1])

    return simulate(step, actions)


def scipy_peers() -> Iterator[Peer]:
    """LSODA of SciPy behind both of its interfaces, and its BDF; nothing where SciPy is missing."""
    try:
        from scipy.integrate import odeint, solve_ivp
    except ImportError:
        return

    def lsoda(rtol: float) -> Step:
        def step(x: FloatArray, u: FloatArray) -> FloatArray:
            result = odeint(lambda y, _: rates(y, u), x, [0.0, STEP], rtol=rtol, atol=rtol * 1e-2 * RANGES)
            return np.asarray(result[-1])

        return step

    def ivp(method: str) -> Callable[[float], Step]:
        def make(rtol: float) -> Step:
            def step(x: FloatArray, u: FloatArray) -> FloatArray:
                atol = rtol * 1e-2 * RANGES
                result = solve_ivp(lambda _, y: rates(y, u), (0.0, STEP), x, method=method, rtol=rtol, atol=atol)
                return np.asarray(result.y[:, -1])

            return step

        return make

    yield Peer("SciPy odeint (LSODA)", lsoda)
    yield Peer("SciPy solve_ivp LSODA", ivp("LSODA"))
    yield Peer("SciPy solve_ivp BDF", ivp("BDF"))


def casadi_peers() -> Iterator[Peer]:
    """CVODES and IDAS of CasADi, built once and called for each step; nothing where CasADi is missing."""
    try:
        import casadi
    except ImportError:
        return
    from smpl.controllers.nmpc import reactor_rates

    parameters = smpl.Env("reactor").parameters
    x, u = casadi.SX.sym("x", 3), casadi.SX.sym("u", 2)
    problem = {"x": x, "p": u, "ode": reactor_rates(casadi, x, u, parameters)}

    def make(plugin: str) -> Callable[[float], Step]:
        def with_tolerance(rtol: float) -> Step:
            options = {"reltol": rtol, "abstol": rtol * 1e-2}
            integrator = casadi.integrator("reactor", plugin, problem, 0.0, STEP, options)

            def step(state: FloatArray, action: FloatArray) -> FloatArray:
                return np.asarray(integrator(x0=state, p=action)["xf"]).ravel()

            return step

        return with_tolerance

    yield Peer("CasADi CVODES", make("cvodes"))
    yield Peer("CasADi IDAS", make("idas"))


def own_environment(rtol: float, **arguments: Any) -> smpl.Env:
    """The reactor in physical units with a tolerance of its own and no time limit that could matter."""
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
        file.write(f"solver: {{rtol: {rtol!r}}}\n")
        file.flush()
        return smpl.Env("reactor", normalize=False, scenario=file.name, max_steps=10**9, **arguments)


def own_peer() -> Peer:
    """`smpl.Env.step`, the whole of it: checks, solve, rewards, observation, info."""

    def make(rtol: float) -> Step:
        env = own_environment(rtol)
        env.reset(options={"state": STATE})

        last: list[FloatArray | None] = [None]

        def step(x: FloatArray, u: FloatArray) -> FloatArray:
            if x is not last[0]:  # a new episode; otherwise the environment carries its own state
                env.reset(options={"state": x})
            env.step(u)
            after = env.state
            last[0] = after
            return after

        return step

    return Peer("smpl Env.step", make)


def measure(peer: Peer, actions: FloatArray, exact: FloatArray, repeats: int) -> list[Run]:
    """Error and time a step of a peer at each tolerance."""
    runs = []
    for rtol in TOLERANCES:
        step = peer.make(rtol)
        error = float(np.max(np.abs(simulate(step, actions) - exact) / RANGES))
        seconds = []
        for _ in range(repeats):
            begin = time.thread_time()
            simulate(step, actions)
            seconds.append((time.thread_time() - begin) / len(actions))
        runs.append(Run(rtol, error, statistics.median(seconds)))
    return runs


def at_error(runs: list[Run], target: float) -> float | None:
    """Time a step at the error `target`, interpolated between tolerances; none where it is not reached."""
    ordered = sorted(runs, key=lambda run: run.error)
    if not ordered or ordered[0].error > target:
        return None
    reached = [run for run in ordered if run.error <= target]
    best = min(reached, key=lambda run: run.seconds)
    looser = [run for run in ordered if run.error > target and run.seconds < best.seconds]
    if not looser:
        return best.seconds
    near = min(looser, key=lambda run: run.error)
    weight = (np.log(target) - np.log(best.error)) / (np.log(near.error) - np.log(best.error))
    return float(np.exp((1 - weight) * np.log(best.seconds) + weight * np.log(near.seconds)))


def batch_rate(num_envs: int, steps: int, repeats: int, rtol: float) -> float:
    """Environment steps a second of a native batch on one thread."""
    model = own_environment(rtol).model
    env = smpl.VectorEnv(model, num_envs, normalize=False, num_threads=1, max_steps=10**9, autoreset_mode="same_step")
    actions = np.repeat(controls(steps)[:, np.newaxis], num_envs, axis=1)
    rates_found = []
    for _ in range(repeats):
        env.reset(options={"state": STATE})
        begin = time.thread_time()
        for action in actions:
            env.step(action)
        rates_found.append(num_envs * steps / (time.thread_time() - begin))
    return statistics.median(rates_found)


def main() -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument(
        "--steps", type=int, default=100, help="control steps of an episode; the reactor ignites after 112"
    )
    parser.add_argument("--repeats", type=int, default=5, help="runs whose median is taken")
    parser.add_argument("--error", type=float, default=1e-6, help="common error, fraction of the ranges")
    arguments = parser.parse_args()
    actions = controls(arguments.steps)
    exact = reference(actions)
    found: dict[str, float] = {}
    for peer in (own_peer(), *scipy_peers(), *casadi_peers()):
        seconds = at_error(measure(peer, actions, exact, arguments.repeats), arguments.error)
        if seconds is not None:
            found[peer.name] = seconds
    own = found.get("smpl Env.step")
    print(f"one step of the reactor at an error of {arguments.error:g} of the ranges")
    print(f"{'':28} {'us a step':>10} {'ratio':>8}")
    for name, seconds in found.items():
        print(f"{name:28} {seconds * 1e6:10.1f} {seconds / own if own else float('nan'):8.1f}")
    print_rates(arguments)


def print_rates(arguments: argparse.Namespace) -> None:
    """Steps a second of a batch of 64 on one thread, and what of a single step is Python's."""
    rtol = 1e-8
    rate = batch_rate(64, arguments.steps, arguments.repeats, rtol)
    env = own_environment(rtol)
    actions = controls(arguments.steps)
    seconds = []
    for _ in range(arguments.repeats):
        env.reset(options={"state": STATE})
        begin = time.thread_time()
        for action in actions:
            env.step(action)
        seconds.append((time.thread_time() - begin) / len(actions))
    single = statistics.median(seconds)
    print(f"batch of 64, one thread: {rate:,.0f} steps/s")
    print(f"single environment: {1 / single:,.0f} steps/s, Python's share {1 - min(1.0, 1 / (rate * single)):.0%}")


if __name__ == "__main__":
    main()
