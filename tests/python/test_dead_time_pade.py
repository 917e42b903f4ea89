"""Padé approximations of dead times, against transfer functions and SciPy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lsim

import smpl
from smpl.controllers import LQR, NMPC, ExtendedKalmanFilter
from smpl.evaluation import run_episode

HEATER = """
model Heater
time t : min
param  theta : min = 2.3
param  T_c   : min = 1.7
action u : K = 1 in -20..20
state  T : K = 1 in -50..50
eq d/dt T = (delay(u, theta) - T) / T_c
observe T
reward r default = -sq(T / 1 [K])
solver { rtol = 1e-9 }
episode { step = 0.5 [min], max_steps = 60 }
"""


def polynomials(order: int, theta: float) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator of the approximation of exp(-theta s), highest power first."""
    factorial = math.factorial
    c = [
        factorial(order) * factorial(2 * order - k) / (factorial(2 * order) * factorial(k) * factorial(order - k))
        for k in range(order + 1)
    ]
    powers = [c[k] * theta**k for k in range(order + 1)]
    return np.array([(-1) ** k * p for k, p in enumerate(powers)])[::-1], np.array(powers)[::-1]


@pytest.mark.parametrize("order", [1, 2, 3, 5])
def test_a_linearisation_with_padé_approximations_has_their_transfer_function(order):
    model = smpl.compile(source=HEATER)
    A, B, C, D = model.linearize([1.0], [1.0], pade=order)
    assert A.shape == (1 + order, 1 + order)
    above, below = polynomials(order, 2.3)
    for s in (0.1, 1.3j, 0.4 + 2j):
        found = C @ np.linalg.solve(s * np.eye(1 + order) - A, B) + D
        assert found[0, 0] == pytest.approx(np.polyval(above, s) / np.polyval(below, s) / (1.7 * s + 1), rel=1e-10)
    slow = 0.2j
    found = (C @ np.linalg.solve(slow * np.eye(1 + order) - A, B))[0, 0]
    assert found == pytest.approx(np.exp(-slow * 2.3) / (1.7 * slow + 1), abs=1e-2 if order == 1 else 1e-4)


def test_a_linearisation_without_an_order_is_refused_by_the_call():
    with pytest.raises(smpl.SimulationError, match=r"delay\(u, theta\).*pade"):
        smpl.compile(source=HEATER).linearize([1.0], [1.0])
    with pytest.raises(ValueError, match="pade"):
        smpl.compile(source=HEATER).with_pade(6)


