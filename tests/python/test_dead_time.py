"""Dead times, `delay(e, theta)`, against closed forms and the method of steps with SciPy at a tolerance of 1e-12."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

import smpl
from smpl.controllers import OpenLoop
from smpl.evaluation import run_episode

METHODS = ("ida", "rosenbrock", "explicit", "auto")

DECAY = """
model Decay
time t : s
param tau : s = 1
state y = 1
eq d/dt y = -delay(y, tau) / 1 [s]
solver { rtol = 1e-9 }
"""
# Its dead times, ends and values there: sums over k of (-1)^k (t - (k - 1) tau)^k / k!.
PUBLISHED = [
    (1.0, 5.0, 0.158333333333),
    (0.1, 2.0, 0.107540393546),
    (0.01, 2.0, 0.132621765180),
    (0.001, 2.0, 0.135064544957),
]


def compiled(source: str, interval: float, steps: int) -> smpl.Model:
    return smpl.compile(source=source + f"\nepisode {{ step = {interval!r} [s], max_steps = {steps} }}\n")


def final(source: str, end: float, steps: int, method: str, actions=None, **reset) -> np.ndarray:
    """The state at the end of an episode of so many equal control steps."""
    model = compiled(source, end / steps, steps)
    env = smpl.Env(model, normalize=False, method=method)
    env.reset(seed=0, options=reset or None)
    for k in range(steps):
        _, _, _, _, info = env.step(np.zeros(0) if actions is None else np.atleast_1d(actions(k)))
        assert not info["failure"], info["failure"]
    return env.state


def by_steps(rates: Callable, before: Callable, lag: float, end: float) -> Callable:
    """The solution of y' = rates(t, y, y(t - lag)) by the method of steps."""
    pieces: list[tuple[float, Callable]] = []

    def past(t: float) -> np.ndarray:
        if t <= 0:
            return np.atleast_1d(before(t))
        number = min(int(t / lag - 1e-12), len(pieces) - 1)
        return pieces[number][1](t)

    y = np.atleast_1d(before(0.0)).astype(float)
    for number in range(math.ceil(end / lag - 1e-9)):
        span = (number * lag, min(end, (number + 1) * lag))
        found = solve_ivp(
            lambda t, y: rates(t, y, past(t - lag)), span, y, "DOP853", rtol=1e-12, atol=1e-14, dense_output=True
        )
        pieces.append((span[0], found.sol))
        y = found.y[:, -1]
    return lambda t: past(t) if t <= 0 else pieces[min(int(t / lag - 1e-12), len(pieces) - 1)][1](t)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("steps", [1, 7, 40])
@pytest.mark.parametrize(("tau", "end", "expected"), PUBLISHED)
def test_a_delayed_decay_has_the_published_values_for_any_step(method, steps, tau, end, expected):
    found = final(DECAY, end, steps, method, parameters={"tau": tau})
    assert found[0] == pytest.approx(expected, rel=2e-7 if method == "ida" else 2e-8)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("steps", [1, 10, 33])
def test_a_delayed_jump_is_a_break(method, steps):
    source = """
    model Jump
    time t : s
    state z = 0
    var x
    var y in -2..2
    eq x = if t < 0.5 [s] then 1 else t / 1 [s]
    eq y = delay(x, 0.1 [s])
    eq d/dt z = y / 1 [s]
    observe y
    solver { rtol = 1e-9 }
    """
    # 0.6 until the jump, then the integral of t - 0.1.
    assert final(source, 1.0, steps, method)[0] == pytest.approx(0.88, abs=5e-8)
    if steps == 10:
        env = smpl.Env(compiled(source, 0.1, 10), normalize=False, method=method)
        env.reset(seed=0)
        seen = [env.step(np.zeros(0))[0][0] for _ in range(10)]
        assert seen == pytest.approx([1] * 5 + [0.5, 0.6, 0.7, 0.8, 0.9], abs=1e-12)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("steps", [1, 30])
