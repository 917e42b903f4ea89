"""`previous(e)` and `initial(e)` of an `e` that depends on time, and rates in other equations.

x is the time itself, `t` seconds.
"""

import numpy as np
import pytest

import smpl

TEXT = """
time t : s
action u = 0 in 0..1
table feed : 1 over time : s linear {{ 0: 1, 4: 5, 10: 17 }}
state x = 0 in 0..1000
eq d/dt x = 1 / 1 [s]
var w = 0
eq w = x*t / 1 [s] + feed(t)
var q = 0
eq q^3 + q = x + t / 1 [s]
let l = x + feed(t)
observe x
reward one default = {expression}
episode {{ step = 2 [s], max_steps = 5 }}
"""


def feed(t):
    return np.interp(t, [0, 4, 10], [1, 5, 17])


def root(t):
    (real,) = [z.real for z in np.roots([1, 0, 1, -2 * t]) if abs(z.imag) < 1e-9]
    return real


#: Of a step from the second `a` to `b`; the step before it began at `c`.
PREVIOUS = {
    "previous(t) / 1 [s]": lambda a, b, c: a,
    "previous(n)": lambda a, b, c: c / 2,
    "previous(clock) / 1 [s]": lambda a, b, c: c,
    "previous(feed(t))": lambda a, b, c: feed(a),
    "previous(x*feed(t))": lambda a, b, c: a * feed(a),
    "previous(l)": lambda a, b, c: a + feed(a),
    "previous(w)": lambda a, b, c: a**2 + feed(a),
    "previous(q)": lambda a, b, c: root(a),
    "previous(if t > 3 [s] then 1 else 0)": lambda a, b, c: float(a > 3),
    "w - previous(w)": lambda a, b, c: b**2 + feed(b) - a**2 - feed(a),
    "integral(previous(l)) / 1 [s]": lambda a, b, c: (a + feed(a)) * 2,
    "initial(l)": lambda a, b, c: 1.0,
    "initial(t) / 1 [s] + initial(n) + initial(clock) / 1 [s]": lambda a, b, c: 0.0,
    "previous(initial(l) + x)": lambda a, b, c: 1.0 + a,
}


def rewards(text):
    env = smpl.Env(smpl.compile(source=text))
    env.reset(seed=0)
    return [env.step(np.zeros(1))[1] for _ in range(5)]


@pytest.mark.parametrize("expression", PREVIOUS)
def test_an_expression_at_another_instant_has_the_time_of_that_instant(expression):
    expected = [PREVIOUS[expression](a, a + 2, max(a - 2, 0)) for a in range(0, 10, 2)]
    np.testing.assert_allclose(rewards(TEXT.format(expression=expression)), expected, rtol=1e-6, atol=1e-6)


def test_the_time_before_an_event_is_that_of_the_step_before():
    text = """
time t : s
action u = 0 in 0..1
state x = 0 in 0..1000
discrete before = -1 in -10..1000
discrete condition = -1 in -10..1000
eq d/dt x = 1 / 1 [s]
event passed when x >= 3.5
event ahead when x >= 1.25 + previous(t) / 1 [s]
at passed { next before = previous(t) / 1 [s] }
at ahead { next condition = clock / 1 [s] }
observe x
reward one default = before + 100*condition
episode { step = 2 [s], max_steps = 5 }
"""
    np.testing.assert_allclose(rewards(text), [124, 327, 527, 727, 927], atol=1e-5)


def test_policies_look_back_to_the_sample_before():
    """A policy acts at the end of a step; the instant before it is that step's beginning, for states and time."""
    text = """
time t : s
action u = 0 in 0..1000
action v = 0 in 0..1000
state x = 0 in 0..1000
eq d/dt x = 1 / 1 [s]
policy back { u = previous(x + t / 1 [s] + 100*n), v = previous(clock) / 1 [s] }
observe x
reward one default = u
episode { step = 2 [s], max_steps = 5 }
"""
    env = smpl.Env(smpl.compile(source=text), normalize=False)
    env.reset(seed=0)
    for step in range(5):
        action = env.policy("back")
        before = max(step - 1, 0)
        np.testing.assert_allclose(action, [4 * before + 100 * before, 2 * before], atol=1e-6)
        env.step(action)


