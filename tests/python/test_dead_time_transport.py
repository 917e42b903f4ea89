"""Plug flow with a velocity that changes, `transport(c, v, L)`, against the volume that has passed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import smpl

METHODS = ("ida", "rosenbrock", "explicit", "auto")

TUBE = """
model Tube
time t : s
param L : m = 3
action v : m/s = 2 in -9..9
action c : mol/m^3 = 1 in 0..9
let c_out : mol/m^3 = transport(c, v, L)
state left : mol/m^2 = 0 scale 1
eq d/dt left = v*c_out
observe c_out in 0..9
solver { rtol = 1e-9 }
"""


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("step", [0.37, 1.1])
def test_what_leaves_entered_one_length_ago_and_the_amount_is_kept(method, step):
    steps = 25
    rng = np.random.default_rng(1)
    v, c = rng.uniform(0.5, 5, steps), rng.uniform(0, 5, steps)
    times, entered = step * np.arange(steps + 1), np.concatenate([[0], np.cumsum(v * step)])
    amount = np.concatenate([[0], np.cumsum(v * c * step)])
    source = TUBE + f"episode {{ step = {step} [s], max_steps = {steps} }}"
    env = smpl.Env(smpl.compile(source=source), normalize=False, method=method)
    env.reset(seed=0)
    for k in range(steps):
        observed, _, _, _, info = env.step(np.array([v[k], c[k]]))
        assert not info["failure"]
        # Before the start the velocity is the nominal one, 2 m/s, and the tube is full at 1 mol/m3.
        place = entered[k + 1] - 3
        expected = c[min(int(np.interp(place, entered, times) / step), steps - 1)] if place > 0 else 1
        assert observed[0] == pytest.approx(expected, abs=1e-5)
        mass = min(entered[k + 1], 3.0) + np.interp(max(place, 0), entered, amount)
        assert env.state[0] == pytest.approx(mass, rel=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_a_velocity_that_changes_smoothly_is_integrated(method):
    source = """
    model Smooth
    time t : s
    var v : m/s
    eq v = (1 + 0.5*sin(t/(1 [s]))) as [m/s]
    eq c = cos(0.7*t/(1 [s]))
    var c
    let y : 1 = transport(c, v, 2 [m])
    let z : 1 = 3*transport(c^2, v, 2 [m])
    observe y in -9..9, z in -9..9
    solver { rtol = 1e-9 }
    episode { step = 0.4 [s], max_steps = 30 }
    """
    env = smpl.Env(smpl.compile(source=source), normalize=False, method=method)
    env.reset(seed=0)

    def passed(time):
        return time + 0.5 * (1 - np.cos(time)) if time > 0 else time

    for k in range(30):
        observed = env.step(np.zeros(0))[0]
        time = 0.4 * (k + 1)
        entry = brentq(lambda s, left: passed(s) - left, -3, time, args=(passed(time) - 2,), xtol=1e-14)
        c = np.cos(0.7 * max(entry, 0))
        assert observed == pytest.approx([c, 3 * c**2], abs=1e-6)


def test_tubes_of_an_array_have_residence_times_of_their_own():
    source = """
    model Bundle
    time t : s
    set tubes = 1..40
    state x = 0
    eq d/dt x = 1/(1 [s])
    let speed[i in tubes] : m/s = (1 + i/10) as [m/s]
    let y[i in tubes] : 1 = transport(x^2, speed[i], 3 [m])
    observe y[i] in -9..99 for i in tubes
    episode { step = 1 [s], max_steps = 5 }
    """
    env = smpl.Env(smpl.compile(source=source), normalize=False)
    env.reset(seed=0)
    for time in range(1, 6):
        found = env.step(np.zeros(0))[0]
        expected = np.maximum(time - 3 / (1 + np.arange(1, 41) / 10), 0) ** 2
        assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("velocity", [0.0, -1.0])
def test_a_flow_that_stops_or_turns_ends_the_episode_by_name(velocity):
    env = smpl.Env(smpl.compile(source=TUBE + "episode { step = 1 [s], max_steps = 9 }"), normalize=False)
    env.reset(seed=0)
    env.step(np.array([2.0, 1.0]))
    _, _, ended, _, info = env.step(np.array([velocity, 1.0]))
    assert ended
    assert info["failure"].startswith("transport_1_stops")


def test_a_flow_that_turns_within_a_step_ends_the_episode_at_that_time():
    source = TUBE.replace("let c_out : mol/m^3 = transport(c, v, L)", "").replace("left = v*c_out", "left = c*w")
    source = (
        source.replace("observe c_out in 0..9", "observe y in -9..9")
        + """
    var w : m/s
    eq w = v - 0.5 [m/s^2]*t
    let y : mol/m^3 = transport(c, w, L)
    episode { step = 9 [s], max_steps = 9 }
    """
    )
    env = smpl.Env(smpl.compile(source=source), normalize=False)
    env.reset(seed=0)
    _, _, ended, _, info = env.step(np.array([2.0, 1.0]))
    assert ended
    assert info["failure"].startswith("transport_1_stops")
    assert env.unwrapped.time == pytest.approx(4.0, abs=1e-6)


def test_the_residence_time_at_rest_is_length_over_velocity():
    model = smpl.compile(source=TUBE.replace("v*c_out", "v*(c - c_out)") + "episode { step = 1 [s], max_steps = 9 }")
    found = model.steady_state([1.5, 4.0], fixed={"left": 0.0})
    assert dict(zip(model.state_names, found, strict=False))["transport_1"] == pytest.approx(2)


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("reward r default = transport(c, v, L)/(1 [mol/m^3])", "`transport` outside of an equation or a `let`"),
        ("let wrong : mol/m^3 = transport(c, v)", "`transport` takes 3 arguments, not 2"),
    ],
)
def test_calls_without_a_meaning_are_refused_by_name(statement, message):
    with pytest.raises(smpl.CompileError, match=message):
        smpl.compile(source=TUBE + statement + "\nepisode { step = 1 [s], max_steps = 9 }")