def test_mackey_glass_agrees_with_the_method_of_steps(method, steps):
    source = """
    model MackeyGlass
    time t : s
    state y = 0.5
    eq d/dt y = (0.2*delay(y, 17 [s])/(1 + delay(y, 17 [s])^10) - 0.1*y) / 1 [s]
    solver { rtol = 1e-9 }
    """
    expected = by_steps(lambda _, y, z: 0.2 * z / (1 + z**10) - 0.1 * y, lambda _: 0.5, 17.0, 120.0)(120.0)
    assert final(source, 120.0, steps, method) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("steps", [1, 25])
def test_hutchinson_agrees_with_the_method_of_steps(method, steps):
    source = """
    model Hutchinson
    time t : s
    state y = 0.1
    eq d/dt y = 1.8*y*(1 - delay(y, 1 [s])) / 1 [s]
    solver { rtol = 1e-9 }
    """
    expected = by_steps(lambda _, y, z: 1.8 * y * (1 - z), lambda _: 0.1, 1.0, 20.0)(20.0)
    assert final(source, 20.0, steps, method) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("method", METHODS)
def test_marchuk_s_model_of_an_infection_agrees_with_the_method_of_steps(method):
    source = """
    model Marchuk
    time t : s
    state V = 1e-6 scale 1e-3
    state C = 1
    state F = 1
    state m = 0
    let xi = if m <= 0.1 then 1 else (1 - m)*10/9
    eq d/dt V = (2 - 0.8*F)*V / 1 [s]
    eq d/dt C = (xi*1e4*delay(F*V, 0.5 [s], before = max(0, 1e-6 + t / 1 [s])) - 0.5*(C - 1)) / 1 [s]
    eq d/dt F = (0.17*(C - F) - 8*F*V) / 1 [s]
    eq d/dt m = (10*V - 0.12*m) / 1 [s]
    solver { rtol = 1e-9 }
    """

    def rates(_, y, z):
        v, c, f, m = y
        xi = 1 if m <= 0.1 else (1 - m) * 10 / 9
        return [
            (2 - 0.8 * f) * v,
            xi * 1e4 * z[2] * z[0] - 0.5 * (c - 1),
            0.17 * (c - f) - 8 * f * v,
            10 * v - 0.12 * m,
        ]

    before = lambda t: [max(0.0, 1e-6 + t), 1.0, 1.0, 0.0]  # noqa: E731
    expected = by_steps(rates, before, 0.5, 30.0)(30.0)
    assert final(source, 30.0, 6, method) == pytest.approx(expected, rel=1e-4, abs=1e-9)


def repeated_lag(a: int, b: int, t: float, lag: float) -> float:
    """The inverse transform of 1/(s^a (lag s + 1)^b)."""
    if b == 0:
        return t ** (a - 1) / math.factorial(a - 1)
    if a == 0:
        return t ** (b - 1) * math.exp(-t / lag) / (lag**b * math.factorial(b - 1))
    return repeated_lag(a, b - 1, t, lag) - lag * repeated_lag(a - 1, b, t, lag)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("steps", [1, 12])
def test_a_second_order_process_with_dead_time_under_pi_control_follows_its_step_response(method, steps):
    source = """
    model Loop
    time t : s
    state a = 0
    state y = 0
    state I : s = 0
    var u
    eq u = 1.5*((1 - y) + I / 3 [s])
    eq d/dt a = (delay(u, 0.8 [s], before = 0) - a) / 3 [s]
    eq d/dt y = (a - y) / 1 [s]
    eq d/dt I = 1 - y
    solver { rtol = 1e-9 }
    """
    # The integral time cancels the longer lag: L = k exp(-0.8 s)/(s (s + 1)), and y is a sum of its powers.
    end, k = 6.0, 1.5 / 3
    terms = [(-1) ** (n + 1) * k**n * repeated_lag(n + 1, n, end - 0.8 * n, 1.0) for n in range(1, 10) if end > 0.8 * n]
    assert final(source, end, steps, method)[1] == pytest.approx(sum(terms), rel=1e-6)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("theta", [0.25, 0.2, 0.03])
