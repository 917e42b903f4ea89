"""Integrals beside the states of a large model whose rates are implicit."""

from __future__ import annotations

import math

import pytest

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
