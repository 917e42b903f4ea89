"""Property functions of the library against published tables and formulas written anew in Python."""

import numpy as np
import pytest
from numpy.polynomial import polynomial
from scipy.integrate import quad

from plants import values

# The library compiles without warnings.
pytestmark = pytest.mark.filterwarnings("error::smpl.CompileWarning")

STEAM = """
use "lib/steam.eq"
param p : MPa  = 1
param T : K    = 400
let v1 : m^3/kg    = water_v(p, T)
let h1 : kJ/kg     = water_h(p, T)
let s1 : kJ/(kg K) = water_s(p, T)
let v2 : m^3/kg    = steam_v(p, T)
let h2 : kJ/kg     = steam_h(p, T)
let s2 : kJ/(kg K) = steam_s(p, T)
let ps : MPa       = water_psat(T)
let Ts : K         = water_Tsat(p)
"""


@pytest.mark.parametrize(
    ("region", "T", "p", "printed"),
    [
        # IAPWS R7-97(2012), tables 5 and 15: v in m3/kg, h in kJ/kg, s in kJ/(kg K).
        (1, 300, 3, ("0.100215168e-2", "0.115331273e3", "0.392294792e0")),
        (1, 300, 80, ("0.971180894e-3", "0.184142828e3", "0.368563852e0")),
        (1, 500, 3, ("0.120241800e-2", "0.975542239e3", "0.258041912e1")),
        (2, 300, 0.0035, ("0.394913866e2", "0.254991145e4", "0.852238967e1")),
        (2, 700, 0.0035, ("0.923015898e2", "0.333568375e4", "0.101749996e2")),
        (2, 700, 30, ("0.542946619e-2", "0.263149474e4", "0.517540298e1")),
    ],
)
def test_water_and_steam_agree_with_all_digits_of_the_release(region, T, p, printed):
    found = values(STEAM, T=T, p=p)
    for name, text in zip("vhs", printed, strict=True):
        assert f"{found[f'{name}{region}']:.8e}" == f"{float(text):.8e}", name


@pytest.mark.parametrize(("T", "printed"), [(300, 0.353658941e-2), (500, 0.263889776e1), (600, 0.123443146e2)])
def test_saturation_pressure_agrees_with_table_35(T, printed):
    assert f"{values(STEAM, T=T)['ps']:.8e}" == f"{printed:.8e}"


@pytest.mark.parametrize(("p", "printed"), [(0.1, 0.372755919e3), (1, 0.453035632e3), (10, 0.584149488e3)])
def test_saturation_temperature_agrees_with_table_36(p, printed):
    assert f"{values(STEAM, p=p)['Ts']:.8e}" == f"{printed:.8e}"


def test_boiling_points_by_antoine_are_those_of_reference_equations():
    """Temperatures at 101325 Pa by CoolProp 8.0 in K; Stull's row of water ends there with 0.5 K."""
    found = values(
        'use "lib/antoine.eq"\n'
        "let T_b[i in antoine_substances] : K = antoine_boiling(i, 1 [atm])\n"
        "let p[i in antoine_substances] : bar = antoine(i, T_b[i])\n"
    )
    known = {
        "water": 373.124, "water_hot": 373.124, "methanol": 337.632, "ethanol": 351.570, "acetone": 329.225,
        "benzene": 353.216, "toluene": 383.746, "ethylbenzene": 409.314, "cyclohexane": 353.865, "hexane": 341.866,
        "heptane": 371.533, "octane": 398.794,
    }  # fmt: skip
    assert len(found) == 2 * len(known) + 2  # water_cold ends at 303 K
    for name, temperature in known.items():
        assert found[f"T_b[{name}]"] == pytest.approx(temperature, abs=0.5 if name == "water" else 0.2), name
        assert found[f"p[{name}]"] == pytest.approx(1.01325, rel=1e-12), name


@pytest.mark.parametrize(
    ("name", "T", "pascal"),
    [
        # CoolProp 8.0.
        ("water", 298.15, 3169.93), ("water_cold", 298.15, 3169.93), ("methanol", 298.15, 16981.4),
        ("ethanol", 300, 8767.9), ("acetone", 298.15, 30727.2), ("benzene", 298.15, 12694.7), ("toluene", 350, 34821.2),
    ],
)  # fmt: skip
def test_vapour_pressures_are_those_of_reference_equations(name, T, pascal):
    found = values(f'use "lib/antoine.eq"\nparam T : K = 300\nlet p : Pa = antoine({name}, T)\n', T=T)
    assert found["p"] == pytest.approx(pascal, rel=6e-3)


