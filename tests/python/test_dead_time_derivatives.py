"""Derivatives of models with dead times, against closed forms and the method of steps with SciPy."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import smpl

METHODS = ("ida", "rosenbrock", "explicit", "auto")

HEATER = """
model Heater
time t : min
param  theta : min = 2.3
param  T_c   : min = 1.7
action u : K = 0 in -20..20
state  T : K = 1 in -50..50
eq d/dt T = (delay(u, theta) - T) / T_c
observe T
reward r default = -sq((delay(T, theta) - 2 [K]) / 1 [K])
solver { rtol = 1e-9 }
"""


def compiled(source: str, step: float, steps: int, unit: str = "min") -> smpl.Model:
    return smpl.compile(source=f"{source}\nepisode {{ step = {step!r} [{unit}], max_steps = {steps} }}\n")


def by_complex_step(function: Callable, point: Sequence[float]) -> np.ndarray:
    """Derivatives of an analytic function, to rounding; ordering within it is by real parts."""
    columns = []
    for at in range(len(point)):
        moved = np.array(point, dtype=complex)
        moved[at] += 1e-30j
        columns.append(np.imag(function(moved)) / 1e-30)
    return np.array(columns).T


def heater(point: np.ndarray, actions: int, step: float, ends: np.ndarray) -> np.ndarray:
    """The temperature at times: of start, dead time, time constant, then the actions."""
    x, theta, lag, *u = point

    def at(time: float) -> complex:
        value = x * np.exp(-time / lag)
        for k in range(actions):
            begin, end = k * step + theta, (k + 1) * step + theta
            if begin.real < time:
                last = end if end.real < time else time
                value += u[k] * (np.exp((last - time) / lag) - np.exp((begin - time) / lag))
        return value

    return np.array([at(time) for time in ends])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("step", "steps"), [(0.5, 20), (3.7, 3), (10.0, 1)])
def test_derivatives_of_a_first_order_lag_with_dead_time_are_those_of_its_closed_form(method, step, steps):
    model = compiled(HEATER, step, steps)
    actions = np.random.default_rng(1).uniform(-5, 5, (steps, 1))
    found = model.linearize_rollout([1.0], actions, parameters=["theta", "T_c"], method=method)
    ends = step * np.arange(1, steps + 1)
    point = [1.0, 2.3, 1.7, *actions[:, 0]]
    exact = by_complex_step(lambda z: heater(z, steps, step, ends), point)
    value = heater(np.array(point, dtype=complex), steps, step, ends).real
    assert found.states[:, 0] == pytest.approx(value, abs=2e-6)
    assert found.dx_dx[:, 0, 0] == pytest.approx(exact[:, 0], abs=2e-5)
    assert found.dx_dp[:, 0] == pytest.approx(exact[:, 1:3], abs=2e-4)
    assert found.dx_du[:, 0] == pytest.approx(exact[:, 3:], abs=2e-5)
    assert found.dy_dp[:, 0] == pytest.approx(found.dx_dp[:, 0])
    assert model.rollout([1.0], actions, method=method).states[0, 1:, 0] == pytest.approx(value, abs=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_rewards_that_read_a_delayed_state_have_its_derivatives(method):
    step, steps = 1.1, 6
    model = compiled(HEATER, step, steps)
    actions = np.random.default_rng(2).uniform(-5, 5, (steps, 1))
    found = model.linearize_rollout([1.0], actions, parameters=["theta", "T_c"], method=method)

    def reward(point):
        theta = point[1]
        ends = [k * step - theta for k in range(1, steps + 1)]
        # Before the start the temperature is that at the start.
        values = [heater(point, steps, step, [end])[0] if end.real > 0 else point[0] for end in ends]
        return np.array([-((value - 2) ** 2) for value in values])

    exact = by_complex_step(reward, [1.0, 2.3, 1.7, *actions[:, 0]])
    assert found.dr_dx[:, 0, 0] == pytest.approx(exact[:, 0], abs=2e-4)
    assert found.dr_dp[:, 0] == pytest.approx(exact[:, 1:3], abs=2e-3)
    assert found.dr_du[:, 0] == pytest.approx(exact[:, 3:], abs=2e-4)


@pytest.mark.parametrize("method", METHODS)
def test_one_step_has_the_derivatives_by_state_action_and_dead_time(method):
    model = compiled(HEATER, 5.0, 2)
    found = model.linearize_step([1.0], [4.0], parameters=["theta", "T_c"], method=method)
    exact = by_complex_step(lambda z: heater(z, 1, 5.0, [5.0]), [1.0, 2.3, 1.7, 4.0])[0]
    assert found.dx_dx[0, 0] == pytest.approx(exact[0], abs=1e-5)
    assert found.dx_dp[0] == pytest.approx(exact[1:3], abs=1e-4)
    assert found.dx_du[0, 0] == pytest.approx(exact[3], abs=1e-5)
    value, by_x, by_u, by_p = model.sensitivity([1.0], [4.0], parameters=["theta"], method=method)
    assert (by_x[0, 0], by_u[0, 0], by_p[0, 0]) == pytest.approx((exact[0], exact[3], exact[1]), abs=1e-4)
    assert model.step([1.0], [4.0], method=method) == pytest.approx(value, abs=1e-6)


def by_steps(rates: Callable, start: np.ndarray, before: Callable, piece: float, end: float) -> Callable:
    """The solution of y' = rates(t, y, past) by pieces no longer than the shortest dead time."""
    pieces: list[Callable] = []

    def past(t):
        return before(t) if t <= 0 else pieces[min(int(t / piece), len(pieces) - 1)](t)

    y = start
    for number in range(math.ceil(end / piece - 1e-9)):
        span = (number * piece, min(end, (number + 1) * piece))
        found = solve_ivp(lambda t, y: rates(t, y, past), span, y, "DOP853", rtol=1e-12, atol=1e-14, dense_output=True)
        pieces.append(found.sol)
        y = found.y[:, -1]
    return y