def test_actions_are_the_steps_that_they_are(method, theta):
    source = f"""
    model Lag
    time t : s
    action u = 0 in -10..10
    state y = 0
    eq d/dt y = (delay(u, {theta} [s]) - y) / 1 [s]
    solver {{ rtol = 1e-9 }}
    """
    values = np.random.default_rng(3).uniform(-1, 1, 12)
    found = final(source, 1.2, 12, method, actions=lambda k: values[k])
    expected = 0.0
    edges = sorted({0.0, 1.2, *(theta + 0.1 * k for k in range(12) if theta + 0.1 * k < 1.2)})
    for low, high in itertools.pairwise(edges):
        number = math.floor((0.5 * (low + high) - theta) / 0.1)
        u = values[number] if number >= 0 else 0.0
        expected = u + (expected - u) * math.exp(low - high)
    assert found[0] == pytest.approx(expected, rel=1e-6, abs=1e-9)


ARRAY = """
model Array
time t : s
set z = 1..20
param k[z] : 1/s = 0.1
action u = 0 in -1..1
state T[z] = 1
state mean = 0
eq d/dt T[z] = -k[z]*z*delay(T[z], 0.3 [s]) + delay(u, 0.25 [s]) / 1 [s] for z in 1..20
eq d/dt mean = sum(delay(T[i], 0.1 [s]) for i in 1..20) / 20 [s]
observe mean in -100..100, late = delay(T[7], 0.5 [s]) in -100..100
reward r default = -delay(mean, 0.2 [s])
solver { rtol = 1e-8 }
"""


@pytest.mark.parametrize("method", METHODS)
def test_a_loop_of_delays_is_one_loop_and_agrees_with_single_ones(method):
    action = lambda k: math.sin(k)  # noqa: E731
    found = final(ARRAY, 2.0, 20, method, actions=action)
    single = """
    model Single
    time t : s
    param k : 1/s = 0.1
    action u = 0 in -1..1
    state T = 1
    eq d/dt T = -k*delay(T, 0.3 [s]) + delay(u, 0.25 [s]) / 1 [s]
    solver { rtol = 1e-8 }
    """
    for number in (1, 7, 20):
        alone = final(single, 2.0, 20, method, actions=action, parameters={"k": 0.1 * number})
        assert found[number - 1] == pytest.approx(alone[0], rel=1e-5)


@pytest.mark.parametrize("method", METHODS)
def test_snapshots_and_copies_go_on_with_the_same_bits(method):
    env = smpl.Env(compiled(ARRAY, 0.1, 40), normalize=False, method=method)
    env.reset(seed=1)
    actions = np.random.default_rng(0).uniform(-1, 1, (20, 1))
    for action in actions[:9]:
        env.step(action)
    point = env.snapshot()
    first = [env.step(action)[:2] for action in actions[9:]]
    env.reset(seed=5)
    env.restore(point)
    second = [env.step(action)[:2] for action in actions[9:]]
    for (a, r), (b, s) in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)
        assert r == s


def test_batches_and_rollouts_agree_with_single_environments_bit_for_bit():
    model = compiled(ARRAY, 0.1, 40)
    actions = np.random.default_rng(0).uniform(-1, 1, (15, 1))
    single = smpl.Env(model, normalize=False)
    single.reset(seed=0)
    start = single.state.copy()
    batch = smpl.VectorEnv(model, 3, normalize=False, num_threads=2)
    batch.reset(seed=0)
    states = [start]
    for action in actions:
        observed = single.step(action)[0]
        np.testing.assert_array_equal(batch.step(np.tile(action, (3, 1)))[0][0], observed)
        states.append(single.state.copy())
    rollout = model.rollout(start, actions)
    np.testing.assert_array_equal(rollout.states[0], states)
    np.testing.assert_array_equal(model.step(start, actions[0]), states[1])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("steps", [1, 9])
