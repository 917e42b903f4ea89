"""A full batch of PenSim against SciPy's LSODA with a right-hand side compiled by Numba."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
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
    seconds,
    title,
    where_time_goes,
)

STEPS, LENGTH = 1150, 0.2
# Tolerance, method and how many times as long LSODA should take.
GOALS = ((1e-6, "auto", 15), (1e-6, "ida", 8), (1e-8, "auto", 8), (1e-8, "ida", 8))
FLOWS = ("Fa", "Fb", "Fc", "Fh", "Fpaa")
# Magnitudes for absolute tolerances and errors, in the order of the states.
SCALE = np.array(
    [1e-3, 10, 0.2, 1e-3, 6e4, 6e4, 1e-7, 300, 1e5, 10, 1, 0.1, 0.1, 1e-3, 1e-3]
    + [1e3] * 11
    + [1e-5, 0.1, 0.1, 1e3, 1e3, 1e-2, 1e-2]
)


@dataclass(frozen=True)
class Batch:
    """A batch of the recipe from the means: states before each step, inputs, states after it."""

    before: FloatArray
    inputs: FloatArray
    after: FloatArray
    total: float


def main(repeats: int) -> None:
    """Print the comparison."""
    title("PenSim: a batch of 1150 steps by the recipe, from the means, without disturbances")
    goal("compile", compile_time("pensim") * 1e3, 5, "ms")
    exact = record(1e-10)
    found = {(rtol, method): own(rtol, method, exact, repeats) for rtol, method, _ in GOALS}
    goal("step at 1e-6", found[1e-6, "auto"] / STEPS * 1e6, 90, "us")
    goal("batch at 1e-6", found[1e-6, "auto"] * 1e3, 100, "ms")
    vectorised(exact, repeats)
    if not installed("SciPy LSODA with Numba", "scipy", "numba"):
        return
    function = rates()
    check(function, exact)
    peers = {rtol: lsoda(function, exact, rtol) for rtol in sorted({rtol for rtol, _ in found})}
    for rtol, method, target in GOALS:
        peer = peers[rtol]
        what = f"SciPy LSODA with Numba at {rtol:g} ({peer / STEPS * 1e6:.0f} us a step) over {method}"
        at_least(what, peer / found[rtol, method], target)


def make(rtol: float, method: str | None = None) -> smpl.Env:
    """The environment at a tolerance."""
    return environment("pensim", rtol, settings={"disturbances": False}, method=method)


def record(rtol: float) -> Batch:
    """A batch of the recipe."""
    env = make(rtol)
    env.reset(options={"start": "nominal"})
    flows = [env.discrete_names.index(name) for name in FLOWS]
    before, inputs, after, total = [], [], [], 0.0
    for _ in range(STEPS):
        before.append(env.state)
        action = env._native.policy(env.model.native.policies[0])
        total += env.step(action)[1]
        inputs.append(np.concatenate([action, env.discrete[flows]]))
        after.append(env.state)
    return Batch(np.array(before), np.array(inputs), np.array(after), total)


def own(rtol: float, method: str, exact: Batch, repeats: int) -> float:
    """Seconds of a batch; prints the error of its yield and where its time goes."""
    env = make(rtol, method)
    actions = exact.inputs[:, :6]
    total = [0.0]

    def batch() -> None:
        env.reset(options={"start": "nominal"})
        total[0] = sum(env.step(action)[1] for action in actions)

    each = seconds(batch, repeats)
    print(
        f"  smpl, {method}, at {rtol:g}: {each / STEPS * 1e6:.0f} us a step, {each * 1e3:.0f} ms a batch;"
        f" yield {total[0]:.3f} kg, {abs(total[0] - exact.total):.0e} kg off"
    )
    where_time_goes(env, each / STEPS, STEPS, env.state, actions[-1])
    return each


def vectorised(exact: Batch, repeats: int) -> None:
    """Steps a second of 16 batches on one thread."""
    model = make(1e-6).model
    env = smpl.VectorEnv(model, 16, normalize=False, num_threads=1, autoreset_mode="same_step")
    env.reset(options={"start": "nominal"})
    actions = np.repeat(exact.inputs[:300, np.newaxis, :6], 16, axis=1)
    begin = time.thread_time()
    for action in actions:
        env.step(action)
    rate = 16 * len(actions) / (time.thread_time() - begin)
    print(f"  16 batches together on one thread: {rate:,.0f} steps/s, the first 60 h")


def check(function: Callable[..., FloatArray], exact: Batch) -> None:
    """Print how far the rates of the peer are from those of the model."""
    model = smpl.compile("pensim", settings={"disturbances": False})
    worst = 0.0
    for k in range(10, STEPS, 57):
        given = dict(zip(FLOWS, exact.inputs[k, 6:], strict=True))
        mine = model.rhs(LENGTH * k, exact.before[k], exact.inputs[k, :6], given)
        other = function(exact.before[k], LENGTH * k, exact.inputs[k])
        worst = max(worst, float(np.max(np.abs(mine - other) / (np.abs(mine) + 1e-3 * SCALE))))
    print(f"  rates of the peer, written from the specification, agree to {worst:.0e}")


def lsoda(function: Callable[..., FloatArray], exact: Batch, rtol: float) -> float:
    """Seconds of all steps, each from the exact state; prints the largest error of a step."""
    from scipy.integrate import odeint

    span = np.empty(2)
    atol = 1e-2 * rtol * SCALE
    names = smpl.compile("pensim", settings={"disturbances": False}).state_names
    worst, place, total = 0.0, "", 0.0
    for k in range(STEPS):
        start = exact.before[k].copy()
        start[-2:] = 0.0
        span[:] = LENGTH * k, LENGTH * (k + 1)
        begin = time.thread_time()
        end = odeint(function, start, span, args=(exact.inputs[k],), rtol=rtol, atol=atol)[-1]
        total += time.thread_time() - begin
        # What a clamp has set says nothing about the integration.
        free = (exact.after[k] != 1e-3) & (exact.after[k] != 0.0)
        errors = np.where(free, np.abs(end - exact.after[k]) / np.maximum(np.abs(exact.after[k]), SCALE), 0.0)
        if errors.max() > worst:
            worst, place = float(errors.max()), f"{names[int(errors.argmax())]}, step {k + 1}"
    print(f"  LSODA at {rtol:g}: largest error of a single step {worst:.0e} ({place})")
    return total


def rates() -> Callable[..., Any]:
    """dy/dt from the specification with the mean parameters, compiled."""
    from numba import njit

    def f(y: Any, t: float, u: Any) -> Any:
        d = np.empty(33)
        s, do2, o2, p, v, _, h, temp, _, visc, age, a0, a1, a3, a4 = y[:15]
        n9, nm, phi0, co2out, co2d, paa, nh3 = y[24], y[25], y[26], y[27], y[28], y[29], y[30]
        discharge, fs, foil, fg, pressure, fw, fa, fb, fc, fh, fpaa = u
        mu_p, mux, alpha_kla, n_paa, paa_c = 0.041, 0.41, 85.0, 150000.0, 530000.0
        x = a0 + a1 + a3 + a4
        rho_b = 1100 + p + x
        rho_f = 0.6 * 1540 + 0.4 * 1000
        area = np.pi * 2.1**2
        v_m = v / 1000
        h_b = 0.9 * v_m / area
        p_top = 1 + pressure
        p_bot = p_top + 9.81e-5 * rho_b * h_b
        p_lm = (p_bot - p_top) / np.log(p_bot / p_top)
        f_evp = 5.24e-4 * v * (np.exp(2.5 * (temp - 273) / 100) - 1)
        f_dil = fs + fb + fa + fw - f_evp + fpaa
        k_dil = f_dil / v
        ph = -np.log10(h)
        do_sat = p_lm * 0.21 / 0.0251
        f_ph = 1 / (1 + h / 1e-5 + 2.5e-8 / h)
        f_n = (1 + np.tanh(nh3 - 150)) / 2
        f_t = 450 * np.exp(-14880 / (8.314 * temp)) - 2.5e29 * np.exp(-173250 / (8.314 * temp))
        f_co2 = (1 + np.tanh(7570 - 1000 * co2d)) / 2
        f_o2x = (1 + np.tanh(do2 - 0.1 * do_sat)) / 2
        f_o2p = (1 + np.tanh(do2 - 0.3 * do_sat)) / 2
        f_paax = (1 + np.tanh(2400 - paa)) / 2
        f_paap = (1 + np.tanh(paa - 200)) / 2
        f_s = 2.5 / np.sqrt(2 * np.pi) * np.exp(-(((s - 0.002) / 0.0015) ** 2) / 2)
        mu_h = np.exp(-64.29 - 1.825 * ph + 0.3649 * temp + 0.1280 * ph**2 - 4.9496e-4 * temp**2)
        mu_e = mux * f_ph * f_n * f_t * f_o2x * f_co2 * f_paax
        r_b = 0.4 * mu_e * a1 * s / (0.05 + s)
        r_e = mu_e * a0 * s / (0.009 + s)
        k_diff = max(0.75 - 0.006 * age / x, 0.09)
        r_d = 5.36e-3 * a0 / (k_diff + s)
        r_m0 = 0.029 * a0 / (k_diff + s)
        r_a = 3.5e-3 * a3
        dr, r_0, k_v = 0.75e-4, 1.5e-4, 3.22e-5
        v_2 = phi0
        for j in range(1, 10):
            v_2 += 4 * np.pi / 3 * (r_0 + (j - 1) * dr) ** 3 * y[15 + j] * dr
        v_a1 = (a1 / 0.35 - v_2) / 2
        r_s = mu_p * 0.35 * v_a1 * f_s * f_o2p * f_paap
        r_p = r_s - mu_h * p
        r_m1 = 0.029 * 0.35 * v_a1 * s / (0.05 + s)
        g_v = 1.71e-4 * v_a1 / (0.05 + s)
        r_k, r_m = r_0 + 8 * dr, r_0 + 10 * dr
        r_deg = np.pi / 6 * (r_k + r_m) ** 3 * 0.18 * k_v * n9
        newborn = (r_0 + 1e-4) ** 3
        d[15] = g_v * (6 / np.pi) / newborn - k_v * y[15]
        for j in range(1, 10):
            below, here, above = y[14 + j], y[15 + j], y[16 + j]
            d[15 + j] = -k_v * (above - below) / (2 * dr) + 2.66e-11 * (above - 2 * here + below) / dr**2
        d[25] = k_v * d[24] / (r_m - r_k) - 3.5e-3 * nm
        d[26] = g_v - k_v * y[15] * np.pi * newborn / 6
        d[11] = r_b - r_d - k_dil * a0
        d[12] = r_e - r_b + r_d - r_deg - k_dil * a1
        d[13] = r_deg - r_a - k_dil * a3
        d[14] = r_a - k_dil * a4
        dx = d[11] + d[12] + d[13] + d[14]
        d[3] = r_p - k_dil * p
        d[10] = x
        d[4] = f_dil - discharge / (rho_b / 1000)
        d[5] = fs * rho_f / 1000 + foil * 0.9 + fb + fa + fw - discharge - f_evp + fpaa
        d[0] = -1.85 * (r_e + r_b) - r_m0 - r_m1 - 0.9 * r_s + (fs * 600 + foil * 1000) / v - k_dil * s
        d[9] = 3 * a0 ** (1 / 3) / ((1 + np.exp(-0.001 * (t - 1))) * (1 + np.exp(-0.0001 * (t - 250)))) - 0.005 * fw
        visc_e = 1.0 if visc <= 4 else visc
        q_g = fg / 60
        n_s, d_imp = 100 / 60, 1.7
        p_u = 3 * 5 * rho_b * n_s**3 * d_imp**5
        p_g = 0.706 * (p_u**2 * n_s * d_imp**3 / q_g**0.56) ** 0.45 / 1000
        v_s = q_g / area
        p_air = v_s * 8.314 * temp * v_m / (22.4 * h_b) * np.log(1 + 9.81e-5 * rho_b * h_b / p_top)
        p_t = p_g + p_air
        kla = alpha_kla * v_s**0.38 * (p_t / v_m) ** 0.34 * (visc_e / 100) ** (-0.38) * (1 - (foil / v) ** 0.25)
        otr = kla * (do_sat - do2)
        d[1] = -650 * dx - 17.5 * x - 160 * d[3] + otr - k_dil * do2
        gas = 0.1 * v_m * (28970 / 22.4)
        c_o2, c_co2 = 60000 * 32 / 22.4, 60000 * 44 / 22.4
        d[2] = (c_o2 * q_g * 0.21 - c_o2 * q_g * (0.79 / (1 - o2 - co2out / 100)) * o2 - 0.06 * otr * v_m) / gas
        d[27] = (c_co2 * q_g * 0.033 + 0.1353 * v * (a0 + a1) - c_co2 * q_g * co2out) / gas
        h_co2 = np.exp(11.25 - 395.9 / (temp - 175.9)) / 4400
        d[28] = 0.89 * kla * (p_lm * co2out / h_co2 - co2d) - k_dil * co2d
        d[29] = fpaa * paa_c / v - 187.5 * d[3] - 45 * dx - 1.05 * p - k_dil * paa
        d[30] = (n_paa * fpaa + 20000 * foil) / v - 10 * (r_b + r_e + r_d + r_a) - 80 * d[3] - 0.03 * x - k_dil * nh3
        g_h = 3.25e-7 * (r_b + r_e + r_a + r_d + 0.0025 * x + r_p) + 2.5e-11 * (fs + foil + fb + fa - discharge + fw)
        b = -(h * v + 0.033 * (fa - fb) * 0.005) / (v + (fa + fb) * 0.005)
        d[6] = g_h + ((-b + np.sqrt(b * b + 4e-14)) / 2 - h)
        q_r = max(0.0, 25 * v_m * (650 * dx + 160 * d[3]))
        cool = 2.4518 * fc**3.88 * (temp - 285) / (fc / 1000 + 2451.8 * (fc / 1000) ** 2.88 / 2 * rho_b * 5.9)
        warm = 2.4518 * fh**3.88 * (temp - 333) / (fh / 1000 + 2451.8 * (fh / 1000) ** 2.88 / 2 * rho_b * 5.9)
        d[8] = fs * rho_f * 5.9 * (288 - temp) / 1000 + fw * 4.18 * (288 - temp) - f_evp * rho_b * 4.18 / 1000
        d[8] += -2430.7 * f_evp + q_r + p_t - cool - warm - 36 * 105 * (temp - 290)
        d[7] = d[8] / (v_m * 4.18 * rho_b)
        d[31], d[32] = mu_p, mu_e
        return d

    compiled: Callable[..., Any] = njit(fastmath=False)(f)
    return compiled