GASES = """
use "lib/gas.eq"
param T : K = 500
let cp[i in shomate_gases] : J/(mol K) = shomate_heat_capacity(i, T)
let h[i in shomate_gases]  : kJ/mol    = shomate_enthalpy(i, T)
let s[i in shomate_gases]  : J/(mol K) = shomate_entropy(i, T)
"""


def test_ideal_gases_agree_with_the_tables_of_janaf():
    """Chase 1998 at 1000 K: heat capacity, enthalpy above 298.15 K and of formation, entropy; J, kJ, J per mol."""
    found = values(GASES, T=1000)
    for name, cp, rise, formation, s in [
        ("N2_hot", 32.697, 21.463, 0.0, 228.170),
        ("O2_hot", 34.870, 22.703, 0.0, 243.578),
        ("CO2", 54.308, 33.397, -393.522, 269.299),
        ("H2O", 41.268, 26.000, -241.826, 232.738),
        ("CH4", 71.795, 38.179, -74.873, 247.549),
        ("H2", 30.205, 20.680, 0.0, 166.216),
        ("CO", 33.183, 21.690, -110.527, 234.538),
    ]:
        assert found[f"cp[{name}]"] == pytest.approx(cp, abs=0.01), name
        assert found[f"h[{name}]"] == pytest.approx(rise + formation, abs=0.005), name
        assert found[f"s[{name}]"] == pytest.approx(s, abs=0.005), name


@pytest.mark.parametrize(("cold", "hot", "T"), [("N2", "N2_hot", 500), ("O2", "O2_hot", 700)])
def test_rows_of_one_gas_meet(cold, hot, T):
    found = values(GASES, T=T)
    for name, slack in (("cp", 0.01), ("h", 0.004), ("s", 0.004)):
        assert found[f"{name}[{cold}]"] == pytest.approx(found[f"{name}[{hot}]"], abs=slack), name


PROPANE = """
use "lib/cubic.eq"
param T : K   = 300
param p : bar = 5
use PengRobinsonVapour as gas(T_c = 369.83 [K], p_c = 42.48 [bar], omega = 0.152)
use PengRobinsonLiquid as liquid(T_c = 369.83 [K], p_c = 42.48 [bar], omega = 0.152)
eq gas.T = T
eq gas.p = p
eq liquid.T = T
eq liquid.p = p
let phi_gas : 1    = gas.ln_phi
let phi_liquid : 1 = liquid.ln_phi
let a_srk : J m^3/mol^2 = srk_a(T, 369.83 [K], 42.48 [bar], 0.152)
let b_srk : m^3/mol     = srk_b(369.83 [K], 42.48 [bar])
let p_srk : bar         = srk_pressure(T, 2e-3 [m^3/mol], a_srk, b_srk)
let a_pr : J m^3/mol^2  = pr_a(T, 369.83 [K], 42.48 [bar], 0.152)
let p_pr  : bar         = pr_pressure(T, gas.v, a_pr, pr_b(369.83 [K], 42.48 [bar]))
let z_srk : 1               = p_srk*2e-3 [m^3/mol]/(R_cubic*T)
let A_srk : 1               = a_srk*p_srk/sq(R_cubic*T)
let B_srk : 1               = b_srk*p_srk/(R_cubic*T)
let zero_srk : 1            = srk_polynomial(z_srk, A_srk, B_srk)
let phi_srk : 1             = srk_ln_phi(z_srk, A_srk, B_srk)
"""
GAS = 8.31446261815324