def test_events_on_delayed_values_are_located(method, steps):
    source = """
    model Event
    time t : s
    state x = 0
    discrete hit : s = 0
    discrete hits = 0
    eq d/dt x = cos(t / 1 [s]) / 1 [s]
    event late when delay(x, 0.3 [s]) > 0.9
    at late { next hit = t ; next hits = hits + 1 }
    solver { rtol = 1e-9 }
    """
    model = compiled(source, 3.0 / steps, steps)
    env = smpl.Env(model, normalize=False, method=method)
    env.reset(seed=0)
    for _ in range(steps):
        env.step(np.zeros(0))
    found = dict(zip(env.discrete_names, env.discrete, strict=True))
    assert found["hits"] == 1
    assert found["hit"] == pytest.approx(math.asin(0.9) + 0.3, abs=1e-6)


@pytest.mark.parametrize("method", ["ida", "rosenbrock", "auto"])
@pytest.mark.parametrize("steps", [1, 20])
def test_algebraic_variables_are_delayed_as_they_were(method, steps):
    source = """
    model Algebraic
    time t : s
    state x = 1
    state y = 0
    var a = 0.6 in 0..5
    eq a^3 + a = x
    eq d/dt x = 1 / 1 [s]
    eq d/dt y = delay(a, 0.4 [s]) / 1 [s]
    solver { rtol = 1e-8 }
    """

    def solved(x: float) -> float:
        return brentq(lambda a: a**3 + a - x, 0, 5, xtol=1e-14)

    expected = 0.4 * solved(1.0) + quad(lambda s: solved(1 + s), 0, 1.6)[0]
    assert final(source, 2.0, steps, method)[1] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("steps", [1, 20])
def test_a_dead_time_that_an_event_changes_is_taken_from_then_on(method, steps):
    source = """
    model Held
    time t : s
    discrete th : s = 0.5 in 0.1..2
    state x = 0
    state y = 0
    eq d/dt x = 1 / 1 [s]
    eq d/dt y = delay(x, th) / 1 [s]
    event later when x > 1
    at later { next th = 0.8 }
    solver { rtol = 1e-9 }
    """
    # The integrals of t - 0.5 from 0.5 to 1, and of t - 0.8 from 1 to 2.
    assert final(source, 2.0, steps, method)[1] == pytest.approx(0.125 + 0.5 * (1.2**2 - 0.2**2), rel=1e-7)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("steps", [1, 30])
