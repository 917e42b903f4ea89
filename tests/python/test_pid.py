"""PID loops and their tuning, against closed forms and published rules."""

import math
from pathlib import Path

import numpy as np
import pytest

import smpl
from smpl.controllers import PID, Cascade, Loops
from smpl.controllers.tuning import Lag, Ultimate, half_rule, relay, simc, step_response, tune
from smpl.evaluation import run_episode

PROBLEMS = Path(__file__).resolve().parent.parent / "problems"

LAGS = """model Lags "equal lags in series"
time t : s
action u = 0 in -10..10
state x[i in 1..3] = 0 in -100..100
eq d/dt x[1] = (u - x[1]) / 1 [s]
eq d/dt x[2] = (x[1] - x[2]) / 1 [s]
eq d/dt x[3] = (x[2] - x[3]) / 1 [s]
steady { u = 0 }
observe y = x[3] in -100..100, inner = x[1] in -100..100
reward r default = -sq(y_now)
let y_now = x[3]
episode { step = 0.02 [s], max_steps = 4000, error_reward = -1000 }
"""


@pytest.fixture(scope="module")
def lags():
    return smpl.compile(source=LAGS)


def ready(**options):
    """A loop with an interval of 0.5 and no limits, at rest."""
    loop = PID("y", "u", 2.0, **options)
    loop.interval = 0.5
    loop.begin(1.0, None)
    return loop


def test_a_pi_law_answers_a_constant_error_with_a_ramp():
    loop = ready(integral_time=4.0)
    # u_0 + K e (1 + k h/T_i) with K = 2, e = 3, h/T_i = 1/8.
    np.testing.assert_allclose([loop.update(-3.0, 0.0) for _ in range(5)], 1 + 6 * (1 + np.arange(5) / 8))


def test_the_derivative_answers_a_step_of_the_measurement_with_a_decaying_kick():
    loop = ready(derivative_time=2.0, filter=8.0)
    loop.update(0.0, 0.0)
    found = [loop.update(1.0, 0.0) for _ in range(5)]
    # Backward differences: T_d/(T_d + N h) = 1/3, kick K T_d N/(T_d + N h) = 16/3.
    np.testing.assert_allclose(found, 1 - 2 - 16 / 3 * (1 / 3) ** np.arange(5))


@pytest.mark.parametrize("weight", [1.0, 0.4])
def test_the_velocity_form_is_the_positional_one_where_nothing_saturates(weight):
    rng = np.random.default_rng(0)
    forms = [
        PID("y", "u", 2.0, 3.0, 0.7, form=form, set_point_weight=weight, set_point=0.0)
        for form in ("positional", "velocity")
    ]
    for form in forms:
        form.interval = 0.5
        form.begin(1.0, 0.3, 0.0)
    for value, goal in rng.normal(size=(30, 2)):
        assert forms[0].update(value, goal) == pytest.approx(forms[1].update(value, goal), abs=1e-12)


def saturated(anti_windup, form="positional", **options):
    """Steps until the action leaves its limit after the error changed its sign, having been there for 200."""
    loop = PID("y", "u", 1.0, 5.0, form=form, anti_windup=anti_windup, low=-1.0, high=1.0, **options)
    loop.interval, loop.low, loop.high = 0.1, -1.0, 1.0
    loop.begin(0.0, None)
    loop._before = 0.0, 0.0
    for _ in range(200):
        assert loop.update(-2.0, 0.0) <= 1.0
    for step in range(1000):
        if loop.update(0.5, 0.0) < 1.0:
            return step
    return 1000


def test_anti_windup_leaves_the_limit_when_the_error_changes_its_sign():
    assert saturated("none") > 500
    assert saturated("back_calculation") <= 1
    assert saturated("clamping") <= 1
    assert saturated("none", form="velocity") <= 1


