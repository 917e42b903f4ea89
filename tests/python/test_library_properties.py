"""Data of substances, DIPPR correlations, gases and validity ranges of the library, against published values."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

import smpl
from plants import values

# The library compiles without warnings.
pytestmark = pytest.mark.filterwarnings("error::smpl.CompileWarning")

LIBRARY = Path(__file__).resolve().parents[2] / "models/lib"
# Fluids of CoolProp.
COOLPROP = {
    "hydrogen": "Hydrogen", "helium": "Helium", "argon": "Argon", "nitrogen": "Nitrogen",
    "oxygen": "Oxygen", "carbon_monoxide": "CarbonMonoxide", "carbon_dioxide": "CarbonDioxide", "water": "Water",
    "methane": "Methane", "ethane": "Ethane", "propane": "n-Propane", "butane": "n-Butane", "isobutane": "IsoButane",
    "pentane": "n-Pentane", "hexane": "n-Hexane", "heptane": "n-Heptane", "octane": "n-Octane", "nonane": "n-Nonane",
    "decane": "n-Decane", "ethylene": "Ethylene", "propylene": "Propylene", "cyclohexane": "CycloHexane",
    "benzene": "Benzene", "toluene": "Toluene", "o_xylene": "o-Xylene", "p_xylene": "p-Xylene", "methanol": "Methanol",
    "ethanol": "Ethanol", "dimethyl_ether": "DimethylEther", "diethyl_ether": "DiethylEther", "acetone": "Acetone",
    "ethylene_oxide": "EthyleneOxide", "ammonia": "Ammonia", "sulfur_dioxide": "SulfurDioxide",
    "hydrogen_chloride": "HydrogenChloride", "chlorine": "Chlorine", "hydrogen_sulfide": "HydrogenSulfide",
    "air": "Air",
}  # fmt: skip


def rows(file, names):
    """Numbers of the table of a file, by substance and column."""
    text = (LIBRARY / file).read_text(encoding="utf-8")
    found = {name: [float(x) for x in row.split(",")] for name, row in re.findall(r"^  (\w+): +(.*)$", text, re.M)
             if name != "columns"}  # fmt: skip
    return {name: dict(zip(names, row, strict=True)) for name, row in found.items()}


SUBSTANCES = rows("substances.eq", ["M", "T_c", "p_c", "omega", "T_b", "h", "A", "B", "C", "D", "low"])


def wagner(T, T_c, p_c, A, B, C, D):
    x = 1 - T / T_c
    return p_c * math.exp((A * x + B * x**1.5 + C * x**3 + D * x**6) / (T / T_c))


def test_the_data_set_has_44_substances():
    assert len(SUBSTANCES) == 44


def test_boiling_points_by_wagner_are_the_listed_ones():
    """Half a percent; the temperature solves the model's equation. Carbon dioxide sublimes at 1 atm."""
    found = values(
        'use "lib/substances.eq"\n'
        "var T[i in pure_substances] : K = 0.65*critical_T[i] in 2..600\n"
        "eq wagner(i, T[i]) = 1 [atm] for i in pure_substances\n"
        "let T_b[i in pure_substances] : K = T[i]\n"
    )
    for name, row in SUBSTANCES.items():
        if name != "carbon_dioxide":
            assert found[f"T_b[{name}]"] == pytest.approx(row["T_b"], rel=5e-3), name


def test_acentric_factors_follow_their_definition():
    found = values(
        'use "lib/substances.eq"\n'
        "let w[i in pure_substances] : 1 = -log10(wagner(i, 0.7*critical_T[i])/critical_p[i]) - 1\n"
        "let M[i in pure_substances] : g/mol = substance_M[i]\n"
    )
    for name, row in SUBSTANCES.items():
        own = wagner(0.7, 1, 1, *(row[key] for key in "ABCD"))
        assert found[f"w[{name}]"] == pytest.approx(-math.log10(own) - 1, abs=1e-12), name
        assert row["omega"] == pytest.approx(found[f"w[{name}]"], abs=6e-4), name
        assert found[f"M[{name}]"] == row["M"]