def test_the_phase_in_force_is_observed_within_its_numbers():
    text = """
time t : s
state x = 0 in 0..1000
phase first for 1.5 [s] then second
phase second for 1 [s] then third
phase third
eq d/dt x = 1 / 1 [s]
observe phase, same = phase
episode { step = 1 [s], max_steps = 4 }
"""
    model = smpl.compile(source=text)
    env = smpl.Env(model, normalize=False)
    assert env.observation_space.low.tolist() == [1, 1]
    assert env.observation_space.high.tolist() == [3, 3]
    observed = [env.reset(seed=0)[0], *(env.step([])[0] for _ in range(4))]
    assert np.transpose(observed).tolist() == [[1, 1, 2, 3, 3]] * 2


#: Durations in seconds, of an action 10, 10, 10, 1.5, 1, 1 (which w keeps) and y, the seconds passed; when they end.
DURATIONS = {
    "w": 3.0,
    "u": 3.0,
    "4 + w/10": 4.1,
    "10 - 2*y": 10 / 3,
    "10 - u*y": 10 / 11,
    "w_first": 5.5,
}


@pytest.mark.parametrize("duration", DURATIONS)
@pytest.mark.parametrize("method", ["ida", "rosenbrock", "explicit"])
def test_a_duration_moves_with_what_it_reads(duration, method):
    text = f"""
time t : s
action u = 10 in 0..10
state x = 0 in 0..1000
state y = 0 in 0..1000
discrete w = 3 in 0..10
discrete w_first = 5.5 in 0..10
phase first for ({duration})*1 [s] then last
phase last
at start {{ next w = u }}
eq d/dt x = (if phase == first then 1 else 0) / 1 [s]
eq d/dt y = 1 / 1 [s]
observe x
reward one default = x
episode {{ step = 1 [s], max_steps = 6 }}
"""
    env = smpl.Env(smpl.compile(source=text), normalize=False, method=method)
    env.reset(seed=0)
    lasted = [env.step([u])[1] for u in (10, 10, 10, 1.5, 1, 1)][-1]
    assert lasted == pytest.approx(DURATIONS[duration], abs=1e-6)


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        ("previous(previous(x))", "`previous` of `previous`"),
        ("previous(x - previous(t) / 1 [s])", "`previous` of `previous`"),
        ("initial(previous(x))", "`initial` of `previous`"),
        ("previous(if success then 1 else 0)", "`previous` of how the step ends"),
        ("integral(integral(x)) / 1 [s] / 1 [s]", "`integral` over the step of an integral over the step"),
    ],
)
def test_what_is_not_known_at_another_instant_is_refused(expression, message):
    with pytest.raises(smpl.CompileError, match=message):
        smpl.compile(source=TEXT.format(expression=expression) + "success done when x > 100\n")


@pytest.mark.parametrize("equation", ["v = 3*der(x)*1 [s] + x", "v - x = 3*der(x)*1 [s]", "x = v - 3*der(x)*1 [s]"])
@pytest.mark.parametrize("rate", ["d/dt x = (1 + x) / 1 [s]", "2*der(x)*1 [s] = 2 + 2*x"])
@pytest.mark.parametrize("first", [True, False])
def test_a_rate_on_the_right_side_determines_an_algebraic_variable(equation, rate, first):
    """x is exp(t) - 1, so that v is 4 exp(t) - 1."""
    lines = [f"eq {rate}", f"eq {equation}"]
    text = "\n".join(
        [
            "time t : s",
            "action u = 0 in 0..1",
            "state x = 0 in 0..1000",
            "var v = 3",
            *(lines if first else reversed(lines)),
            "observe x",
            "reward one default = v",
            "episode { step = 0.5 [s], max_steps = 5 }",
        ]
    )
    np.testing.assert_allclose(rewards(text), 4 * np.exp(0.5 * np.arange(1, 6)) - 1, rtol=1e-5)
