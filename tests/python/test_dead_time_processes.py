"""Processes with dead time: a pipe of the library, and loops with PI control, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

import smpl

METHODS = ("ida", "rosenbrock", "explicit", "auto")

LINE = """
model Line
time t : h
unit amount = 1 [mol]
set species = { A }
use "lib/pipes.eq"
action Q : m^3/h = 2 in -9..9
action c : mol/m^3 = 1 in 0..9
action T : degC = 20 in 0..99
use Pipe as pipe(V = 3 [m^3])
eq pipe.inlet.Q = Q
eq pipe.inlet.c[A] = c
eq pipe.inlet.T = T
state left : mol = 0 scale 1
eq d/dt left = pipe.outlet.Q*pipe.outlet.c[A]
observe pipe.outlet.c[A] in 0..9, pipe.outlet.T in 0..99
solver { rtol = 1e-9 }
episode { step = 0.37 [h], max_steps = 60 }
"""


@pytest.mark.parametrize("method", METHODS)
def test_a_pipe_gives_back_what_entered_one_volume_ago_and_keeps_the_mass(method):
    step, steps = 0.37, 30
    rng = np.random.default_rng(0)
    Q, c, T = rng.uniform(1, 5, steps), rng.uniform(0, 5, steps), rng.uniform(10, 90, steps)
    times, entered = step * np.arange(steps + 1), np.concatenate([[0], np.cumsum(Q * step)])
    amount = np.concatenate([[0], np.cumsum(Q * c * step)])
    env = smpl.Env(smpl.compile(source=LINE), normalize=False, method=method)
    env.reset(seed=0)
    for k in range(steps):
        observed, _, _, _, info = env.step(np.array([Q[k], c[k], T[k]]))
        assert not info["failure"]
        # The pipe is full of the liquid of the start, which flowed at 2 m3/h.
        volume = entered[k + 1] - 3
        instant = np.interp(volume, entered, times) if volume > 0 else volume / 2
        at = min(int(instant / step), steps - 1)
        assert observed == pytest.approx((c[at], T[at]) if volume > 0 else (1, 20), abs=1e-5)
        mass = min(entered[k + 1], 3.0) + np.interp(max(volume, 0), entered, amount)
        assert env.state[env.unwrapped.state_names.index("left")] == pytest.approx(mass, rel=1e-6)


@pytest.mark.parametrize("flow", [-1.0, 0.0])
def test_a_pipe_names_a_flow_that_turns_or_stops(flow):
    env = smpl.Env(smpl.compile(source=LINE), normalize=False)
    env.reset(seed=0)
    _, _, ended, _, info = env.step(np.array([flow, 1.0, 20.0]))
    assert ended
    assert info["failure"].startswith("pipe.transport_")


def loop(gain: float, integral: float, theta: float, times: np.ndarray) -> np.ndarray:
    """Step response of 1/((s + 1)(0.5 s + 1)) exp(-theta s) under PI control, 1 + ... as a series.

    With L = G C, y = (L exp(-theta s) - L^2 exp(-2 theta s) + ...) / s. Each term is the response of a rational
    function. The exponential of the matrix of a realisation gives it, with poles of any multiplicity.
    """
    from scipy.linalg import expm
    from scipy.signal import tf2ss

    found = np.zeros(len(times))
    above, below = np.array([gain * integral, gain]), integral * np.array([0.5, 1.5, 1.0, 0.0])
    number, up, down = 1, above, below
    while number * theta < times[-1]:
        A, B, C, _ = tf2ss(up, np.append(down, 0.0))
        for i, time in enumerate(times):
            if time > number * theta:
                found[i] -= (-1) ** number * (C @ expm(A * (time - number * theta)) @ B)[0, 0]
        number, up, down = number + 1, np.polymul(up, above), np.polymul(down, below)
    return found


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("steps", [6, 25])
def test_second_order_plus_dead_time_under_pi_control_follows_its_analytic_step_response(method, steps):
    source = """
    model Loop
    time t : s
    param theta : s = 0.8
    param K_c = 0.9
    param T_i : s = 1.4
    state x = 0
    state y = 0 in -9..9
    state I : s = 0
    var u
    eq d/dt I = 1 - y
    eq u = K_c*(1 - y + I/T_i)
    eq d/dt x = (delay(u, theta, before = 0) - x) / 1 [s]
    eq d/dt y = (x - y) / 0.5 [s]
    observe y
    solver { rtol = 1e-9 }
    """
    model = smpl.compile(source=source + f"episode {{ step = {5.0 / steps!r} [s], max_steps = {steps} }}")
    found = model.rollout([0.0, 0.0, 0.0], np.zeros((steps, 0)), method=method)
    times = 5.0 / steps * np.arange(1, steps + 1)
    assert found.states[0, 1:, 1] == pytest.approx(loop(0.9, 1.4, 0.8, times), abs=1e-6)


def test_an_open_loop_of_second_order_plus_dead_time_follows_its_closed_form():
    source = """
    model Open
    time t : s
    action u = 0 in -9..9
    state x = 0
    state y = 0 in -9..9
    eq d/dt x = (delay(u, 0.8 [s]) - x) / 1 [s]
    eq d/dt y = (x - y) / 0.5 [s]
    observe y
    solver { rtol = 1e-9 }
    episode { step = 0.5 [s], max_steps = 12 }
    """
    found = smpl.compile(source=source).rollout([0.0, 0.0], np.ones((12, 1))).states[0, :, 1]
    times = np.maximum(0.5 * np.arange(13) - 0.8, 0)
    expected = [1 - (math.exp(-t) - 0.5 * math.exp(-2 * t)) / 0.5 for t in times]
    assert found == pytest.approx(expected, abs=1e-7)