def test_formation_enthalpies_close_reactions():
    """Heats of reaction at 298.15 K in kJ/mol: NIST Chemistry WebBook and JANAF, kJ."""
    h = {name: row["h"] for name, row in SUBSTANCES.items()}
    assert h["carbon_monoxide"] + h["water"] - h["carbon_dioxide"] == pytest.approx(41.17, abs=0.5)
    assert h["methane"] + h["water"] - h["carbon_monoxide"] == pytest.approx(-206.1 + 2 * 0.2, abs=0.6)
    # Burning methane to water vapour gives 802.3 kJ/mol, hydrogenation of benzene 206.0 kJ/mol.
    assert h["methane"] - h["carbon_dioxide"] - 2 * h["water"] == pytest.approx(802.3, abs=0.5)
    assert h["benzene"] - h["cyclohexane"] == pytest.approx(206.0, abs=1.0)


def test_substances_agree_with_an_independent_package():
    """CoolProp: pressures at 0.75 and 0.95 of the critical temperature, constants, masses."""
    coolprop = pytest.importorskip("CoolProp.CoolProp", reason="CoolProp is not installed")
    text = 'use "lib/substances.eq"\nparam r : 1 = 0.7\n' + (
        "let p[i in pure_substances] : Pa = wagner(i, r*critical_T[i])\n"
    )
    for name, row in SUBSTANCES.items():
        if name not in COOLPROP:
            continue
        fluid = COOLPROP[name]
        assert row["M"] == pytest.approx(1e3 * coolprop.PropsSI("M", fluid), rel=2e-4), name
        assert row["T_c"] == pytest.approx(coolprop.PropsSI("Tcrit", fluid), rel=4e-3), name
        assert row["p_c"] == pytest.approx(1e-5 * coolprop.PropsSI("pcrit", fluid), rel=0.025), name
        assert row["omega"] == pytest.approx(coolprop.PropsSI("acentric", fluid), abs=0.011), name
    for r in (0.75, 0.95):
        found = values(text, r=r)
        for name, row in SUBSTANCES.items():
            T = r * row["T_c"]
            if name in COOLPROP and row["low"] < T:
                known = coolprop.PropsSI("P", "T", T, "Q", 0, COOLPROP[name])
                assert found[f"p[{name}]"] == pytest.approx(known, rel=0.015), (name, r)


DIPPR = """
use "lib/dippr.eq"
param T : K = 300
let water : Pa       = dippr_101(T, 73.649, -7258.2, -7.3037, 4.1653e-6, 2) as [Pa]
let methanol : 1     = dippr_105(T, 2.3267, 0.27073, 512.5, 0.24713)
let nitrogen : 1     = dippr_102(T, 6.5592e-7, 0.6081, 54.714, 0)
let heat : 1         = dippr_106(T, 647.096 [K], 5.2053e7, 0.3199, -0.212, 0.25795, 0)
let capacity : 1     = dippr_107(T, 0.39252e5, 0.879e5, 1.9165e3, 0.53654e5, 896.7)
let liquid : 1       = dippr_100(T, 276370, -2090.1, 8.125, -0.014116, 9.3701e-6)
"""


@pytest.mark.parametrize(
    ("name", "T", "printed"),
    [
        # Perry's Chemical Engineers' Handbook, 8th edition: values at the ends of the ranges, in tables
        # 2-8 (Pa), 2-32 (kmol/m3), 2-150 (J/kmol), 2-153 and 2-156 (J/(kmol K)), 2-312 (Pa s).
        ("water", 273.16, "6.1056e2"), ("water", 647.096, "2.1930e7"),
        ("methanol", 175.47, "2.7915e1"), ("methanol", 512.5, "8.594e0"),
        ("nitrogen", 63.15, "4.372e-6"), ("nitrogen", 1970, "6.432e-5"),
        ("heat", 273.16, "4.473e7"),
        ("capacity", 200, "3.980e4"), ("capacity", 1500, "1.0533e5"),
        ("liquid", 273.16, "7.615e4"), ("liquid", 533.15, "8.939e4"),
    ],
)  # fmt: skip
def test_forms_of_dippr_reproduce_printed_values(name, T, printed):
    """To two units of the last digit: the coefficients have five digits."""
    mantissa, exponent = printed.split("e")
    unit = 10.0 ** (int(exponent) - (len(mantissa) - 2))
    assert values(DIPPR, T=T)[name] == pytest.approx(float(printed), abs=2 * unit)


