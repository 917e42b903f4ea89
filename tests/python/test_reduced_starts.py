"""Starts of reduced systems: values off a constraint are refused with those that satisfy it."""

import numpy as np
import pytest
from scipy.optimize import brentq

import smpl
from reduced import HEAD, solved

PENDULUM = """
state x = 1
state y = 0
state u : 1/s = 0
state v : 1/s = 0
var F : 1/s^2
eq d/dt x = u
eq d/dt y = v
eq d/dt u = -F*x
eq d/dt v = -F*y - 9.81 [1/s^2]
eq x^2 + y^2 = 1
"""
DISTILLATION = """
set c = {a, b}
state n[c] : mol = 50
state T : K = 365 in 250..500
var V : mol/s
param A[c] = { a: 10, b: 9 }
param B[c] : K = { a: 3600, b: 3500 }
let N : mol = sum(n[i] for i in c)
let y[i in c] = n[i]/N*exp(A[i] - B[i]/T)
eq d/dt n[i] = -V*y[i] for i in c
eq d/dt (N*T) = 20 [mol*K/s] - V*(T + 400 [K])
eq sum(y[i] for i in c) = 1
"""
PREHEATER = """
set k = 1..5
state T[k] : K = 350
state q : 1/s = 0.5
var w : 1/s^2
eq d/dt T[1] = q*5*(300 [K] - T[1]) + 0.5 [1/s]*(400 [K] - T[1])
eq d/dt T[i] = q*5*(T[i-1] - T[i]) + 0.5 [1/s]*(400 [K] - T[i]) for i in 2..5
eq d/dt q = w
eq T[5] = 360 [K]
"""


def start(text):
    env = smpl.Env(smpl.compile(source=HEAD.format(step=1, steps=1) + text), normalize=False)
    env.reset(seed=0)
    return env


def refusal(text, **changes):
    for name, value in changes.items():
        text += f"initial {name} = {value}\n"
    with pytest.raises(smpl.SimulationError) as caught:
        start(text)
    return str(caught.value)


def test_each_state_of_a_constraint_is_proposed_with_the_value_that_fits_the_others():
    message = refusal(PENDULUM, x=0.6, y=0.5)
    # sqrt(1 - 0.5^2) and sqrt(1 - 0.6^2)
    assert "start `x` at 0.8660254038," in message and "or `y` at 0.8" in message, message


def test_a_state_that_a_constraint_cannot_move_is_not_proposed():
    """At y = 0 the derivative of x^2 + y^2 by y is zero."""
    message = refusal(PENDULUM, x=0.6)
    assert "start `x` at 1" in message and "`y`" not in message, message


def test_a_boiling_point_is_proposed():
    T = brentq(lambda T: (np.exp(10 - 3600 / T) + np.exp(9 - 3500 / T)) / 2 - 1, 300, 400)
    message = refusal(DISTILLATION)
    assert f"`T` at {T:.6f} K" in message, message


def test_a_derivative_of_a_constraint_moves_states_that_the_constraint_does_not_bind():
    message = refusal(PENDULUM, x=0.6, y=0.8, u=1)
    # x u + y v = 0
    assert "time derivative" in message and "`v` at -0.75 1/s" in message and "`x`" not in message, message
    message = refusal(PREHEATER, **{"T[5]": "360 [K]"})
    # q*5*(T4 - 360) + 0.5*40 = 0
    assert "`T[4]` at 352 K" in message and "`T[5]`" not in message, message


def test_values_off_a_constraint_are_named_where_the_equations_are_singular_there():
    """The second derivative reads q'*(T4 - T5), and both start at 350 K."""
    assert "start `T[5]` at 360 K" in refusal(PREHEATER)


def test_an_initial_value_may_read_an_unknown_of_an_implicit_equation():
    text = PENDULUM + "var p = 1\neq p^3 + p = 0.8^3 + 0.8 + 0*x\ninitial y = p\ninitial x = 0.6\n"
    assert start(text).state[1] == pytest.approx(0.8, rel=1e-9)
    vessels = """
    state n1 : mol = 1
    state n2 : mol = 7
    var w : mol/s
    var q : mol = 0.5
    eq d/dt n1 = 1 [mol/s] - w
    eq d/dt n2 = w
    eq 2*n1 = n2
    eq q^3/1 [mol^2] + q = 10 [mol] + 0*n1
    initial n2 = {}
    """
    env = start(vessels.format("q"))
    names = env.model.state_names + env.model.algebraic_names
    values = dict(zip(names, [*env.state, *env.algebraic], strict=True))
    assert values["n2"] == pytest.approx(2.0, rel=1e-9)
    assert "demands 2 mol" in refusal(vessels.format("2*q"))


def test_a_preheater_holds_its_outlet_by_its_feed():
    """T4 = 360 - 4/q from the derivative of the constraint; its own derivative gives q'."""

    def rates(t, z):
        T1, T2, T3, q = z
        T4 = 360 - 4 / q
        cell = lambda before, T: q * 5 * (before - T) + 0.5 * (400 - T)  # noqa: E731
        return [cell(300, T1), cell(T1, T2), cell(T2, T3), q**2 / 4 * cell(T3, T4)]

    T1, T2, T3, q = solved(rates, [350, 350, 350, 0.5], 5, "LSODA")
    text = PREHEATER + "initial T[5] = 360 [K]\ninitial T[4] = 352 [K]\n"
    for method in ("ida", "rosenbrock", "auto"):
        env = smpl.Env(smpl.compile(source=HEAD.format(step=0.5, steps=10) + text), method=method, normalize=False)
        env.reset(seed=0)
        for _ in range(10):
            env.step([])
        assert env.state == pytest.approx([T1, T2, T3, 360 - 4 / q, 360, q], rel=1e-6), method


@pytest.mark.parametrize("other", ["", "initial n2 = 2*n1\n"])
def test_a_given_state_that_does_not_fit_is_refused_next_to_conditions(other):
    """A condition holds n1 at 70 mol; a given n1 drops it."""
    vessels = """
    action F : mol/s = 0 in -1..1
    state n1 : mol = 40
    state n2 : mol = 80
    var w : mol/s
    eq n1 = n2/2
    eq d/dt n1 = F - w
    eq d/dt n2 = w
    initial eq n1 = 70 [mol] free n1
    """
    env = smpl.Env(smpl.compile(source=HEAD.format(step=1, steps=1) + vessels + other), normalize=False)
    for given, n1 in ({}, 70), ({"n1": 10.0}, 10), ({"n1": 10.0, "n2": 20.0}, 10), ({"n2": 140.0}, 70):
        env.reset(seed=0, options={"state": given} if given else None)
        assert env.state == pytest.approx([n1], rel=1e-9)
    for given, demanded in ({"n2": 100.0}, 140), ({"n1": 10.0, "n2": 21.0}, 20):
        with pytest.raises(smpl.SimulationError, match=f"`n2` starts at {given['n2']:g} mol.* demands {demanded}"):
            env.reset(seed=0, options={"state": given})