def test_a_change_of_parameters_and_a_hand_over_are_bumpless():
    loop = ready(integral_time=4.0, set_point=0.0)
    loop._reference = 0.0
    for _ in range(5):
        before = loop.update(0.7, 0.0)
    step = before - loop.update(0.7, 0.0)
    loop.tune(gain=20.0, integral_time=40.0)
    # The ramp goes on from where it was: K/T_i is the same.
    assert loop.update(0.7, 0.0) == pytest.approx(before - 2 * step)
    for form in ("positional", "velocity"):
        loop = PID("y", "u", 2.0, 4.0, form=form)
        loop.begin(1.0, 0.0)
        loop.update(0.0, 0.0)
        loop.track(-5.0)
        assert loop.update(0.0, 0.0) == pytest.approx(-5.0)


def test_a_proportional_pid_is_the_published_controller_of_the_reactor():
    from smpl.controllers import Proportional

    env = smpl.Env("reactor", max_steps=30, variants=("published_setpoint",))
    loops = Loops(
        PID("c_A", "T_c", -100.0, set_point=0.8778252, sees="state"),
        PID("h", "q_out", -0.5, set_point=0.659, sees="state"),
    )
    for seed in range(3):
        expected, found = run_episode(env, Proportional(), seed), run_episode(env, loops, seed)
        np.testing.assert_allclose(found.actions, expected.actions, atol=1e-6)


def test_a_bumpless_loop_begins_at_the_operating_action():
    env = smpl.Env("reactor", max_steps=3)
    for form in ("positional", "velocity"):
        loop = PID("h", "q_out", -0.5, 3.0, form=form, bumpless=True)
        assert run_episode(env, loop, 1).actions[0, 1] == pytest.approx(env.from_physical([26.85, 0.1])[1], abs=1e-6)


@pytest.mark.parametrize(
    ("name", "action", "sees", "says"),
    [
        ("c_A", "T_c", "observation", r"does not show: sees='state'.*There are: T \[degC\], h \[m\]"),
        ("x", "T_c", "state", r"not in the states of Reactor.*c_A \[kmol/m\^3\]"),
        ("T", "F", "observation", r"action 'F' is not one of Reactor; there are: T_c \[degC\], q_out \[m\^3/min\]"),
    ],
)
def test_names_that_do_not_fit_are_refused_with_those_that_do(name, action, sees, says):
    with pytest.raises(ValueError, match=says):
        run_episode(smpl.Env("reactor", observation="online"), PID(name, action, 1.0, sees=sees), 0)


def test_loops_that_do_not_fit_together_are_refused():
    with pytest.raises(ValueError, match="two loops choose the action u"):
        Loops(PID("y", "u", 1.0), PID("x", "u", 1.0))
    with pytest.raises(ValueError, match="the outer loop's action must be the inner loop's measurement"):
        Cascade(PID("y", "w", 1.0), PID("x", "u", 1.0))
    with pytest.raises(ValueError, match="no steady state: give set_point for X_A"):
        run_episode(smpl.Env("beer"), PID("X_A", "T", 1.0), 0)
    with pytest.raises(ValueError, match="give integral_time"):
        PID("y", "u", 1.0, form="velocity")


def test_simc_gives_the_published_settings():
    """Skogestad 2003, table 1 and section 3: E1 = 1/((s + 1)(0.2 s + 1)), the example with an inverse response."""
    first = half_rule(1.0, [1.0, 0.2])
    assert (first.lag, first.delay) == pytest.approx((1.1, 0.1))
    assert simc(first)[:2] == pytest.approx((5.5, 0.8))
    # (-0.3 s + 1)(0.08 s + 1) / ((2 s + 1)(s + 1)(0.4 s + 1)(0.2 s + 1)(0.05 s + 1)^3), 0.08 taken off the lag 0.2.
    lags = [2.0, 1.0, 0.4, 0.2 - 0.08, 0.05, 0.05, 0.05]
    second = half_rule(1.0, lags, inverse=[0.3], order=2)
    assert (second.lag, second.second_lag, second.delay) == pytest.approx((2.0, 1.2, 0.77))
    first = half_rule(1.0, lags, inverse=[0.3])
    assert (first.lag, first.delay) == pytest.approx((2.5, 1.47))
    # Integrating: K = 1/(k' 2 theta), T_i = 8 theta.
    assert simc(Lag(0.2, 1.0, math.inf)) == pytest.approx((2.5, 8.0, 0.0))
    # Series to parallel form: (tau_i + tau_d) and their product over the sum.
    gain, integral, derivative = simc(Lag(1.0, 1.0, 6.0, 2.0))
    assert (gain, integral, derivative) == pytest.approx((3.0 * 8 / 6, 8.0, 1.5))