def test_rates_are_delayed(method, steps):
    source = """
    model Neutral
    time t : s
    state y = 1
    eq d/dt y = -y / 1 [s] + 0.5*delay(der(y), 1 [s], before = 0)
    solver { rtol = 1e-9 }
    """
    # After t = 1 the solution of y' = -y - exp(1 - t)/2.
    assert final(source, 1.5, steps, method)[0] == pytest.approx(math.exp(-0.5) * (math.exp(-1) - 0.25), rel=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_updates_observations_and_rewards_read_delayed_values(method):
    source = """
    model Instants
    time t : s
    state x = 0
    discrete d = 0
    eq d/dt x = 1 / 1 [s]
    at end { next d = delay(x, 0.25 [s]) }
    observe d in -10..10, z = delay(x^2, 0.3 [s]) in -10..10
    reward r default = integral(delay(x, 0.35 [s])) / 1 [s]
    solver { rtol = 1e-9 }
    """
    env = smpl.Env(compiled(source, 0.2, 10), normalize=False, method=method)
    env.reset(seed=0)
    steps = [env.step(np.zeros(0)) for _ in range(10)]
    assert steps[-1][0] == pytest.approx([1.75, 1.7**2], rel=1e-7)
    assert sum(step[1] for step in steps) == pytest.approx(1.65**2 / 2, rel=1e-7)


@pytest.mark.parametrize("method", METHODS)
def test_nested_delays_and_algebraic_variables_are_delayed(method):
    source = """
    model Nested
    time t : s
    state x = 0
    state y = 0
    state w = 0
    var a = 1
    eq a^3 + a = x
    eq d/dt x = 1 / 1 [s]
    eq d/dt y = delay(delay(x, 0.4 [s]), 0.3 [s]) / 1 [s]
    eq d/dt w = delay(x^2, 0.5 [s]) / 1 [s]
    solver { rtol = 1e-9 }
    """
    if method == "explicit":
        source = source.replace("    var a = 1\n    eq a^3 + a = x\n", "")
    found = final(source, 2.0, 3, method)
    assert found[1] == pytest.approx(1.3**2 / 2, rel=1e-7)
    assert found[2] == pytest.approx(1.5**3 / 3, rel=1e-7)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("steps", [1, 8])
def test_a_dead_time_that_changes_with_time_and_state_is_followed(method, steps):
    source = """
    model Varying
    time t : s
    state x = 1
    var theta : s in 0.1..2
    eq theta = (0.6 + 0.3*sin(t / 1 [s]) + 0.1*x) as [s]
    eq d/dt x = -delay(x, theta) / 1 [s]
    solver { rtol = 1e-8 }
    """

    # Runge-Kutta steps of fixed length, with cubic interpolation of what was: far below the tolerance compared to.
    n, end = 40_000, 4.0
    h = end / n
    grid, values, slopes = np.linspace(0, end, n + 1), np.empty(n + 1), np.empty(n + 1)

    def past(s: float) -> float:
        if s <= 0:
            return 1.0
        i = min(int(s / h), n - 1)
        u = s / h - i
        a, b, da, db = values[i], values[i + 1], h * slopes[i], h * slopes[i + 1]
        return a * (1 + 2 * u) * (1 - u) ** 2 + da * u * (1 - u) ** 2 + b * u * u * (3 - 2 * u) + db * u * u * (u - 1)

    def rate(t: float, x: float) -> float:
        return -past(t - (0.6 + 0.3 * math.sin(t) + 0.1 * x))

    values[0], slopes[0] = 1.0, rate(0.0, 1.0)
    for i in range(n):
        t, x = grid[i], values[i]
        k1 = rate(t, x)
        k2 = rate(t + h / 2, x + h / 2 * k1)
        k3 = rate(t + h / 2, x + h / 2 * k2)
        k4 = rate(t + h, x + h * k3)
        values[i + 1] = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        slopes[i + 1] = rate(t + h, values[i + 1])
    assert final(source, end, steps, method)[0] == pytest.approx(values[-1], abs=2e-6)


def test_at_rest_a_delayed_value_is_the_present_one():
    source = """
    model Rest
    time t : s
    action u = 2 in 0..5
    state x = 0.5
    state y = 0.5
    eq d/dt x = (u - x*delay(y, 2 [s])) / 1 [s]
    eq d/dt y = (delay(x, 1 [s]) - delay(delay(y, 1 [s]), 3 [s])) / 1 [s]
    """
    found = compiled(source, 1.0, 5).steady_state([2.0])
    state = np.asarray(getattr(found, "state", found))[:2]
    assert state == pytest.approx([math.sqrt(2)] * 2, rel=1e-9)


def test_the_smith_predictor_of_the_book_follows_its_closed_form():
    page = (Path(__file__).resolve().parents[2] / "docs/dead-time.md").read_text(encoding="utf-8")
    source = page.split('```eq title="smith.eq"\n')[1].split("```")[0]
    env = smpl.Env(smpl.compile(source=source), normalize=False)
    env.reset(seed=0)
    for k in range(12):
        observed = env.step(np.array([1.0]))[0]
        expected = 1 - math.exp(-2 * max(0, k + 1 - 4) / 5)
        assert observed[0] == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        ("delay(y, -1 [s])", "the dead time of `delay(y, ...)` is -1"),
        ("delay(y, th)", "has no bounds above zero"),
        ("delay(y > 1, 1 [s])", "`delay` of a condition"),
        ("delay(y)", "`delay` takes an expression and a dead time"),
        ("delay(y, 1 [m])", "the dead time of `delay`"),
        ("sin(y, before = 2)", "`before = ...` is not an argument of this function"),
    ],
)
def test_what_has_no_past_is_refused_by_name(call, message):
    source = f"""
    model Faulty
    time t : s
    state y = 1
    var th : s
    eq th = (1 + 0.1*y) as [s]
    eq d/dt y = -{call} / 1 [s]
    """
    with pytest.raises(smpl.CompileError) as found:
        compiled(source, 1.0, 5)
    assert message in str(found.value)


