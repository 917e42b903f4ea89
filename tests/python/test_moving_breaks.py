"""Derivatives of integrals and states over breaks whose times move, against closed forms by a complex step."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

import smpl

METHODS = ("ida", "rosenbrock", "explicit", "auto")
GRIDS = ((1.0, 4), (0.37, 11), (4.0, 1))

ACTIONS = (0.5, 1.3, -0.4, 0.7)

# `z` is the integral of the same expression as the reward.
SIGNALS = """
model Signals
time t : s
param th : s = 0.3
param th2 : s = 0.55
action a = 0 in -9..9
state z = 0 in -99..99
discrete v = 0
state w = 0.1
eq d/dt w = 1 [1/s]
event e when w >= 1.3
at e {{ next v = 3 }}
eq d/dt z = ({0})*1 [1/s]
reward r default = integral({0})/(1 [s])
observe z
"""

Piece = tuple[complex, complex, complex]


def compiled(source: str, step: float, steps: int) -> smpl.Model:
    return smpl.compile(source=f"{source}\nepisode {{ step = {step!r} [s], max_steps = {steps} }}\n")


def by_complex_step(function: Callable, point: Sequence[float]) -> np.ndarray:
    """Derivatives of an analytic function, to rounding; ordering within it is by real parts."""
    columns = []
    for at in range(len(point)):
        moved = np.array(point, dtype=complex)
        moved[at] += 1e-30j
        columns.append(np.imag(function(moved)) / 1e-30)
    return np.array(columns).T


def integrals(pieces: Sequence[Piece], step: float, steps: int) -> np.ndarray:
    """Integrals over each step of straight lines, each with its beginning, its value there and its slope."""

    def inside(time: complex, begin: float, end: float) -> complex:
        return begin if time.real < begin else end if time.real > end else time

    found = []
    for k in range(steps):
        begin, end = k * step, (k + 1) * step
        sum_ = 0
        for at, (start, value, slope) in enumerate(pieces):
            stop = pieces[at + 1][0] if at + 1 < len(pieces) else end + 1 + 0j
            low, high = inside(start, begin, end), inside(stop, begin, end)
            sum_ += (high - low) * (value + slope * ((low + high) / 2 - start))
        found.append(sum_)
    return np.array(found)


def jumps(of: Sequence[tuple[complex, complex]]) -> list[Piece]:
    """A sum of steps, each of a size at a time."""
    pieces, level = [(-99 + 0j, 0 + 0j, 0 + 0j)], 0
    for time, size in sorted(of, key=lambda pair: pair[0].real):
        level += size
        pieces.append((time, level, 0))
    return pieces


def check(model: smpl.Model, start, actions, names, exact: Callable, step: float, method: str) -> None:
    """Compares rewards and the first state with their derivatives by the states and the parameters."""
    steps = len(actions)
    point = [*start, *names.values()]
    states = len(start)
    found = model.linearize_rollout(start, actions, parameters=list(names), by=("state",), method=method)
    value = exact(np.array(point, dtype=complex)).real
    by = by_complex_step(exact, point)
    assert found.rewards[:, 0] == pytest.approx(value, abs=1e-5)
    assert found.dr_dx[:, 0] == pytest.approx(by[:, :states], abs=1e-4)
    assert found.dr_dp[:, 0] == pytest.approx(by[:, states:], abs=1e-4)
    sums = np.cumsum(by, axis=0)
    sums[:, 0] += 1
    if found.dx_dx.shape[1] > 1:
        assert found.dx_dx[:, 0] == pytest.approx(sums[:, :states], abs=1e-4)
        assert found.dx_dp[:, 0] == pytest.approx(sums[:, states:], abs=1e-4)
    assert steps == len(by)


def of_actions(delay: complex, step: float, steps: int, factor: float = 1) -> list[tuple[complex, complex]]:
    """Jumps of a delayed action, from 0 before the start."""
    levels = np.resize(ACTIONS, steps)
    return [(k * step + delay, factor * (levels[k] - (levels[k - 1] if k else 0))) for k in range(steps)]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("step", "steps"), GRIDS)
@pytest.mark.parametrize(
    ("expression", "signals"),
    [
        ("delay(a, th)", [("a", 2, 1)]),
        ("delay(v, th)", [("v", 2, 1)]),
        ("delay(a, th) + 2*delay(v, th)", [("a", 2, 1), ("v", 2, 2)]),
        ("delay(a, th) + 2*delay(v, th2)", [("a", 2, 1), ("v", 3, 2)]),
        ("3*delay(a, th2) - delay(v, th)*2 + delay(a, th)", [("a", 3, 3), ("v", 2, -2), ("a", 2, 1)]),
    ],
)
def test_each_delayed_jump_moves_states_and_integrals(expression, signals, step, steps, method):
    model = compiled(SIGNALS.format(expression), step, steps)
    actions = np.resize(ACTIONS, steps)[:, None]

    def exact(point):
        _, w, *_ = point
        found = []
        for name, place, factor in signals:
            delay = point[place]
            found += of_actions(delay, step, steps, factor) if name == "a" else [(1.3 - w + delay, 3 * factor)]
        return integrals(jumps(found), step, steps)

    check(model, [0.0, 0.1], actions, {"th": 0.3, "th2": 0.55}, exact, step, method)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("step", "steps"), GRIDS)
@pytest.mark.parametrize("delay", [0.0, 0.1, 0.83])
def test_the_integral_of_a_delayed_saw_tooth_moves_with_its_jumps(delay, step, steps, method):
    reads = f"delay(J, {delay} [s])" if delay else "J"
    source = f"""
    model Saw
    time t : s
    param p = 1.9
    state J = 1 in -99..99
    eq d/dt J = p*1 [1/s]
    event e when J >= 2.5
    at e {{ reset J = J - 1.5 }}
    reward r default = integral({reads})/(1 [s])
    observe J
    """

    def exact(point):
        x, p = point
        first = (2.5 - x) / p + delay
        pieces = [(-99 + 0j, x, 0), (delay + 0j, x, p)]
        pieces += [(first + k * 1.5 / p, 1, p) for k in range(9)]
        return integrals(pieces, step, steps)

    check(compiled(source, step, steps), [1.0], np.zeros((steps, 0)), {"p": 1.9}, exact, step, method)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("step", "steps"), GRIDS)
@pytest.mark.parametrize("delay", [0.0, 0.25])
@pytest.mark.parametrize(
    ("expression", "pieces"),
    [
        ("f(t*sc)", lambda sc: [(0, 1, 0), (1.5 / sc, 5, 0), (2.6 / sc, 4, 0)]),
        ("if t > 1.3 [s]*sc then 4 else 1", lambda sc: [(0, 1, 0), (1.3 * sc, 4, 0)]),
        ("floor(t*sc/(0.7 [s]))", lambda sc: [(0.7 * k / sc, k, 0) for k in range(7)]),
        ("mod(t*sc, 0.7 [s])/(1 [s])", lambda sc: [(0.7 * k / sc, 0, sc) for k in range(7)]),
    ],
)
def test_breaks_in_time_that_a_parameter_moves_act_on_integrals(expression, pieces, delay, step, steps, method):
    expression = f"delay({expression}, {delay} [s])" if delay else expression
    source = f"""
    model Breaks
    time t : s
    param sc = 1
    table f : 1 over time : s step {{ 0: 1, 1.5: 5, 2.6: 4 }}
    state z = 0.3
    eq d/dt z = ({expression})*1 [1/s]
    reward r default = integral({expression})/(1 [s])
    """

    def exact(point):
        found = [(begin + delay + 0j, value, slope) for begin, value, slope in pieces(point[1])]
        return integrals([(-99 + 0j, found[0][1], 0), *found], step, steps)

    check(compiled(source, step, steps), [0.3], np.zeros((steps, 0)), {"sc": 1.0}, exact, step, method)


@pytest.mark.parametrize(
    ("expression", "names"),
    [
        ("(if t > p then 1 else 0) + 2*(if t > q then 1 else 0)", ("p", "q")),
        ("delay(a, p) + 2*delay(b, q)", ("p", "q")),
        ("delay(a, p) + (if t > q then 1 else 0)", ("p", "q")),
    ],
)
@pytest.mark.parametrize("integral", [False, True])
def test_jumps_at_one_time_that_move_differently_are_refused_by_their_time(expression, names, integral):
    source = f"""
    model Together
    time t : s
    param p : s = 0.5
    param q : s = 0.5
    action a = 0 in -9..9
    action b = 0 in -9..9
    state z = 0 in -99..99
    eq d/dt z = ({"0" if integral else expression})*1 [1/s]
    reward r default = {f"integral({expression})/(1 [s])" if integral else "z"}
    observe z
    """
    model = compiled(source, 1.0, 2)
    actions = np.array([[1.0, 2.0], [3.0, -1.0]])
    with pytest.raises(smpl.SimulationError, match=r"jump together at t = 0\.5"):
        model.linearize_rollout([0.0], actions, parameters=list(names), by=("state",))
    # Along directions that move both alike there is a derivative.
    found = model.linearize_rollout([0.0], actions, by=("state", "action"))
    assert np.isfinite(found.dr_du).all()


def test_a_signal_that_does_not_jump_does_not_hinder_another_with_an_equal_dead_time():
    # Both dead times are 0.5; only `a` jumps at 1, and `v` is constant after the start.
    source = """
    model Alone
    time t : s
    param p : s = 0.5
    param q : s = 0.5
    action a = 0 in -9..9
    discrete v = 2
    state z = 0 in -99..99
    eq d/dt z = (delay(a, p) + delay(v, q))*1 [1/s]
    observe z
    """
    model = compiled(source, 1.0, 2)
    found = model.linearize_rollout([0.0], np.array([[1.0], [4.0]]), parameters=["p", "q"], by=("state",))
    assert found.dx_dp[:, 0] == pytest.approx(np.array([[-1.0, 0.0], [-4.0, 0.0]]), abs=1e-6)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("step", "steps"), [(1.0, 5), (0.4, 9), (3.3, 2)])
def test_a_delayed_relay_has_the_derivatives_of_its_triangles(step, steps, method):
    # The kink of `z` a dead time ago is always at the time at which `z` passes the threshold again.
    source = """
    model Relay
    time t : s
    param th : s = 0.31
    state z = 0.2
    eq d/dt z = delay(if z > 0.5 then -1 else 1, th) / 1 [s]
    observe z in -9..9
    """

    def at(time, z, delay):
        begin, slope, change = 0, 1, 0.5 - z + delay
        while change.real < time:
            z += slope * (change - begin)
            begin, slope, change = change, -slope, change + slope * (z - 0.5) + delay
        return z + slope * (time - begin)

    def exact(point):
        return np.array([at(step * k, *point) for k in range(1, steps + 1)])

    found = compiled(source, step, steps).linearize_rollout(
        [0.2], np.zeros((steps, 0)), parameters=["th"], by=("state",), method=method
    )
    by = by_complex_step(exact, [0.2, 0.31])
    assert found.dx_dx[:, 0, 0] == pytest.approx(by[:, 0], abs=1e-5)
    assert found.dx_dp[:, 0, 0] == pytest.approx(by[:, 1], abs=1e-5)
