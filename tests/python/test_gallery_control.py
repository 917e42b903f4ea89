"""Control benchmarks of the gallery against published figures and SciPy.

The right-hand sides are written from the papers that the models name, in their own notation.
"""

import numpy as np
import pytest
from scipy.linalg import eigvals
from scipy.optimize import brentq, minimize

import smpl
from plants import difference, gains, moves, near, rest


def test_four_tanks_have_the_published_operating_points():
    """Johansson 2000: measured levels, gains and time constants of both phases."""
    for variants, levels, voltage, published, times in (
        ((), (12.4, 12.7, 1.8, 1.4), 3.0, [[2.6, 1.5], [1.4, 2.8]], [23, 30, 62, 90]),
        (("nonminimum_phase",), (12.6, 13.0, 4.8, 4.9), 3.15, [[1.5, 2.5], [2.5, 1.6]], [39, 56, 63, 91]),
    ):
        model = smpl.compile("four_tanks", variants=variants)
        action = np.full(2, voltage)
        np.testing.assert_allclose(model.steady_state(action)[:4], levels, atol=0.21)
        np.testing.assert_allclose(gains(model, action)[:2], published, atol=0.08)
        A = model.linearize(model.steady_state(action), action)[0]
        np.testing.assert_allclose(np.sort(-1 / np.linalg.eigvals(A).real), times, atol=1.1)


@pytest.mark.parametrize(("variants", "published"), [((), (-0.060, -0.018)), (("nonminimum_phase",), (-0.057, 0.013))])
def test_four_tanks_have_the_published_zeros(variants, published):
    model = smpl.compile("four_tanks", variants=variants)
    action = np.array(model.native.defaults("action")) if not variants else np.full(2, 3.15)
    A, B, C, D = model.linearize(model.steady_state(action), action)
    pencil = np.block([[A, B], [C[:2], D[:2]]])
    zeros = eigvals(pencil, np.diag([1.0] * 4 + [0.0] * 2))
    finite = np.sort(zeros[np.isfinite(zeros) & (np.abs(zeros) < 10)].real)
    np.testing.assert_allclose(finite, published, atol=1.5e-3)


def four_tanks(A, a, g, gamma, k):
    A, a, gamma, k = map(np.asarray, (A, a, gamma, k))

    def right_side(h, v):
        out = a * np.sqrt(2 * g * h)
        lower = gamma * k * v
        upper = ((1 - gamma) * k * v)[::-1]
        return (np.concatenate([lower, upper]) - out + np.array([out[2], out[3], 0, 0])) / A

    return right_side


@pytest.mark.parametrize(
    ("variants", "numbers", "step"),
    [
        ((), ([28, 32, 28, 32], [0.071, 0.057, 0.071, 0.057], 981, [0.7, 0.6], [3.33, 3.35]), 2),
        (("nonminimum_phase",), ([28, 32, 28, 32], [0.071, 0.057, 0.071, 0.057], 981, [0.43, 0.34], [3.14, 3.29]), 2),
        (("pcgym",), ([1e4] * 4, [35, 30, 20, 25], 981, [0.2, 0.2], [850, 950]), 15),
    ],
)
def test_four_tanks_move_as_in_scipy(variants, numbers, step):
    model = smpl.compile("four_tanks", variants=variants)
    start = np.array([10.0, 14, 2, 1]) if variants != ("pcgym",) else np.array([14.1, 11.2, 7.2, 10.1])
    assert difference(model, four_tanks(*numbers), start, moves(model, 60), step) < 1e-6


def test_van_de_vusse_reactor_rests_at_the_published_point():
    """Klatt and Engell 1998."""
    model = smpl.compile("van_de_vusse")
    found = model.steady_state(np.array([14.19, -1113.5]))[:4]
    near(found, [2.14, 1.09, 114.2, 112.9], [5e-3, 5e-3, 0.05, 0.05])


def van_de_vusse(x, u):
    c_A, c_B, T, T_K = x
    flow, Q = u
    k1 = 1.287e12 * np.exp(-9758.3 / (T + 273.15))
    k3 = 9.043e9 * np.exp(-8560 / (T + 273.15))
    released = -(4.2 * k1 * c_A - 11.0 * k1 * c_B - 41.85 * k3 * c_A**2)
    exchange = 4032 * 0.215
    return np.array(
        [
            -k1 * c_A - k3 * c_A**2 + flow * (5.1 - c_A),
            k1 * (c_A - c_B) - flow * c_B,
            released / (0.9342 * 3.01) + flow * (104.9 - T) + exchange * (T_K - T) / (0.9342 * 3.01 * 10),
            (Q + exchange * (T - T_K)) / (5 * 2.0),
        ]
    )


