"""Derivatives of a control step: against analytic ones, SciPy, differences of tight steps, and CasADi's IDAS."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest
from scipy import integrate, optimize

import smpl
from smpl.analysis.sensitivity import linearize_rollout

PROBLEMS = Path(__file__).resolve().parents[1] / "problems"

LINEAR = """model Linear "two tanks and an input"
time t : h
param a : 1/h = 0.7 in 0..5
param b : 1/h = 2*a in 0..10
action u = 0.3 in -2..2
action v = -0.1 in -2..2
state x_1 = 1 in -10..10
state x_2 = -0.5 in -10..10
eq d/dt x_1 = -a*x_1 + 0.4*x_2*1[1/h] + u*1[1/h]
eq d/dt x_2 = 0.3*x_1*1[1/h] - b*x_2 + v*u*1[1/h]
reward energy : h = integral(x_1^2 + u^2)
reward last = x_2^2 + u*x_1
let square : 1 = x_1*x_2
observe x_1, square in -100..100
episode { step = 0.8 [h], max_steps = 10 }
"""

CLOCKED = """model Clocked "rewards and observations that read the time"
time t : s
action u = 0 in -1..1
state x = 2 in 0..10
eq d/dt x = (u*sin(t/(1 [s])) - 0.1*x)/(1 [s])
observe y = x*value(t), rate : 1/s = der(x) in -100..100
reward last default = x*value(t)
reward wave = x^2*cos(t/(1 [s]))
episode { step = 0.5, max_steps = 10 }
"""

BALL = """model Ball "a ball on a plate"
time t : s
param e = 0.8 in 0..1
param g : m/s^2 = 10 in 1..30
action push : m/s^2 = 0 in -5..5
state h : m = 1 in -1..100
state v : m/s = 0 in -100..100
discrete hits = 0
eq d/dt h = v
eq d/dt v = push - g
event bounce when h < 0
at bounce { reset v = -e*v ; reset h = 0 ; next hits = hits + 1 }
observe h, v
reward height : m s = integral(h)
episode { step = 0.7 [s], max_steps = 10 }
"""

SWITCH = """model Switch "a drain that opens at a level, without an event"
time t : s
param level = 1 in 0..5
action u = 1 in 0..3
state x = 0.5 in -5..50
eq d/dt x = (if x < level then u else 0.25*u)*1[1/s]
observe x
reward above : s = integral(if x < level then 0 else 1)
episode { step = 2 [s], max_steps = 10 }
"""

CLOCK = """model Clock "a feed that begins at a time"
time t : s
param begin : s = 0.6 in 0..5
action u = 1 in 0..3
state x = 0.5 in -5..50
eq d/dt x = (if t > begin then u else 0)*1[1/s] - x*0.5[1/s]
observe x
reward r = x
episode { step = 1 [s], max_steps = 10 }
"""

INSTANTS = """model Instants "what happens at sampling instants"
time t : s
param K = 2 in 0..10
action u = 0.2 in -3..3
state x = 1 in -50..50
state y = 0.5 in -50..50
discrete d = 3*x
disturbance w ~ normal(0, 1)
eq d/dt x = (d - x*y + w)*1[1/s]
eq d/dt y = (previous(x) - y)*1[1/s]
at start { next d = d + K*sq(u)*x ; reset y = y*(1 + 0.1*u) }
at end { next d = d*x ; clamp x at 3 when x > 3 }
observe x, d in -100..100
reward r = d*x - u^2
episode { step = 0.3 [s], max_steps = 10 }
"""

LATENT = """model Latent "a state and an action that come into play at an event, and a state that nothing reads"
time t : s
action u = 1 in 0..3
action late = 0.4 in 0..3
state x = 1 in 0..10
state y = 0.7 in 0..10
state z = 0 in -10..10
eq d/dt x = -x*0.5[1/s]
eq d/dt y = u*0.1[1/s]
eq d/dt z = x*1[1/s]
event low when x < 0.8
at low { reset x = x + y*late }
observe x, late in 0..3
reward area : s = integral(x)
reward cost = -late
episode { step = 1 [s], max_steps = 10 }
"""

TWINS = """model Twins "two events that move differently"
time t : s
action u = 1 in 0..3
state x = 0.5 in -5..50
state y = 0.5 in -5..50
eq d/dt x = u*1[1/s]
eq d/dt y = u*1[1/s]
event left when x > 1
at left { reset y = 2*y + x }
event right when y > 1
at right { reset x = 0.5*x }
observe x
episode { step = 0.8 [s], max_steps = 10 }
"""

IMPLICIT = """model Implicit
param k : 1/s = 0.7
action u = 0.3 in -1..1
state x = 1
state y = 0.5
eq d/dt x + 0.2*sin(d/dt x * 1[s])*1[1/s] + 0.1*d/dt y = -k*x + u*1[1/s]
eq d/dt y + 0.3*x*d/dt x = -k*y*x
observe x, y in -9..9
reward r = x*y
episode { step = 0.8 [s], max_steps = 10 }
"""

ALGEBRAIC = """model Algebraic "a rate that follows from an equation"
time t : s
param k = 1.3 in 0..5
action u = 0.4 in 0..3
state x = 1 in 0..10
state s = 0.2 in 0..10
var z : 1 = 0.5
eq d/dt x = (u - z)*1[1/s]
eq d/dt s = (x*z - k*s)*1[1/s]
eq 0 = z + 0.2*z^3 - k*x*exp(-s)
observe x, z in -10..10
reward r = z*u
episode { step = 0.5 [s], max_steps = 10 }
"""


# A held state, a condition, an action and a discrete variable of the steady state depend on parameters.
REST = """model Rest "what tends to its own steady state"
time t : s
param k = 0.5 in 0.1..5
param q = 2 in 0.1..9
param total = 3 in 0.1..9
param kept = 1.2 in 0.1..9
param w = 2*k
action u = 1 in 0..9
state s = 1 in 0..50
state L = 1 in 0..50
state A = 1 in 0..50
state B = 2 in 0..50
state x = 0 in -50..50
var z = 0.5 in 0..10
discrete seen = steady(s)
steady { u = q*k, L = kept, A + B = total }
eq d/dt s = (0.3*seen + u*k - s)*1[1/s]
eq d/dt L = (u - q*k)*1[1/s]
eq d/dt A = (B - w*A)*1[1/s]
eq d/dt B = (w*A - B)*1[1/s]
eq 0 = z^3 + z - s
eq d/dt x = (steady(z) + steady(A)*steady(L) + steady(u) + steady(seen) - x)*1[1/s]
initial s = 1
initial x = 0
observe x, ends = steady(B) in 0..10
reward gap = x - steady(z)
episode { step = 0.7 [s], max_steps = 5 }
"""


def compiled(source, rtol=1e-11):
    return smpl.compile(source=source, settings={"rtol": rtol})


def differences(function, at, size=1e-5):
    """Central differences of fourth order, by columns."""
    columns = []
    for i in range(len(at)):
        h = size * max(abs(at[i]), 1e-2)

        def value(k, i=i, h=h):
            moved = np.array(at, dtype=float)
            moved[i] += k * h
            return np.asarray(function(moved))

        columns.append((8 * (value(1) - value(-1)) - (value(2) - value(-2))) / (12 * h))
    return np.stack(columns, axis=-1)


def check(model, x, u, parameters=(), rtol=2e-6, size=1e-4, **p):
    """All derivatives of a step against differences of steps; returns what was found."""
    x, u = np.asarray(x, dtype=float), np.asarray(u, dtype=float)
    found = model.linearize_step(x, u, p, parameters=parameters)

    def values(x=x, u=u, **given):
        moved = model.linearize_step(x, u, {**p, **given}, by=())
        return np.concatenate([model.step(x, u, {**p, **given}), moved.rewards, moved.observations])

    np.testing.assert_allclose(found.states, model.step(x, u, p), rtol=1e-7, atol=1e-9)
    by_x = differences(lambda moved: values(x=moved), x, size)
    by_u = differences(lambda moved: values(u=moved), u, size)
    assert_near(np.concatenate([found.dx_dx, found.dr_dx, found.dy_dx]), by_x, rtol)
    assert_near(np.concatenate([found.dx_du, found.dr_du, found.dy_du]), by_u, rtol)
    for k, name in enumerate(parameters):
        default = p.get(name, model.native.defaults("parameter")[model.parameter_names.index(name)])
        by_p = differences(lambda moved, name=name: values(**{name: moved[0]}), [default], size)
        assert_near(np.concatenate([found.dx_dp, found.dr_dp, found.dy_dp])[:, [k]], by_p, rtol)
    return found


def assert_near(found, expected, rtol):
    np.testing.assert_allclose(found, expected, rtol=rtol, atol=rtol * max(1e-3, np.abs(expected).max()))


def test_a_linear_system_has_the_matrix_exponential():
    linalg = pytest.importorskip("scipy.linalg")
    model = compiled(LINEAR)
    a, u, v = 0.7, 0.3, -0.1
    matrix = np.array([[-a, 0.4, 1, 0], [0.3, -2 * a, v, u], [0, 0, 0, 0], [0, 0, 0, 0]])
    expected = linalg.expm(matrix * 0.8)
    reached, by_x, by_u, by_p = model.sensitivity([1, -0.5], [u, v], parameters=("a",))
    assert (reached.shape, by_x.shape, by_u.shape, by_p.shape) == ((2,), (2, 2), (2, 2), (2, 1))
    np.testing.assert_allclose(by_x, expected[:2, :2], rtol=1e-8)
    np.testing.assert_allclose(by_u, expected[:2, 2:], rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(reached, model.step([1, -0.5], [u, v]), rtol=1e-9)


def test_derivatives_do_not_rest_where_the_state_does():
    """At a steady state the solver takes the longest steps for the state; the derivatives need their own."""
    linalg = pytest.importorskip("scipy.linalg")
    model = smpl.compile(source=LINEAR)
    a = np.array([[-0.7, 0.4], [0.3, -1.4]])
    rest = np.linalg.solve(a, [-0.3, 0.03])
    _, by_x, _, _ = model.sensitivity(rest, [0.3, -0.1])
    np.testing.assert_allclose(by_x, linalg.expm(a * 0.8), rtol=1e-6)


def test_the_steady_state_moves_with_parameters():
    """Against the closed solution: what a model at rest reads of itself."""
    model = compiled(REST)
    names = ("k", "q", "total", "kept", "w")
    action, s0, begun = 1.3, 1.0, np.array([1, 1, 1, 2, 0.2])

    def closed(given):
        k, q, total, kept, w = given
        rest = q * k * k / 0.7
        z = optimize.brentq(lambda z: z**3 + z - rest, 0, 10, xtol=1e-15)
        target = z + total / (1 + w) * kept + q * k + rest
        toward, decay = 0.3 * rest + action * k, np.exp(-0.7)
        x = target + (0.2 - target) * decay
        return np.array([toward + (s0 - toward) * decay, x, x - z, x, total - total / (1 + w)])

    at = np.array([0.5, 2, 3, 1.2, 1])
    by = differences(closed, at, 1e-3)
    by[:, 0] += 2 * by[:, 4]  # w = 2*k moves along
    found = model.linearize_step(begun, [action], parameters=names)
    mine = np.concatenate([found.dx_dp[[0, 4]], found.dr_dp, found.dy_dp])
    np.testing.assert_allclose(mine, by, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(found.dx_dp[1], [-2 * 0.7, -0.5 * 0.7, 0, 0, 0], rtol=1e-8, atol=1e-8)  # dL = -q dk t
    # Another point, after one whose derivatives are kept; and the order of the directions.
    other = model.linearize_step(begun, [action], {"q": 3}, parameters=names[::-1])
    by = differences(closed, np.array([0.5, 3, 3, 1.2, 1]), 1e-3)
    by[:, 0] += 2 * by[:, 4]
    np.testing.assert_allclose(
        np.concatenate([other.dx_dp[[0, 4]], other.dr_dp, other.dy_dp])[:, ::-1], by, rtol=1e-7, atol=1e-8
    )


def test_atropine_whose_start_and_rewards_read_the_steady_state_has_derivatives_by_its_flows():
    model = smpl.compile("atropine", settings={"rtol": 1e-9})
    env = smpl.Env(model)
    env.reset(seed=0)
    x, u = env.state, env.steady_action
    names = ("q1_ss", "R1.V")
    found = model.linearize_step(x, u, by=(), parameters=names)
    for k, (name, value) in enumerate(zip(names, (0.4078, 2.0), strict=True)):
        by = differences(lambda moved, name=name: model.step(x, u, {name: moved[0]}), [value], 1e-3)[:, 0]
        np.testing.assert_allclose(found.dx_dp[:, k], by, atol=1e-5 * np.abs(by).max())
    assert np.isfinite(found.dr_dp).all() and np.abs(found.dr_dp[:, 0]).max() > 0


@pytest.mark.parametrize("method", ["ida", "rosenbrock", "explicit", "auto"])
def test_rewards_integrals_observations_and_computed_parameters(method):
    model = compiled(LINEAR)
    found = check(model, [1, -0.5], [0.3, -0.1], ("a", "b"))
    other = model.linearize_step([1, -0.5], [0.3, -0.1], parameters=("a", "b"), method=method)
    for mine, theirs in zip(found.derivatives, other.derivatives, strict=True):
        np.testing.assert_allclose(theirs, mine, rtol=1e-6, atol=1e-8)


def test_a_bounce_is_crossed_by_its_jump_condition():
    model = compiled(BALL)
    h, v, e, g = 1.0, 0.0, 0.8, 10.0
    found = check(model, [h, v], [0.5], ("e", "g"), g=g)
    g -= 0.5
    # v(T) = e v_1 - g (T - t_1) with t_1 = sqrt(2 h / g), v_1 = g t_1.
    hit = np.sqrt(2 * h / g)
    by_h = (1 + e) * g * hit / (2 * h)
    np.testing.assert_allclose(found.dx_dx[1, 0], by_h, rtol=1e-8)
    assert found.dx_dx.shape == (2, 2) and found.dr_dx.shape == (1, 2)


SAWTOOTH = """model Sawtooth "a saw of two teeth next to {cells} cells that it does not move"
time t : s
param top = 0.63 in 0..2
state x = 0.1 in 0..10
state w[i in 1..{cells}] = 0.1*i in -10..10
{others}
eq d/dt x = 1 [1/s]
event tooth when x > top
at tooth {{ reset x = x/2 ; reset w[i] = (if i < 3 then 0.2 else 0.7)*w[i] for i in 1..{cells} }}
episode {{ step = 1 [s], max_steps = 5 }}
solver {{ rtol = 1e-10 }}
"""
CHAIN = "eq d/dt w[i] = ((if i == 1 then 0 else w[i-1]) - w[i]) / 0.3 [s] for i in 1..20"
LOOP = "var z = 1\neq z^3 + z = 2 + w[1]\neq d/dt w[1] = -z*w[1] / 2 [s]"


@pytest.mark.parametrize(("cells", "others"), [(20, CHAIN), (1, LOOP)])
def test_several_events_inside_of_a_step_of_a_large_or_algebraic_model(cells, others):
    """The flow from event to event is SciPy's, the instants of the events are those of straight lines."""
    model = smpl.compile(source=SAWTOOTH.format(cells=cells, others=others))
    factor = np.where(np.arange(cells) < 2, 0.2, 0.7)

    def rates(t, w):
        if cells > 1:
            return (np.concatenate([[0], w[:-1]]) - w) / 0.3
        return -0.5 * optimize.brentq(lambda z: z**3 + z - 2 - w[0], 0, 5, xtol=1e-14) * w

    def step(x, w, top):
        now = 0.0
        while now < 1:
            end = min(1.0, now + top - x)
            w = integrate.solve_ivp(rates, (now, end), w, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
            x, now = x + end - now, end
            if end < 1:
                x, w = x / 2, factor * w
        return np.concatenate([[x], w])

    start = np.concatenate([[0.1], 0.1 * np.arange(1, cells + 1)])
    found = model.linearize_step(start, [], parameters=("top",))
    np.testing.assert_allclose(found.states, step(start[0], start[1:], 0.63), rtol=1e-7, atol=1e-9)

    def along(move):
        return (step(*move(1e-4)) - step(*move(-1e-4))) / 2e-4

    by_start = along(lambda d: (start[0] + d, start[1:], 0.63))
    by_top = along(lambda d: (start[0], start[1:], 0.63 + d))
    np.testing.assert_allclose(found.dx_dx[:, 0], by_start, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(found.dx_dp[:, 0], by_top, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("method", ["ida", "explicit"])
def test_directions_that_move_nothing_come_into_play_at_an_event(method):
    model = compiled(LATENT)
    found = check(model, [1.0, 0.7, 0.0], [1.0, 0.4])
    # The event is at t = 2 ln(x/0.8), where x becomes 0.8 + y late, with y = 0.7 + 0.1 u t.
    at = 2 * np.log(1 / 0.8)
    y, decay = 0.7 + 0.1 * at, np.exp(-0.5 * (1 - at))
    by_x = 2 * decay * (0.04 + 0.5 * (0.8 + 0.4 * y))
    other = model.linearize_step([1.0, 0.7, 0.0], [1.0, 0.4], method=method)
    for result in (found, other):
        np.testing.assert_allclose(result.dx_dx[0], [by_x, 0.4 * decay, 0], rtol=1e-7)
        np.testing.assert_allclose(result.dx_du[0], [0.04 * at * decay, y * decay], rtol=1e-7)
        np.testing.assert_allclose(result.dx_dx[1:, 1:], [[1, 0], [0.8 * (1 - decay), 1]], rtol=1e-7, atol=1e-12)
        np.testing.assert_allclose(result.dr_du[1], [0, -1], atol=1e-12)


def test_equations_that_switch_without_an_event():
    model = compiled(SWITCH)
    found = check(model, [0.5], [1.0], ("level",))
    # 0.5 s to the level, then a quarter of the rate: x(2) = level + (2 - (level - x)/u) u/4.
    np.testing.assert_allclose([found.dx_dx[0, 0], found.dx_du[0, 0], found.dx_dp[0, 0]], [0.25, 0.5, 0.75], rtol=1e-8)
    np.testing.assert_allclose(found.dr_dx, [[1.0]], rtol=1e-8)


def test_a_break_in_time_moves_with_its_parameter():
    model = compiled(CLOCK)
    found = check(model, [0.5], [1.0], ("begin",))
    np.testing.assert_allclose(found.dx_dp, [[-np.exp(-0.5 * 0.4)]], rtol=1e-8)


def test_updates_resets_discrete_variables_and_disturbances():
    model = compiled(INSTANTS)
    check(model, [1.0, 0.5], [0.2], ("K",))
    found = model.linearize_step([1, 0.5], [0.2], {"d": 2.0, "w": 0.3}, discrete=("d",), disturbances="w")
    by_d = differences(lambda d: model.step([1, 0.5], [0.2], {"d": d[0], "w": 0.3}), [2.0], 1e-4)
    by_w = differences(lambda w: model.step([1, 0.5], [0.2], {"d": 2.0, "w": w[0]}), [0.3], 1e-3)
    assert_near(found.dx_dd, by_d, 1e-6)
    assert_near(found.dx_dw, by_w, 1e-6)
    # Where the clamp holds, nothing moves the state.
    clamped = model.linearize_step([2.9, 0.5], [0.2])
    assert clamped.states[0] == 3 and not clamped.dx_dx[0].any()


def test_what_is_asked_for_beside_a_parameter_does_not_change_its_derivative():
    """x(1) = x e^-1 + (e q + w) (1 - e^-1), where e is q + 2 and w is 3 q unless they are moved themselves."""
    model = compiled(
        """model M
        time t : s
        param q = 7 in 0..100
        discrete e = q + 2
        disturbance w = 3*q ~ w
        state x = 2
        eq d/dt x = (e*q + w - x)/1 [s]
        episode { step = 1 [s], max_steps = 5 }
        """
    )
    gone = 1 - np.exp(-1.0)
    alone = model.linearize_step([2.0], [], parameters=("q",))
    both = model.linearize_step([2.0], [], parameters=("q",), discrete=("e",), disturbances=("w",))
    assert_near(alone.dx_dp, [[(2 * 7 + 2 + 3) * gone]], 1e-6)
    assert_near(both.dx_dp, [[(2 * 7 + 2 + 3) * gone]], 1e-6)
    assert_near(both.dx_dd, [[7 * gone]], 1e-6)
    assert_near(both.dx_dw, [[gone]], 1e-6)
    # A value that is given stays where it is.
    held = model.linearize_step([2.0], [], p={"e": 9.0}, parameters=("q",), discrete=("e",))
    assert_near(held.dx_dp, [[(9 + 3) * gone]], 1e-6)


def test_algebraic_variables():
    check(compiled(ALGEBRAIC), [1.0, 0.2], [0.4], ("k",))


def test_rates_that_are_given_implicitly():
    model = compiled(IMPLICIT)
    assert not model.explicit
    check(model, [1.0, 0.5], [0.3], ("k",))


def test_tolerances_of_derivatives_are_those_that_the_book_tells():
    """At `rtol = 1e-8` derivatives keep to 1e-6, at 1e-11 to 1e-9; compared with the matrix exponential."""
    linalg = pytest.importorskip("scipy.linalg")
    a, u, v = 0.7, 0.3, -0.1
    expected = linalg.expm(np.array([[-a, 0.4, 1, 0], [0.3, -2 * a, v, u], [0, 0, 0, 0], [0, 0, 0, 0]]) * 0.8)
    for rtol, bound in ((1e-8, 2e-6), (1e-11, 2e-9)):
        # An algebraic variable keeps it from the explicit method.
        source = LINEAR.replace("let square", "var z : 1 = 0.7\neq 0 = z + 0.2*z^3 - x_1\nlet square")
        _, by_x, by_u, _ = smpl.compile(source=source, settings={"rtol": rtol}).sensitivity([1, -0.5], [u, v])
        np.testing.assert_allclose(by_x, expected[:2, :2], rtol=bound, atol=bound)
        np.testing.assert_allclose(by_u, expected[:2, 2:], rtol=bound, atol=bound)


def test_what_has_no_derivative_is_refused_by_name():
    with pytest.raises(smpl.SimulationError, match="`left` and the event `right` happen at the same time"):
        compiled(TWINS).linearize_step([0.5, 0.5], [1.0])
    # One of them alone has a derivative.
    check(compiled(TWINS), [0.5, 0.45], [1.0])
    ends = (
        BALL.replace("event bounce when h < 0", "fail broken event h < 0").split("at bounce")[0]
        + "episode { step = 0.7 [s] }"
    )
    with pytest.raises(smpl.SimulationError, match="broken"):
        smpl.compile(source=ends).sensitivity([1, 0], [0])
    with pytest.raises(smpl.SimulationError, match="broken"):
        smpl.compile(source=ends).step([1, 0], [0])


def test_a_rounded_state_has_the_derivative_across_its_jumps():
    """x = 0.1 + p t, and y' = floor(3 x): dy/dp and dy/dx by differences of the closed form."""
    model = smpl.compile(
        source="time t : 1\nparam p = 1.3\nstate x = 0.1\nstate y = 0\neq d/dt x = p\neq d/dt y = floor(3*x)\n"
        "episode { step = 2 }\nsolver { rtol = 1e-10 }"
    )
    _, by_x, _, by_p = model.sensitivity([0.1, 0], [], parameters=("p",))

    def y(x, p):
        # Each whole number k adds the time that is left after 3 x passes it.
        times = [(k / 3 - x) / p for k in range(1, 100)]
        return sum(2 - t for t in times if 0 <= t < 2)

    h = 1e-6
    assert by_p[1, 0] == pytest.approx((y(0.1, 1.3 + h) - y(0.1, 1.3 - h)) / (2 * h), rel=1e-6)
    assert by_x[1, 0] == pytest.approx((y(0.1 + h, 1.3) - y(0.1 - h, 1.3)) / (2 * h), rel=1e-6)


def test_points_on_all_cores_are_the_points_one_by_one():
    model = smpl.compile("reactor")
    rng = np.random.default_rng(3)
    env = smpl.Env(model, normalize=False)
    env.reset(seed=1)
    states = env.state * rng.uniform(0.98, 1.02, (7, 3))
    actions = rng.uniform(env.action_low, env.action_high, (7, 2))
    together = model.sensitivity(states, actions, parameters=("k_0",), threads=2)
    np.testing.assert_array_equal(model.step(states, actions)[2], model.step(states[2], actions[2]))
    for i in range(7):
        for many, one in zip(together, model.sensitivity(states[i], actions[i], parameters=("k_0",)), strict=True):
            np.testing.assert_array_equal(many[i], one)
    values = {"k_0": model.native.defaults("parameter")[model.parameter_names.index("k_0")] * rng.uniform(0.9, 1.1, 7)}
    shared = model.sensitivity(np.tile(states[0], (7, 1)), actions[0], values)[0]
    assert shared.shape == (7, 3) and np.ptp(shared[:, 0]) > 0


def test_bad_input_is_named():
    model = smpl.compile("reactor")
    x, u = np.zeros(3), np.zeros(2)
    with pytest.raises(ValueError, match=r"x has shape \(4,\)"):
        model.step(np.zeros(4), u)
    with pytest.raises(ValueError, match=r"u has shape"):
        model.sensitivity(x, np.zeros(3))
    with pytest.raises(ValueError, match=r"u.*nan"):
        model.sensitivity(x, [np.nan, 0])
    with pytest.raises(ValueError, match="k_00"):
        model.sensitivity(x, u, parameters=("k_00",))
    with pytest.raises(ValueError, match="k_00"):
        model.step(x, u, {"k_00": 1.0})
    with pytest.raises(ValueError, match="by has 'states'"):
        model.linearize_step(x, u, by=("states",))
    assert model.step > 0 and model.step == model.native.step


def start(name):
    """A state some steps after the start, where no bound holds, and an action."""
    env = smpl.Env(name, normalize=False)
    env.reset(seed=0)
    middle = (env.action_low + env.action_high) / 2
    for _ in range(5):
        env.step(middle)
    return env, np.array(env.state), middle


@pytest.mark.parametrize("name", ["reactor", "beer", "pensim", "atropine"])
def test_shipped_models_against_differences(name):
    env, x, u = start(name)
    model = smpl.compile(name, settings={"rtol": 1e-11} if name != "pensim" else {"rtol": 1e-12})
    rng = np.random.default_rng(0)
    wide = env.action_high - env.action_low
    found = model.linearize_step(x, u, by="action")
    for _ in range(2):
        along = rng.uniform(-1, 1, len(u)) * wide

        def moved(k, along=along):
            return model.step(x, u + k * 1e-3 * along)

        expected = (8 * (moved(1) - moved(-1)) - (moved(2) - moved(-2))) / 12e-3
        assert_near(found.dx_du @ along, expected, 2e-6)
    if len(x) < 100:
        by_x = model.sensitivity(x, u)[1]
        along = rng.uniform(-1, 1, len(x)) * np.abs(x)

        def shifted(k):
            return model.step(x + k * 1e-4 * along, u)

        expected = (8 * (shifted(1) - shifted(-1)) - (shifted(2) - shifted(-2))) / 12e-4
        assert_near(by_x @ along, expected, 2e-6)


def test_the_gradient_through_an_episode():
    import policy_gradient as example

    env = smpl.Env("reactor", normalize=False)
    starts = example.starts_of(env, 3)
    policy = example.Policy.small(env, starts, hidden=3)
    model = smpl.compile("reactor", settings={"rtol": 1e-11})
    _, slopes = example.gradient(model, policy, starts, 3)
    for w, slope in zip(policy.weights, slopes, strict=True):
        flat = w.reshape(-1)

        def value(delta, flat=flat):
            flat[0] += delta
            found = example.gradient(model, policy, starts, 3)[0]
            flat[0] -= delta
            return found

        expected = (8 * (value(1e-3) - value(-1e-3)) - (value(2e-3) - value(-2e-3))) / 12e-3
        assert slope.reshape(-1)[0] == pytest.approx(expected, rel=1e-5, abs=1e-8)
    costs = example.main(["--episodes", "4", "--steps", "5", "--iterations", "12"])
    assert costs[-1] < 0.9 * costs[0]


def test_the_code_of_the_page_runs_in_its_order():
    page = (Path(__file__).resolve().parents[2] / "docs" / "sensitivities.md").read_text(encoding="utf-8")
    names = {}
    missing = [package for package in ("torch", "jax") if importlib.util.find_spec(package) is None]
    for block in re.findall(r"^```python\n(.*?)^```$", page, re.S | re.M):
        if any(package in block for package in missing):
            continue
        exec(compile(block, "docs/sensitivities.md", "exec"), names)
    found = names["found"]
    assert [np.shape(v) for v in (found.value, found.by_action, found.by_state)] == [(), (3, 2), (3,)]


def test_the_cost_is_printed(capsys):
    import sensitivity_cost as example

    example.main(["beer"])
    header, row = capsys.readouterr().out.splitlines()
    assert "ratio" in header and row.split()[:2] == ["beer", "8"]


@pytest.mark.parametrize("name", ["reactor", "van_de_vusse"])
def test_casadi_idas_has_the_same_derivatives(name):
    """Forward sensitivities of the exported equations by CasADi's interface to IDAS."""
    ca = pytest.importorskip("casadi")
    path = "reactor" if name == "reactor" else PROBLEMS / f"{name}.eq"
    model = smpl.compile(path, settings={"rtol": 1e-11})
    exported = smpl.export.casadi(model)
    x = ca.MX.sym("x", len(model.state_names))
    u = ca.MX.sym("u", len(model.action_names))
    parameters = np.asarray(model.native.defaults("parameter"))[: exported.rhs.size1_in(2)]
    rates = exported.rhs(x, u, parameters)
    options = {"abstol": 1e-12, "reltol": 1e-11}
    integrator = ca.integrator("F", "idas", {"x": x, "p": u, "ode": rates}, 0.0, float(model.step), options)
    after = integrator(x0=x, p=u)["xf"]
    slopes = ca.Function("slopes", [x, u], [ca.jacobian(after, x), ca.jacobian(after, u)])
    env = smpl.Env(model, normalize=False)
    env.reset(seed=3)
    action = (env.action_low + 2 * env.action_high) / 3
    by_x, by_u = (np.asarray(part) for part in slopes(env.state, action))
    found = model.sensitivity(env.state, action)
    assert_near(found[1], by_x, 1e-6)
    assert_near(found[2], by_u, 1e-6)


def test_scipy_integrates_the_variational_equations_of_a_model_that_is_not_shipped():
    integrate = pytest.importorskip("scipy.integrate")
    model = smpl.compile(PROBLEMS / "van_de_vusse.eq", settings={"rtol": 1e-11})
    env = smpl.Env(model, normalize=False)
    env.reset(seed=3)
    x, u = np.array(env.state), np.array(env.action_low + env.action_high) / 2
    n, m = len(x), len(u)

    def rates(t, z):
        y, s = z[:n], z[n:].reshape(n, n + m)
        jacobian = model.jacobian(t, y, np.zeros(n), u, 0.0).toarray()
        by_u = differences(lambda w: model.rhs(t, y, w), u, 1e-3)
        return np.concatenate([model.rhs(t, y, u), (jacobian @ s + np.hstack([np.zeros((n, n)), by_u])).ravel()])

    begin = np.concatenate([x, np.eye(n, n + m).ravel()])
    solved = integrate.solve_ivp(rates, (0, float(model.step)), begin, method="LSODA", rtol=1e-10, atol=1e-10)
    expected = solved.y[n:, -1].reshape(n, n + m)
    _, by_x, by_u, _ = model.sensitivity(x, u)
    assert_near(by_x, expected[:, :n], 1e-6)
    assert_near(by_u, expected[:, n:], 1e-6)


def test_a_stiff_algebraic_problem_against_differences():
    """Robertson's reaction with a conservation law: rates over eleven orders of magnitude."""
    source = (PROBLEMS / "robertson_dae.eq").read_text().replace("step = 1e11", "step = 100")
    model = smpl.compile(source=source, settings={"rtol": 1e-12})
    x = np.array([0.9, 2e-5])
    found = model.linearize_step(x, [], parameters=("k_1", "k_2", "k_3"))
    expected = differences(lambda by: model.step(x * by, []), np.ones(2), 1e-3)
    np.testing.assert_allclose(found.dx_dx * x, expected, rtol=1e-5, atol=2e-9)
    for k, (name, value) in enumerate((("k_1", 0.04), ("k_2", 3e7), ("k_3", 1e4))):
        by_p = differences(lambda p, name=name: model.step(x, [], {name: p[0]}), [value], 1e-3)[:, 0]
        np.testing.assert_allclose(found.dx_dp[:, k] * value, by_p * value, rtol=1e-5, atol=2e-9)


@pytest.mark.parametrize("first_step", [0, 3])
def test_the_time_that_a_reward_and_an_observation_read_is_that_of_the_end_of_the_step(first_step):
    model = smpl.compile(source=CLOCKED)
    found = model.linearize_step([2.0], [0.3], first_step=first_step)
    start, end = 0.5 * first_step, 0.5 * (first_step + 1)
    decay = np.exp(-0.1 * (end - start))
    # dx/dx0, and dx/du = the integral of exp(-0.1 (end - s)) sin(s), by parts.
    grown = [np.exp(0.1 * (s - end)) * (0.1 * np.sin(s) - np.cos(s)) / 1.01 for s in (start, end)]
    by = np.array([decay, grown[1] - grown[0]])
    x = 2.0 * decay + 0.3 * by[1]
    rate = -0.1 * by + [0.0, np.sin(end)]
    np.testing.assert_allclose(np.hstack([found.dy_dx, found.dy_du]), [end * by, rate], rtol=1e-5)
    np.testing.assert_allclose(np.hstack([found.dr_dx, found.dr_du]), [end * by, 2 * x * np.cos(end) * by], rtol=1e-5)


COUPLED = """model Coupled "rates that are solved for together, by weights that the state moves"
time t : s
state x = 1 in -10..10
state y = 2 in -10..10
action u = 0 in -1..1
eq (1 + x*x)*d/dt x + 0.5*d/dt y = (u - x)/(1 [s])
eq d/dt y - 0.5*y*d/dt x = (x*x - y)/(1 [s])
observe rx : 1/s = der(x), ry : 1/s = der(y), x in -10..10
episode { step = 0.1, max_steps = 10 }
"""


@pytest.mark.parametrize("at", [(1.5, 2.0), (-0.4, 0.7)])
def test_rates_that_are_solved_for_together_are_linearised_where_nothing_rests(at):
    def rates(x, y, u):
        return np.linalg.solve([[1 + x * x, 0.5], [-0.5 * y, 1.0]], [u - x, x * x - y])

    point, h = np.array([*at, 0.3]), 1e-6
    by = np.array([(rates(*(point + h * e)) - rates(*(point - h * e))) / (2 * h) for e in np.eye(3)]).T
    a, b, c, d = smpl.compile(source=COUPLED).linearize(list(at), [0.3])
    np.testing.assert_allclose(np.hstack([a, b]), by, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(np.hstack([c, d])[:2], by, rtol=1e-7, atol=1e-8)
    np.testing.assert_array_equal(np.hstack([c, d])[2], [1.0, 0.0, 0.0])


COLLISION = (PROBLEMS / "collisions.eq").read_text()


def elastic(m: tuple[float, float], x: list[float], push: float, step: float) -> np.ndarray:
    """Positions and velocities of two carts after a step with one collision, by the roots of their distance."""
    (x_1, x_2, v_1, v_2), (m_1, m_2) = x, m
    a, b, c = push / 2, v_1 - v_2, x_1 - x_2
    t = -c / b if a == 0 else 2 * c / (-b - np.sqrt(b * b - 4 * a * c))
    at, before = x_1 + v_1 * t + a * t * t, v_1 + push * t
    after_1 = ((m_1 - m_2) * before + 2 * m_2 * v_2) / (m_1 + m_2)
    after_2 = ((m_2 - m_1) * v_2 + 2 * m_1 * before) / (m_1 + m_2)
    rest = step - t
    return np.array([at + after_1 * rest + a * rest**2, at + after_2 * rest, after_1 + push * rest, after_2])


@pytest.mark.parametrize("method", ["ida", "rosenbrock", "explicit"])
def test_an_elastic_collision_keeps_momentum_and_energy(method):
    env = smpl.Env(smpl.compile(source=COLLISION), normalize=False, method=method)
    env.reset(seed=0)
    for _ in range(6):
        env.step(np.array([0.0]))
    state = dict(zip(env.state_names, env.state, strict=True))
    # They meet after 1.1 s at 1.1 m; the laws of elastic collisions give v_1 = -2, v_2 = 0.
    assert [state[n] for n in ("x_1", "x_2", "v_1", "v_2")] == pytest.approx([-2.7, 1.1, -2, 0], abs=1e-7)
    assert state["v_1"] + 3 * state["v_2"] == pytest.approx(-2, abs=1e-9)
    assert state["v_1"] ** 2 + 3 * state["v_2"] ** 2 == pytest.approx(4, abs=1e-9)
    # The belt has moved by a cell a step and got the velocity at the start of each.
    assert [state[f"belt[{i}]"] for i in range(1, 8)] == pytest.approx([-2, -2, -2, 1, 1, 1, 0], abs=1e-9)


def test_derivatives_of_an_elastic_collision():
    model = smpl.compile(
        source=COLLISION.replace("step = 0.5", "step = 2") + "solver { rtol = 1e-11, atol_factor = 1e-4 }\n"
    )
    start = [0.0, 2.2, 1.0, -1.0]
    x = np.zeros(len(model.state_names))
    place = [model.state_names.index(name) for name in ("x_1", "x_2", "v_1", "v_2")]
    x[place] = start
    after, dx, du, dp = model.sensitivity(x, [0.2], parameters=("m_1", "m_2"))
    assert after[place] == pytest.approx(elastic((1, 3), start, 0.2, 2), abs=1e-8)

    def difference(change):
        h = 1e-6
        return (change(h) - change(-h)) / (2 * h)

    for j in range(4):
        moved = difference(lambda h: elastic((1, 3), [v + h * (i == j) for i, v in enumerate(start)], 0.2, 2))  # noqa: B023
        assert dx[np.ix_(place, [place[j]])][:, 0] == pytest.approx(moved, abs=1e-6)
    assert du[place, 0] == pytest.approx(difference(lambda h: elastic((1, 3), start, 0.2 + h, 2)), abs=1e-6)
    assert dp[place, 0] == pytest.approx(difference(lambda h: elastic((1 + h, 3), start, 0.2, 2)), abs=1e-6)
    assert dp[place, 1] == pytest.approx(difference(lambda h: elastic((1, 3 + h), start, 0.2, 2)), abs=1e-6)


@pytest.mark.parametrize("method", ["ida", "rosenbrock", "auto"])
def test_derivatives_of_a_rollout_by_some_actions_are_columns_of_those_by_all(method):
    model = smpl.compile(source=LINEAR)
    plan = np.random.default_rng(2).uniform(-1, 1, (3, 4, 2))
    x = [[1.0, -0.5], [0.3, 0.4], [-1.0, 2.0]]
    every = linearize_rollout(model, x, plan, by=("action",), method=method)
    some = linearize_rollout(model, x, plan, by=("action",), actions_by=["v"], method=method)
    assert some.by["action"] == ("v@0", "v@1", "v@2", "v@3")
    np.testing.assert_allclose(some.dx_du, every.dx_du[..., 1::2], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(some.dr_du, every.dr_du[..., 1::2], rtol=1e-6, atol=1e-9)
    with pytest.raises(ValueError, match="actions_by: unknown 'w'"):
        linearize_rollout(model, x, plan, actions_by=["w"])
