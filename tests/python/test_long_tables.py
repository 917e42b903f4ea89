"""Long tables over time are searched: what they give, beside NumPy and SciPy."""

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