def test_the_step_response_of_a_lag_is_that_lag():
    text = LAGS.replace("x[3] in", "x[1] in")
    found = step_response(smpl.compile(source=text), "y", "u")
    # A sampled controller sees half of its interval as delay.
    assert (found.gain, found.lag, found.delay) == pytest.approx((1.0, 1.0, 0.01), abs=3e-3)
    env = smpl.Env("reactor")
    level = step_response(env.model, "h", "q_out")
    assert level.gain == pytest.approx(-1 / (np.pi * 0.219**2)) and math.isinf(level.lag)


def test_the_relay_finds_the_ultimate_point_of_three_lags(lags):
    """1/(s + 1)^3: ultimate gain 8, period 2 pi/sqrt(3); the describing function is off by a few percent."""
    env = smpl.Env(lags, normalize=False)
    found = relay(env, "y", "u", 1.0, cycles=8, options={"state": [0.1, 0.1, 0.1]})
    assert found.period == pytest.approx(2 * np.pi / np.sqrt(3), rel=0.04)
    assert found.gain == pytest.approx(8.0, rel=0.08)
    assert Ultimate(8.0, 3.6).rule("ziegler_nichols") == pytest.approx((4.8, 1.8, 0.45))
    with pytest.raises(ValueError, match="rule is 'zn'; there are: ziegler_nichols_pi"):
        found.rule("zn")
    with pytest.raises(ValueError, match="crossed its set-point 3 times"):
        relay(smpl.Env(lags, max_steps=150), "y", "u", 1.0, options={"state": [0.1, 0.1, 0.1]})


def test_a_tuned_loop_holds_its_set_point_against_a_change(lags):
    loop = tune(lags, "y", "u", set_point=lambda time: 0.0 if time < 1 else 2.0)
    episode = run_episode(smpl.Env(lags, normalize=False, max_steps=2000), loop, 0)
    assert episode.states[-1, 2] == pytest.approx(2.0, abs=1e-3)
    assert episode.states[:, 2].max() < 2.7


def test_a_cascade_holds_the_outer_set_point(lags):
    inner = PID("inner", "u", 4.0, 1.0)
    outer = PID("y", "inner", 0.8, 2.5, low=-5.0, high=5.0, set_point=1.5)
    episode = run_episode(smpl.Env(lags, normalize=False, max_steps=2000), Cascade(outer, inner, every=5), 0)
    assert episode.states[-1, 2] == pytest.approx(1.5, abs=1e-3)


def test_the_published_loops_hold_the_four_tanks_in_both_settings():
    """Johansson 2000, section V: (K, T_i) of both loops, with a zero in the left and in the right half plane."""
    published = {
        (): ((3.0, 30.0, "v_1"), (2.7, 40.0, "v_2"), 300),
        ("nonminimum_phase",): ((1.5, 110.0, "v_1"), (-0.12, 220.0, "v_2"), 3000),
    }
    for variants, (one, two, steps) in published.items():
        model = smpl.compile(PROBLEMS / "four_tanks.eq", variants=variants)
        env = smpl.Env(model, normalize=False, max_steps=steps)
        env.reset(options={"start": "steady"})
        goal = 0.5 * env.state[0] + 1.0
        loops = Loops(PID("y_1", one[2], one[0], one[1], set_point=goal), PID("y_2", two[2], two[0], two[1]))
        episode = run_episode(env, loops, 0, {"start": "steady"})
        assert not episode.failure
        np.testing.assert_allclose(episode.observations[-1] - episode.observations[0], [1.0, 0.0], atol=0.02)