def test_van_de_vusse_reactor_moves_as_in_scipy():
    model = smpl.compile("van_de_vusse")
    start = np.array([2.6, 0.9, 118, 110])
    assert difference(model, van_de_vusse, start, moves(model, 60, 0.3), 0.005) < 1e-6


def williams_otto(x, u):
    A, B, C, _E, _G, P = x
    F_B, T = u[0], u[1] + 273.15
    F = 1.8275 + F_B
    k = np.array([1.6599e6, 7.2117e8, 2.6745e12]) * np.exp(-np.array([6666.7, 8333.3, 11111.0]) / T)
    r1, r2, r3 = k * [A * B, B * C, C * P]
    feed = np.array([1.8275, F_B, 0, 0, 0, 0])
    made = np.array([-r1, -r1 - r2, 2 * r1 - 2 * r2 - r3, 2 * r2, 1.5 * r3, r2 - 0.5 * r3])
    return (feed - F * x) / 2104.7 + made


def test_williams_otto_reactor_moves_as_in_scipy():
    model = smpl.compile("williams_otto")
    assert difference(model, williams_otto, np.full(6, 1 / 6), moves(model, 40, 0.3), 60) < 1e-6


def test_williams_otto_reactor_earns_most_at_the_published_point():
    """Optimum of the plant: 4.787 kg/s of B at 89.70 degC."""
    model = smpl.compile("williams_otto")
    profit = model.algebraic_names.index("profit") - len(model.algebraic_names)

    def loss(u):
        return -model.rollout(model.steady_state(np.array(u))[:6], [u], outputs=True).outputs[0, -1, profit]

    found = minimize(loss, [4.5, 86.0], method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-7})
    near(found.x, [4.787, 89.70], [1e-3, 1e-2])


def column_a(x, u):
    """Skogestad's stages from the reboiler; x[:41] compositions, x[41:] holdups."""
    z, M = x[:41], x[41:]
    L, V = u
    y = 1.5 * z / (1 + 0.5 * z)
    liquid = np.empty(41)
    liquid[1:40] = 2.70629 + (M[1:40] - 0.5) / 0.063
    liquid[1:21] += 1.0
    liquid[40] = L
    liquid[0] = 0.5 + 10 * (M[0] - 0.5)
    D = 0.5 + 10 * (M[40] - 0.5)
    dM, dMz = np.zeros(41), np.zeros(41)
    dM[:40] += liquid[1:] - liquid[:40]
    dMz[:40] += liquid[1:] * z[1:] - liquid[:40] * z[:40]
    dM[0] -= V
    dMz[0] -= V * y[0]
    dMz[1:40] += V * (y[:39] - y[1:40])
    dM[20] += 1.0
    dMz[20] += 0.5
    dM[40] += V - L - D
    dMz[40] += V * y[39] - (L + D) * z[40]
    return np.concatenate([(dMz - z * dM) / M, dM])


def test_column_a_has_the_published_products_gains_and_time_constant():
    model = smpl.compile("column_a")
    nominal = np.array([2.70629, 3.20629])
    steady = dict(zip(model.unknown_names, model.steady_state(nominal), strict=True))
    assert steady["x[41]"] == pytest.approx(0.99, abs=1e-6)
    assert steady["x[1]"] == pytest.approx(0.01, abs=1e-6)
    np.testing.assert_allclose(gains(model, nominal)[:2], [[0.8754, -0.8618], [1.0846, -1.0982]], atol=5e-5)
    A = model.linearize(model.steady_state(nominal), nominal)[0]
    assert -1 / np.linalg.eigvals(A).real.max() == pytest.approx(194.0, abs=0.5)


def test_column_a_moves_as_in_scipy():
    model = smpl.compile("column_a")
    actions = moves(model, 60, 0.02)
    assert difference(model, column_a, rest(model), actions, 1.0) < 1e-6


