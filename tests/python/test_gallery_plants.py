"""Tennessee Eastman and BSM1 against the figures of their papers and programs."""

import numpy as np
import pytest

import eastman
import smpl
from plants import difference, near, rest


@pytest.fixture(scope="module")
def plant() -> smpl.Model:
    return smpl.compile("tennessee_eastman")


def test_eastman_base_point_has_the_published_pressure_temperature_and_cost(plant):
    """Downs and Vogel 1993: 2705 kPa gauge, 120.4 degC, 170.6 $/h; teprob.f gives 170.27 $/h."""
    run = plant.rollout(rest(plant), [plant.native.defaults("action")], outputs=True)
    outputs = dict(zip(plant.algebraic_names, run.outputs[0, 0], strict=True))
    near(
        [outputs["p_reactor"], outputs["T[reactor]"], outputs["cost"], outputs["L_reactor"], outputs["Q_product"]],
        [2705.0, 120.4, 170.27, 75.0, 22.949],
        [0.5, 0.05, 0.2, 0.05, 5e-3],
    )


def test_eastman_base_point_is_unstable_with_the_eigenvalues_of_the_program(plant):
    action = np.array(plant.native.defaults("action"))
    A = plant.linearize(plant.steady_state(action), action)[0]
    values = np.linalg.eigvals(A)
    fastest = values[values.real.argmax()]
    near([fastest.real, abs(fastest.imag)], [3.06, 5.08], [0.01, 0.01])


def test_eastman_plant_shuts_down_by_pressure_without_control():
    """The program of the authors shuts down at 3.587 h."""
    env = smpl.Env("tennessee_eastman", normalize=False)
    env.reset(seed=0)
    while True:
        _, _, terminated, _, info = env.step(env.model.native.defaults("action"))
        if terminated:
            break
    assert info["failure"].startswith("reactor_pressure")
    assert env.time == pytest.approx(3.587, abs=2e-3)


def test_nineteen_loops_hold_the_eastman_plant_until_the_feed_of_a_is_lost():
    """IDV(6) at 1 h: both programs shut down at 6.8917 h."""
    env = smpl.Env("tennessee_eastman", variants=("pi",), normalize=False, settings={"fault_6": 1, "t_fault": 1})
    env.reset(seed=0)
    steady = env.model.native.defaults("action")
    worst = 0.0
    while True:
        _, _, terminated, truncated, info = env.step(steady)
        if terminated or truncated:
            break
        if env.time < 1:
            worst = max(worst, abs(env.algebraic[env.algebraic_names.index("p_reactor")] - 2705))
    assert worst < 10
    assert info["failure"]
    assert env.time == pytest.approx(6.8917, abs=5e-3)


def eastman_rates(model, states, commands):
    """Right-hand side by the program of the authors, in the order and the units of the model."""
    at = dict(zip(model.state_names, states, strict=True))
    valves = [name[2:-1] for name in model.action_names]

    def vessel(holdup, energy):
        return np.r_[[at[holdup.format(i)] / eastman.LB for i in "ABCDEFGH"], at[energy] / eastman.BTU]

    vessels = [
        ("N[reactor,{}]", "U[reactor]"),
        ("N[separator,{}]", "U[separator]"),
        ("n_c[{}]", "H_c"),
        ("n_m[{}]", "U_m"),
    ]
    opening = np.array([at[f"pos[{name}]"] for name in valves])
    water = np.array([at["T_wr"], at["T_wc"]])
    found = eastman.rates(*(vessel(*names) for names in vessels), water, opening, commands)
    rate = dict(zip(("T_wr", "T_wc"), found[4], strict=True))
    rate |= {f"pos[{name}]": value for name, value in zip(valves, found[5], strict=True)}
    for (holdup, energy), values in zip(vessels, found, strict=False):
        rate |= {holdup.format(i): value * eastman.LB for i, value in zip("ABCDEFGH", values, strict=False)}
        rate[energy] = values[8] * eastman.BTU
    return np.array([rate[name] for name in model.state_names])


def test_eastman_plant_moves_as_in_scipy(plant):
    """Twelve minutes with steps of four valves, against the program written in NumPy."""
    start, nominal = rest(plant), np.array(plant.native.defaults("action"))
    actions = np.tile(nominal, (12, 1))
    actions[3:, [0, 9]] += 0.5
    actions[6:, [5, 8]] -= 1
    expected = difference(
        plant, lambda x, u: eastman_rates(plant, x, u), start, actions, 1 / 60, method="LSODA", rtol=1e-9
    )
    assert expected < 1e-6


BSM1 = {
    "S_I": 30.0, "S_S": 0.889, "X_I": 1149, "X_S": 49.3, "X_BH": 2559, "X_BA": 150, "X_P": 452, "S_O": 0.491,
    "S_NO": 10.4, "S_NH": 1.73, "S_ND": 0.688, "X_ND": 3.53, "S_ALK": 4.13,
}  # fmt: skip


