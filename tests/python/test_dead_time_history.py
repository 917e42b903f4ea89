"""Rollouts with a given past, against long runs cut in two and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import smpl

METHODS = ("ida", "rosenbrock", "explicit", "auto")

HEATER = """
model Heater
time t : min
param  theta : min = 2.3
action u : K = 0 in -20..20
state  T : K = 1 in -50..50
eq d/dt T = (delay(u, theta) - T) / 1.7 [min]
observe T
solver { rtol = 1e-9 }
episode { step = 0.5 [min], max_steps = 60 }
"""


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("cut", [3, 7, 12])
def test_a_run_cut_in_two_goes_on_with_the_actions_before_the_cut(cut, method):
    model = smpl.compile(source=HEATER)
    actions = np.random.default_rng(1).uniform(-5, 5, (20, 1))
    whole = model.rollout([1.0], actions, method=method).states[0]
    # Before the first action `u` has its nominal value 0.
    past = np.concatenate([np.zeros((5, 1)), actions[:cut]])
    rest = model.rollout(whole[cut], actions[cut:], method=method, history={"actions": past}).states[0]
    assert rest == pytest.approx(whole[cut:], abs=1e-6)
    without = model.rollout(whole[cut], actions[cut:], method=method).states[0]
    assert np.abs(without - whole[cut:]).max() > 0.1


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("steps", [1, 8])
def test_a_state_history_continues_an_exact_solution(steps, method):
    # y' = -(pi/2) y(t - 1) has the solution sin(pi t/2).
    source = f"""
    model Sine
    time t : s
    state y = 0 in -9..9
    eq d/dt y = -1.5707963267948966*delay(y, 1 [s]) / 1 [s]
    observe y
    solver {{ rtol = 1e-10 }}
    episode {{ step = {4 / steps} [s], max_steps = 60 }}
    """
    model = smpl.compile(source=source)
    times = np.linspace(-1.2, 0, 241)[:-1]
    history = {"times": times, "states": np.sin(np.pi * times / 2)[:, None]}
    found = model.rollout([0.0], np.zeros((steps, 0)), method=method, history=history).states[0, :, 0]
    assert found == pytest.approx(np.sin(np.pi / 2 * np.linspace(0, 4, steps + 1)), abs=2e-6)


@pytest.mark.parametrize("method", METHODS)
def test_states_and_actions_of_the_last_steps_are_taken_together(method):
    source = """
    model Both
    time t : s
    action u = 0 in -9..9
    state x = 0.5 in -9..9
    state y = 0 in -9..9
    eq d/dt x = -x / 1 [s]
    eq d/dt y = delay(u*x, 0.75 [s]) / 1 [s]
    observe y
    solver { rtol = 1e-10 }
    episode { step = 0.05 [s], max_steps = 99 }
    """
    model = smpl.compile(source=source)
    actions = np.repeat(np.random.default_rng(2).uniform(-3, 3, 12), 5)[:, None]
    whole = model.rollout([0.5, 0.0], actions, method=method).states[0]
    history = {"states": whole[:30], "actions": actions[:30]}
    rest = model.rollout(whole[30], actions[30:], method=method, history=history).states[0]
    assert rest == pytest.approx(whole[30:], abs=1e-5)


def test_a_start_reads_the_history_in_its_algebraic_equations():
    source = """
    model Start
    time t : s
    state x = 1
    var z
    eq z = 2*delay(x, 1 [s])
    eq d/dt x = (z - x) / 1 [s]
    observe z in -99..99
    episode { step = 1 [s], max_steps = 9 }
    """
    model = smpl.compile(source=source)
    history = {"times": [-2.0, -1.0], "states": [[3.0], [5.0]]}
    found = model.rollout([1.0], np.zeros((1, 0)), history=history)
    assert found.observations[0, 0, 0] == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("history", "message"),
    [
        ({}, "neither states nor actions"),
        ({"state": [[1.0]]}, "history"),
        ({"states": [[1.0, 2.0]]}, r"history\['states'\] has shape \(1, 2\), expected \(k, 1\)"),
        ({"states": [[1.0]], "actions": [[1.0], [2.0]]}, "lengths 1, 2"),
        ({"states": [[1.0]], "times": [0.5]}, "times must increase and be before the start"),
        ({"states": [[1.0], [1.0]], "times": [-1.0, -2.0]}, "times must increase and be before the start"),
        ({"states": [[np.inf]]}, r"history\['states'\] has a value that is not finite"),
    ],
)
def test_histories_that_do_not_fit_are_refused(history, message):
    model = smpl.compile(source=HEATER)
    with pytest.raises(ValueError, match=message):
        model.rollout([1.0], np.zeros((2, 1)), history=history)


def test_a_model_without_delays_and_delayed_algebraic_variables_refuse_a_history():
    plain = "model M\ntime t : s\nstate x = 1\neq d/dt x = -x/1 [s]\nepisode { step = 1 [s], max_steps = 9 }\n"
    with pytest.raises(ValueError, match="no `delay`"):
        smpl.compile(source=plain).rollout([1.0], np.zeros((1, 0)), history={"states": [[1.0]]})
    algebraic = plain.replace("eq d", "var z\neq z = 2*x + 0.5*delay(z, 1 [s], before = 0)\neq d")
    with pytest.raises(ValueError, match=r"`delay\(z, .*delays more"):
        smpl.compile(source=algebraic).rollout([1.0], np.zeros((1, 0)), history={"states": [[1.0]]})
