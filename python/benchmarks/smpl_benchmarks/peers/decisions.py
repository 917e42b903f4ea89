"""Decisions of predictive controllers: the reactor against do-mpc, the culture.

Both controllers of the reactor have a horizon of 20, the same cost, Radau collocation of degree 3
and the action box; both drive the same environment. A decision is all that a controller does
between an observation and an action.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

import smpl
from smpl.controllers import NMPC, baseline
from smpl.support.arguments import FloatArray
from smpl_benchmarks.peers.common import goal, installed, title

WEIGHT = 0.1
# The predictive controller that was shipped before, with its own copy of the equations, ms.
BEFORE = 16.0
Decide = Callable[[FloatArray], Any]


def do_mpc_controller(env: smpl.Env) -> Any:
    """The reactor's problem in do-mpc."""
    import do_mpc

    peer = do_mpc.controller.MPC(smpl.export.do_mpc(env.model))
    peer.settings.n_horizon, peer.settings.t_step = 20, env.model.step
    peer.settings.collocation_deg, peer.settings.store_full_solution = 3, False
    peer.settings.supress_ipopt_output()
    target = dict(zip(env.state_names, env.model.steady_state([26.85, 0.1]).tolist(), strict=True))
    cost = sum(WEIGHT * (peer.model.x[name] - target[name]) ** 2 for name in env.state_names)
    peer.set_objective(lterm=cost, mterm=cost)
    peer.set_rterm(**dict.fromkeys(env.action_names, 0))
    for name, low, high in zip(env.action_names, env.action_low, env.action_high, strict=True):
        peer.bounds["lower", "_u", name], peer.bounds["upper", "_u", name] = low, high
    peer.setup()
    return peer


def run(env: smpl.Env, begin: Callable[[], None], decide: Decide, episodes: int, steps: int) -> tuple[Any, Any, float]:
    """Wall and processor seconds of each decision, and the mean squared control error."""
    clock, processor, distance = [], [], []
    target = env.model.steady_state([26.85, 0.1])
    for seed in range(episodes):
        env.reset(seed=seed)
        begin()
        for _ in range(steps):
            start, used = time.perf_counter(), time.process_time()
            action = decide(env.state)
            clock.append(time.perf_counter() - start)
            processor.append(time.process_time() - used)
            *_, terminated, truncated, _ = env.step(action)
            distance.append(float(np.mean((env.state - target) ** 2)))
            if terminated or truncated:
                break
    return np.array(clock), np.array(processor), float(np.mean(distance))


def line(name: str, found: tuple[Any, Any, float]) -> float:
    """Print times in ms; the median of the processor's time."""
    clock, processor, distance = found
    low, high = (float(value) for value in np.percentile(1e3 * processor, [50, 99]))
    median, late = (float(value) for value in np.percentile(1e3 * clock, [50, 99]))
    print(
        f"  {name:16} processor: median {low:.2f} ms, 99th percentile {high:.2f} ms;"
        f" clock: {median:.2f} ms, {late:.2f} ms; mean squared distance {distance:.4f}"
    )
    return low


def reactor(episodes: int) -> None:
    """NMPC by each solver, and do-mpc."""
    env = smpl.Env("reactor", normalize=False, max_steps=60)
    medians = {}
    for solver in ("auto", "fatrop", "ipopt", "sqp"):
        controller = NMPC(env, 20, dict.fromkeys(env.state_names, WEIGHT), declared=False, solver=solver)
        found = run(env, lambda c=controller: c.reset(env), lambda _, c=controller: c.action(env), episodes, 60)  # type: ignore[misc]
        medians[solver] = line(f"smpl, {solver}", found)
    goal("smpl against the controller of before", medians["auto"], BEFORE / 4, "ms")
    if not installed("do-mpc", "do_mpc"):
        return
    peer = do_mpc_controller(env)

    def begin() -> None:
        peer.reset_history()
        peer.x0 = env.state
        peer.set_initial_guess()

    other = line("do-mpc (IPOPT)", run(env, begin, lambda x: peer.make_step(x[:, None]).ravel(), episodes, 60))
    goal("smpl against do-mpc", medians["auto"], other / 4, "ms")


def culture(decisions: int) -> None:
    """Tracking and economic control of the culture, 100 intervals of an hour."""
    env = smpl.Env("mab", normalize=False)
    for kind in ("mpc", "empc"):
        env.reset(seed=0, options={"start": "nominal"})
        controller = baseline("mab", kind)
        controller.reset(env)
        times = []
        for _ in range(decisions + 1):
            used = time.process_time()
            action = controller.action(env)
            times.append(time.process_time() - used)
            env.step(action)
        if kind == "mpc":
            goal("culture, tracking, horizon 100, first decision", times[0], 1.0, "s")
            goal("culture, tracking, horizon 100, later ones", float(np.median(times[1:])), 1.0, "s")
        else:
            print(f"  culture, economic, horizon 100: {times[0]:.2f} s, later ones {np.median(times[1:]):.2f} s")


def main(repeats: int) -> None:
    """Print the figures; those of a peer that is not installed are left out."""
    title("Decisions of predictive controllers")
    if installed("predictive control", "casadi"):
        reactor(repeats)
        culture(repeats)
