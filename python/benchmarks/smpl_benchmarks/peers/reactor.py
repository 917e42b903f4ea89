"""The reactor against SciPy and CasADi.

Control steps of 0.1 min with an action that changes at every step, the shape of reinforcement
learning. Every integrator runs at several tolerances. Its error is measured against a tight
reference and its time is interpolated at a common error, so that inaccuracy does not look fast.
Times are medians of several runs in processor time of one thread.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

import smpl
from smpl.support.arguments import FloatArray
from smpl_benchmarks.peers.common import at_least, environment, installed, seconds, title, where_time_goes

Step = Callable[[FloatArray, FloatArray], FloatArray]

STATE = np.array([0.8778252005501434, 51.34660619295078, 0.659])
RANGES = np.array([1.0, 100.0, 1.0])
STEP = 0.1
GOALS = {"SciPy odeint (LSODA)": 30, "CasADi CVODES": 60}
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)


@dataclass(frozen=True)
class Peer:
    """An integrator: name, step for a relative tolerance, and episode if it keeps the state."""

    name: str
    make: Callable[[float], Step]
    episode: Callable[[float], Callable[[FloatArray], object]] | None = None


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
    if not installed("SciPy", "scipy"):
        return
    from scipy.integrate import odeint, solve_ivp

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
    """CVODES and IDAS of CasADi, built once and called for each step; empty without CasADi."""
    if not installed("CasADi", "casadi"):
        return
    import casadi

    functions = smpl.export.casadi(smpl.compile("reactor"))
    x, u = casadi.SX.sym("x", 3), casadi.SX.sym("u", 2)
    problem = {"x": x, "p": u, "ode": functions.rhs(x, u)}

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


def own_environment(rtol: float, method: str | None = None) -> smpl.Env:
    """The reactor in physical units with a tolerance and a method."""
    return environment("reactor", rtol, method=method)


def own_peer(method: str) -> Peer:
    """`smpl.Env.step`, the whole of it: checks, solve, rewards, observation, info."""

    def make(rtol: float) -> Step:
        env = own_environment(rtol, method)
        last: list[FloatArray | None] = [None]

        def step(x: FloatArray, u: FloatArray) -> FloatArray:
            if x is not last[0]:  # a new episode; otherwise the environment carries its own state
                env.reset(options={"state": x})
            env.step(u)
            after = env.state
            last[0] = after
            return after

        return step

    def episode(rtol: float) -> Callable[[FloatArray], object]:
        env = own_environment(rtol, method)

        def run(actions: FloatArray) -> None:
            env.reset(options={"state": STATE})
            for action in actions:
                env.step(action)

        return run

    return Peer(f"smpl Env.step, {method}", make, episode)


def measure(peer: Peer, actions: FloatArray, exact: FloatArray, repeats: int) -> list[Run]:
    """Error and time a step of a peer at each tolerance."""
    runs = []
    for rtol in TOLERANCES:
        step = peer.make(rtol)
        error = float(np.max(np.abs(simulate(step, actions) - exact) / RANGES))
        run = peer.episode(rtol) if peer.episode else lambda actions, step=step: simulate(step, actions)
        each = seconds(lambda run=run: run(actions), repeats) / len(actions)  # type: ignore[misc]
        runs.append(Run(rtol, error, each))
    return runs


def at_error(runs: list[Run], target: float) -> float | None:
    """Time per step at the error `target`, interpolated between tolerances, or None."""
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


def main(repeats: int, steps: int = 100, errors: tuple[float, ...] = (1e-5, 1e-6)) -> None:
    """Print the comparison.

    Args:
        repeats: runs whose median is taken.
        steps: control steps of an episode; the reactor ignites after 112.
        errors: common errors, fractions of the ranges.
    """
    title("Reactor: one step of 0.1 min with a new action, at equal error")
    actions = controls(steps)
    exact = reference(actions)
    peers = (*map(own_peer, ("auto", "ida")), *scipy_peers(), *casadi_peers())
    runs = {peer.name: measure(peer, actions, exact, repeats) for peer in peers}
    for error in errors:
        found = {name: at_error(of_peer, error) for name, of_peer in runs.items()}
        own = found["smpl Env.step, auto"]
        print(f"  at an error of {error:g} of the ranges")
        for name, each in found.items():
            if each is not None:
                print(f"    {name:26} {each * 1e6:8.1f} us {each / own if own else float('nan'):8.1f}")
        if not own:
            continue
        for name, target in GOALS.items():
            each = found.get(name)
            if each:
                at_least(name, each / own, target)
    print_rates(steps, repeats)


def print_rates(steps: int, repeats: int) -> None:
    """Steps a second of a batch of 64 on one thread, and what of a single step is Python's."""
    rtol = 1e-8
    rate = batch_rate(64, steps, repeats, rtol)
    env = own_environment(rtol)
    actions = controls(steps)

    def episode() -> None:
        env.reset(options={"state": STATE})
        for action in actions:
            env.step(action)

    single = seconds(episode, repeats) / steps
    print(f"  batch of 64, one thread, rtol {rtol:g}: {rate:,.0f} steps/s; goal 120,000, {rate / 120_000:.2f} of it")
    print(f"  single environment: {1 / single:,.0f} steps/s, Python's share {1 - min(1.0, 1 / (rate * single)):.0%}")
    where_time_goes(env, single, steps, STATE, actions[-1])