@pytest.mark.parametrize("tau", [0.0, -1.0])
def test_a_dead_time_of_a_parameter_that_is_not_positive_is_refused_at_the_reset(tau):
    env = smpl.Env(compiled(DECAY, 1.0, 5))
    with pytest.raises((ValueError, smpl.SimulationError), match="the dead time of `delay"):
        env.reset(seed=0, options={"parameters": {"tau": tau}})


def test_a_start_that_depends_on_itself_is_refused():
    source = """
    model Loop
    time t : s
    state x = 0
    var y
    eq y = delay(y, 1 [s]) + 1
    eq d/dt x = y / 1 [s]
    """
    with pytest.raises((ValueError, smpl.SimulationError), match="before the start depends on itself"):
        smpl.Env(compiled(source, 1.0, 5)).reset(seed=0)
    counted = final(source.replace("1 [s])", "1 [s], before = 0)"), 2.5, 1, "rosenbrock")
    assert counted[0] == pytest.approx(1 + 2 + 1.5, rel=1e-6)


def test_linearisation_names_the_delay():
    model = compiled(DECAY, 1.0, 5)
    with pytest.raises((ValueError, smpl.SimulationError), match=r"delay\(y, tau\)"):
        model.linearize([1.0], [])


def test_an_export_to_casadi_names_the_delay():
    pytest.importorskip("casadi", reason="casadi is not installed")
    with pytest.raises((ValueError, smpl.SimulationError), match=r"delay\(y, tau\)"):
        smpl.export.casadi(compiled(DECAY, 1.0, 5))


def test_a_rollout_from_the_present_point_takes_the_past_along():
    env = smpl.Env(compiled(ARRAY, 0.1, 40), normalize=False)
    env.reset(seed=1)
    actions = np.random.default_rng(0).uniform(-1, 1, (20, 1))
    for action in actions[:9]:
        env.step(action)
    found = env.rollout(actions[9:])
    for action in actions[9:]:
        env.step(action)
    np.testing.assert_array_equal(found.states[0, -1], env.state)


def test_estimators_name_the_delay():
    model = compiled(ARRAY, 0.1, 40)
    assert model.delays[0] == "delay(T[z], 0.3)"
    with pytest.raises(ValueError, match=r"delay\(T\[z\], 0.3\)"):
        smpl.controllers.ExtendedKalmanFilter(model)


def test_a_dead_time_is_fitted():
    source = """
    model Process
    time t : s
    param K = 1 in 0.1..5
    param theta : s = 0.6 in 0.1..2
    action u = 0 in -5..5
    state y = 0 in -20..20
    eq d/dt y = (K*delay(u, theta) - y) / 1 [s]
    observe y
    solver { rtol = 1e-9 }
    """
    model = compiled(source, 0.2, 60)
    actions = np.repeat(np.random.default_rng(2).uniform(-1, 1, 12), 5)[:, None]
    env = smpl.Env(model, normalize=False)
    episode = run_episode(env, OpenLoop(actions), 0, {"parameters": {"K": 2.0, "theta": 0.83}})
    found = smpl.fit(model, episode, ["K", "theta"])
    assert found.parameters == pytest.approx({"K": 2.0, "theta": 0.83}, rel=1e-4)