@pytest.mark.parametrize(
    ("name", "T_b", "heat", "hot", "bar"),
    [
        # CoolProp 8.0: K and J/mol at 101325 Pa, pressure in bar at another temperature.
        ("ammonia", 239.834, 23326, 287.8, 7.19788), ("hydrogen_sulfide", 212.855, 18622, 255.4, 5.90586),
        ("sulfur_dioxide", 263.137, 24956, 315.8, 6.81091), ("hydrogen_chloride", 188.173, 16180, 225.8, 5.83785),
        ("chlorine", 239.198, 20347, 287.0, 5.66713), ("water", 373.124, 40651, 447.7, 8.84199),
        ("methanol", 337.632, 35281, 405.2, 8.87681), ("ethanol", 351.570, 39140, 421.9, 9.51369),
        ("acetone", 329.225, 29122, 395.1, 6.31888), ("benzene", 353.216, 30749, 423.9, 5.90861),
        ("toluene", 383.746, 33234, 460.5, 5.95264), ("propane", 231.036, 18767, 277.2, 5.36580),
    ],
)  # fmt: skip
def test_vapour_pressures_and_heats_of_dippr_are_those_of_reference_equations(name, T_b, heat, hot, bar):
    text = (
        'use "lib/dippr.eq"\nparam T : K = 300\n'
        f"let p : bar = dippr_pressure({name}, T)\nlet h : J/mol = dippr_vaporisation({name}, T)\n"
    )
    found = values(text, T=T_b)
    assert found["p"] == pytest.approx(1.01325, rel=0.01)
    assert found["h"] == pytest.approx(heat, rel=0.025)
    assert values(text, T=hot)["p"] == pytest.approx(bar, rel=0.03 if name == "sulfur_dioxide" else 0.01)


@pytest.mark.parametrize("T", [300, 500])
def test_gases_have_the_viscosity_and_conductivity_of_reference_equations(T):
    """CoolProp 8.0 at zero density: uPa s and mW/(m K)."""
    known = {
        300: {
            "air": (18.523, 26.353), "nitrogen": (17.877, 25.936), "oxygen": (20.631, 26.44),
            "hydrogen": (8.9379, 186.56), "helium": (19.926, 155.9), "argon": (22.724, 17.804),
            "carbon_dioxide": (14.994, 16.719),
            "water": (9.7681, 18.563), "methane": (11.242, 34.322), "ethane": (9.3864, 21.129),
            "propane": (8.2035, 18.492), "ammonia": (10.188, 24.988), "hydrogen_sulfide": (12.197, None),
        },
        500: {
            "air": (27.08, 39.927), "nitrogen": (26.056, 39.024), "oxygen": (30.47, 41.019),
            "hydrogen": (12.738, 270.94), "helium": (28.361, 222.23), "argon": (34.068, 26.705),
            "carbon_dioxide": (23.91, 32.837),
            "water": (17.326, 35.781), "methane": (16.967, 68.46), "ethane": (14.759, 53.737),
            "propane": (13.273, 46.227), "ammonia": (17.862, 53.053),
        },
    }[T]  # fmt: skip
    found = values(
        'use "lib/transport.eq"\nparam T : K = 300\n'
        "let mu[i in transport_gases] : uPa s = gas_viscosity(i, T)\n"
        "let k[i in transport_gases] : mW/(m K) = gas_conductivity(i, T)\n"
        "let s : uPa s = sutherland(T, 17.16 [uPa s], 273.15 [K], 110.4 [K])\n",
        T=T,
    )
    for name, (mu, k) in known.items():
        assert found[f"mu[{name}]"] == pytest.approx(mu, rel=0.05), name
        if k is not None:
            assert found[f"k[{name}]"] == pytest.approx(k, rel=0.06), name
    assert found["s"] == pytest.approx(known["air"][0], rel=0.015)


RANGE = """
model Range
time t : s
use "lib/antoine.eq"
use "lib/validity.eq"
param rise : K/s = 20
state T : K = 300 in 0..1000
eq d/dt T = rise*cos(t/1 [s])
component Counted extends ValidRange {
  discrete times : 1 = 0 in 0..10
  at left { next warned = 1 ; next times = times + 1 }
}
use Counted as valid
eq valid.place = place_in(T, 285 [K], 315 [K])
let p : bar = antoine(water_cold, T)
let warned : 1 = valid.warned
observe p in 0..10, warned in 0..1
let count : 1 = valid.times
episode { step = 1 [s], max_steps = 20 }
"""


@pytest.mark.parametrize(("rise", "start", "first"), [(20, 300, 1), (-20, 300, 1), (5, 300, None), (1, 330, 1)])
def test_a_range_that_is_left_is_an_event_once_in_an_episode(rise, start, first):
    """Temperatures move by the amplitude `rise` about the start; the range is 15 K wide on both sides of 300 K."""
    model = smpl.compile(source=RANGE)
    run = model.rollout([float(start)], np.zeros((20, 0)), parameters={"rise": rise}, outputs=True)
    names = list(model.algebraic_names)
    warned = run.outputs[0, :, names.index("warned")]
    count = run.outputs[0, :, names.index("count")]
    assert not run.failure[0]
    assert count[-1] == (0 if first is None else 1)
    expected = np.zeros(21) if first is None else np.arange(21) >= first
    assert np.array_equal(warned, expected.astype(float))


