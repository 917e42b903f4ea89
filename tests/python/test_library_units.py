"""Units of the library in small plants, against SciPy with the balances written anew, and against closed forms."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import smpl
from plants import difference, rest

# The library compiles without warnings.
pytestmark = pytest.mark.filterwarnings("error::smpl.CompileWarning")

END = "solver { rtol = 1e-9, atol_factor = 1e-3 }\n"

RECYCLE = """
model Recycle "mixer, buffer tank, jacketed reactor, tube, and recycle of a part"
time t : h
unit amount = 1 [mol]
set species = { A, B }
use "lib/reactors.eq"
param k : 1/h = 5
action F : m^3/h = 1 in 0.5..1.5
use Mixer as mixer
use Tank as buffer(A = 2 [m^2])
use StirredReactor as R
use Jacket as J(V = 0.2 [m^3], UA = 3 [kW/K])
use PlugFlow as tube(cells = 10, L = 2 [m], A = 0.1 [m^2], D = 0.4 [m^2/h])
use Splitter as split
eq mixer.inlet_1.Q = F
eq mixer.inlet_1.c[i] = if i == A then 1000 [mol/m^3] else 0 for i in species
eq mixer.inlet_1.T = 30 [degC]
connect split.outlet_1 -> mixer.inlet_2
connect mixer.outlet -> buffer.inlet
connect buffer.outlet -> R.inlet
connect J.wall -> R.wall
connect R.outlet -> tube.inlet
connect tube.outlet -> split.inlet
eq buffer.outlet.Q = 1.2 [m^3/h]*sqrt(buffer.h/1 [m])
eq R.outlet.Q = R.inlet.Q
eq R.r[A] = -k*R.c[A]
eq R.r[B] = k*R.c[A]
eq R.q = 60 [kJ/mol]*k*R.c[A]
eq J.Q = 5 [m^3/h]
eq J.T_in = 15 [degC]
eq tube.r[A, z] = -k*tube.c[A, z] for z in 1..10
eq tube.r[B, z] = k*tube.c[A, z] for z in 1..10
eq split.share = 0.3
observe R.c[A] in 0..1000
episode { step = 0.1 [h], max_steps = 100 }
"""


def recycle(x, u):
    h, c, T, V, c_R, T_R, T_J = x[0], x[1:3], x[3], x[4], x[5:7], x[7], x[8]
    tube = x[9:].reshape(10, 2)
    out = 1.2 * math.sqrt(h)
    fresh, back = u[0], 0.3 * out
    c_in = (fresh * np.array([1000, 0]) + back * tube[-1]) / (fresh + back)
    T_in = (fresh * 30 + back * T_R) / (fresh + back)
    feed = fresh + back
    rate = np.array([-5, 5])
    heat = 3 * (T_J - T_R)
    v, dz = out / 0.1, 0.2
    faces = np.empty((11, 2))
    faces[0] = v * c_R
    faces[1:] = v * tube
    faces[1:-1] -= 0.4 * np.diff(tube, axis=0) / dz
    return np.concatenate([
        [(feed - out) / 2], feed * (c_in - c) / (2 * h), [feed * (T_in - T) / (2 * h)],
        [0], out * (c - c_R) / V + rate * c_R[0],
        [out * (T - T_R) / V + 60 * 5 * c_R[0] / 4180 + heat * 3600 / (4180 * V)],
        [5 * (15 - T_J) / 0.2 - heat * 3600 / (4180 * 0.2)],
        (-np.diff(faces, axis=0) / dz + rate * tube[:, :1]).ravel(),
    ])  # fmt: skip


def test_reactors_with_recycle_follow_their_balances():
    model = smpl.compile(source=RECYCLE + END)
    actions = np.repeat([[1.0], [1.4], [0.6]], 10, axis=0)
    assert difference(model, recycle, rest(model), actions, 0.1) < 1e-6


TUBE = """
model Tube "first-order reaction in a tube"
time t : h
unit amount = 1 [mol]
set species = { A }
use "lib/reactors.eq"
action Q : m^3/h = 1 in 0..2
param D : m^2/h = 0 in 0..1
use PlugFlow as tube(cells = 100, L = 1 [m], A = 1 [m^2], D = D)
eq tube.inlet.Q = Q
eq tube.inlet.c[A] = 1 [mol/m^3]
eq tube.inlet.T = 20 [degC]
eq tube.r[A, z] = -2 [1/h]*tube.c[A, z] for z in 1..100
observe tube.outlet.c[A] in 0..1
episode { step = 1 [h], max_steps = 10 }
"""


def outlet(model, **parameters):
    return model.rollout(rest(model), np.ones((10, 1)), parameters=parameters).observations[0, -1, 0]


def test_tube_has_the_conversion_of_its_cells_and_of_plug_flow():
    """A row of n mixed cells passes (1 + k tau/n)^-n, plug flow exp(-k tau)."""
    assert outlet(smpl.compile(source=TUBE + END)) == pytest.approx(1.02**-100, rel=1e-7)
    limited = smpl.compile(source=TUBE + END, variants=("convection=limited",))
    assert outlet(limited) == pytest.approx(math.exp(-2), rel=2e-3)


def test_dispersed_tube_has_the_conversion_of_danckwerts():
    """Danckwerts 1953, first order, closed ends; 100 cells of second order."""
    k, D = 2.0, 0.25
    a = math.sqrt(1 + 4 * k * D)
    exact = 4 * a * math.exp(0.5 / D) / ((1 + a) ** 2 * math.exp(a / 2 / D) - (1 - a) ** 2 * math.exp(-a / 2 / D))
    model = smpl.compile(source=TUBE + END, variants=("convection=limited",))
    assert outlet(model, D=D) == pytest.approx(exact, rel=1e-3)


LEVEL = """
model Level "pump and valve fill a tank under level control, a linear valve drains it"
time t : h
unit amount = 1 [g]
set species = { salt }
use "lib/flow.eq"
action setpoint = 0.5 in 0..1
action mode     = 1 in 0..1
param opening = 0.4
use Pump as P(head_0 = 20 [m])
use EqualPercentageValve as V(K_v = 8)
use Tank as tank
use LinearValve as drain(K_v = 20, density = 1.1)
use Sensor as LT(tau = 20 [s])
use CONTROLLER
eq P.inlet.c[salt] = 10 [g/m^3]
eq P.inlet.T = 20 [degC]
eq P.speed.y = 0.9
eq P.dp = V.dp + 0.2 [bar]
connect P.outlet -> V.inlet
connect V.outlet -> tank.inlet
connect tank.outlet -> drain.inlet
eq drain.dp = 1100 [kg/m^3]*9.80665 [m/s^2]*tank.h
eq drain.opening.y = opening
eq LT.input.y = tank.h/2 [m]
connect LT.output -> LC.measured
connect LC.output -> V.opening
eq LC.setpoint = setpoint
at start { next LC.auto = mode ; next LC.manual = 0.6 }
observe tank.h in 0..2
episode { step = 0.02 [h], max_steps = 100 }
"""


def level(x, u, derivative):
    h, c, T, y, integral = x[:5]
    rate = (y - x[5]) * 10 / (10 / 3600) if derivative else 0.0
    K, T_i, T_d = 3, 200 / 3600, 10 / 3600
    wanted = K * (u[0] - y - (T_d * rate if derivative else 0)) + integral
    sent = min(max(wanted, 0), 1) if u[1] >= 0.5 else 0.6
    tracking = math.sqrt(T_i * T_d) if derivative else T_i
    head = 1000 * 9.80665
    K_v = 8 * 50 ** (sent - 1)
    Q = math.sqrt((head * 20 * 0.81 - 0.2e5) / (head * 0.02 + 1e5 / K_v**2))
    out = 20 * 0.4 * math.sqrt(1100 * 9.80665 * h / 1e5 / 1.1)
    integrates = K * (u[0] - y) / T_i + (sent - wanted) / tracking
    slopes = [Q - out, Q * (10 - c) / h, Q * (20 - T) / h, (h / 2 - y) * 180, integrates]
    return np.array([*slopes, rate] if derivative else slopes)


@pytest.mark.parametrize("kind", ["PI", "PID"])
def test_pump_valves_sensor_and_controller_follow_their_equations(kind):
    """Set-points that saturate the valve, then manual mode and back."""
    source = LEVEL.replace("CONTROLLER", f"{kind} as LC(K = 3, T_i = 200 [s])")
    model = smpl.compile(source=source + END)
    actions = np.repeat([[0.5, 1], [0.95, 1], [0.2, 1], [0.2, 0], [0.4, 1]], 8, axis=0)
    start = rest(model)
    assert len(start) == 5 + (kind == "PID")
    found = difference(model, lambda x, u: level(x, u, kind == "PID"), start, actions, 0.02)
    assert found < 1e-6


def test_controller_in_manual_mode_follows_the_operator_without_a_bump():
    source = LEVEL.replace("CONTROLLER", "PI as LC(K = 3, T_i = 200 [s], T_t = 5 [s])")
    model = smpl.compile(source=source + END)
    run = model.rollout(rest(model), [[0.5, 0]] * 50 + [[0.5, 1]], outputs=True)
    outputs = [row[model.algebraic_names.index("LC.output.y")] for row in run.outputs[0]]
    assert outputs[40] == 0.6
    state = dict(zip(model.state_names, run.states[0, 50], strict=True))
    assert 3 * (0.5 - state["LT.y"]) + state["LC.I"] == pytest.approx(0.6, abs=0.05)


DISTILLATION = """
model Distillation "flash ahead of a column, a tray with holdup behind it"
time t : h
set species = { light, middle, heavy }
table relative_volatility[species] : 1 = { light: 4, middle: 2, heavy: 1 }
use "lib/distillation.eq"
action F : kmol/h = 100 in 50..150
use Flash as flash
use Column as column(above = 6, below = 8)
use Tray as tray(L_0 = 40 [kmol/h])
eq flash.feed.F = F
eq flash.feed.x[light] = 0.4
eq flash.feed.x[middle] = 0.3
eq flash.feed.x[heavy] = 0.3
eq flash.K[light] = 2
eq flash.K[middle] = 1
eq flash.K[heavy] = 0.4
connect flash.liquid -> column.feed
eq column.reflux = 90 [kmol/h]
eq column.boilup = 110 [kmol/h]
connect column.distillate -> tray.feed
connect flash.vapour -> tray.vapour_in
eq tray.liquid_in.F = 10 [kmol/h]
eq tray.liquid_in.x[light] = 0.5
eq tray.liquid_in.x[middle] = 0.25
eq tray.liquid_in.x[heavy] = 0.25
initial column.top.x[k, i] = 1/3 for k in 1..6, i in species
initial column.bottom.x[k, i] = 1/3 for k in 1..8, i in species
initial column.condenser.x[i] = 1/3 for i in species
initial column.middle.x[i] = 1/3 for i in species
initial column.reboiler.x[i] = 1/3 for i in species
initial tray.x[i] = 1/3 for i in species
observe column.distillate.x[light] in 0..1
episode { step = 0.05 [h], max_steps = 100 }
"""
VOLATILITY, FEED, K = np.array([4.0, 2.0, 1.0]), np.array([0.4, 0.3, 0.3]), np.array([2.0, 1.0, 0.4])


SHARE = brentq(lambda b: (FEED * (K - 1) / (1 + b * (K - 1))).sum(), 0, 1, xtol=1e-14)


def balances(values, flow):
    """Rates of the column from the compositions of its stages, top down, and those of the last tray."""
    liquid = FEED / (1 + SHARE * (K - 1))
    x, tray, M = values
    F, L, V = (1 - SHARE) * flow, 90.0, 110.0
    y = VOLATILITY * x / (x @ VOLATILITY)[:, None]
    rate = np.empty_like(x)
    feed = 7
    for k in range(1, 16):
        down = L if k <= feed else L + F
        rate[k] = (down * (x[k - 1] - x[k]) + V * (y[k + 1] - y[k]) + (F * (liquid - x[k]) if k == feed else 0)) / 0.5
    rate[0] = V * (y[1] - x[0]) / 5
    rate[16] = ((L + F) * (x[15] - x[16]) - V * (y[16] - x[16])) / 5
    y_t = VOLATILITY * tray / (tray @ VOLATILITY)
    up, D = SHARE * flow, V - L
    slope = (D * (x[0] - tray) + 10 * ([0.5, 0.25, 0.25] - tray) + up * (K * liquid - y_t)) / M
    return rate, slope, D + 10 - (40 + (M - 0.5) / 0.001)


def test_flash_column_and_tray_follow_their_balances():
    model = smpl.compile(source=DISTILLATION + END)
    names = list(model.state_names)
    species = ("light", "middle", "heavy")
    stages = [
        "column.condenser.x[{}]", *(f"column.top.x[{k},{{}}]" for k in range(1, 7)), "column.middle.x[{}]",
        *(f"column.bottom.x[{k},{{}}]" for k in range(1, 9)), "column.reboiler.x[{}]",
    ]  # fmt: skip
    at = np.array([[names.index(stage.format(i)) for i in species] for stage in stages])
    tray, M = [names.index(f"tray.x[{i}]") for i in species], names.index("tray.M")

    def right_side(x, u):
        out = np.empty_like(x)
        out[at], out[tray], out[M] = balances((x[at], x[tray], x[M]), u[0])
        return out

    actions = np.repeat([[100.0], [130.0], [80.0]], 10, axis=0)
    assert difference(model, right_side, rest(model), actions, 0.05) < 1e-6


FLASH = """
model Point
time t : h
set species = { a, b, c }
table relative_volatility[species] : 1 = { a: 3, b: 2, c: 1 }
use "lib/distillation.eq"
param K_a = 1, K_b = 1, K_c = 1, z_a = 0.2, z_b = 0.3
use Flash as flash
eq flash.feed.F = 100 [kmol/h]
eq flash.feed.x[a] = z_a
eq flash.feed.x[b] = z_b
eq flash.feed.x[c] = 1 - z_a - z_b
eq flash.K[a] = K_a
eq flash.K[b] = K_b
eq flash.K[c] = K_c
observe flash.share in 0..1
state still = 0
eq d/dt still = 0
episode { step = 1 [h], max_steps = 2 }
"""


def test_flash_finds_one_or_two_phases_of_random_feeds():
    model, random = smpl.compile(source=FLASH), np.random.default_rng(0)
    for _ in range(100):
        K, z = np.exp(random.normal(0, 3, 3)), random.dirichlet([0.5] * 3)

        def excess(share, K=K, z=z):
            return (z * (K - 1) / (1 + share * (K - 1))).sum()

        share = 0 if excess(0) <= 0 else 1 if excess(1) >= 0 else brentq(excess, 0, 1, xtol=1e-15)
        parameters = {"K_a": K[0], "K_b": K[1], "K_c": K[2], "z_a": z[0], "z_b": z[1]}
        run = model.rollout([0.0], np.zeros((1, 0)), parameters=parameters)
        assert run.observations[0, 0, 0] == pytest.approx(share, abs=1e-7), (K, z)


CULTURE = """
model Culture "bioreactor with a settler behind it"
time t : h
unit amount = 1 [g]
set species = { X, S, P }
set solids = { X }
set solubles = { S, P }
use "lib/bioreactor.eq"
use "lib/settler.eq"
action F : L/h = 100 in 0..300
action out : L/h = 100 in 0..300
use Bioreactor as B(Y_PX = 0.2, beta = 0.01 [1/h], m_S = 0.02 [1/h], k_d = 0.01 [1/h], i_S = 0.05 [L/g], Y_PS = 0.9)
use Settler as settler(A = 0.4 [m^2], depth = 2 [m])
eq B.inlet.Q = F
eq B.inlet.c[i] = if i == S then 5 [g/L] else 0 for i in species
eq B.inlet.T = 20 [degC]
eq B.outlet.Q = out
connect B.outlet -> settler.inlet
eq settler.underflow.Q = 0.3*settler.inlet.Q
observe B.c[X] in 0..1e4
episode { step = 0.1 [h], max_steps = 100 }
"""


def culture(x, u):
    F, out = u / 1000
    V, (X, S, P) = x[0], x[1:4]
    s = max(S, 0) / 1000
    mu = 0.4 * s / (0.1 + s + 0.05 * s**2)
    fed = s / (1e-4 + s)
    r_P = (0.2 * mu + fed * 0.01) * X
    eats = mu * X / 0.5 + fed * 0.02 * X + r_P / 0.9
    slopes = [F - out, (mu - 0.01) * X - F * X / V, F * (5000 - S) / V - eats, r_P - F * P / V]
    layers, dissolved = x[4:14], x[14:].reshape(2, 10)
    inlet, h = 0.75 * X, 0.2
    down, up = 0.3 * out / 0.4, 0.7 * out / 0.4
    free = layers - 0.00228 * inlet
    speed = np.clip(474 * (np.exp(-0.000576 * free) - np.exp(-0.00286 * free)), 0, 250) / 24
    settling = speed * layers
    falls = np.zeros(11)  # from layer j to the one below, counted from the bottom
    for j in range(1, 10):
        own = j > 5 and layers[j - 1] <= 3000
        falls[j] = settling[j] if own else min(settling[j], settling[j - 1])

    def layer_rates(c, c_in, falls):
        rate = falls[1:] - falls[:-1]
        rate[6:] += up * (c[5:9] - c[6:])
        rate[5] += (up + down) * (c_in - c[5])
        rate[:5] += down * (c[1:6] - c[:5])
        return rate / h

    still = np.zeros(11)
    passing = [layer_rates(c, c_in, still) for c, c_in in zip(dissolved, (S, P), strict=True)]
    return np.concatenate([slopes, layer_rates(layers, inlet, falls), *passing])


def test_bioreactor_and_settler_follow_their_balances():
    """Chemostat, fed batch, batch."""
    model = smpl.compile(source=CULTURE + END)
    actions = np.repeat([[100.0, 100.0], [200.0, 150.0], [100.0, 30.0]], 10, axis=0)
    assert difference(model, culture, rest(model), actions, 0.1) < 1e-6


def test_batch_ends_when_the_substrate_is_used_up():
    """Maintenance and product cease with the substrate, whose concentration stays at zero."""
    model = smpl.compile(source=CULTURE.replace("max_steps = 100", "max_steps = 4000") + END)
    start = rest(model)
    start[[model.state_names.index(f"B.c[{i}]") for i in "XSP"]] = 100.0, 1000.0, 0.0
    run = model.rollout(start, np.full((1000, 2), [0.0, 0.0]))
    values = dict(zip(model.state_names, run.states[0, -1], strict=True))
    assert not run.failure[0]
    assert -1e-6 < values["B.c[S]"] < 1e-2


def test_chemostat_rests_at_the_substrate_of_monod():
    source = CULTURE.replace("beta = 0.01 [1/h], m_S = 0.02 [1/h], k_d = 0.01 [1/h], i_S = 0.05 [L/g], Y_PS = 0.9", "")
    source = source.replace("Y_PX = 0.2, ", "").replace("use Settler as", "#").replace("connect B.outlet", "#")
    source = source.replace("eq settler", "#").replace("max_steps = 100", "max_steps = 4000")
    model = smpl.compile(source=source + END)
    run = model.rollout(rest(model), np.full((3000, 2), [100.0, 100.0]))
    values = dict(zip(model.state_names, run.states[0, -1], strict=True))
    S = 0.1 * 0.1 / (0.4 - 0.1)
    assert values["B.c[S]"] == pytest.approx(1000 * S, rel=1e-6)
    assert values["B.c[X]"] == pytest.approx(1000 * 0.5 * (5 - S), rel=1e-6)


CRYSTALS = """
model Crystals "cooling crystallisation"
time t : h
unit amount = 1 [kg]
set species = { solute }
use "lib/crystalliser.eq"
action T : degC = 40 in 0..100
action Q : m^3/h = 0 in 0..1
use Crystalliser as C
eq C.inlet.Q = Q
eq C.outlet.Q = Q
eq C.inlet.c[solute] = 110 [kg/m^3]
eq C.inlet.T = 60 [degC]
eq C.c_sat = (60 + value(T)) as [kg/m^3]
initial C.c[solute] = 115
observe C.m_3 in 0..10
episode { step = 0.1 [h], max_steps = 400 }
"""


def crystals(x, u):
    c, m = x[0], x[1:]
    sigma, D = max(c / (60 + u[0]) - 1, 0), u[1]
    G, B = 3600 * 1e-7 * sigma**1.5, 3600 * 1e8 * sigma**2
    return np.array([
        D * (110 - c) - 3 * 2000 * 0.5 * G * m[2],
        B - D * m[0], G * m[0] - D * m[1], 2 * G * m[1] - D * m[2], 3 * G * m[2] - D * m[3],
    ])  # fmt: skip


def test_crystalliser_follows_the_moments_in_batch_and_continuous_operation():
    model = smpl.compile(source=CRYSTALS + END)
    assert model.state_names[0] == "C.c[solute]"
    actions = np.repeat([[40.0, 0.0], [30.0, 0.0], [30.0, 0.5]], 20, axis=0)
    assert difference(model, crystals, rest(model), actions, 0.1) < 1e-6
    run = model.rollout(rest(model), actions[:40])
    mass = run.states[0, :, 0] + 2000 * 0.5 * run.states[0, :, 4]
    assert mass == pytest.approx(np.full(41, 115.0), rel=1e-8)


def test_continuous_crystalliser_rests_at_the_moments_of_randolph_and_larson():
    """Exponential distribution: m_j = j! B tau (G tau)^j."""
    model = smpl.compile(source=CRYSTALS + END)
    run = model.rollout(rest(model), np.full((400, 2), [40.0, 1.0]))
    c, *m = run.states[0, -1]
    sigma = c / 100 - 1
    G, B = 3600 * 1e-7 * sigma**1.5, 3600 * 1e8 * sigma**2
    assert m == pytest.approx([math.factorial(j) * B * G**j for j in range(4)], rel=1e-4)
