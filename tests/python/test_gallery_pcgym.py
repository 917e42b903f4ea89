"""Systems of pc-gym in the gallery, against closed forms, balances and SciPy.

Right-hand sides are written from the balances with the parameters of pc-gym 0.1.8. The variant
`pcgym` repeats the sign of a heat of reaction.
"""

import numpy as np
import pytest

import smpl
from plants import difference, moves, near, rest


def outputs(name, **options):
    """Model, nominal action, and all values at rest by name."""
    model = smpl.compile(name, **options)
    action = np.array(model.native.defaults("action"))
    run = model.rollout(rest(model), [action], outputs=True)
    values = [
        *zip(model.state_names, run.states[0, 0], strict=True),
        *zip(model.algebraic_names, run.outputs[0, 0], strict=True),
    ]
    return model, action, dict(values)


def first_order(x, u):
    return (u - x) / 0.5


def second_order(x, u):
    return np.array([[0, 1], [-2, -3]]) @ x + np.array([0, 1]) * u


def cstr(x, u):
    c, T = x
    rate = 7.2e10 * np.exp(-8750 / T) * c
    return np.array([1 - c - rate, 350 - T + 5e4 * rate / 239 + 5e4 / (239 * 100) * (u[0] - T)])


def extraction(x, u):
    X, Y = x[:5], x[5:]
    transfer = 5 * (X - Y**2)
    before, behind = np.concatenate([[0.6], X[:4]]), np.concatenate([Y[1:], [0.05]])
    return np.concatenate([u[0] / 5 * (before - X) - transfer, u[1] / 5 * (behind - Y) + transfer])


def reactive_extraction(x, u):
    X, A, B, C = x.reshape(4, 5)
    transfer, rate = 0.01 * (X - A**2), 0.1 * A * B
    from_left, from_right = lambda c, fed: np.r_[fed, c[:4]], lambda c, fed: np.r_[c[1:], fed]
    L, G = u / 5
    return np.concatenate(
        [
            L * (from_left(X, 2) - X) - transfer,
            G * (from_right(A, 0) - A) + transfer - rate,
            G * (from_right(B, 2) - B) - rate,
            G * (from_right(C, 0) - C) + rate,
        ]
    )


def reactor_separator(x, u):
    H_R, H_M, H_B = x[:3]
    R, M, B = x[3:6], x[6:9], x[9:]
    F_R, F_M, P, D = u
    a = 90 * B[0] / (1 - B[0] + 90 * B[0])
    over, k = np.array([a, 1 - a, 0]), 0.0167
    reaction = k * np.array([-R[0], R[0] - R[1], R[1]])
    return np.concatenate(
        [
            np.array([0.4 + D - F_R, F_R - F_M, F_M - P - D]) / 10,
            (0.4 * (np.array([1, 0, 0]) - R) + D * (over - R)) / (10 * H_R) + reaction,
            F_R * (R - M) / (10 * H_M),
            (F_M * (M - B) - D * (over - B)) / (10 * H_B),
        ]
    )


def recycle_cascade(sign):
    def right_side(x, u):
        C1, T1, C2, T2 = x
        F, L = u[0] * 1e-6, u[1] * 1e-6
        k1, k2 = (3.118e5 * np.exp(-46.14 / (8.3145e-3 * T)) for T in (T1, T2))
        capacity = 1.05e3 * 3.766
        heat = sign * 58.41 / capacity
        return np.array(
            [
                (97.35 * F + L * C2 - (F + L) * C1) / 1e-3 - k1 * C1,
                (298 * F + L * T2 - (F + L) * T1) / 1e-3 - 0.461 / (1e-3 * capacity) * (T1 - u[2]) + heat * k1 * C1,
                (F + L) * (C1 - C2) / 2e-3 - k2 * C2,
                (F + L) * (T1 - T2) / 2e-3 - 0.732 / (2e-3 * capacity) * (T2 - u[3]) + heat * k2 * C2,
            ]
        )

    return right_side


