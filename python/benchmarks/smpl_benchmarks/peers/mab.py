"""Steps of MAb with a loading column against SciPy's BDF and CasADi's integrators."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

import smpl
from smpl.support.arguments import FloatArray
from smpl_benchmarks.peers.common import (
    at_least,
    compile_time,
    environment,
    goal,
    installed,
    largest,
    memory,
    title,
    where_time_goes,
)

# Scales of the tanks' states; those of the column are 1.
TANKS = [3e10, 5e10, 5000, 50, 200, 50, 150, 3000, 2e10, 3e10, 5000, 100, 250, 100, 200, 3000, 37, 3, 200]
HOURS = 21
ORIGINAL = 6.3
SAMPLED = (1, 6, 11, 16, 20)
CASADI_STEPS = 100_000


def main(repeats: int) -> None:
    """Print all tables."""
    title("MAb: one step of 60 min with nominal inputs, loading of a fresh column for 21 h")
    goal("compile", compile_time("mab") * 1e3, 15, "ms")
    exact = record(environment("mab", 1e-11))
    median = own("default", exact, repeats)
    equal = one_step(exact, repeats)
    own("legacy", None, repeats)
    goal("median step", median * 1e3, 1.5, "ms")
    at_least(f"the original, {ORIGINAL} ms", ORIGINAL * 1e-3 / median, 4)
    if installed("SciPy BDF", "scipy"):
        scipy_bdf(exact, median)
    if installed("CasADi", "casadi"):
        casadi_integrators(exact, median, equal)
    cells(repeats)


def record(env: smpl.Env) -> FloatArray:
    """States at the start and after each hour."""
    env.reset(options={"start": "steady"})
    action = env.model.native.defaults("action")
    states = [env.state]
    for _ in range(HOURS):
        env.step(action)
        states.append(env.state)
    return np.array(states)


def hours(env: smpl.Env, repeats: int) -> FloatArray:
    """Seconds of each hour, the median of some episodes."""
    action = env.model.native.defaults("action")
    times = np.empty((repeats, HOURS))
    for row in times:
        env.reset(options={"start": "steady"})
        for k in range(HOURS):
            begin = time.thread_time()
            env.step(action)
            row[k] = time.thread_time() - begin
    median: FloatArray = np.median(times, axis=0)
    return median


def own(scenario: str, exact: FloatArray | None, repeats: int) -> float:
    """Median seconds of a step at the tolerance of the original, 1e-8."""
    env = smpl.Env("mab", normalize=False, scenario=scenario)
    times = hours(env, repeats)
    median = float(np.median(times))
    print(f"  smpl, {scenario}, rtol 1e-8: median {median * 1e3:.2f} ms, mean {times.mean() * 1e3:.2f},", end="")
    print(f" first hour (a fresh column) {times[0] * 1e3:.2f}")
    if exact is not None:
        error = np.abs(env.state - exact[-1]) / np.abs(exact).max(axis=0).clip(1e-300)
        print(f"  largest error after {HOURS} h, over the largest value of each state: {error[:-1].max():.0e}")
    where_time_goes(env, float(times.mean()), HOURS, env.state, env.model.native.defaults("action"))
    return median


def one_step(exact: FloatArray, repeats: int) -> float:
    """Median seconds of a step by `auto` at tolerances whose errors bracket those of the peers."""
    found = {}
    for rtol in (1e-6, 1e-7, 1e-8):
        env = environment("mab", rtol, method="auto")
        times = hours(env, repeats)
        found[rtol] = float(np.median(times))
        error = np.abs(env.state - exact[-1]) / np.abs(exact).max(axis=0).clip(1e-300)
        print(
            f"  smpl, auto, rtol {rtol:g}: median {found[rtol] * 1e3:.2f} ms, mean {times.mean() * 1e3:.2f},"
            f" first hour {times[0] * 1e3:.2f}; largest error after {HOURS} h {error[:-1].max():.0e}"
        )
    return found[1e-6]


def scipy_bdf(exact: FloatArray, ours: float) -> None:
    """Some of the hours by SciPy's BDF with the exact sparse Jacobian."""
    from scipy.integrate import solve_ivp

    model = smpl.compile("mab")
    action = model.native.defaults("action")
    scale = scales(model)
    if installed("a right-hand side by Numba", "numba"):
        independent = rates()
        each = [independent(x, action) for x in exact]
        apart = max(largest(a, model.rhs(0.0, x, action), scale) for a, x in zip(each, exact, strict=True))
        print(f"  right-hand side of the peer: Numba, written from the specification, agrees to {apart:.0e} 1/min")

        def rhs(t: float, y: FloatArray) -> Any:
            return independent(y, action)
    else:
        print("  right-hand side of the peer: the compiled one")

        def rhs(t: float, y: FloatArray) -> Any:
            return model.rhs(t, y, action)

    zero = np.zeros_like(scale)

    def jacobian(t: float, y: FloatArray) -> Any:
        return model.jacobian(t, y, zero, action, 0.0)

    def step(y: FloatArray) -> FloatArray:
        end = solve_ivp(rhs, (0.0, 60.0), y, method="BDF", jac=jacobian, rtol=1e-8, atol=1e-8 * scale)
        return np.asarray(end.y[:, -1])

    sample("SciPy BDF with exact sparse Jacobian", step, exact, ours)