@pytest.mark.parametrize("method", ["ida", "rosenbrock", "explicit", "auto"])
def test_a_model_with_padé_approximations_runs_as_their_transfer_function(method):
    model = smpl.compile(source=HEATER, settings={"pade": 3})
    actions = np.where(np.arange(20) % 7 < 3, 4.0, -2.0)[:, None]
    start = model.rollout(model.steady_state([1.0])[:4], actions, method=method).states[0, :, 0]
    above, below = polynomials(3, 2.3)
    times = np.arange(0, 10.0001, 0.005)
    # Deviations from rest at an action of 1; of SciPy's linear interpolation the steps are short.
    u = actions[np.minimum((times + 1e-9) // 0.5, 19).astype(int), 0] - 1.0
    _, y, _ = lsim((above, np.polymul(below, [1.7, 1.0])), u, times, interp=False)
    assert start == pytest.approx(1.0 + y[::100], abs=1e-6)


def test_every_element_of_a_loop_and_nested_delays_have_their_own_approximation():
    source = """
    model Loop
    time t : s
    param theta[i in 1..3] : s = 0.5*i
    action u = 2 in -9..9
    state x[i in 1..3] = 2 in -9..9
    state y = 2 in -9..9
    eq d/dt x[i] = (delay(u, theta[i]) - x[i]) / 1 [s] for i in 1..3
    eq d/dt y = (delay(delay(x[1], 1 [s], before = 2), 2 [s], before = 2) - y) / 1 [s]
    observe x, y
    episode { step = 1 [s], max_steps = 9 }
    """
    model = smpl.compile(source=source)
    y = model.steady_state([2.0])
    A, B, C, _ = model.linearize(y, [2.0], pade=4)
    s = 0.3j
    found = (C @ np.linalg.solve(s * np.eye(len(A)) - A, B))[:, 0]
    lag = 1 / (s + 1)
    expected = [np.exp(-s * theta) * lag for theta in (0.5, 1, 1.5)] + [np.exp(-s * (0.5 + 1 + 2)) * lag**2]
    assert found == pytest.approx(np.array(expected), abs=1e-5)


SPECIES = """
model Species
time t : s
set g = { A, N }
domain z in 0..1 [m] cells 4
state c[i in g, z] = 1
state y = 1
eq d/dt c[i, z] = -c[i, z]*1 [1/s] for i in g, z
eq d/dt y = -delay(y, 2 [s])*1 [1/s]
observe y in -9..9
solver { rtol = 1e-10 }
episode { step = 1 [s], max_steps = 30 }
"""


def delayed_decay(order: int) -> np.ndarray:
    """Roots of s + N(s)/D(s) for y' = -y(t - 2) with an approximation N/D of exp(-2 s), by NumPy."""
    above, below = polynomials(order, 2.0)
    return np.roots(np.polyadd(np.polymul(below, [1.0, 0.0]), above))


def by_size(values) -> np.ndarray:
    return np.array(sorted(values, key=lambda value: (round(value.real, 6), value.imag)))


@pytest.mark.parametrize("order", [1, 2, 4])
def test_approximations_keep_their_states_next_to_a_state_over_a_set_and_cells(order):
    names = [f"delayed_1_pade[{i + 1}]" if order > 1 else "delayed_1_pade" for i in range(order)]
    model = smpl.compile(source=SPECIES, settings={"pade": order})
    assert list(model.state_names) == [f"c[{i},{z}]" for z in (1, 2, 3, 4) for i in "AN"] + ["y", *names]
    A, *_ = model.linearize([0.0] * (9 + order), [])
    expected = [*delayed_decay(order), *[-1.0] * 8]
    assert by_size(np.linalg.eigvals(A)) == pytest.approx(by_size(expected), abs=1e-7)
    same, *_ = smpl.compile(source=SPECIES).linearize([0.0] * 9, [], pade=order)
    assert same == pytest.approx(A, abs=1e-14)
    for target in ("c", "jax"):
        assert smpl.export.text(model, target)


def test_a_delayed_state_over_a_set_and_cells_has_an_approximation_for_each_element():
    source = SPECIES.replace("-delay(y, 2 [s])", "-y").replace("-c[i, z]", "-delay(c[i, z], 2 [s])")
    model = smpl.compile(source=source, settings={"pade": 2})
    assert len(model.state_names) == 9 + 16
    assert len(set(model.state_names)) == 25
    A, *_ = model.linearize([0.0] * 25, [])
    expected = [*np.repeat(delayed_decay(2), 8), -1.0]
    assert by_size(np.linalg.eigvals(A)) == pytest.approx(by_size(expected), abs=1e-6)


@pytest.mark.parametrize("method", ["ida", "rosenbrock", "explicit", "auto"])
def test_a_step_from_the_state_of_an_episode_continues_its_approximations(method):
    model = smpl.compile(source=SPECIES, settings={"pade": 2})
    env = smpl.Env(model, normalize=False, method=method)
    env.reset(seed=0)
    # d = z2 + y, z1' = -d + y, z2' = 3 (z1 - d - y), y' = -d: constants of order 2, dead time 2; at rest (2, 0).
    matrix = np.array([[-1.0, 0.0, -1.0], [0.0, 0.0, -1.0], [-6.0, 3.0, -3.0]])
    state = np.array([1.0, 2.0, 0.0])
    for _ in range(5):
        state = expm(matrix) @ state
        stepped = model.step(env.state, [], method=method)
        env.step([])
        assert env.state[8:] == pytest.approx(state, abs=1e-6)
        assert stepped == pytest.approx(env.state, abs=1e-6)


def test_exports_take_a_padé_approximation_on_request():
    model = smpl.compile(source=HEATER)
    approximate = model.with_pade(2)
    assert approximate.state_names == ("T", "delayed_1_pade[1]", "delayed_1_pade[2]")
    for target in ("c", "jax", "casadi"):
        with pytest.raises((ValueError, smpl.SimulationError), match="pade=2"):
            smpl.export.text(model, target)
        assert smpl.export.text(approximate, target)
    pytest.importorskip("casadi")
    x = np.array([3.0, 1.5, 0.4])
    found = np.array(smpl.export.casadi(approximate).rhs(x, [2.0])).ravel()
    assert found == pytest.approx(approximate.rhs(0.0, x, [2.0]), rel=1e-12)
    # d = z2 + u, theta z1' = 2 (u - d), theta z2' = 6 (z1 - d - u): 2 and 6 are quotients of 12, 6 and 1.
    delayed = 0.4 + 2.0
    rates = [(delayed - 3.0) / 1.7, 2 * (2.0 - delayed) / 2.3, 6 * (1.5 - delayed - 2.0) / 2.3]
    assert found == pytest.approx(rates, rel=1e-12)


def test_an_approximation_whose_start_is_not_known_is_refused_by_the_call():
    source = """
    model Algebraic
    time t : s
    state x = 1
    var z
    eq z*z*z + z = x
    eq d/dt x = -delay(z, 1 [s]) / 1 [s]
    episode { step = 1 [s], max_steps = 9 }
    """
    with pytest.raises(smpl.CompileError, match=r"delay\(z, 1\)"):
        smpl.compile(source=source, settings={"pade": 2})
    before = source.replace("1 [s])", "1 [s], before = 0.68)")
    assert smpl.compile(source=before, settings={"pade": 2}).state_names[1:] == (
        "delayed_1_pade[1]",
        "delayed_1_pade[2]",
    )


def test_a_regulator_of_a_process_with_dead_time_counts_on_what_is_under_way():
    source = HEATER.replace("= (delay(u, theta) - T) / T_c", "= delay(u, theta) / T_c").replace(
        "K = 1 in -20", "K = 0 in -20"
    )
    model = smpl.compile(source=source)
    env = smpl.Env(model, normalize=False)
    controller = LQR(model, {"T": 1.0}, {"u": 0.1}, at=([0.0], [0.0]))
    assert (np.abs(controller.eigenvalues) < 1).all()
    episode = run_episode(env, controller, seed=0, options={"state": {"T": 5.0}})
    assert abs(episode.states[-1][0]) < 0.05
    # Without the dead time the same weights do not stabilise it.
    deaf = LQR(smpl.compile(source=source.replace("delay(u, theta)", "u")), {"T": 1.0}, {"u": 0.1}, at=([0.0], [0.0]))
    states, x = [], env
    x.reset(seed=0, options={"state": {"T": 5.0}})
    for _ in range(60):
        x.step(np.clip(-deaf.gain[0] * x.state, -20, 20))
        states.append(abs(float(x.state[0])))
    assert max(states[-10:]) > 1.0


def test_a_filter_and_a_predictive_controller_estimate_the_states_of_an_approximation():
    source = HEATER.replace("observe T", "observe T noise normal(0, 0.01 [K])").replace(
        "-sq(T / 1 [K])", "-sq((T - 3 [K]) / 1 [K])"
    )
    model = smpl.compile(source=source)
    approximate = model.with_pade(3)
    env, estimator = smpl.Env(model, normalize=False), ExtendedKalmanFilter(approximate)
    env.reset(seed=0)
    estimator.reset(env)
    for _ in range(30):
        env.step(np.array([3.0]))
        estimate = estimator.update(env)
    # At rest the states are twice the delayed value, 0 and twice it.
    assert estimate == pytest.approx([3.0, 6.0, 0.0, 6.0], abs=0.05)
    pytest.importorskip("casadi")
    controller = NMPC(approximate, horizon=15, rate_weight={"u": 1.0}, estimator=estimator)
    episode = run_episode(env, controller, seed=0)
    assert episode.states[-1][0] == pytest.approx(3.0, abs=0.3)
