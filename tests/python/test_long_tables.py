"""Values of long tables over time (search) and over a range (lookup), compared with NumPy and SciPy."""

import re
from pathlib import Path

import numpy as np
import pytest

import smpl

integrate = pytest.importorskip("scipy.integrate", reason="SciPy is not installed")

PROBLEM = Path(__file__).resolve().parents[1] / "problems" / "influent.eq"


def tables():
    """Points of the tables of the problem, read from its text."""
    found = re.findall(r"table (\w+) : \S+ over time : h \w+ \{(.*?)\}", PROBLEM.read_text(), re.S)
    return {name: np.array(re.findall(r"(\S+): ([^,\s]+)", body), dtype=float).T for name, body in found}


def rates(points):
    """Right side of the problem, written for NumPy."""

    def until(name, t):
        times, values = points[name]
        return values[min(np.searchsorted(times, t, side="left"), len(values) - 1)]

    def begins(name, t):
        times, values = points[name]
        return values[max(np.searchsorted(times, t, side="right") - 1, 0)]

    def f(t, y):
        s_1, s_2 = y[:2]
        flow = np.interp(t % 24.0, *points["inflow"])
        load = np.interp(t - 1.5, *points["load"])
        decay = 0.35 * s_1 / (60.0 + s_1) * 60.0 * begins("air", t) / 6.2
        first = flow / 900.0 * (load - s_1) - decay
        return [first, flow / 900.0 * (s_1 - s_2) - 0.35 * s_2, flow * until("dosing", 24.0 - t), flow]

    return f


def test_two_tanks_follow_recorded_tables_as_scipy_does():
    points = tables()
    assert all(values.shape[1] > 32 for values in points.values()), "long ones"
    f = rates(points)
    y = np.array([200.0, 80.0, 0.0, 0.0])
    env = smpl.Env(PROBLEM, scenario=None)
    env.reset(seed=0)
    for step in range(30):
        # Between the points of all tables the right side is smooth: pieces of a quarter of an hour, each a hair inside.
        for quarter in range(4):
            a, b = step + 0.25 * quarter, step + 0.25 * (quarter + 1)
            hair = 1e-9
            y = integrate.solve_ivp(f, (a + hair, b - hair), y, method="DOP853", rtol=1e-11, atol=1e-9).y[:, -1]
        env.step(env.action_space.sample())
        np.testing.assert_allclose(env.unwrapped.state, y, rtol=3e-6)


def test_trays_with_a_table_of_their_own_follow_numpy_in_every_form(tmp_path):
    n = 40
    alpha, hold = 1.2 + 0.3 * np.sin(np.arange(n)) ** 2, 0.5 + 0.1 * (np.arange(n) % 5)
    rows = "\n".join(f"{i + 1}: {float(a)!r}, {float(m)!r}" for i, (a, m) in enumerate(zip(alpha, hold, strict=True)))
    path = tmp_path / "trays.eq"
    path.write_text(
        f"""time t : min
        set trays = 1..{n}
        table over trays {{
          columns: alpha, M
          {rows}
        }}
        action V = 3.2 in 2..4
        state x[i in trays] = 0.5 in 0..1
        let y[i in trays] = alpha[i]*x[i] / (1 + (alpha[i] - 1)*x[i])
        eq d/dt x[i] = (2.7*((if i == {n} then 0.99 else x[i+1]) - x[i])
                        + V*((if i == 1 then 0.01 else y[i-1]) - y[i])) / (M[i] * 1 [min])  for i in trays
        """
    )
    x, v = np.linspace(0.1, 0.9, n), 3.1
    y = alpha * x / (1 + (alpha - 1) * x)
    expected = (2.7 * (np.append(x[1:], 0.99) - x) + v * (np.append(0.01, y[:-1]) - y)) / hold
    model = smpl.compile(path)
    np.testing.assert_allclose(model.rhs(0.0, x, [v]), expected, rtol=1e-13)
    (text,) = smpl.export.write(model, "json", tmp_path / "trays.json")
    np.testing.assert_array_equal(smpl.compile(text).rhs(0.0, x, [v]), model.rhs(0.0, x, [v]))
    casadi = pytest.importorskip("casadi", reason="casadi is not installed")
    for kind in (casadi.SX, casadi.MX):
        state, action = kind.sym("x", n), kind.sym("u", 1)
        rates = casadi.Function("rates", [state, action], [smpl.export.casadi(model, kind.__name__).rhs(state, action)])
        np.testing.assert_allclose(np.ravel(rates(x, v)), expected, rtol=1e-13)