def pressures(T, T_c=369.83, p_c=42.48e5, omega=0.152):
    """Pressure as a function of the volume by Peng-Robinson and by Soave, with the covolumes."""
    reduced = 1 - np.sqrt(T / T_c)
    a = 0.45723552892138 * (GAS * T_c) ** 2 / p_c
    a *= (1 + (0.37464 + 1.54226 * omega - 0.26992 * omega**2) * reduced) ** 2
    b = 0.07779607390389 * GAS * T_c / p_c
    third = 2 ** (1 / 3) - 1
    a_s = (GAS * T_c) ** 2 / p_c / (9 * third) * (1 + (0.48 + 1.574 * omega - 0.176 * omega**2) * reduced) ** 2
    b_s = third / 3 * GAS * T_c / p_c
    return (
        (lambda v: GAS * T / (v - b) - a / (v * (v + b) + b * (v - b)), a, b),
        (lambda v: GAS * T / (v - b_s) - a_s / (v * (v + b_s)), a_s, b_s),
    )


def fugacity(pressure, T, v):
    """Logarithm of the fugacity coefficient by integration over the volume."""
    Z = pressure(v) * v / (GAS * T)
    work = quad(lambda r: (GAS * T * r - pressure(1 / r)) / r**2, 1e-9, 1 / v, epsabs=1e-10, epsrel=1e-12, limit=500)[0]
    return -work / (GAS * T) - np.log(Z) + Z - 1


@pytest.mark.parametrize(("T", "p"), [(300, 5.0), (250, 2.0), (340, 30.0), (340, 22.0)])
def test_peng_robinson_finds_the_root_of_each_phase(T, p):
    found = values(PROPANE, T=T, p=p)
    pressure, a, b = pressures(T)[0]
    A, B = a * p * 1e5 / (GAS * T) ** 2, b * p * 1e5 / (GAS * T)
    roots = polynomial.polyroots([-(A * B - B**2 - B**3), A - 3 * B**2 - 2 * B, -(1 - B), 1])
    real = np.sort(roots[np.abs(roots.imag) < 1e-9].real)
    assert found["gas.Z"] == pytest.approx(real[-1], rel=1e-9)
    assert found["liquid.u"] * B == pytest.approx(real[0], rel=1e-9)
    assert found["p_pr"] == pytest.approx(p, rel=1e-9)
    for phase in ("gas", "liquid"):
        expected = fugacity(pressure, T, found[f"{phase}.v"])
        assert found[f"phi_{phase}"] == pytest.approx(expected, abs=1e-7), phase


def test_soave_redlich_kwong_agrees_with_its_integral_over_the_volume():
    found = values(PROPANE)
    pressure, _, _ = pressures(300)[1]
    assert found["p_srk"] == pytest.approx(pressure(2e-3) / 1e5, rel=1e-12)
    assert abs(found["zero_srk"]) < 1e-14
    assert found["phi_srk"] == pytest.approx(fugacity(pressure, 300, 2e-3), abs=1e-7)


@pytest.mark.parametrize(("T", "known"), [(250, 2.1796), (300, 9.9768), (340, 24.3105)])
def test_equal_fugacities_give_the_vapour_pressure_of_propane(T, known):
    """CoolProp 8.0, bar; Peng-Robinson deviates by less than 1 %."""
    text = PROPANE.replace(
        "param p : bar = 5", f"var p : bar = {1.1 * known} in 0.1..40\neq gas.ln_phi = liquid.ln_phi"
    )
    assert values(text, T=T)["p"] == pytest.approx(known, rel=0.01)


def nrtl(x, tau, alpha):
    """Logarithms of activity coefficients for any number of components, Renon and Prausnitz 1968."""
    G = np.exp(-alpha * tau)
    S, C = x @ G, x @ (tau * G)
    return C / S + (G * (tau - C / S) / S) @ x


def wilson(x, L):
    """The same by Wilson 1964."""
    return 1 - np.log(L @ x) - (x / (L @ x)) @ L


ACTIVITY = """
use "lib/activity.eq"
param x = 0.3
let n1 : 1 = nrtl(x, 1.2, -0.4, 0.3)
let n2 : 1 = nrtl(1 - x, -0.4, 1.2, 0.3)
let w1 : 1 = wilson(x, 0.35, 0.8)
let w2 : 1 = wilson(1 - x, 0.8, 0.35)
let m1 : 1 = margules(x, 0.6, 1.1)
let m2 : 1 = margules(1 - x, 1.1, 0.6)
let v1 : 1 = van_laar(x, 0.6, 1.1)
let v2 : 1 = van_laar(1 - x, 1.1, 0.6)
let L : 1  = wilson_parameter(353.15 [K], 76.92 [cm^3/mol], 18.07 [cm^3/mol], 437.98 [cal/mol])
"""


