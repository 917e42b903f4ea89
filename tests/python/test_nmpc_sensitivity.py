"""Derivatives of predictive control: against central differences of solved programmes, and a Riccati equation."""

import numpy as np
import pytest
from scipy.linalg import expm

import smpl
from smpl.controllers import NMPC

pytest.importorskip("casadi", reason="CasADi is not installed")

START = {"c_A": 0.9, "T": 46.0, "h": 0.62}
COST = {"c_A": 50.0, "T": 0.4, "h": 30.0, "T_c": 0.05, "q_out": 200.0}
TERMINAL = {"c_A": 80.0, "T": 1.0, "h": 60.0}


def decided(controller, env, changes=None, state=None):
    """The first actions from a state with changed values."""
    if changes:
        controller.adjust(changes)
    env.reset(seed=0, options={"state": {**START, **(state or {})}})
    controller.reset(env)
    return controller.action(env)


def reactor(**options):
    env = smpl.Env("reactor", normalize=False)
    values = {"terminal": TERMINAL, "tunable": True, "solver": "ipopt", "tolerance": 1e-11, **options}
    return env, NMPC(env, 8, COST, **values)


@pytest.mark.parametrize("start", [{}, {"T": 39.0}, {"c_A": 0.8, "T": 60.0, "h": 0.75}])
def test_derivatives_of_the_first_action_equal_central_differences(start):
    env, controller = reactor(p={"U": 54.94})
    middle = decided(controller, env, state=start)
    found = controller.derivatives()
    assert found.actions == ("T_c", "q_out")
    values = {
        "cost:T": 0.4,
        "cost:T_c": 0.05,
        "terminal:c_A": 80.0,
        "cost:h": 30.0,
        "target:T": 51.34660837,
        "U": 54.94,
    }
    values |= {"dH": -5.0e4, "terminal:h": 60.0}
    for name, value in values.items():
        step = 1e-4 * abs(value)
        up, down = (decided(controller, env, {name: value + sign * step}, start) for sign in (1, -1))
        decided(controller, env, {name: value}, start)
        expected = (up - down) / (2 * step)
        np.testing.assert_allclose(found.by[name], expected, rtol=2e-3, atol=1e-6 * np.abs(middle / value).max())
    for i, name in enumerate(START):
        value = {**START, **start}[name]
        step = 1e-4 * value
        sides = [decided(controller, env, state={**start, name: value + sign * step}) for sign in (1, -1)]
        expected = (sides[0] - sides[1]) / (2 * step)
        np.testing.assert_allclose(found.by_state[:, i], expected, rtol=2e-3, atol=1e-6 * np.abs(middle / value).max())


def test_an_action_at_its_bound_has_the_derivative_zero():
    env, controller = reactor()
    action = decided(controller, env, {"cost:q_out": 2e5}, {"T": 39.0})
    assert action[0] == pytest.approx(35.0, abs=1e-6)  # the jacket is as warm as it can be
    found = controller.derivatives()
    np.testing.assert_allclose(found.by_state[0], 0, atol=1e-8)
    assert all(abs(column[0]) < 1e-8 for column in found.by.values())
    assert np.abs(found.by_state[1]).max() > 1e-3


LINEAR = """model Linear
time t : s
action u = 0 in -1e4..1e4
state x = 0 in -1e6..1e6
state v = 0 in -1e6..1e6
eq d/dt x = v*1[1/s]
eq d/dt v = (0.5*x - 0.2*v + u)*1[1/s]
steady { x = 0, v = 0, u = 0 }
observe x, v
episode { step = 0.2 [s], max_steps = 40 }
"""


def test_the_derivative_by_the_state_of_a_linear_plant_is_the_gain_of_the_riccati_recursion():
    env = smpl.Env(smpl.compile(source=LINEAR), normalize=False)
    controller = NMPC(env, 12, {"x": 1.0, "v": 0.1, "u": 0.1}, degree=4, tolerance=1e-10)
    env.reset(seed=0, options={"state": {"x": 1.0, "v": -0.3}})
    controller.reset(env)
    controller.action(env)
    whole = expm(0.2 * np.array([[0, 1, 0], [0.5, -0.2, 1], [0, 0, 0]]))
    a, b = whole[:2, :2], whole[:2, 2:]
    q, r = np.diag([1.0, 0.1]), np.array([[0.1]])
    p = q  # costs count at the ends of intervals
    for _ in range(12):
        gain = np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)
        p = q + a.T @ p @ (a - b @ gain)
    np.testing.assert_allclose(controller.derivatives().by_state, -gain, rtol=1e-6)


def test_a_tunable_cost_decides_as_one_of_numbers():
    env, controller = reactor()
    numbers = NMPC(env, 8, COST, terminal=TERMINAL, solver="ipopt", tolerance=1e-11)
    assert decided(controller, env) == pytest.approx(decided(numbers, env), rel=1e-7)
    changed = decided(controller, env, {"cost:T": 4.0, "target:T": 50.0})
    other = NMPC(env, 8, {**COST, "T": 4.0}, terminal=TERMINAL, set_point={"T": 50.0}, solver="ipopt", tolerance=1e-11)
    assert changed == pytest.approx(decided(other, env), rel=1e-7)


def test_invalid_values_and_missing_decisions_are_refused():
    env, controller = reactor()
    with pytest.raises(ValueError, match="no solution that has converged"):
        controller.derivatives()
    for values, message in (
        ({"cost:x": 1.0}, "unknown 'cost:x'"),
        ({"cost:T": -1.0}, "not negative"),
        ({"target:T": float("nan")}, "finite"),
    ):
        with pytest.raises(ValueError, match=message):
            controller.adjust(values)
    with pytest.raises(ValueError, match="unknown 'cost:T'"):
        NMPC(env, 8, COST).adjust({"cost:T": 1.0})