# Gmehling et al., Chemical Thermodynamics for Process Simulation: problem 5.1 (ethanol, water at 343.15 K);
# Poling, Prausnitz and O'Connell, examples 8-3 (ethanol, benzene at 260 K).
@pytest.mark.parametrize(
    ("x", "r", "q", "tau", "gammas", "slack"),
    [
        (0.252, (2.1055, 0.92), (1.972, 1.4), (1.0919744384510301, 0.37452902779205477), (2.3588, 1.2442), 1e-4),
        (0.7566, (2.1055, 3.1878), (1.972, 2.4), (1.17984681869376, 0.22826016391070073), (1.083, 3.018), 1e-3),
    ],
)
def test_uniquac_reproduces_published_binaries(x, r, q, tau, gammas, slack):
    found = values(
        'use "lib/activity.eq"\n'
        f"let a : 1 = exp(uniquac({x}, {r[0]}, {r[1]}, {q[0]}, {q[1]}, {tau[0]}, {tau[1]}))\n"
        f"let b : 1 = exp(uniquac(1 - {x}, {r[1]}, {r[0]}, {q[1]}, {q[0]}, {tau[1]}, {tau[0]}))\n"
    )
    assert [found["a"], found["b"]] == pytest.approx(gammas, abs=slack)


MIXTURE = """
set species = { a, b, c }
use "lib/mixtures.eq"
param x_a = 0.3, x_b = 0.2
let x[i in species] = { a: x_a, b: x_b, c: 1 - x_a - x_b }
"""


def matrix(name, numbers):
    """A table over pairs of species."""
    lines = (
        f"  {i}: " + ", ".join(f"{j} = {value}" for j, value in zip("abc", row, strict=True))
        for i, row in zip("abc", numbers, strict=True)
    )
    return f"table {name}[species, species] : 1 default 0 {{\n" + "\n".join(lines) + "\n}\n"


def vector(name, numbers):
    return f"table {name}[species] : 1 = {{ a: {numbers[0]}, b: {numbers[1]}, c: {numbers[2]} }}\n"


@pytest.mark.parametrize(
    ("T", "x", "r", "q", "energies", "gammas", "slack"),
    [
        # Poling et al., problem 8.32: acetonitrile, benzene, heptane.
        (318.15, (0.1311, 0.0330, 0.8359), (1.87, 3.19, 5.17), (1.72, 2.4, 4.4),
         [[0, 60.28, 23.71], [89.57, 0, -135.9], [545.8, 245.4, 0]], (7.15, 1.25, 1.06), 5e-3),
        # Gmehling et al., example 5.19: water, ethanol, benzene, both liquid phases.
        (298.15, (0.7273, 0.0909, 0.1818), (0.92, 2.1055, 3.1878), (1.4, 1.972, 2.4),
         [[0, 526.02, 309.64], [-318.06, 0, -91.532], [1325.1, 302.57, 0]], (1.570, 0.2948, 18.11), 5e-3),
        (298.15, (1 / 6, 1 / 6, 2 / 3), (0.92, 2.1055, 3.1878), (1.4, 1.972, 2.4),
         [[0, 526.02, 309.64], [-318.06, 0, -91.532], [1325.1, 302.57, 0]], (8.856, 0.860, 1.425), 6e-4),
    ],
)  # fmt: skip
def test_uniquac_reproduces_published_ternaries(T, x, r, q, energies, gammas, slack):
    tau = np.exp(-np.array(energies) / T)
    found = values(
        MIXTURE + vector("r", r) + vector("q", q) + matrix("tau", tau)
        + "let g[i in species] : 1 = exp(mixture_uniquac(i, x, r, q, tau))\n",
        x_a=x[0], x_b=x[1],
    )  # fmt: skip
    assert [found[f"g[{i}]"] for i in "abc"] == pytest.approx(gammas, abs=slack)