def casadi_integrators(exact: FloatArray, ours: float, equal: float) -> None:
    """Some of the hours by CasADi's CVODES and IDAS with the exact sparse Jacobian.

    States are those of the specification over their scales, since CasADi has one absolute tolerance
    for all.
    """
    import casadi

    model = smpl.compile("mab")
    action = model.native.defaults("action")
    scale = scales(model)
    x, u = casadi.SX.sym("x", len(scale)), casadi.SX.sym("u", len(action))
    states, inputs = np.empty(len(scale), dtype=object), np.empty(len(action), dtype=object)
    for symbols, values in ((x, states), (u, inputs)):
        for i in range(len(values)):
            values[i] = symbols[i]
    ode = casadi.vertcat(*(equations(states * scale, inputs) / scale))
    independent = casadi.Function("rates", [x, u], [ode])
    each = [np.asarray(independent(y / scale, action)).ravel() * scale for y in exact]
    apart = max(largest(a, model.rhs(0.0, y, action), scale) for a, y in zip(each, exact, strict=True))
    print(f"  right-hand side of the peers: CasADi, written from the specification, agrees to {apart:.0e} 1/min")
    options: dict[str, Any] = {
        "reltol": 1e-8,
        "abstol": 1e-8,
        "linear_solver": "csparse",
        "max_num_steps": CASADI_STEPS,
    }
    for plugin in ("cvodes", "idas"):
        integrator = casadi.integrator("mab", plugin, {"x": x, "p": u, "ode": ode}, 0.0, 60.0, options)

        def step(y: FloatArray, integrator: Any = integrator) -> FloatArray:
            return np.asarray(integrator(x0=y / scale, p=action)["xf"]).ravel() * scale

        try:
            each_step = sample(f"CasADi {plugin.upper()} with CSparse", step, exact, ours)
            if plugin == "cvodes":
                at_least("CasADi CVODES with CSparse over IDA at the same tolerance", each_step / ours, 12)
                at_least("the same over auto at 1e-6, whose error is smaller", each_step / equal, 12)
        except RuntimeError as error:
            print(f"  CasADi {plugin.upper()}: no solution within {CASADI_STEPS} steps: {str(error).splitlines()[-1]}")


def scales(model: smpl.Model) -> FloatArray:
    """Scale of each state."""
    scale = np.ones(len(model.state_names))
    scale[: len(TANKS)] = TANKS
    return scale


def sample(name: str, step: Callable[[FloatArray], FloatArray], exact: FloatArray, ours: float) -> float:
    """Prints time and error of a peer's steps from exact states; returns the median."""
    times, worst = [], 0.0
    for hour in SAMPLED:
        begin = time.thread_time()
        end = step(exact[hour - 1])
        times.append(time.thread_time() - begin)
        error = np.abs(end - exact[hour]) / np.abs(exact).max(axis=0).clip(1e-300)
        worst = max(worst, float(error[:-1].max()))
    median = float(np.median(times))
    print(
        f"  {name}, hours {SAMPLED}: median {median * 1e3:.0f} ms, {median / ours:.0f} times ours,"
        f" first hour {times[0] * 1e3:.0f} ms; largest error of an hour {worst:.0e}"
    )
    return median