SAMPLED = """
model Sampled
time t : s
param theta : s = 1
state x = 0
discrete m = 0
discrete k = -1
let z = delay(m, theta)
eq d/dt x = 1 [1/s]
at every 1 [s] { next m = m + 1; next k = delay(m, theta) }
observe k in -9..99
observe z in -9..99
"""


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("step", (0.2, 0.3, 0.4, 0.6, 0.7, 0.8, 1.0, 2.5))
def test_a_jump_read_one_dead_time_later_has_the_new_value_on_any_grid(step, method):
    # m is floor(t) + 1 from each instant on, so that delay(m, theta) is floor(t - theta) + 1 there.
    count = round(12 / step)
    for theta in (1.0, 2.0, 3.0):
        env = smpl.Env(compiled(SAMPLED, step, count), normalize=False, method=method)
        env.reset(seed=0, options={"parameters": {"theta": theta}})
        for k in range(count):
            last = math.floor((k + 1) * step + 1e-9)
            # An instant at the end of a step belongs to the next one.
            seen = last - 1 if last >= (k + 1) * step - 1e-9 else last
            (by_update, present), *_ = env.step(np.zeros(0))
            if last > theta:
                assert present == last - theta + 1, (theta, (k + 1) * step)
            if seen > theta:
                assert by_update == seen - theta + 1, (theta, (k + 1) * step)


@pytest.mark.parametrize("method", METHODS)
def test_a_loop_with_sampled_delayed_values_does_not_depend_on_the_control_step(method):
    source = """
model Predictor
time t : s
param theta : s = 2
state x = 0
state z = 0
discrete u = 0 in -50..50
discrete p = 0
eq d/dt x = (delay(u, theta) - x)/5 [s]
eq d/dt z = (delay(u, theta) - z)/3 [s]
control u from x + p - z*0.1 setpoint (if t < 7.3 [s] then 5 else 2) gain 1.3 reset 4 [s] every 0.5 [s]
at every 0.5 [s] { next p = 0.9*p + 0.1*(u - delay(u, theta)) }
observe x in -99..99
solver { rtol = 1e-9 }
"""
    whole = final(source, 12.0, 1, method)[0]
    assert [final(source, 12.0, n, method)[0] for n in (12, 15, 20, 30, 40)] == pytest.approx([whole] * 5, rel=1e-7)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("delayed", ["delay(if z > 0.5 then -1 else 1, th)", "if delay(z, th) > 0.5 then -1 else 1"])
@pytest.mark.parametrize(
    ("th", "start", "end", "steps"),
    [(0.31, 0.2, 1.6, 1), (0.11, -0.3, 1.571, 1), (1.0, 0.2, 7.586, 2), (0.6, -0.3, 7.093, 5)],
)
def test_a_delayed_relay_follows_its_triangles(method, delayed, th, start, end, steps):
    # z passes the threshold always a dead time after a corner, so that steps end within a rounding of it.
    source = f"""
    model Relay
    time t : s
    param th : s = {th}
    state z = {start}
    eq d/dt z = ({delayed}) / 1 [s]
    """
    corner, slope, z, time = 0.5 - start + th, 1, start, 0.0
    while corner < end:
        z += slope * (corner - time)
        time, slope, corner = corner, -slope, corner + 2 * th
    expected = z + slope * (end - time)
    found = final(source, end, steps, method)[0]
    assert found == pytest.approx(expected, abs=1e-10 if method == "ida" else 1e-6)


@pytest.mark.parametrize(
    ("heating", "outflow"),
    [("delay(Q, 0.7 [s])", "m"), ("delay(2*delay(Q, 1 [s]) - Q, 0.7 [s])", "m"), ("Q", "delay(m, 2 [s])")],
)
def test_trims_find_actions_that_act_after_a_dead_time(heating, outflow):
    """At rest a delayed value is the present one: Q = 0.5*(320 - 290) - 5, and m = 16."""
    model = smpl.compile(
        source=f"""
time t : s
action Q : kW = 20 in 0..100
state T : K = 300
state m : kg = 5 in 0..100
eq 10 [kJ/K]*d/dt T = {heating} + 5 [kW] - 0.5 [kW/K]*(T - 290 [K])
eq d/dt m = 2 [kg/s] - 1 [kg/s]*sqrt({outflow}/4 [kg])
observe T in 0..1000
episode {{ step = 1 [s], max_steps = 3 }}
"""
    )
    y, u = model.trim({"T": 320.0}, ["Q"])
    assert u == pytest.approx([10], rel=1e-9)
    assert y == pytest.approx([320, 16], rel=1e-9)
