"""Integrals in addition to the states of models with implicit rates."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

import smpl

# r + r^3/10 = -x with r = dx/dt: time and integral are closed forms in r.
SOURCE = """model Slow
time t : h
domain z in 0..1 cells 210
state x[z] = 1 in -2..2
eq d/dt x[z]*1[h] + 0.1*(d/dt x[z]*1[h])^3 = -x[z] for z
let level = mean(x[z] for z)
observe level in -2..2
reward total : h = integral(mean(x[z] for z))
episode { step = 1 [h], max_steps = 3 }
"""


def root(of, low, high):
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if of(low) * of(middle) > 0 else (low, middle)
    return low


def test_the_integral_of_a_large_implicit_model_is_that_of_the_closed_form():
    env = smpl.Env(smpl.compile(source=SOURCE, settings={"rtol": 1e-8}), normalize=False)
    assert not env.model.explicit
    observation, _ = env.reset(seed=0)
    start = root(lambda r: r + 0.1 * r**3 + 1, -1.0, 0.0)
    end = root(lambda r: math.log(r / start) + 0.15 * (r**2 - start**2) + 1, -1.0, -1e-3)
    integral = sum(c * (end**k - start**k) for k, c in ((1, 1.0), (3, 0.4 / 3), (5, 0.03 / 5)))
    observation, reward, *_ = env.step([])
    assert observation[0] == pytest.approx(-(end + 0.1 * end**3), rel=1e-6)
    assert reward == pytest.approx(integral, rel=1e-6)


# Rates and z are determined by three equations together, that of z reads one of the rates.
FOLLOWING = """model Following
time t : s
action u = 0.5 in -2..2
state x = 1 in -100..100
state y = 0.2 in -100..100
var z = 0.1
eq value(d/dt x) + 0.5*tanh(value(d/dt x)*y) = u - 0.3*x + z
eq exp(z) = 1 + sq(y) + 0.1*value(d/dt y)
eq d/dt y = (x - 2*y)/(1 [s]) + 0.2*d/dt x
observe x in -100..100
reward total = integral(z*value(der(x)))/(1 [s])
episode { step = 0.5 [s], max_steps = 3 }
"""


def rates(x, y, u):
    def equations(unknown):
        dx, dy, z = unknown
        return [
            dx + 0.5 * np.tanh(dx * y) - (u - 0.3 * x + z),
            np.exp(z) - 1 - y * y - 0.1 * dy,
            dy - (x - 2 * y) - 0.2 * dx,
        ]

    return fsolve(equations, [0.1, 0.1, 0.1], xtol=1e-12)


@pytest.fixture(scope="module")
def expected():
    """SciPy's steps of half a second, with the integral, from starts under actions."""

    def slope(_, state, u):
        dx, dy, z = rates(state[0], state[1], u)
        return [dx, dy, z * dx]

    def step(x, y, u):
        return solve_ivp(slope, (0, 0.5), [x, y, 0], "DOP853", args=(u,), rtol=1e-11, atol=1e-13).y[:, -1]

    starts = [((1.1, 0.4), 0.5), ((1.1, 0.4), 1.2), ((0.9, 0.4), -1.0), ((1.0, 0.2), 0.0)]
    return [(start, u, step(*start, u)) for start, u in starts]


@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-10, 1e-11, 1e-12, 1e-13])
def test_an_algebraic_variable_that_follows_a_rate_does_not_stop_a_tight_tolerance(expected, rtol):
    """An integrand that follows a rate is not part of the error test: rates jump with the order."""
    model = smpl.compile(source=FOLLOWING, settings={"rtol": rtol})
    assert not model.explicit
    env = smpl.Env(model, normalize=False)
    for start, u, (x, y, integral) in expected:
        env.reset(seed=0, options={"state": start})
        _, reward, terminated, *_ = env.step([u])
        assert not terminated and env.solver_statistics["steps"] < 500
        np.testing.assert_allclose([*env.state, reward], [x, y, integral], rtol=0, atol=max(30 * rtol, 1e-9))
        np.testing.assert_allclose(model.linearize_step(start, [u]).states, [x, y], rtol=0, atol=max(30 * rtol, 1e-9))