def acidity(W_a, W_b):
    """pH of a solution with these reaction invariants, mol/L."""

    def excess(pH):
        carbonate = W_b * (1 + 2 * 10 ** (pH - 10.25)) / (1 + 10 ** (6.35 - pH) + 10 ** (pH - 10.25))
        return W_a + 10 ** (pH - 14) - 10**-pH + carbonate

    return brentq(excess, 0, 14, xtol=1e-13)


def test_neutralisation_rests_at_the_published_point():
    """Henson and Seborg 1994: pH 7.0 at the printed invariants, level 14.0 cm."""
    assert acidity(-4.32e-4, 5.28e-4) == pytest.approx(7.0, abs=0.05)
    model = smpl.compile("ph_neutralisation")
    W_a, W_b, h, pH = model.steady_state(np.array([15.6, 16.6]))[:4]
    near([W_a, W_b, h, pH], [-0.432, 0.528, 14.0, 7.0], [5e-3, 5e-4, 0.05, 0.05])
    assert pH == pytest.approx(acidity(W_a / 1e3, W_b / 1e3), abs=1e-9)


def test_neutralisation_moves_as_in_scipy():
    def right_side(x, u):
        q = np.array([u[1], 0.55, u[0]])
        volume = 207 * x[2]
        return np.array(
            [
                (q * (np.array([3.0, -30, -3.05]) - x[0])).sum() / volume,
                (q * (np.array([0, 30, 0.05]) - x[1])).sum() / volume,
                (q.sum() - 8.75 * np.sqrt(x[2])) / 207,
            ]
        )

    model = smpl.compile("ph_neutralisation")
    actions = moves(model, 60, 0.1)
    assert difference(model, right_side, rest(model), actions, 15) < 1e-6
    run = model.rollout(rest(model), actions, outputs=True)
    pH = run.outputs[0, -1, model.algebraic_names.index("pH")]
    assert pH == pytest.approx(acidity(*run.states[0, -1, :2] / 1e3), abs=1e-6)


def evaporator(x, u, every=False):
    """Equations of Newell and Lee."""
    _, X2, P2 = x
    F2, P100, F200 = u
    F1, F3, X1, T1, T200 = 10, 50, 5, 40, 25
    T2 = 0.5616 * P2 + 0.3126 * X2 + 48.43
    T3 = 0.507 * P2 + 55
    T100 = 0.1538 * P100 + 90
    Q100 = 0.16 * (F1 + F3) * (T100 - T2)
    F4 = (Q100 - 0.07 * F1 * (T2 - T1)) / 38.5
    Q200 = 6.84 * (T3 - T200) / (1 + 6.84 / (2 * 0.07 * F200))
    T201 = T200 + Q200 / (F200 * 0.07)
    if every:
        return np.array([T2, T3, T100, Q100, F4, Q100 / 36.6, Q200, T201, Q200 / 38.5])
    return np.array([(F1 - F4 - F2) / 20, (F1 * X1 - F2 * X2) / 20, (F4 - Q200 / 38.5) / 4])


def test_evaporator_rests_at_the_published_point():
    """Newell and Lee 1989, table of the steady state."""
    published = {
        "X_2": 25,
        "P_2": 50.5,
        "T_2": 84.6,
        "T_3": 80.6,
        "T_100": 119.9,
        "Q_100": 339,
        "F_4": 8,
        "F_100": 9.3,
        "Q_200": 307.9,
        "T_201": 46.1,
        "F_5": 8,
    }
    model = smpl.compile("evaporator")
    action = np.array([2, 194.7, 208])
    states = model.steady_state(action, fixed={"L_2": 1.0})[:3]
    outputs = model.rollout(states, [action], outputs=True).outputs[0, 0]
    found = dict(zip(model.state_names, states, strict=True)) | dict(zip(model.algebraic_names, outputs, strict=True))
    for name, value in published.items():
        assert found[name] == pytest.approx(value, abs=0.3 if name == "Q_100" else 0.11), name
    np.testing.assert_allclose(outputs[[0, 1, 2, 4, 5, 6, 7, 8, 9]], evaporator(states, action, True), rtol=1e-9)


def test_evaporator_moves_as_in_scipy():
    model = smpl.compile("evaporator")
    start = np.array([1.0, 24.0, 52.0])
    actions = np.tile([2.02, 194.7, 208], (40, 1)) * np.random.default_rng(0).uniform(0.98, 1.02, (40, 3))
    assert difference(model, evaporator, start, actions, 1.0) < 1e-6