def test_bsm1_rests_at_the_published_steady_state():
    """Alex et al.: tank 5, effluent and underflow of the open loop."""
    model = smpl.compile("bsm1")
    found = dict(zip(model.unknown_names, model.steady_state(model.native.defaults("action")), strict=True))
    for name, value in BSM1.items():
        digits = 5e-4 if value < 1 else 5e-3 if value < 10 else 0.05 if value < 100 else 0.6
        assert found[f"tank[5].c[{name}]"] == pytest.approx(value, abs=digits), name
    near([found["settler.X[10]"], found["settler.X[1]"]], [12.5, 6394], [0.05, 0.5])


def asm1(c):
    """Conversion rates of Activated Sludge Model No. 1, components in the order of the model."""
    S_S, X_S, X_BH, X_BA, S_O, S_NO, S_NH, S_ND, X_ND = c[[1, 3, 4, 5, 7, 8, 9, 10, 11]]
    oxic, anoxic = S_O / (0.2 + S_O), 0.2 / (0.2 + S_O) * S_NO / (0.5 + S_NO)
    p1 = 4 * S_S / (10 + S_S) * oxic * X_BH
    p2 = 4 * S_S / (10 + S_S) * anoxic * 0.8 * X_BH
    p3 = 0.5 * S_NH / (1 + S_NH) * S_O / (0.4 + S_O) * X_BA
    p4, p5, p6 = 0.3 * X_BH, 0.05 * X_BA, 0.05 * S_ND * X_BH
    p7 = 3 * (X_S / X_BH) / (0.1 + X_S / X_BH) * (oxic + 0.8 * anoxic) * X_BH
    p8 = p7 * X_ND / X_S
    return np.array(
        [
            0,
            -(p1 + p2) / 0.67 + p7,
            0,
            0.92 * (p4 + p5) - p7,
            p1 + p2 - p4,
            p3 - p5,
            0.08 * (p4 + p5),
            -0.33 / 0.67 * p1 - 4.33 / 0.24 * p3,
            -0.33 / (2.86 * 0.67) * p2 + p3 / 0.24,
            -0.08 * (p1 + p2) - (0.08 + 1 / 0.24) * p3 + p6,
            -p6 + p8,
            (0.08 - 0.08 * 0.06) * (p4 + p5) - p8,
            -0.08 / 14 * p1
            + (0.33 / (14 * 2.86 * 0.67) - 0.08 / 14) * p2
            - (0.08 / 14 + 1 / (7 * 0.24)) * p3
            + p6 / 14,
        ]
    )


def bsm1(x, u):
    """The plant in NumPy: tanks, then solids and solubles of the settler from the bottom."""
    tanks, X, S = x[:65].reshape(5, 13), x[65:75], x[75:].reshape(7, 10)
    Q_a, Q_r, Q_w, kLa5 = u
    Q_in, fresh = 18446.0, np.array([30, 69.5, 51.2, 202.32, 28.17, 0, 0, 0, 0, 31.56, 6.95, 10.59, 7])
    soluble, cod = [0, 1, 7, 8, 9, 10, 12], [2, 3, 4, 5, 6]
    leaving = tanks[4]
    X_f = 0.75 * leaving[cod].sum()
    returned = leaving * X[0] / X_f
    returned[soluble] = S[:, 0]
    Q = Q_in + Q_a + Q_r
    entering = (Q_in * fresh + Q_a * leaving + Q_r * returned) / Q
    d = np.empty_like(tanks)
    for k, (V, kLa) in enumerate(zip((1000, 1000, 1333, 1333, 1333), (0, 0, 240, 240, kLa5), strict=True)):
        d[k] = Q / V * ((entering if k == 0 else tanks[k - 1]) - tanks[k]) + asm1(tanks[k])
        d[k, 7] += kLa * (8 - tanks[k, 7])
    up, down, into = (Q_in - Q_w) / 1500, (Q_r + Q_w) / 1500, (Q_in + Q_r) / 1500
    above = X - 0.00228 * X_f
    settle = X * np.clip(474 * (np.exp(-0.000576 * above) - np.exp(-0.00286 * above)), 0, 250)
    flux = np.zeros(11)  # flux[j] leaves layer j for the one below
    for j in range(1, 10):
        clear = j > 5 and X[j - 1] <= 3000
        flux[j] = settle[j] if clear else min(settle[j], settle[j - 1])

    def flow(c, fed):
        change = np.empty(10)
        change[6:] = up * (c[5:9] - c[6:])
        change[5] = into * fed - (up + down) * c[5]
        change[:5] = down * (c[1:6] - c[:5])
        return change

    dX = (flow(X, X_f) + flux[1:] - flux[:10]) / 0.4
    dS = np.array([flow(S[i], leaving[n]) for i, n in enumerate(soluble)]) / 0.4
    return np.concatenate([d.ravel(), dX, dS.ravel()])


def test_bsm1_has_the_rates_of_a_plant_written_in_numpy():
    model = smpl.compile("bsm1")
    start = rest(model)
    random = np.random.default_rng(0)
    low, high = smpl.Env(model).action_low, smpl.Env(model).action_high
    for _ in range(10):
        states = start * random.uniform(0.7, 1.3, len(start))
        action = low + (high - low) * random.uniform(0.1, 0.9, 4)
        expected = bsm1(states, action)
        np.testing.assert_allclose(
            model.rhs(0, states, action), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max()
        )