def distillation(x, u):
    R, F = u
    L, V = 100 * R, 100 * (R + 1)
    y = 5 * x / (1 + 4 * x)
    down = np.r_[[L] * 4, [L + F] * 4]  # leaves tray i, i = 0..7
    d = np.zeros(9)
    d[1:] += down * x[:8]
    d[:8] -= down * x[:8]
    d[:8] += V * y[1:]
    d[1:] -= V * y[1:]
    d[0] -= 100 * x[0]
    d[4] += F * 0.2
    d[8] -= (F - 100) * x[8]
    # The drum sends L and D down, together V.
    return d / 2000


def heat_exchanger(x, u):
    tube, wall, shell = x.reshape(3, 8)
    Q, q = np.pi * (tube - wall), 2 * np.pi * (wall - shell)
    return np.concatenate(
        [
            (u[0] * (np.r_[90, tube[:7]] - tube) - Q) / np.pi,
            (Q - q) / (3 * np.pi),
            (u[1] * (np.r_[shell[1:], 20] - shell) + q) / (5 * np.pi),
        ]
    )


def biofilm(x, u):
    S1, S2, S3, oxygen = x.reshape(4, 4)
    recycle, F = u
    r1 = 0.8 * S1[:3] / (0.5 + S1[:3]) * oxygen[:3] / (1.5 + oxygen[:3])
    r2 = S2[:3] / (0.1 + S2[:3]) * oxygen[:3] / (0.5 + oxygen[:3])
    made = np.array([-r1, r1 - r2, r2, -3.5 * r1 - 1.1 * r2])
    d = np.empty((4, 4))
    for row, c in enumerate((S1, S2, S3, oxygen)):
        d[row, :3] = recycle / 10 * (np.r_[c[3], c[:2]] - c[:3]) + made[row]
        d[row, 3] = recycle / 15 * (c[2] - c[3])
    d[:3, 3] += F / 15 * (np.array([10, 0, 0]) - np.array([S1[3], S2[3], S3[3]]))
    d[3, 3] += 1.5 * (600 - oxygen[3])
    return d.ravel()


def polymerisation(x, u):
    T, M, initiator = x
    F = u[0] / 1000
    kp, kd, kt = np.array([6e10, 4e10, 9e10]) * np.exp(-np.array([7750, 8500, 8250]) / T)
    rate = kp * M * np.sqrt(0.5 * kd * initiator / kt)
    return np.array([F * (u[1] - T) + 3e4 / 2400 * rate, F * (10 - M) - rate, F * (1e-3 - initiator) - kd * initiator])


def potassium_sulfate(x, u):
    m0, m1, m2, m3, c = x  # lengths in um, as in the model
    T = u[0] + 273.15
    S = 1e3 * c - (-686.2686 + 3.579165 * T - 0.00292874 * T**2)
    B = 0.923714966 * np.exp(-6754.878558 / T) * S**0.92229965554 * m3**1.341205945
    G = 48.07514464 * np.exp(-4921.261419 / T) * S**1.871281405  # cm/min
    a, b = 0.50523693, 7.271241375e-4  # b per um
    grown = a * m2 + b * m3
    return np.array(
        [
            B,
            10000.0 * G * (a * m0 + b * m1),
            20000.0 * G * (a * m1 + b * m2),
            30000.0 * G * grown,
            -0.5 * 2.658 * 7.510905767 * G * grown * 1e-08,
        ]
    )


@pytest.mark.parametrize(
    ("name", "variants", "right_side", "step", "share"),
    [
        ("first_order", (), first_order, 0.1, 0.3),
        ("second_order", (), second_order, 0.1, 0.5),
        ("cstr", (), cstr, 0.25, 0.1),
        ("extraction", (), extraction, 0.1, 0.1),
        ("reactive_extraction", (), reactive_extraction, 10, 0.1),
        ("reactor_separator", (), reactor_separator, 2, 0.05),
        ("recycle_cascade", (), recycle_cascade(1), 20, 0.3),
        ("recycle_cascade", ("pcgym",), recycle_cascade(-1), 20, 0.3),
        ("distillation", (), distillation, 1, 0.1),
        ("heat_exchanger", (), heat_exchanger, 2, 0.3),
        ("biofilm", (), biofilm, 1, 0.1),
        ("polymerisation", (), polymerisation, 10, 0.05),
    ],
)
def test_a_system_of_pcgym_moves_as_in_scipy(name, variants, right_side, step, share):
    model = smpl.compile(name, variants=variants)
    start = rest(model) * (1 + 0.01 * np.random.default_rng(1).uniform(-1, 1, len(model.state_names)))
    assert difference(model, right_side, start, moves(model, 40, share), step, method="Radau") < 1e-6