def test_wilson_of_a_mixture_reproduces_a_published_ternary():
    """Dortmund Data Bank, worksheet 5.09: mole fractions 0.229, 0.175, 0.596."""
    L = [
        [1, 1.1229699812593, 0.73911816162836],
        [3.26947621620298, 1, 1.16749678447695],
        [0.37280197780932, 0.01917909648619, 1],
    ]
    text = MIXTURE + matrix("L", L) + "let g[i in species] : 1 = exp(mixture_wilson(i, x, L))\n"
    found = values(text, x_a=0.229, x_b=0.175)
    expected = (1.22339343348885, 1.10094590247015, 1.2052899281172)
    assert [found[f"g[{i}]"] for i in "abc"] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("x", [(0.3, 0.2), (1e-6, 0.5), (0.0, 0.0)])
def test_nrtl_of_a_mixture_is_the_derivative_of_the_excess_energy(x):
    """Renon and Prausnitz: G/RT = sum x_i (sum_j tau_ji G_ji x_j)/(sum_k G_ki x_k); derivatives by complex steps."""
    tau = np.array([[0, 1.2, 0.4], [-0.4, 0, 0.9], [1.7, 0.3, 0]])
    alpha = np.array([[0, 0.3, 0.2], [0.3, 0, 0.47], [0.2, 0.47, 0]])
    G = np.exp(-alpha * tau)

    def energy(n):
        x = n / n.sum()
        return n.sum() * (x * ((x @ (tau * G)) / (x @ G))).sum()

    mole = np.array([*x, 1 - sum(x)], complex)
    expected = [energy(mole + 1e-30j * np.eye(3)[i]).imag / 1e-30 for i in range(3)]
    found = values(
        MIXTURE + matrix("tau", tau) + matrix("alpha", alpha)
        + "let g[i in species] : 1 = mixture_nrtl(i, x, tau, alpha)\n",
        x_a=x[0], x_b=x[1],
    )  # fmt: skip
    assert [found[f"g[{i}]"] for i in "abc"] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(("T", "p"), [(300, 5.0), (250, 2.0), (340, 22.0)])
def test_soave_redlich_kwong_finds_the_root_of_each_phase(T, p):
    """Roots of the cubic by NumPy for propane, and equal fugacities at a pressure near that of saturation."""
    found = values(
        'use "lib/cubic.eq"\nparam T : K = 300\nparam p : bar = 5\n'
        "use SoaveVapour as gas(T_c = 369.83 [K], p_c = 42.48 [bar], omega = 0.152)\n"
        "use SoaveLiquid as liquid(T_c = 369.83 [K], p_c = 42.48 [bar], omega = 0.152)\n"
        "eq gas.T = T\neq gas.p = p\neq liquid.T = T\neq liquid.p = p\n"
        "let Z : 1 = liquid.Z\nlet v : m^3/mol = liquid.v\n",
        T=T, p=p,
    )  # fmt: skip
    third = 2 ** (1 / 3) - 1
    m = 0.48 + 1.574 * 0.152 - 0.176 * 0.152**2
    reduced, pressure = T / 369.83, p / 42.48
    A = (1 + m * (1 - math.sqrt(reduced))) ** 2 * pressure / reduced**2 / (9 * third)
    B = third / 3 * pressure / reduced
    roots = np.roots([1, -1, A - B - B**2, -A * B])
    real = np.sort(roots[np.abs(roots.imag) < 1e-9].real)
    assert found["gas.Z"] == pytest.approx(real[-1], rel=1e-9)
    assert found["Z"] == pytest.approx(real[0], rel=1e-9)
    assert found["v"] == pytest.approx(real[0] * 8.31446261815324 * T / (p * 1e5), rel=1e-9)


def test_flash_drum_reports_a_temperature_outside_of_its_data():
    model = smpl.compile(
        source="model Drum\nset species = { benzene, toluene }\n"
        'use "lib/drums.eq"\naction T : degC = 95 in 0..120\nuse FlashDrum as D(p = 1.013 [bar])\neq D.T = T\n'
        "eq D.feed.F = 1 [kmol/h]\neq D.feed.x[i] = 0.5 for i in species\n"
        "let benzene_left : 1 = D.valid[benzene].warned\nlet toluene_left : 1 = D.valid[toluene].warned\n"
        "observe D.share in 0..1\nepisode { step = 1 [s], max_steps = 5 }\n"
    )
    # Below 309 K the data of toluene end, below 288 K those of benzene.
    run = model.rollout([], np.array([[95.0], [30.0], [95.0], [5.0], [95.0]]), outputs=True)
    at = [model.algebraic_names.index(name) for name in ("benzene_left", "toluene_left")]
    assert run.outputs[0][:, at].tolist() == [[0, 0], [0, 0], [0, 1], [0, 1], [1, 1], [1, 1]]