def cells(repeats: int) -> None:
    """Cost against the grid of the column."""
    print(
        f"  {'grid':>9} {'states':>7} {'compile':>11} {'median step':>12} {'a state':>9} {'memory':>9} {'a state':>8}"
    )
    for bed, beads in ((150, 10), (300, 20), (600, 40)):
        settings = {"n_z": bed, "n_r": beads}
        compiled = compile_time("mab", settings, 3)
        env = smpl.Env("mab", normalize=False, settings=settings)
        states = len(env.state_names)
        each = float(np.median(hours(env, max(1, repeats * 150 // bed // 2))))
        size = memory("mab", settings)
        kept = f"{size / 1e6:6.0f} MB {size / states:6.0f} B" if size else "unknown"
        print(
            f"  {bed:4} x {beads:2} {states:7} {compiled * 1e3:8.1f} ms"
            f" {each * 1e3:9.2f} ms {each / states * 1e9:6.0f} ns {kept}"
        )


def rates() -> Callable[[FloatArray, FloatArray], FloatArray]:
    """dy/dt of the default scenario, compiled by Numba."""
    from numba import njit

    compiled: Callable[..., Any] = njit(fastmath=False)(equations)
    return compiled


def equations(y: Any, u: Any) -> Any:
    """dy/dt of the default scenario from the specification, of numbers or of symbols."""
    d = np.empty_like(y)
    f_in, f_1, f_r, f_2, glc_in, gln_in, t_c, f_out = u[:8]
    xv, glc, gln, lac, amm, v1, v2, temp = y[0], y[2], y[3], y[4], y[5], y[7], y[15], y[16]
    mu = 5 * (0.0016 * temp - 0.0308) * glc / (0.75 + glc) * gln / (0.075 + gln)
    mu *= 171.76 / (171.76 + lac) * 28.48 / (28.48 + amm) / 60
    mu_d = 0.06 / (1 + (1.76 / amm) ** 2) / 60
    q_glc = mu / 2.6e8 + 4.9e-14 / 60
    q_gln = mu / 8e8 + 3.4e-13 / 60 * gln / (4 + gln)
    decay = 9.6e-3 / 60 * gln
    made = (
        (mu - mu_d) * xv,
        mu * xv,
        -q_glc * xv,
        -q_gln * xv - decay,
        2 * q_glc * xv,
        0.45 * q_gln * xv + decay,
        6.59e-10 / 60 * xv,
    )
    for s in range(7):
        eta = 0.92 if s < 2 else 0.2
        fed = glc_in if s == 2 else gln_in if s == 3 else 0.0
        here, there = y[s], y[8 + s]
        back = eta * f_1 * here  # what the recycle carries
        d[s] = made[s] + f_in / v1 * (fed - here) + (back - f_r * here) / v1
        d[8 + s] = f_1 / v2 * (here - there) - (back - f_r * there) / v2
    d[7] = f_in + f_r - f_1
    d[15] = f_1 - f_2 - f_r
    capacity = 1560 * 1.244
    d[16] = f_in / v1 * (37 - temp) + 1.2454042e-13 * mu * xv / capacity + 400 / 60 * (t_c - temp) / (v1 * capacity)
    area = np.pi * 2.5**2
    d[17] = (f_2 - f_out) / area
    c_buf = y[18]
    d[18] = f_2 * (y[14] - c_buf) / (area * y[17])

    n, m = 150, 10
    dz, dr, v = 2 / n, 4.25e-4 / m, f_out / 50
    k_f, k_rim = 0.0254726895534776 * v**0.58, 2 * 7.6e-7 / dr
    flux = v * c_buf
    for i in range(n):
        at = 19 + 13 * i
        c = y[at]
        after = v * c
        if i < n - 1:
            after = v * (c + y[at + 13]) / 2 - 0.31 * 0.055 * v * (y[at + 13] - c) / dz
        surface = (k_f * c + k_rim * y[at + m]) / (k_f + k_rim)
        film = k_f * (c - surface)
        d[at] = (-(after - flux) / dz - 0.69 * 3 / 4.25e-4 * film) / 0.31
        flux = after
        q1, q2 = y[at + 11], y[at + 12]
        d[at + 11] = 7.04e-4 * ((36450 - q1) * surface - q1 / 0.0153)
        d[at + 12] = 2.1e-5 * ((77850 - q2) * surface - q2 / 0.0153)
        inner = 0.0
        for k in range(1, m + 1):
            outer = film if k == m else 7.6e-7 * (y[at + k + 1] - y[at + k]) / dr
            r_in, r_out = (k - 1) * dr, k * dr
            gain = 3 * (r_out**2 * outer - r_in**2 * inner) / (r_out**3 - r_in**3)
            d[at + k] = (gain - d[at + 11] - d[at + 12]) / 0.94
            inner = outer
    d[-1] = f_out * (c_buf - y[19 + 13 * (n - 1)])
    return d