def test_the_crystalliser_moves_as_in_scipy():
    model = smpl.compile("potassium_sulfate")
    actions = np.linspace(39, 25, 30)[:, None]
    start = rest(model)
    assert difference(model, potassium_sulfate, start, actions, 1.0) < 1e-6
    grown, lost = (model.rollout(start, actions).states[0, -1] - start)[3:]
    assert -lost == pytest.approx(0.5 * 2.658 * 7.510905767 / 3 * grown * 1e-12, rel=1e-6)


def test_the_response_of_the_first_order_system_is_an_exponential():
    model = smpl.compile("first_order")
    found = model.rollout([0.0], np.full((20, 1), 2.0)).states[0, :, 0]
    np.testing.assert_allclose(found, 2 * (1 - np.exp(-0.2 * np.arange(21))), atol=1e-7)


def test_the_response_of_the_second_order_system_is_a_squared_exponential():
    model = smpl.compile("second_order")
    found = model.rollout([0.0, 0.0], np.full((20, 1), 1.0)).states[0, :, 0]
    np.testing.assert_allclose(found, (1 - np.exp(-0.1 * np.arange(21))) ** 2 / 2, atol=1e-8)


def test_the_tank_rests_at_half_conversion_and_is_unstable_there():
    """Seborg, Edgar and Mellichamp: 0.5 mol/L and 350 K at a coolant of 300 K."""
    model = smpl.compile("cstr")
    found = model.steady_state([300.0], guess={"c_A": 0.5, "T": 350})
    near(found[:2], [0.5, 350], [1e-3, 0.05])
    assert np.linalg.eigvals(model.linearize(found, [300.0])[0]).real.max() > 1


def test_balances_close_at_rest():
    _, (L, G), at = outputs("extraction")
    assert L * (0.6 - at["X[5]"]) == pytest.approx(G * (at["Y[1]"] - 0.05), rel=1e-9)
    _, (L, G), at = outputs("reactive_extraction")
    assert L * (2 - at["X[5]"]) == pytest.approx(G * (at["A[1]"] + at["C[1]"]), rel=1e-9)
    _, (_, F), at = outputs("distillation")
    assert pytest.approx(100 * at["x[0]"] + (F - 100) * at["x[8]"], rel=1e-9) == F * 0.2
    _, (F_t, F_s), at = outputs("heat_exchanger")
    assert F_t * (90 - at["T_t[8]"]) == pytest.approx(F_s * (at["T_s[1]"] - 20), rel=1e-9)
    _, _, at = outputs("biofilm")
    assert at["S_1[4]"] + at["S_2[4]"] + at["S_3[4]"] == pytest.approx(10, rel=1e-9)
    _, action, at = outputs("polymerisation")
    assert at["T"] == pytest.approx(action[1] + 3e4 / 2400 * (10 - at["M"]), rel=1e-9)
    _, _, at = outputs("reactor_separator")
    for vessel in "RMB":
        assert sum(at[f"x_{vessel}[{i}]"] for i in "ABC") == pytest.approx(1, abs=1e-9)
    _, (F, _, T_1, T_2), at = outputs("recycle_cascade")
    reacted = F * 1e-6 * (97.35 - at["C_2"])
    cooled = 0.461 * (at["T_1"] - T_1) + 0.732 * (at["T_2"] - T_2)
    assert reacted * 58.41 == pytest.approx(cooled + F * 1e-6 * 1.05e3 * 3.766 * (at["T_2"] - 298), rel=1e-8)