def by_differences(function: Callable, point: Sequence[float], distance: float = 2e-4) -> np.ndarray:
    """Derivatives by differences of the fourth order."""
    columns = []
    for at in range(len(point)):
        moved = [np.array(point, dtype=float) for _ in range(4)]
        for one, factor in zip(moved, (-2, -1, 1, 2), strict=True):
            one[at] += factor * distance
        a, b, c, d = (function(one) for one in moved)
        columns.append((8 * (c - b) - (d - a)) / (12 * distance))
    return np.array(columns).T


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("steps", [1, 9])
def test_hutchinson_s_equation_has_the_derivatives_of_the_method_of_steps(method, steps):
    source = """
    model Hutchinson
    time t : s
    param r = 1.4
    param tau : s = 1.1
    state y = 0.3
    eq d/dt y = r*y*(1 - delay(y, tau)) / 1 [s]
    solver { rtol = 1e-10 }
    """
    model = compiled(source, 7.3 / steps, steps, "s")
    found = model.linearize_rollout([0.3], np.zeros((steps, 0)), parameters=["r", "tau"], method=method)

    def end(point):
        y, r, tau = point
        return by_steps(
            lambda t, y, past: r * y * (1 - past(t - tau)), np.array([y]), lambda _: np.array([y]), tau, 7.3
        )

    exact = by_differences(end, [0.3, 1.4, 1.1])[0]
    assert found.dx_dx[-1, 0, 0] == pytest.approx(exact[0], rel=1e-4, abs=1e-4)
    assert found.dx_dp[-1, 0] == pytest.approx(exact[1:], rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("steps", [1, 8])
def test_switches_that_act_after_a_dead_time_move_with_it(method, steps):
    source = """
    model Thermostat
    time t : s
    param theta : s = 0.4
    param T : s = 1
    state x = 0
    var s
    eq s = if x < 0.8 then 1 else 0
    eq d/dt x = (delay(s, theta) - x) / T
    solver { rtol = 1e-10 }
    """
    end = 4.0
    model = compiled(source, end / steps, steps, "s")
    found = model.linearize_rollout([0.0], np.zeros((steps, 0)), parameters=["theta", "T"], method=method)

    def final(point):
        # Heated until a dead time after 0.8 is passed upwards, cooled until one after it is passed downwards.
        x, theta, lag = point
        time, target = 0.0, 1.0
        while True:
            crossing = time + lag * np.log((x - target) / (0.8 - target))
            change = crossing + theta
            if change.real > end:
                return np.array([target + (x - target) * np.exp((time - end) / lag)])
            x = target + (0.8 - target) * np.exp(-theta / lag)
            time, target = change, 1.0 - target

    exact = by_complex_step(final, [0.0, 0.4, 1.0])[0]
    assert found.states[-1, 0] == pytest.approx(final(np.array([0, 0.4, 1], dtype=complex))[0].real, abs=1e-6)
    assert found.dx_dx[-1, 0, 0] == pytest.approx(exact[0], abs=1e-4)
    assert found.dx_dp[-1, 0] == pytest.approx(exact[1:], abs=1e-4)


@pytest.mark.parametrize("method", METHODS)
def test_values_before_the_start_may_depend_on_parameters_and_time(method):
    source = """
    model Before
    time t : s
    param a = 0.7
    param theta : s = 2.5
    state y = 1
    eq d/dt y = delay(y, theta, before = a*exp(t / 1 [s])) / 1 [s]
    solver { rtol = 1e-10 }
    """
    # y = y0 + a exp(-theta) (exp(t) - 1) up to the dead time.
    model = compiled(source, 0.4, 5, "s")
    found = model.linearize_rollout([1.0], np.zeros((5, 0)), parameters=["a", "theta"], method=method)
    growth = math.exp(-2.5) * (math.exp(2.0) - 1)
    assert found.dx_dx[-1, 0, 0] == pytest.approx(1, abs=1e-6)
    assert found.dx_dp[-1, 0] == pytest.approx([growth, -0.7 * growth], abs=1e-5)


@pytest.mark.parametrize("method", METHODS)
def test_nested_dead_times_add_up(method):
    source = """
    model Nested
    time t : s
    param theta : s = 0.65
    action u = 0 in -9..9
    state x = 0
    eq d/dt x = (delay(delay(u, theta), theta) - x) / 1 [s]
    solver { rtol = 1e-10 }
    """
    step, steps = 0.8, 6
    model = compiled(source, step, steps, "s")
    actions = np.array([[1.0], [-2], [3], [0.5], [4], [-1]])
    found = model.linearize_rollout([0.0], actions, parameters=["theta"], method=method)

    def ends(point):
        return heater(np.array([point[0], 2 * point[1], 1.0, *point[2:]]), steps, step, step * np.arange(1, steps + 1))

    exact = by_complex_step(ends, [0.0, 0.65, *actions[:, 0]])
    assert found.dx_dp[:, 0, 0] == pytest.approx(exact[:, 1], abs=1e-4)
    assert found.dx_du[:, 0] == pytest.approx(exact[:, 2:], abs=1e-5)


@pytest.mark.parametrize("method", METHODS)
def test_a_dead_time_that_changes_with_time_and_state_has_exact_derivatives(method):
    source = """
    model Varying
    time t : s
    param a : s = 0.2
    state z = 0.5
    state y = 1
    var theta : s in 0.5..2
    eq theta = 1 [s] + a*z
    eq d/dt z = -z / 2 [s]
    eq d/dt y = -delay(y, theta) / 1 [s]
    solver { rtol = 1e-10 }
    """
    model = compiled(source, 3.0, 1, "s")
    found = model.linearize_rollout([0.5, 1.0], np.zeros((1, 0)), parameters=["a"], method=method)

    def end(point):
        z, y, a = point
        rates = lambda t, w, past: np.array([-past(t - 1 - a * z * np.exp(-t / 2))[0]])  # noqa: E731
        return by_steps(rates, np.array([y]), lambda _: np.array([y]), 0.5, 3.0)

    exact = by_differences(end, [0.5, 1.0, 0.2])[0]
    assert found.dx_dx[-1, 1] == pytest.approx(exact[:2], abs=2e-4)
    assert found.dx_dp[-1, 1, 0] == pytest.approx(exact[2], abs=2e-4)


def test_a_dead_time_is_fitted_from_a_recorded_step_response(tmp_path):
    model = compiled(HEATER, 0.5, 30)
    actions = np.where(np.arange(30) < 12, 4.0, -3.0)[:, None]
    ends = 0.5 * np.arange(31)
    values = heater(np.array([1.0, 2.3, 1.7, *actions[:, 0]], dtype=complex), 30, 0.5, ends).real
    path = tmp_path / "run.csv"
    rows = [f"{k},{ends[k]},{float(values[k])!r},{actions[k - 1, 0] if k else ''}" for k in range(31)]
    path.write_text("step,time,T,u\n" + "\n".join(rows) + "\n")
    found = smpl.fit(model, [path], {"theta": 1.4, "T_c": 3.0})
    assert found.parameters["theta"] == pytest.approx(2.3, rel=1e-4)
    assert found.parameters["T_c"] == pytest.approx(1.7, rel=1e-4)


def test_layers_differentiate_a_rollout_with_dead_times():
    torch = pytest.importorskip("torch")
    step, steps = 0.5, 9
    model = compiled(HEATER, step, steps)
    actions = np.random.default_rng(3).uniform(-5, 5, (2, steps, 1))
    u = torch.tensor(actions, requires_grad=True)
    theta = torch.tensor(2.3, dtype=torch.float64, requires_grad=True)
    x = torch.tensor([1.0], dtype=torch.float64, requires_grad=True)
    found = smpl.torch.rollout(model, x, u, {"theta": theta})
    assert found.states.shape == (2, steps + 1, 1)
    found.states[:, -1, 0].sum().backward()
    ends = [step * steps]
    parts = [by_complex_step(lambda z: heater(z, steps, step, ends), [1, 2.3, 1.7, *one[:, 0]])[0] for one in actions]
    assert u.grad[..., 0].numpy() == pytest.approx(np.array(parts)[:, 3:], abs=1e-5)
    assert float(theta.grad) == pytest.approx(sum(part[1] for part in parts), abs=1e-4)
    assert float(x.grad[0]) == pytest.approx(sum(part[0] for part in parts), abs=1e-5)
    with pytest.raises(ValueError, match="policy"):
        smpl.torch.rollout(model, x, lambda x, t: x, steps=3)


def test_jax_differentiates_a_rollout_with_dead_times():
    jax = pytest.importorskip("jax")
    step, steps = 0.5, 7
    model = compiled(HEATER, step, steps)
    actions = np.random.default_rng(4).uniform(-5, 5, (steps, 1))
    with jax.enable_x64(True) if hasattr(jax, "enable_x64") else jax.experimental.enable_x64():

        def last(u, theta):
            return smpl.jax.rollout(model, np.array([1.0]), u, {"theta": theta}).states[-1, 0]

        by_u, by_theta = jax.grad(last, (0, 1))(jax.numpy.array(actions), jax.numpy.array(2.3))
    exact = by_complex_step(lambda z: heater(z, steps, step, [step * steps]), [1, 2.3, 1.7, *actions[:, 0]])[0]
    assert np.asarray(by_u)[:, 0] == pytest.approx(exact[3:], abs=1e-5)
    assert float(by_theta) == pytest.approx(exact[1], abs=1e-4)


def test_jumps_under_a_dead_time_that_changes_within_steps_are_refused_by_name():
    source = """
    model Varying
    time t : s
    action u = 0 in -9..9
    state z = 0.5
    state y = 1
    var theta : s in 0.5..2
    eq theta = 1 [s] + 0.2*z*1 [s]
    eq d/dt z = -z / 2 [s]
    eq d/dt y = -delay(u, theta) / 1 [s]
    """
    model = compiled(source, 0.3, 9, "s")
    with pytest.raises(smpl.SimulationError, match=r"delay\(u, theta\).*jumps"):
        model.linearize_rollout([0.5, 1.0], np.ones((9, 1)))


READ_AT_THE_START = """
model Start
time t : s
param p = 1.5
state T = 60 in 0..1000
discrete v = 20 in 0..1000
eq d/dt T = (v - T) / 8 [s]
observe T
solver { rtol = 1e-9 }
"""


@pytest.mark.parametrize(
    ("update", "by_state", "by_parameter"),
    [
        # With E = exp(-5/8) the step gives T E + v (1 - E), v being the value before the start.
        ("at start { next v = delay(p*T, 7 [s]) }", 1.5, 60.0),
        ("at start { next v = delay(T, 7 [s], before = p*1) }", 0.0, 1.0),
        ("at every 5 [s] { next v = p*delay(T, 7 [s]) }", 1.5, 60.0),
    ],
)
def test_updates_at_the_first_instant_read_the_derivatives_of_delayed_values(update, by_state, by_parameter):
    model = compiled(READ_AT_THE_START + update, 5.0, 9, "s")
    found = model.linearize_step([60.0], [], by=("state",), parameters=("p",))
    decay = math.exp(-5 / 8)
    assert found.dx_dx == pytest.approx(decay + by_state * (1 - decay), rel=1e-7)
    assert found.dx_dp == pytest.approx(by_parameter * (1 - decay), rel=1e-7)
    steps = model.linearize_rollout([60.0], np.zeros((3, 0)), by=("state",), parameters=("p",))
    moved = [model.rollout([60.0 + h], np.zeros((3, 0))).states.ravel()[1:] for h in (-0.01, 0.01)]
    assert np.ravel(steps.dx_dx) == pytest.approx((moved[1] - moved[0]) / 0.02, rel=1e-6, abs=1e-7)


CONTACT = """
model Contact "two vessels of one pressure, and a draw from the second one that follows its content"
time t : s
param theta : s = 1.31
action F : mol/s = 1 in 0..10
state n1 : mol = 1
state n2 : mol = 2
var w : mol/s
eq d/dt n1 = F - w - 0.3 [1/s]*n1
eq d/dt n2 = w - 0.05 [1/s]*delay(n2, theta)
eq n1 = n2/2
observe n1 in -100..100, w in -100..100
solver { rtol = 1e-9 }
"""


def contact(theta: float, actions: np.ndarray, step: float) -> np.ndarray:
    """The first amount and the flow after each step: 3 n1' = F - 0.3 n1 - 0.1 n1(t - theta)."""
    end = step * len(actions)
    breaks = {i * theta + j * step for i in range(math.ceil(end / theta) + 1) for j in range(len(actions) + 1)}
    times = [0.0, *sorted(time for time in breaks if 1e-9 < time < end + 1e-9)]
    pieces: list[tuple[float, Callable]] = []

    def past(time: float) -> float:
        known = [piece for begin, piece in pieces if begin <= time]
        return known[-1](time)[0] if known and time > 0 else 1.0

    found, n1 = [], 1.0
    for begin, until in itertools.pairwise(times):
        feed = actions[int((begin + until) / 2 / step), 0]

        def rate(t, y, feed=feed):
            return (feed - 0.3 * y - 0.1 * past(t - theta)) / 3

        piece = solve_ivp(rate, (begin, until), [n1], "DOP853", rtol=1e-12, atol=1e-13, dense_output=True)
        pieces.append((begin, piece.sol))
        n1 = piece.y[0, -1]
        if min(until % step, step - until % step) < 1e-9:
            delayed = past(until - theta)
            found.append([n1, 2 * (feed - 0.3 * n1 - 0.1 * delayed) / 3 + 0.1 * delayed])
    return np.array(found)


@pytest.mark.parametrize("method", ["ida", "rosenbrock", "auto"])
@pytest.mark.parametrize(("step", "steps"), [(0.5, 12), (2.2, 3)])
def test_a_delayed_unknown_of_a_constraint_has_derivatives_by_its_dead_time(method, step, steps):
    model = compiled(CONTACT, step, steps, "s")
    actions = np.random.default_rng(3).uniform(0, 4, (steps, 1))
    found = model.linearize_rollout([1.0], actions, parameters=["theta"], method=method)
    width = 1e-4
    exact = (contact(1.31 + width, actions, step) - contact(1.31 - width, actions, step)) / (2 * width)
    assert found.states[:, 0] == pytest.approx(contact(1.31, actions, step)[:, 0], abs=1e-6)
    assert found.dx_dp[:, 0, 0] == pytest.approx(exact[:, 0], abs=1e-5)
    assert found.dy_dp[:, :, 0] == pytest.approx(exact, abs=1e-4)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("theta", [3, 7, 7.3, 8])
@pytest.mark.parametrize("step", [5, 7.3, 15])
def test_samples_of_a_delayed_state_have_derivatives_whatever_the_steps(method, theta, step):
    """u follows h - theta s ago every 5 s; both are linear in the start of h, by which differences are exact."""
    source = f"""
model Sampled
time t : s
state h = 1 in -100..100
discrete u = 1
eq d/dt h = (u - h)/10 [s]
at every 5 [s] {{ next u = 1.5 - 0.5*delay(h, {theta} [s]) }}
observe h
solver {{ rtol = 1e-9 }}
episode {{ step = {step} [s], max_steps = 80 }}
"""
    model = smpl.compile(source=source)
    actions = np.zeros((12, 0))
    found = model.linearize_rollout([2.0], actions, method=method).dx_dx[:, 0, 0]
    low, high = (model.rollout([start], actions, method=method).states[0, 1:, 0] for start in (1.0, 3.0))
    assert found == pytest.approx((high - low) / 2, abs=1e-7)
    assert max(abs(found)) > 1e-2