@pytest.mark.parametrize("x", [1e-6, 0.3, 0.5, 0.97])
def test_activity_coefficients_agree_with_the_formulas_for_many_components(x):
    found, mole = values(ACTIVITY, x=x), np.array([x, 1 - x])
    expected = nrtl(mole, np.array([[0, 1.2], [-0.4, 0]]), 0.3)
    assert [found["n1"], found["n2"]] == pytest.approx(expected, abs=1e-12)
    expected = wilson(mole, np.array([[1, 0.35], [0.8, 1]]))
    assert [found["w1"], found["w2"]] == pytest.approx(expected, abs=1e-12)
    # Margules and van Laar from the excess Gibbs energy G = x1 x2 g, by differences.
    for name, g in (
        ("m", lambda x: 1.1 * x + 0.6 * (1 - x)),
        ("v", lambda x: 0.6 * 1.1 / (0.6 * x + 1.1 * (1 - x))),
    ):
        G, h = (lambda x, g=g: x * (1 - x) * g(x)), 1e-7
        slope = (G(x + h) - G(x - h)) / (2 * h)
        assert [found[f"{name}1"], found[f"{name}2"]] == pytest.approx(
            [G(x) + (1 - x) * slope, G(x) - x * slope], abs=1e-8
        ), name
    assert found["L"] == pytest.approx(18.07 / 76.92 * np.exp(-437.98 * 4.184 / (GAS * 353.15)), rel=1e-12)


def test_margules_reproduces_the_example_of_a_textbook():
    """Smith, Van Ness and Abbott: methanol, methyl acetate, 318.15 K, x = 0.25: 1.864, 1.072, 73.50 kPa, y = 0.282."""
    found = values("""
    use "lib/activity.eq"
    param x = 0.25
    let A      = 2.771 - 0.00523*318.15
    let p_1 : kPa = exp(16.59158 - 3643.31/(318.15 - 33.424)) as [kPa]
    let p_2 : kPa = exp(14.25326 - 2665.54/(318.15 - 53.424)) as [kPa]
    let g_1 : 1 = exp(margules(x, A, A))
    let g_2 : 1 = exp(margules(1 - x, A, A))
    let p : kPa = x*g_1*p_1 + (1 - x)*g_2*p_2
    let y : 1 = x*g_1*p_1/p
    """)
    assert [found["g_1"], found["g_2"], found["y"]] == pytest.approx([1.864, 1.072, 0.282], abs=6e-4)
    assert found["p"] == pytest.approx(73.50, abs=0.02)


@pytest.mark.parametrize(
    ("T", "wet", "w", "relative", "dew", "h", "v"),
    [
        # CoolProp 8.0 at 101325 Pa: humidity ratio, relative humidity, degC, kJ/kg, m3/kg.
        (25, 18, 0.0100701, 0.507158, 14.0858, 50.7910, 0.857984),
        (35, 30, 0.0251610, 0.696735, 28.6240, 99.7372, 0.907935),
        (10, 7, 0.00501110, 0.656730, 3.8777, 22.6784, 0.808190),
    ],
)
def test_humid_air_agrees_with_real_gas_values(T, wet, w, relative, dew, h, v):
    found = values(
        'use "lib/air.eq"\nparam T : degC = 20\nparam T_wet : degC = 15\n'
        "let w : 1 = air_wet_bulb_humidity(T, T_wet, 1 [atm])\n"
        "let relative : % = air_relative_humidity(T, w, 1 [atm])\n"
        "let dew : degC = air_dew_point(w, 1 [atm])\n"
        "let h : kJ/kg = air_enthalpy(T, w)\n"
        "let v : m^3/kg = air_volume(T, w, 1 [atm])\n",
        T=T,
        T_wet=wet,
    )
    assert found["w"] == pytest.approx(w, rel=1e-2)
    assert found["relative"] == pytest.approx(100 * relative, rel=1e-2)
    assert found["dew"] == pytest.approx(dew, abs=0.1)
    assert found["h"] == pytest.approx(h, rel=6e-3)
    assert found["v"] == pytest.approx(v, rel=1e-3)
