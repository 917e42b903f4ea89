"""Absorber, evaporator, valve with stiction, compressor and recipes of the library, against SciPy and closed forms."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import smpl
from plants import difference, rest

# The library compiles without warnings.
pytestmark = pytest.mark.filterwarnings("error::smpl.CompileWarning")

END = "solver { rtol = 1e-9, atol_factor = 1e-3 }\n"
GAS = 8.31446261815324


def outputs(model, run):
    """Outputs at the end of a trajectory, by name."""
    return dict(zip(model.algebraic_names, run.outputs[0, -1], strict=True))


ABSORBERS = """
model Absorbers "two solutes from a gas into a solvent, in an efficient and an inefficient column"
time t : min
set species = { carrier, solvent, a, b }
set solutes = { a, b }
use "lib/absorber.eq"
action G : kmol/h = 100 in 50..200
action L : kmol/h = 150 in 50..300
param y_a = 0.15
use Absorber as top(stages = 4, M = 2 [kmol])
use Absorber as bottom(stages = 3, E = 0.6)
eq bottom.gas_in.F = G
eq bottom.gas_in.x[i] = if i == a then y_a else if i == b then 0.05 else if i == carrier then 0.95 - y_a else 0
  for i in species
connect bottom.gas_out -> top.gas_in
eq top.liquid_in.F = L
eq top.liquid_in.x[i] = if i == a then 0.01 else if i == solvent then 0.99 else 0 for i in species
connect top.liquid_out -> bottom.liquid_in
eq top.K[i] = if i == a then 0.8 else 3 for i in solutes
eq bottom.K[i] = if i == a then 1.2 else 3.5 for i in solutes
observe top.gas_out.x[a] in 0..1
episode { step = 1 [min], max_steps = 500 }
"""


def absorbers(x, u):
    X, (gas, liquid) = x.reshape(7, 2), np.array(u) / 60
    G, L = 0.8 * gas, 0.99 * liquid
    K = np.array([[0.8, 3.0]] * 4 + [[1.2, 3.5]] * 3)
    M = np.array([2.0] * 4 + [1.0] * 3)[:, None]
    mole = X / (1 + X.sum(axis=1, keepdims=True))
    y = K * mole
    equilibrium = y / (1 - y.sum(axis=1, keepdims=True))
    Y = np.empty((8, 2))
    Y[7] = [0.15 / 0.8, 0.05 / 0.8]
    for k in range(6, -1, -1):
        Y[k] = Y[k + 1] + (1 if k < 4 else 0.6) * (equilibrium[k] - Y[k + 1])
    above = np.vstack([[0.01 / 0.99, 0], X[:-1]])
    return ((L * (above - X) + G * (Y[1:] - Y[:-1])) / M).ravel()


def test_absorbers_in_series_follow_their_balances():
    model = smpl.compile(source=ABSORBERS + END)
    actions = np.repeat([[100.0, 150.0], [150.0, 150.0], [80.0, 220.0]], 10, axis=0)
    assert difference(model, absorbers, rest(model), actions, 1.0) < 1e-6


def test_absorbers_conserve_every_solute_at_rest():
    model = smpl.compile(source=ABSORBERS + END)
    run = model.rollout(rest(model), np.full((400, 2), [100.0, 150.0]), outputs=True)
    found = outputs(model, run)
    for i in ("a", "b", "carrier", "solvent"):
        into = found["bottom.gas_in.F"] * found[f"bottom.gas_in.x[{i}]"]
        into += found["top.liquid_in.F"] * found[f"top.liquid_in.x[{i}]"]
        out = found["top.gas_out.F"] * found[f"top.gas_out.x[{i}]"]
        out += found["bottom.liquid_out.F"] * found[f"bottom.liquid_out.x[{i}]"]
        assert out == pytest.approx(into, rel=1e-7), i


def test_dilute_absorber_has_the_efficiency_of_kremser():
    """Share absorbed (A^(n+1) - A)/(A^(n+1) - 1) with A = L/(K G), clean solvent."""
    source = ABSORBERS.replace("y_a = 0.15", "y_a = 1e-6").replace("b then 0.05", "b then 1e-7")
    source = source.replace("0.95 - y_a", "1 - 1.1e-6").replace("a then 0.01", "a then 0").replace("0.99", "1")
    source = source.replace(", E = 0.6", "").replace("a then 1.2", "a then 0.8")
    model = smpl.compile(source=source + END)
    run = model.rollout(rest(model), np.full((400, 2), [150.0, 150.0]), outputs=True)
    found, A = outputs(model, run), 1 / 0.8
    absorbed = 1 - found["top.gas_out.x[a]"] / 1e-6
    assert absorbed == pytest.approx((A**8 - A) / (A**8 - 1), rel=1e-4)


EVAPORATORS = """
model Evaporators "two effects and a condenser, liquid and vapour in the same direction"
time t : min
unit amount = 1 [kg]
set species = { sugar }
use "lib/evaporator.eq"
action F : m^3/h = 10 in 5..15
action T_s : degC = 120 in 100..140
use Effect as E[k in 1..2](UA = 20 [kW/K])
use SurfaceCondenser as C(UA = 100 [kW/K])
eq E[1].chest.T = T_s
eq E[1].inlet.Q = F
eq E[1].inlet.T = 50 [degC]
eq E[1].inlet.c[sugar] = 100 [kg/m^3]
connect E[1].vapour -> E[2].chest
connect E[2].vapour -> C.vapour
connect E[1].outlet -> E[2].inlet
eq E[k].outlet.Q = 2 [m^3/h] + 6 [1/h]*(E[k].V - 1 [m^3]) for k in 1..2
eq E[k].rise = E[k].c[sugar]/(200 [kg/m^3])*1 [K] for k in 1..2
eq C.T_c = 30 [degC]
initial E[1].T = 100
initial E[2].T = 70
initial E[k].c[sugar] = 150 for k in 1..2
observe E[2].c[sugar] in 0..1000
episode { step = 1 [min], max_steps = 1000 }
"""


def evaporators(x, u):
    (V_1, c_1, T_1), (V_2, c_2, T_2) = x.reshape(2, 3)
    F, steam = u[0] / 60, u[1]
    latent, rho_cp = 2257.0, 4180.0
    q_1 = 20 * 60 * (steam - T_1)
    q_2 = 20 * 60 * (T_1 - c_1 / 200 - T_2)
    q_c = 100 * 60 * (T_2 - c_2 / 200 - 30)
    v_1, v_2 = q_2 / latent / 1000, q_c / latent / 1000
    out_1, out_2 = (2 + 6 * (V_1 - 1)) / 60, (2 + 6 * (V_2 - 1)) / 60
    return np.array([
        F - out_1 - v_1, (F * (100 - c_1) + v_1 * c_1) / V_1, F * (50 - T_1) / V_1 + (q_1 - q_2) / (rho_cp * V_1),
        out_1 - out_2 - v_2, (out_1 * (c_1 - c_2) + v_2 * c_2) / V_2,
        out_1 * (T_1 - T_2) / V_2 + (q_2 - q_c) / (rho_cp * V_2),
    ])  # fmt: skip


def test_two_effects_and_a_condenser_follow_their_balances():
    model = smpl.compile(source=EVAPORATORS + END)
    assert list(model.state_names[:3]) == ["E[1].V", "E[1].c[sugar]", "E[1].T"]
    actions = np.repeat([[10.0, 120.0], [13.0, 120.0], [10.0, 135.0]], 10, axis=0)
    assert difference(model, evaporators, rest(model), actions, 1.0) < 1e-6


def test_two_effects_at_rest_keep_the_solute_and_save_steam():
    model = smpl.compile(source=EVAPORATORS + END)
    found = outputs(model, model.rollout(rest(model), np.full((600, 2), [10.0, 120.0]), outputs=True))
    out = found["E[2].outlet.Q"] * found["E[2].outlet.c[sugar]"]
    assert out == pytest.approx(1000, rel=1e-6)
    evaporated = -found["E[1].vapour.m"] - found["E[2].vapour.m"]
    assert found["E[2].outlet.Q"] == pytest.approx(10 - evaporated / 1000, rel=1e-6)
    assert evaporated / found["E[1].chest.m"] > 1.4  # one effect cannot reach 1 with a cold feed


STICTION = """
model Stick "a tank fed through a sticking valve"
time t : min
unit amount = 1 [g]
set species = { salt }
use "lib/flow.eq"
param wide = 0.3
use Stiction as S(static = 0.07, kinetic = 0.03)
use LinearValve as V(K_v = 2)
use BufferTank as tank(gain = 1.5)
eq S.input.y = 0.5 + wide*sin(t/1 [min])
connect S.output -> V.opening
eq V.dp = 1 [bar]
eq V.inlet.c[salt] = 3 [g/m^3]
eq V.inlet.T = 20 [degC]
connect V.outlet -> tank.inlet
observe tank.h in 0..5
episode { step = 0.5 [min], max_steps = 60 }
"""


@pytest.mark.parametrize("wide", [0.3, 0.06, 0.45])
def test_sticking_valve_moves_as_the_model_of_he(wide):
    """The residual of He et al. 2007, with a signal that is continuous; the level between slips in closed form."""
    model = smpl.compile(source=STICTION + END)
    run = model.rollout(rest(model), np.zeros((60, 0)), parameters={"wide": wide})

    def signal(t):
        return 0.5 + wide * math.sin(t)

    stem, t, h = 0.5, 0.0, 1.0
    levels = [h]
    for end in 0.5 * np.arange(1, 61):
        while True:
            grid = np.linspace(t, end, 400)
            over = [s for s in grid[1:] if abs(signal(s) - stem) > 0.07]
            stop = end
            if over:
                a, b = max(t, over[0] - (grid[1] - grid[0])), over[0]
                stop = brentq(lambda s, x=stem: abs(signal(s) - x) - 0.07, a, b, xtol=1e-14)
            # dh/dt = 2 stem/60 - (1 + 1.5 (h - 1))/60
            rest_level = 1 + (2 * stem - 1) / 1.5
            h = rest_level + (h - rest_level) * math.exp(-1.5 / 60 * (stop - t))
            if not over:
                t = end
                break
            t = stop
            stem = signal(t) - math.copysign(0.03, signal(t) - stem)
        levels.append(h)
    assert run.states[0, :, list(model.state_names).index("tank.h")] == pytest.approx(np.array(levels), rel=1e-6)


COMPRESSOR = """
model Compress "compressor between two vessels"
time t : s
use "lib/compressor.eq"
action speed : 1 = 0.9 in 0.5..1.1
action out : kmol/h = 150 in 50..300
use GasVessel as low(V = 20 [m^3])
use GasVessel as high(V = 5 [m^3], UA = 2 [kW/K])
use Compressor as K(KIND)
eq low.inlet.n = 160 [kmol/h]
eq low.inlet.T = 300 [K]
connect low.outlet -> K.inlet
connect K.outlet -> high.inlet
eq high.outlet.n = out
eq K.speed.y = speed
initial high.p = 2
observe high.p in 0..10
episode { step = 1 [s], max_steps = 100 }
"""


def compressed(Q, T, speed, polytropic):
    """Ratios of pressures and temperatures at a flow in m3/h."""
    head = 120e3 * speed**2 - 3e-3 * Q**2
    eta = 0.8 * (1 - 0.5 * (Q / (4000 * speed) - 1) ** 2)
    m = (0.4 / 1.4) / (eta if polytropic else 1)
    rise = 1 + m * head * 0.02897 / (GAS * T)
    return rise ** (1 / m), rise if polytropic else 1 + (rise - 1) / eta


def vessels(x, u, polytropic):
    p, T, p_2, T_2 = x[0] * 1e5, x[1], x[2] * 1e5, x[3]
    Q = brentq(lambda Q: compressed(Q, T, u[0], polytropic)[0] - p_2 / p, 1500, 7000, xtol=1e-9)
    n = p * Q / (GAS * T) / 3600  # mol/s
    T_in = T * compressed(Q, T, u[0], polytropic)[1]
    feed, out = 160e3 / 3600, u[1] * 1e3 / 3600
    rates = []
    for p_k, T_k, V, n_in, hot, n_out, UA in ((p, T, 20, feed, 300, n, 0), (p_2, T_2, 5, n, T_in, out, 2e3)):
        N = p_k * V / (GAS * T_k)
        # dU = cp (n_in T_in - n_out T) + q with U = N cv T, and dN = n_in - n_out.
        dU = 3.5 * GAS * (n_in * hot - n_out * T_k) + UA * (293 - T_k)
        dT = (dU / (2.5 * GAS) - (n_in - n_out) * T_k) / N
        rates += [((n_in - n_out) * T_k + N * dT) * GAS / V / 1e5, dT]
    return np.array(rates)


@pytest.mark.parametrize("polytropic", [True, False])
def test_compressor_between_vessels_follows_mass_and_energy(polytropic):
    kind = "" if polytropic else "polytropic = false"
    model = smpl.compile(source=COMPRESSOR.replace("(KIND)", f"({kind})" if kind else "") + END)
    actions = np.repeat([[0.9, 150.0], [1.0, 150.0], [1.0, 180.0]], 10, axis=0)
    found = difference(model, lambda x, u: vessels(x, u, polytropic), rest(model), actions, 1.0)
    assert found < 1e-6


def test_isentropic_compression_has_the_temperatures_of_a_textbook():
    """Air from 300 K to eight times the pressure: 543.4 K without losses; 85 % gives 586.4 K and 287.8 kJ/kg."""
    text = """
    model Point
    use "lib/compressor.eq"
    param eta = 1
    use Compressor as K(polytropic = false, head_0 = 500 [kJ/kg], eta_0 = eta, fall = 0)
    eq K.inlet.p = 1 [bar]
    eq K.inlet.T = 300 [K]
    eq K.outlet.p = 8 [bar]
    eq K.speed.y = 1
    observe T : K = K.outlet.T in 0..1000, w : kJ/kg = K.head/K.eta in 0..1000
    episode { step = 1 [s], max_steps = 1 }
    """
    model = smpl.compile(source=text)
    for eta in (1.0, 0.85):
        run = model.rollout([], np.zeros((1, 0)), parameters={"eta": eta})
        T, work = run.observations[0, -1]
        exact = 300 * 8 ** (0.4 / 1.4)
        assert exact == pytest.approx(543.4, abs=0.05)
        assert pytest.approx(300 + (exact - 300) / eta, rel=1e-9) == T
        assert work == pytest.approx(3.5 * GAS / 28.97 * (exact - 300) / eta, rel=1e-9)


DRUM = """
model Drum "ethanol and water, which are not ideal"
set species = { ethanol, water }
use "lib/drums.eq"
use "lib/mixtures.eq"
table tau[species, species] : 1 default 0 {
  ethanol: water = -0.06
  water:   ethanol = 1.7
}
table alpha[species, species] : 1 default 0.3 {
  ethanol: ethanol = 0
  water:   water = 0
}
component Liquid { def ln_gamma(i in species, x[species], T) = mixture_nrtl(i, x, tau, alpha) }
action T : degC = 83 in 78..100
action z : 1 = 0.3 in 0..1
use FlashDrum as real(properties = Liquid, p = 1.01325 [bar])
use FlashDrum as ideal(p = 1.01325 [bar])
eq real.T = T
eq ideal.T = T
eq real.feed.F = 100 [kmol/h]
eq real.feed.x[i] = if i == ethanol then z else 1 - z for i in species
eq ideal.feed.F = 100 [kmol/h]
eq ideal.feed.x[i] = real.feed.x[i] for i in species
observe real.share in 0..1, real.liquid.x[ethanol] in 0..1, ideal.share in 0..1, ideal.liquid.x[ethanol] in 0..1
episode { step = 1 [s], max_steps = 10 }
"""


def split(T, z, real):
    """Share of vapour and mole fraction of ethanol in the liquid, by bisection over the liquid's composition."""
    rows = {
        "e": (513.92, 61.3087, -8.51838, 0.341626, -5.73683, 8.32581),
        "w": (647.35, 221.223, -7.76451, 1.45838, -2.7758, -1.23303),
    }
    pressure = []
    for T_c, p_c, A, B, C, D in rows.values():
        x = 1 - T / T_c
        pressure.append(p_c * math.exp((A * x + B * x**1.5 + C * x**3 + D * x**6) / (T / T_c)))

    def K(x):
        x, tau = np.array([x, 1 - x]), np.array([[0, -0.06], [1.7, 0]])
        G = np.exp(-np.array([[0, 0.3], [0.3, 0]]) * tau)
        S, C = x @ G, x @ (tau * G)
        gamma = np.exp(C / S + (G * (tau - C / S) / S) @ x)
        return (gamma if real else 1) * np.array(pressure) / 1.01325

    # The bubble point fixes the liquid of two phases, the lever rule the share.
    liquid = brentq(lambda x: (K(x) * [x, 1 - x]).sum() - 1, 0.0, 1.0)
    return (z - liquid) / (K(liquid)[0] * liquid - liquid), liquid


