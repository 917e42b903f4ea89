"""Plants of the gallery against their papers: fermenters, reactors, boiler, battery, networks.

The right-hand sides are written from the papers that the models name.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import smpl
from plants import difference, moves, near, rest


def bioreactor(x, u):
    X, S, P = x
    growth = 0.48 * (1 - P / 50) * S / (1.2 + S + S**2 / 22) * X
    return np.array([growth, -growth / 0.4, 2.2 * growth + 0.2 * X]) + u[0] * (np.array([0, 20, 0]) - x)


def test_the_fermenter_rests_at_the_published_point():
    """Henson and Seborg 1992."""
    near(rest(smpl.compile("bioreactor")), [6.0, 5.0, 19.14], [0.05, 0.05, 0.02])


def mma(x, u):
    monomer, initiator, _, _ = x
    living = np.sqrt(2 * 0.58 * 0.10225 * initiator / (1.3281e10 + 1.0930e11))
    propagation, transfer = 2.4952e6 * monomer * living, 2.4522e3 * monomer * living
    termination = (0.5 * 1.3281e10 + 1.0930e11) * living**2
    flows = np.array([10 * 6, u[0] * 80, 0, 0]) - 10 * x
    made = [-propagation - transfer, -0.10225 * initiator, termination + transfer, 100.12 * (propagation + transfer)]
    return flows + np.array(made)


def test_the_polymerisation_of_mma_rests_at_the_published_point():
    """Doyle, Ogunnaike and Pearson 1995."""
    found = rest(smpl.compile("mma"))
    near(found, [5.506774, 0.132906, 0.0019752, 49.38182], [1e-5, 2e-6, 1e-7, 5e-4])
    assert found[3] / found[2] == pytest.approx(25000.5, abs=0.1)


def crystalliser(x, u):
    m0, m1, m2, m3, y = x
    nucleation = 200 * (1 - m3) * np.exp(-3 / y**2)
    return np.array(
        [nucleation - m0, y * m0 - m1, y * m1 - m2, y * m2 - m3, (1 + u[0] - y - (40 - y) * y * m2) / (1 - m3)]
    )


def test_the_crystalliser_rests_at_the_published_unstable_point():
    """Chiu and Christofides 1999: a limit cycle around it."""
    model = smpl.compile("crystalliser")
    found = rest(model)
    near(found, [0.0471, 0.0283, 0.0169, 0.0102, 0.5996], 6e-5)
    assert np.linalg.eigvals(model.linearize(found, [0.0])[0]).real.max() > 0
    solute = model.rollout(found * 1.01, np.zeros((300, 1))).states[0, :, 4]
    assert np.ptp(solute[200:]) > 3 * np.ptp(solute[:100])


# Report of Bell and Astrom, operating points: P, E, density; valves.
BOILER = [
    (75.6, 15.27, 299.6, 0.156, 0.483, 0.183, -0.97),
    (86.4, 36.65, 342.4, 0.209, 0.552, 0.256, -0.65),
    (97.2, 50.52, 385.2, 0.271, 0.621, 0.340, -0.32),
    (108, 66.65, 428, 0.34, 0.69, 0.433, 0),
    (118.8, 85.06, 470.8, 0.418, 0.759, 0.543, 0.32),
    (129.6, 105.8, 513.6, 0.505, 0.828, 0.663, 0.64),
    (135.4, 127, 556.4, 0.6, 0.897, 0.793, 0.98),
]


def boiler(x, u):
    P, E, _ = x
    steam = P ** (9 / 8)
    return np.array(
        [
            -0.0018 * u[1] * steam + 0.9 * u[0] - 0.15 * u[2],
            (0.073 * u[1] - 0.016) * steam - 0.1 * E,
            (141 * u[2] - (1.1 * u[1] - 0.19) * P) / 85,
        ]
    )


@pytest.mark.parametrize("point", BOILER[1:6])
def test_the_boiler_rests_at_the_published_points(point):
    """Points 2 to 6: the printed level, and rest to the digits; E is not at rest in 1 and 7."""
    model = smpl.compile("boiler_drum")
    P, E, rho, *valves, level = point
    run = model.rollout([P, E, rho], [valves], outputs=True)
    outputs = dict(zip(model.algebraic_names, run.outputs[0, 1], strict=True))
    rates = model.rhs(0, np.array([P, E, rho]), np.array(valves))
    assert outputs["L"] == pytest.approx(level, abs=0.02)
    near(rates, 0, [5e-3, 0.03, 0.02])


def glucose(x, u):
    G, X, I = x  # noqa: E741 - the letter of the model
    return np.array(
        [-0.028735 * (G - 4.5) - X * G, -0.028344 * X + 5.035e-5 * 1000 * (I - 0.015), -5 / 54 * I + u[0] / 60 / 12]
    )


def test_the_basal_infusion_holds_the_patient():
    """16.667 mU/min."""
    model = smpl.compile("glucose_insulin")
    near(model.steady_state([16.667e-3 * 60])[:3], [4.5, 0, 0.015], [1e-3, 1e-5, 1e-6])


def yeast(feed):
    def right_side(x, u):
        X, S, E, oxygen, V = x
        uptake = 3.5 * S / (0.1 + S)
        capacity = 0.256 * oxygen / (1e-4 + oxygen) * 10 / (10 + E)
        if uptake * 0.396 <= capacity:
            burnt, spilt = uptake, 0.0
        else:
            burnt, spilt = capacity / 0.396, uptake - capacity / 0.396
        ethanol = (capacity - 0.396 * burnt) / 1.104 * E / (0.1 + E)
        dilution = u[0] / V
        return np.array(
            [
                (0.49 * burnt + 0.05 * spilt + 0.72 * ethanol) * X - dilution * X,
                dilution * (feed - S) - uptake * X,
                (0.48 * spilt - ethanol) * X - dilution * E,
                500 * (0.0075 - oxygen) - (0.396 * burnt + 1.104 * ethanol) * X - dilution * oxygen,
                u[0],
            ]
        )

    return right_side


def battery(shells):
    """Diffusion in two spheres of equal shells, concentrations at their middles."""
    edges = np.linspace(0, 10e-6, shells + 1)
    area, volume = edges**2, np.diff(edges**3) / 3

    def diffusion(c, D, leaving):
        flow = np.zeros(shells + 1)
        flow[1:-1] = -D * np.diff(c) / (10e-6 / shells) * area[1:-1]
        flow[-1] = leaving * area[-1]
        return -np.diff(flow) / volume

    def right_side(x, u):
        section = 96485.33212 * 0.137 * 0.207 * 100e-6 * 3 / 10e-6
        minus, plus = x[:shells], x[shells:]
        rates = [diffusion(minus, 3.9e-14, u[0] / section / 0.6), diffusion(plus, 1e-13, -u[0] / section / 0.5)]
        return 60 * np.concatenate(rates)

    return right_side


def test_the_charge_of_the_battery_is_the_lithium_that_moves():
    model = smpl.compile("lithium_ion")
    start = rest(model)
    run = model.rollout(start, np.full((30, 1), -0.68), outputs=True)
    volumes = np.diff(np.linspace(0, 1, 21) ** 3)
    moved = (run.states[0, -1] - start).reshape(2, 20) @ volumes
    moles = 0.68 * 1800 / 96485.33212 / (0.137 * 0.207 * 100e-6)
    near(moved, [moles / 0.6, -moles / 0.5], 1e-5 * moles)


def test_slow_diffusion_in_the_battery_makes_a_parabola():
    """Surface less mean is j R/(5 D), once the profile is developed."""
    model = smpl.compile("lithium_ion")
    run = model.rollout(rest(model), np.full((60, 1), -0.2), outputs=True)
    outputs = dict(zip(model.algebraic_names, run.outputs[0, -1], strict=True))
    mean = run.states[0, -1, 20:] @ np.diff(np.linspace(0, 1, 21) ** 3)
    expected = -outputs["j_p"] * 10e-6 / (5 * 1e-13)
    assert outputs["s_p"] - mean == pytest.approx(expected, rel=5e-3)


def potentials(x, y):
    """Open-circuit potentials of graphite and lithium cobalt oxide (Dualfoil), V."""
    steps = [(0.0351, 0.286, 0.083), (-0.0045, 0.849, 0.119), (-0.035, 0.9233, 0.05), (-0.0147, 0.5, 0.034)]
    steps += [(-0.102, 0.194, 0.142), (-0.022, 0.9, 0.0164), (-0.011, 0.124, 0.0226), (0.0155, 0.105, 0.029)]
    minus = 0.194 + 1.5 * np.exp(-120 * x) + sum(a * np.tanh((x - at) / width) for a, at, width in steps)
    z = 1.062 * y
    steps = [
        (0.07645, 30.834, 54.4806),
        (2.1581, 52.294, 50.294),
        (-0.14169, 11.0923, 19.8543),
        (0.2051, 1.4684, 5.4888),
    ]
    plus = 2.16216 + sum(a * np.tanh(b - c * z) for a, b, c in steps)
    return minus, plus + 0.2531 * np.tanh((0.56478 - z) / 0.1316) - 0.02167 * np.tanh((z - 0.525) / 0.006)


def test_the_voltage_of_the_battery_is_that_of_its_kinetics():
    model = smpl.compile("lithium_ion")
    run = model.rollout(rest(model), np.full((20, 1), -1.0), outputs=True)
    out = dict(zip(model.algebraic_names, run.outputs[0, -1], strict=True))
    minus, plus = potentials(out["s_n"] / 24983.2619938437, out["s_p"] / 51217.9257309275)
    current = -1.0 / (0.137 * 0.207 * 100e-6 * 3 / 10e-6)
    thermal = 2 * 8.314462618 * 298.15 / 96485.33212
    i_n = 2e-5 * np.sqrt(1000 * out["s_n"] * (24983.2619938437 - out["s_n"]))
    i_p = 6e-7 * np.sqrt(1000 * out["s_p"] * (51217.9257309275 - out["s_p"]))
    lost = thermal * (np.arcsinh(current / 0.6 / (2 * i_n)) + np.arcsinh(current / 0.5 / (2 * i_p)))
    assert out["V"] == pytest.approx(plus - minus - lost, abs=1e-9)


def rates(T):
    """Froment 1967: rate constants of A -> B, B -> C, A -> C, kmol/(kg h)."""
    return np.exp([19.837 - 13636 / T, 20.86 - 15803 / T, 18.97 - 14394 / T])


def bed(x, u):
    A, B, T = x.reshape(80, 3).T
    T_w, G = u
    k1, k2, k3 = rates(T)
    cell, molar = 3 / 80, G / 29.48
    into = lambda c, fed: np.diff(np.r_[fed, c]) / cell  # noqa: E731
    dA = -molar * into(A, 0.00924) - 1300 * 0.208 * (k1 + k3) * A
    dB = -molar * into(B, 0.0) + 1300 * 0.208 * (k1 * A - k2 * B)
    heat = 1300 * 0.208 * ((1.285e6 * k1 + 4.564e6 * k3) * A + 3.279e6 * k2 * B)
    dT = -G * 1.047 * into(T, T_w) + heat - 4 * 96 * 3.6 / 0.0254 * (T - T_w)
    return np.array([dA / (0.4 * 0.0195), dB / (0.4 * 0.0195), dT / 1300]).T.ravel() / 3600


def test_the_bed_rests_at_the_profile_of_plug_flow():
    """Steady state of upwind cells against the equations along the tube, by SciPy."""

    def along(_, x):
        k1, k2, k3 = rates(x[2])
        A, B, T = x
        heat = 1300 * 0.208 * ((1.285e6 * k1 + 4.564e6 * k3) * A + 3.279e6 * k2 * B)
        molar = 4684 / 29.48
        return [
            -1300 * 0.208 * (k1 + k3) * A / molar,
            1300 * 0.208 * (k1 * A - k2 * B) / molar,
            (heat - 4 * 96 * 3.6 / 0.0254 * (T - 630)) / (4684 * 1.047),
        ]

    line = solve_ivp(along, (0, 3), [0.00924, 0, 630], rtol=1e-10, atol=1e-12, max_step=0.01)
    found = rest(smpl.compile("xylene_bed")).reshape(80, 3).T
    assert np.abs(bed(found.T.ravel(), np.array([630.0, 4684]))).max() < 1e-7
    assert found[2].max() == pytest.approx(line.y[2].max(), abs=2)
    assert found[1, -1] == pytest.approx(line.y[1, -1], rel=0.02)


@pytest.mark.parametrize(
    ("name", "right_side", "step", "share"),
    [
        ("bioreactor", bioreactor, 0.5, 0.1),
        ("mma", mma, 0.03, 0.1),
        ("crystalliser", crystalliser, 0.1, 0.1),
        ("boiler_drum", boiler, 5, 0.05),
        ("glucose_insulin", glucose, 5, 0.2),
        ("bakers_yeast", yeast(350), 0.1, 0.05),
    ],
)
def test_a_plant_moves_as_in_scipy(name, right_side, step, share):
    model = smpl.compile(name)
    actions = moves(model, 30, share)
    still = {"D": 0.0} if name == "glucose_insulin" else None
    start = np.array([2, 0.1, 0.5, 0.007, 5]) if name == "bakers_yeast" else rest(model)
    assert difference(model, right_side, start, actions, step, disturbances=still) < 1e-6


def test_the_battery_moves_as_in_scipy():
    model = smpl.compile("lithium_ion")
    actions = -np.abs(moves(model, 10, 0.3, hold=2))
    assert difference(model, battery(20), rest(model), actions, 1.0) < 1e-6


def test_the_bed_moves_as_in_scipy():
    model = smpl.compile("xylene_bed")
    actions = np.array([[632.0, 4684], [632, 4500], [628, 4500]])
    cells = np.kron(np.eye(80) + np.eye(80, k=-1), np.ones((3, 3)))
    assert difference(model, bed, rest(model), actions, 30.0, method="BDF", rtol=1e-9, jac_sparsity=cells) < 1e-6


def chylla_haase(rate):
    """Product A of the benchmark with a constant feed, kg/s; delays are ten lags each."""

    def right_side(x, u):
        monomer, polymer, T, out, into = x[:5]
        jacket, pipe = x[5:15], x[15:]
        water, c = 42.75, u[0]
        f = polymer / (monomer + polymer + water)
        viscosity = lambda at: 5.2e-5 * np.exp(16.4 * f) * 10 ** (2.3 * (555.556 / at - 1.563))  # noqa: E731
        k = 55 * np.exp(-29560.89 / (8.314 * T)) * (1000 * viscosity(T)) ** 0.4
        wall = (T + (into + out) / 2) / 2
        U = 1 / (1 / (0.814 * np.exp(-5.13 * viscosity(wall))) + 0.352)
        area = (monomer / 900 + polymer / 1040 + water / 1000) * 1.594 / 0.193 + 0.167
        heat = U * area * (T - (into + out) / 2)
        gain = 0.8 * 30 ** (-c / 50) * (294.26 - into) if c < 50 else 0.15 * 30 ** (c / 50 - 2) * (449.82 - into)
        made = k * monomer
        released = 70152.16 / 104 * made + rate * 1.675 * (305.382 - T) - 0.00567567 * (T - 305.382) - heat
        moved = np.diff(np.r_[into, jacket]) * -10 / 22.8
        returned = np.diff(np.r_[out, pipe]) * -10 / 15
        head = [
            rate - made,
            made,
            released / (1.675 * monomer + 3.14 * polymer + 4.187 * water),
            (0.9412 * 4.187 * (jacket[-1] - out) + heat) / (21.455 * 4.187),
            returned[-1] + (pipe[-1] - into + gain) / 40.2,
        ]
        return 60 * np.r_[head, moved, returned]

    return right_side


def test_the_semibatch_polymerisation_moves_as_in_scipy():
    """Ten minutes of heating, then ten of the feed from there."""
    model = smpl.compile("chylla_haase")
    start = np.r_[0, 11.227, np.full(23, 305.382)]
    heating = np.full((30, 1), 90.0)
    assert difference(model, chylla_haase(0.0), start, heating, 1 / 3) < 1e-6
    warm = np.r_[2.0, 15, np.full(23, 355)]
    actions = np.repeat([[30.0], [60], [10]], 10, axis=0)
    fed = difference(model, chylla_haase(7.56e-3), warm, actions, 1 / 3, first_step=100)
    assert fed < 1e-6


def test_monomer_fed_is_monomer_left_and_polymer_made():
    """7.56e-3 kg/s for 70 minutes."""
    model = smpl.compile("chylla_haase")
    start = np.r_[0, 11.227, np.full(23, 355.0)]
    end = model.rollout(start, np.full((450, 1), 48.0)).states[0, -1]
    assert end[0] + end[1] - 11.227 == pytest.approx(7.56e-3 * 70 * 60, rel=1e-7)


def network(x, u):
    sides = x.reshape(3, 2, 5)
    rates = np.empty_like(sides)

    def exchanger(i, hot, w, cold, by):
        h, c = sides[i]
        heat = 0.6 * (h - c)
        rates[i] = ((1 - by) * w * (np.r_[hot, h[:-1]] - h) - heat) / 60, (2.5 * (np.r_[c[1:], cold] - c) + heat) / 60

    first, second, third = sides
    leaving = u[2] * 180 + (1 - u[2]) * third[0, -1]
    exchanger(0, 150, 1.5, 40, u[0])
    exchanger(1, leaving, 2, first[1, 0], u[1])
    exchanger(2, 180, 2, second[1, 0], u[2])
    return 60 * rates.ravel()


def test_the_heat_exchanger_network_moves_as_in_scipy_and_closes_its_balance():
    model = smpl.compile("exchanger_network")
    start, actions = rest(model), moves(model, 40, 0.5)
    assert difference(model, network, start, actions, 0.5) < 1e-6
    run = model.rollout(start, [model.native.defaults("action")], outputs=True)
    out = dict(zip(model.algebraic_names, run.outputs[0, 0], strict=True))
    lost = 2 * (180 - out["T_h1"]) + 1.5 * (150 - out["T_h2"])
    assert lost == pytest.approx(2.5 * (out["T_c"] - 40), rel=1e-8)