@pytest.mark.parametrize(("T", "z"), [(86.0, 0.2), (90.0, 0.15), (95.0, 0.08)])
def test_flash_drum_takes_activities_from_its_package(T, z):
    model = smpl.compile(source=DRUM + END)
    run = model.rollout([], np.array([[T, z]]))
    assert run.observations[0, -1, :2] == pytest.approx(split(T + 273.15, z, True), abs=1e-7)
    ideal = split(T + 273.15, z, False)
    if 0 < ideal[0] < 1:
        assert run.observations[0, -1, 2:] == pytest.approx(ideal, abs=1e-7)


RECIPE = """
model Recipe "charge, heat, hold and drain, in a cycle of batches"
time t : min
unit amount = 1 [g]
set species = { salt }
use "lib/recipe.eq"
use Charge as charge(first = true, volume = 0.5 [m^3], Q = 3 [m^3/h])
use Ramp as heat(duration = 20 [min], from = 0.2, to = 0.8)
use Hold as hold(duration = 15 [min])
use RecipeStep as drain
use Tank as tank
eq charge.inlet.c[salt] = 3 [g/m^3]
eq charge.inlet.T = 20 [degC]
connect charge.outlet -> tank.inlet
connect charge.done -> heat.go
connect heat.done -> hold.go
connect hold.done -> drain.go
connect drain.done -> charge.go
eq tank.outlet.Q = 2 [m^3/h]*drain.on
eq drain.progress = (1.5 [m] - tank.h)/0.5 [m]
observe tank.h in 0..5, value = heat.value in 0..1, drain.on in 0..1
episode { step = 1 [min], max_steps = 300 }
"""


def test_blocks_of_a_recipe_follow_one_another_in_a_cycle():
    """Charge 10 min, ramp 20, hold 15, drain 15: a batch of 60 min; between instants all rates are constant."""
    model = smpl.compile(source=RECIPE + END)
    run = model.rollout(rest(model), np.zeros((290, 0)))
    t = np.arange(291.0)
    phase = np.mod(t, 60)
    h = 1 + 0.5 * np.interp(phase, [0, 10, 45, 60], [0, 1, 1, 0])
    assert run.observations[0, :, 0] == pytest.approx(h, abs=1e-6)
    inside = (phase % 5 != 0) & (t > 0)
    value = np.where(phase < 10, np.where(t < 10, 0.2, 0.8), np.interp(phase, [10, 30], [0.2, 0.8]))
    assert run.observations[0, inside, 1] == pytest.approx(value[inside], abs=1e-6)
    assert np.array_equal(run.observations[0, inside, 2], (phase[inside] > 45).astype(float))
