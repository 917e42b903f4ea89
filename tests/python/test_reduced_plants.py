"""Process models of index above 1, written with all their balances and constraints, against hand-reduced forms.

Every reference is a system of ordinary differential equations derived manually, integrated by SciPy (`DOP853` or
`LSODA`), with the constraint solved for. Each model runs by all methods, in one long step and in many short ones.
"""

import numpy as np
import pytest

from reduced import follows, integrate, solved

optimize = pytest.importorskip("scipy.optimize")


def test_a_flash_keeps_its_fractions_with_all_balances():
    """Isothermal and isobaric, liquid level kept: V from the sum of y, L from that of all balances."""
    text = """set s = {a, b, c}
    table K[s] : 1 = {a: 2.5, b: 1.1, c: 0.3}
    param M : mol = 10
    state n[i in s] : mol = 0
    var x[s] : 1 = 0.3
    var y[s] : 1 = 0.3
    var V : mol/s = 0.1
    var L : mol/s = 0.9
    let F : mol/s = (1 + 0.3*sin(t/1[s]))*1[mol/s]
    let z_a = 0.4 + 0.1*sin(t/2[s])
    eq d/dt n[a] = F*z_a - L*x[a] - V*y[a]
    eq d/dt n[b] = F*0.3 - L*x[b] - V*y[b]
    eq d/dt n[c] = F*(0.7 - z_a) - L*x[c] - V*y[c]
    eq x[i] = n[i]/M for i in s
    eq y[i] = K[i]*x[i] for i in s
    eq sum(x[i] for i in s) = 1
    eq sum(y[i] for i in s) = 1
    initial n[a] = 3[mol]
    initial n[b] = 10[mol] - n[a] - n[c]
    initial n[c] = 1[mol]*(2.5*3 + 1.1*7 - 10)/(1.1 - 0.3)
    """
    K = np.array([2.5, 1.1, 0.3])

    def rates(t, n):
        F, za = 1 + 0.3 * np.sin(t), 0.4 + 0.1 * np.sin(t / 2)
        z = np.array([za, 0.3, 0.7 - za])
        x = n / 10
        # Sum of n stays, sum of K n stays.
        a = np.array([[x.sum(), (K * x).sum()], [(K * x).sum(), (K * K * x).sum()]])
        L, V = np.linalg.solve(a, [F * z.sum(), F * (K * z).sum()])
        return F * z - L * x - V * K * x

    c = (2.5 * 3 + 1.1 * 7 - 10) / 0.8
    n = solved(rates, [3, 7 - c, c], 4.0)
    follows(text, 4.0, {"n[a]": n[0], "n[b]": n[1], "n[c]": n[2]})


def test_a_total_condenser_returns_all_that_it_condenses():
    """Total reflux, level and pressure kept: the reflux is the vapour, the duty follows from dT/dt."""
    text = """state n1 : mol = 12
    state n2 : mol = 28
    var T : K = 350 in 200..500
    var L : mol/s = 1
    var Q : kW = 30
    var h : J/mol = 1000
    let V : mol/s = (2 + 0.5*sin(t/3[s]))*1[mol/s]
    let y1 = 0.4 + 0.3*exp(-t/5[s])
    let x1 = n1/(n1 + n2)
    eq d/dt n1 = V*y1 - L*x1
    eq d/dt n2 = V*(1 - y1) - L*(1 - x1)
    eq n1 + n2 = 40[mol]
    eq x1*exp(10.9 - 3800[K]/T) + (1 - x1)*exp(10.2 - 3900[K]/T) = 1
    eq h = (120 + 30*x1)*1[J/mol/K]*(T - 300[K])
    eq d/dt ((n1 + n2)*h) = V*(34000 - 2000*y1)*1[J/mol] - L*h - Q
    """

    def bubble(x):
        def excess(T):
            return x * np.exp(10.9 - 3800 / T) + (1 - x) * np.exp(10.2 - 3900 / T) - 1

        return optimize.brentq(excess, 200, 500, xtol=1e-13)

    def rest(t, n1):
        x, V, y = n1 / 40, 2 + 0.5 * np.sin(t / 3), 0.4 + 0.3 * np.exp(-t / 5)
        dx = V * (y - x) / 40
        T = bubble(x)
        ka, kb = np.exp(10.9 - 3800 / T), np.exp(10.2 - 3900 / T)
        dT = -(ka - kb) * dx / (x * ka * 3800 / T**2 + (1 - x) * kb * 3900 / T**2)
        h = (120 + 30 * x) * (T - 300)
        dh = 30 * dx * (T - 300) + (120 + 30 * x) * dT
        return 40 * dx, T, (V * (34000 - 2000 * y) - V * h - 40 * dh) / 1000

    (n1,) = solved(lambda t, y: [rest(t, y[0])[0]], [12.0], 6.0)
    _, T, Q = rest(6.0, n1)
    follows(text, 6.0, {"n1": n1, "T": T, "Q": Q, "L": 2 + 0.5 * np.sin(2.0)})


def test_a_two_phase_drum_boils_at_a_fixed_volume():
    """Liquid and vapour in a closed volume: the evaporation keeps the volume full."""
    text = """param Rw : J/kg/K = 461.5
    param Vt : m^3 = 2
    state ml : kg = 900 in 1..2000
    state T : K = 430 in 300..600
    state mv : kg = 1 in 0.01..100
    var w : kg/s
    let ps : Pa = exp(25.9 - 5000[K]/T)*1[Pa]
    let rv : kg/m^3 = ps/(Rw*T)
    let ul : J/kg = 4200[J/kg/K]*(T - 273[K])
    let uv : J/kg = 2.5e6[J/kg] + 1500[J/kg/K]*(T - 273[K])
    let F : kg/s = 1.5[kg/s]
    let S : kg/s = (1 + 0.5*sin(t/20[s]))*1[kg/s]
    eq d/dt ml = F - w
    eq d/dt mv = w - S
    eq d/dt (ml*ul + mv*uv) = F*4200[J/kg/K]*60[K] + 3e6[W] - S*(uv + ps/rv)
    eq ml/900[kg/m^3] + mv/rv = Vt
    initial mv = (Vt - ml/900[kg/m^3])*rv
    """
    Rw = 461.5

    def point(T):
        ps = np.exp(25.9 - 5000 / T)
        rv = ps / (Rw * T)
        return ps, rv, rv * (5000 / T**2 - 1 / T), 4200 * (T - 273), 2.5e6 + 1500 * (T - 273)

    def rates(t, z):
        ml, mv, T = z
        ps, rv, drv, ul, uv = point(T)
        S = 1 + 0.5 * np.sin(t / 20)
        heat = 1.5 * 4200 * 60 + 3e6 - S * (uv + ps / rv)
        a = [[1, 0, 0, 1], [0, 1, 0, -1], [ul, uv, ml * 4200 + mv * 1500, 0], [1 / 900, 1 / rv, -mv / rv**2 * drv, 0]]
        return np.linalg.solve(a, [1.5, -S, heat, 0])[:3]

    mv = (2 - 900 / 900) * point(430.0)[1]
    ml, mv, T = solved(rates, [900, mv, 430], 60.0)
    follows(text, 60.0, {"ml": ml, "mv": mv, "T": T})


def test_a_membrane_contactor_is_in_equilibrium_in_every_cell():
    """Twenty cells of two streams, c1 = 2 c2 + c2^2 across the membrane; one loop."""
    text = """set k = 1..20
    state c1[i in k] : mol/m^3 = 0
    state c2[i in k] : mol/m^3 = 0
    var j[k] : mol/m^3/s
    eq d/dt c1[i] = ((if i == 1 then 3[mol/m^3] else c1[i-1]) - c1[i])*2[1/s] - j[i] for i in k
    eq d/dt c2[i] = ((if i == 1 then 0[mol/m^3] else c2[i-1]) - c2[i])*1[1/s] + j[i] for i in k
    eq c1[i] = 2*c2[i] + c2[i]^2/1[mol/m^3] for i in k
    """

    def rates(t, c2):
        c1 = 2 * c2 + c2**2
        total = (np.r_[3, c1[:-1]] - c1) * 2 + (np.r_[0, c2[:-1]] - c2)
        return total / (3 + 2 * c2)

    c2 = solved(rates, np.zeros(20), 8.0)
    expected = {f"c2[{i + 1}]": c2[i] for i in (0, 7, 19)} | {"c1[12]": 2 * c2[11] + c2[11] ** 2}
    follows(text, 8.0, expected)


def test_a_fast_equilibrium_is_kept_while_a_slow_reaction_drains_it():
    """A <-> B at equilibrium, B -> C slow, in a stirred tank."""
    text = """state cA : mol/L = 1
    state cB : mol/L = 3
    state cC : mol/L = 0
    var r : mol/L/s
    eq d/dt cA = (2[mol/L] - cA)*0.1[1/s] - r
    eq d/dt cB = -cB*0.1[1/s] + r - 0.2[1/s]*cB
    eq d/dt cC = -cC*0.1[1/s] + 0.2[1/s]*cB
    eq cB = 3*cA
    """

    def rates(t, z):
        s, c = z
        return [(2 - s) * 0.1 - 0.2 * 0.75 * s, -0.1 * c + 0.2 * 0.75 * s]

    s, c = solved(rates, [4, 0], 5.0)
    r = (2 - s / 4) * 0.1 - (0.2 - 0.1 * s - 0.15 * s) / 4
    follows(text, 5.0, {"cA": s / 4, "cB": 0.75 * s, "cC": c, "r": r})


def test_a_complex_forms_at_once_while_a_vessel_is_fed():
    """A + B <-> C at equilibrium, nC V = K nA nB with K = 2 L/mol, in a fed-batch vessel."""
    text = """state V : L = 1 in 0.1..10
    state nA : mol = 1 in 0..10
    state nB : mol = 0 in 0..10
    state nC : mol = 0 in 0..10
    var r : mol/s
    eq d/dt V = 0.1[L/s]
    eq d/dt nA = -r
    eq d/dt nB = 0.15[mol/s] - r
    eq d/dt nC = r - 0.3[1/s]*nC
    eq nC*V = 2[L/mol]*nA*nB
    """

    def rates(t, z):
        V, a, b, c = z
        # d(nC V) = 2 d(nA nB): solved for r.
        r = (2 * a * 0.15 - c * 0.1 + 0.3 * c * V) / (V + 2 * (a + b))
        return [0.1, -r, 0.15 - r, r - 0.3 * c]

    V, a, b, c = solved(rates, [1, 1, 0, 0], 6.0)
    follows(text, 6.0, {"V": V, "nA": a, "nB": b, "nC": c})


def test_a_reactor_follows_its_ramp_of_temperature_exactly():
    """The duty that keeps T on a curve of second order in time."""
    text = """state c : mol/m^3 = 1000
    state T : K = 300
    var Q : W
    let k : 1/s = 2000*exp(-3000[K]/T)*1[1/s]
    eq d/dt c = (1000[mol/m^3] - c)*0.05[1/s] - k*c
    eq d/dt T = (300[K] - T)*0.05[1/s] + 0.04[K m^3/mol]*k*c + Q/1e5[J/K]
    eq T = 300[K] + 1[K/s]*t - 0.02[K/s^2]*t^2
    """

    def rates(t, c):
        return (1000 - c) * 0.05 - 2000 * np.exp(-3000 / (300 + t - 0.02 * t * t)) * c

    (c,) = solved(rates, [1000.0], 20.0)
    T = 300 + 20 - 8
    k = 2000 * np.exp(-3000 / T)
    Q = 1e5 * (1 - 0.04 * 20 - (300 - T) * 0.05 - 0.04 * k * c)
    follows(text, 20.0, {"c": c, "T": T, "Q": Q})


def test_a_full_tank_overflows_by_what_its_mixture_needs():
    """Three liquids of different density in a full tank: the outflow keeps the volume."""
    text = """state m1 : kg = 500
    state m2 : kg = 0
    state m3 : kg = 250
    var W : kg/s
    let m : kg = m1 + m2 + m3
    eq d/dt m1 = 2[kg/s] - W*m1/m
    eq d/dt m2 = 1[kg/s]*(1 + sin(t/10[s])) - W*m2/m
    eq d/dt m3 = -W*m3/m - 0.001[1/s]*m3
    eq m1/1000[kg/m^3] + m2/800[kg/m^3] + m3/500[kg/m^3] = 1[m^3]
    """
    rho = np.array([1000, 800, 500])

    def rates(t, m):
        feed = np.array([2, 1 + np.sin(t / 10), -0.001 * m[2]])
        W = (feed / rho).sum() / (m / m.sum() / rho).sum()
        return feed - W * m / m.sum()

    m = solved(rates, [500, 0, 250], 100.0)
    follows(text, 100.0, {"m1": m[0], "m2": m[1], "m3": m[2]})


def test_a_feed_is_found_that_leads_an_outlet_along_a_curve():
    """Two tanks in series, the outlet prescribed: the feed is its second derivative, index 3."""
    text = """state c1 : mol/L = 1
    state c2 : mol/L = 1
    var u : mol/L
    eq d/dt c1 = (u - c1)/2[s]
    eq d/dt c2 = (c1 - c2)/3[s]
    eq c2 = (1 + 0.5*(1 - cos(t/2[s])))*1[mol/L]
    """
    t = 7.0
    c2, d1, d2 = 1.5 - 0.5 * np.cos(t / 2), 0.25 * np.sin(t / 2), 0.125 * np.cos(t / 2)
    c1 = c2 + 3 * d1
    follows(text, t, {"c1": c1, "c2": c2, "u": c1 + 2 * (d1 + 3 * d2)})


def test_a_column_of_local_equilibrium_adsorbs_by_langmuirs_isotherm():
    """Mobile and adsorbed phase with their own balances, exchange as the unknown; forty cells."""
    text = """set z = 1..40
    state c[i in z] : mol/L = 0
    state q[i in z] : mol/L = 0
    var r[z] : mol/L/s
    eq d/dt c[i] = -40*(c[i] - (if i == 1 then 1[mol/L] else c[i-1]))*0.1[1/s] - 2*r[i] for i in z
    eq d/dt q[i] = r[i] for i in z
    eq q[i] = 3*c[i]/(1 + 2[L/mol]*c[i]) for i in z
    """

    def rates(t, c):
        slope = 3 / (1 + 2 * c) ** 2
        return -4 * (c - np.r_[1, c[:-1]]) / (1 + 2 * slope)

    c = solved(rates, np.zeros(40), 12.0)
    follows(text, 12.0, {"c[5]": c[4], "c[20]": c[19], "q[20]": 3 * c[19] / (1 + 2 * c[19])})


def test_two_metals_in_contact_share_one_temperature():
    """Enthalpies as states, H = m (c T + d T^2): both temperatures follow from them and are the same."""
    text = """state H1 : J = 5000*300 + 2*300^2
    state H2 : J = 8000*300 + 5*300^2
    var T1 : K = 300 in 1..1000
    var T2 : K = 300 in 1..1000
    var q : W
    eq d/dt H1 = 4e4[W] - q
    eq d/dt H2 = q - 20[W/K]*(T2 - 290[K])
    eq H1 = 5000[J/K]*T1 + 2[J/K^2]*T1^2
    eq H2 = 8000[J/K]*T2 + 5[J/K^2]*T2^2
    eq T1 = T2
    """

    def rates(t, T):
        return (4e4 - 20 * (T - 290)) / (13000 + 14 * T)

    (T,) = solved(rates, [300.0], 50.0)
    rate = rates(0, T)
    follows(text, 50.0, {"T1": T, "H1": 5000 * T + 2 * T * T, "q": 4e4 - (5000 + 4 * T) * rate})


# Saturated water between 70 and 100 bar as parabolas in p - 8.5 MPa: value, slope and half the curvature.
STEAM = {"hs": (2751.0e3, -1.6e4, -1.0e3), "hw": (1340.0e3, 4.2e4, -1.2e3), "rs": (45.7, 6.2, 0.22),
         "rw": (713.0, -11.0, -0.1), "ts": (299.3, 8.8, -0.25)}  # fmt: skip


def drum_boiler():
    """The model of K. J. Astrom and R. D. Bell, Automatica 36 (2000) 363-378, as its balances (1), (2), (9)-(14)."""
    units = {"hs": "J/kg", "hw": "J/kg", "rs": "kg/m^3", "rw": "kg/m^3", "ts": "K"}
    properties = "".join(
        f"let {name} : {units[name]} = ({a} + {b}*(p/1e6[Pa] - 8.5) + {c}*(p/1e6[Pa] - 8.5)^2)*1[{units[name]}]\n"
        for name, (a, b, c) in STEAM.items()
    )
    return (
        "let Vt : m^3 = 88\nlet Vr : m^3 = 37\nlet Vdc : m^3 = 11\nlet Vd : m^3 = 40\n"
        "let mt : kg = 300e3\nlet mr : kg = 160e3\nlet Cp : J/kg/K = 550\nlet Td : s = 12\n"
        "let qf : kg/s = 50\nlet qs : kg/s = (50 + 10*(1 - exp(-t/5[s])))*1[kg/s]\nlet Q : W = 8.6e7\n"
        "let hf : J/kg = 1.03e6\nlet Vsd0 : m^3 = 8\n"
        "state p : Pa = 8.5e6 in 7e6..10e6\nstate Vwt : m^3 = 57.5 in 1..88\nstate ar = 0.05 in 1e-4..1\n"
        "state Vsd : m^3 = 4.9 in 0..40\nvar qdc : kg/s = 1200 in 1..1e4\nvar qr : kg/s = 1200\n"
        + properties
        + """let Vst : m^3 = Vt - Vwt
        let hc : J/kg = hs - hw
        let eta = ar*(rw - rs)/rs
        let av = rw/(rw - rs)*(1 - ln(1 + eta)/eta)
        eq d/dt (rs*Vst + rw*Vwt) = qf - qs
        eq d/dt (rs*hs*Vst + rw*hw*Vwt - p*Vt + mt*Cp*ts) = Q + qf*hf - qs*hs
        eq d/dt (rs*av*Vr + rw*(1 - av)*Vr) = qdc - qr
        eq d/dt (rs*hs*av*Vr + rw*hw*(1 - av)*Vr - p*Vr + mr*Cp*ts) = Q + qdc*hw - (ar*hc + hw)*qr
        let qcd : kg/s = (hw - hf)/hc*qf + (rs*Vst*der(hs) + rw*Vwt*der(hw) - Vt*der(p) + mt*Cp*der(ts))/hc
        let qsd : kg/s = rs/Td*(Vsd - Vsd0) + ar*qdc + ar*0.3*(qdc - qr)
        eq d/dt (rs*Vsd) = ar*qr - qsd - qcd
        eq 0.5*25*qdc^2 = rw*0.38[m^2]*(rw - rs)*9.81[m/s^2]*av*Vr
        """
    )


def drum_boiler_by_hand():
    """The product rule written out: E(x) (p', Vwt', ar', Vsd', qdc, qr) by unit vectors of rates."""

    def at(name, p):
        a, b, c = STEAM[name]
        x = p / 1e6 - 8.5
        return a + b * x + c * x * x, (b + 2 * c * x) / 1e6

    def rates(t, z):
        p, Vw, ar, Vsd = z
        Vt, Vr, mt, mr, Cp, qf, hf, Q = 88, 37, 300e3, 160e3, 550, 50, 1.03e6, 8.6e7
        qs = 50 + 10 * (1 - np.exp(-t / 5))
        (hs, dhs), (hw, dhw), (rs, drs), (rw, drw), (_, dts) = (at(n, p) for n in ("hs", "hw", "rs", "rw", "ts"))
        Vs, hc, eta = Vt - Vw, hs - hw, ar * (rw - rs) / rs
        ratio = 1 - np.log(1 + eta) / eta
        av = rw / (rw - rs) * ratio
        slope = -1 / (eta * (1 + eta)) + np.log(1 + eta) / eta**2
        av_a = rw / (rw - rs) * slope * (rw - rs) / rs
        d_eta = ar * (drw / rs - rw * drs / rs**2)
        av_p = (drw * (rw - rs) - rw * (drw - drs)) / (rw - rs) ** 2 * ratio + rw / (rw - rs) * slope * d_eta
        qdc = np.sqrt(2 * rw * 0.38 * (rw - rs) * 9.81 * av * Vr / 25)
        E, b = np.zeros((5, 5)), np.zeros(5)  # p', Vwt', ar', Vsd', qr
        E[0, :2], b[0] = (drs * Vs + drw * Vw, rw - rs), qf - qs
        E[1, 0] = (drs * hs + rs * dhs) * Vs + (drw * hw + rw * dhw) * Vw - Vt + mt * Cp * dts
        E[1, 1], b[1] = rw * hw - rs * hs, Q + qf * hf - qs * hs
        E[2, 0], E[2, 2] = Vr * (drs * av + drw * (1 - av) + (rs - rw) * av_p), Vr * (rs - rw) * av_a
        E[2, 4], b[2] = 1, qdc
        E[3, 0] = Vr * ((drs * hs + rs * dhs) * av + (drw * hw + rw * dhw) * (1 - av) + (rs * hs - rw * hw) * av_p)
        E[3, 0] += mr * Cp * dts - Vr
        E[3, 2], E[3, 4], b[3] = Vr * (rs * hs - rw * hw) * av_a, ar * hc + hw, Q + qdc * hw
        E[4, 0] = drs * Vsd + (rs * Vs * dhs + rw * Vw * dhw - Vt + mt * Cp * dts) / hc
        E[4, 3], E[4, 4] = rs, -ar - ar * 0.3
        b[4] = -rs / 12 * (Vsd - 8) - ar * qdc - ar * 0.3 * qdc - (hw - hf) / hc * qf
        return np.linalg.solve(E, b)[:4]

    return rates


def test_a_drum_boiler_of_balances_is_that_of_the_expanded_form():
    p, Vwt, ar, Vsd = solved(drum_boiler_by_hand(), [8.5e6, 57.5, 0.05, 4.9], 100.0, "LSODA")
    # Its rates follow from equations that are solved together, which IDA takes.
    grids = [("ida", 1), ("ida", 20), ("auto", 1), ("auto", 6)]
    follows(drum_boiler(), 100.0, {"p": p, "Vwt": Vwt, "ar": ar, "Vsd": Vsd}, grids=grids)


def column(trays):
    """Binary column, holdups and pressure kept: T from the sum of y, V from the enthalpies."""
    return f"""set k = 1..{trays}
    param M : mol = 20
    state x[i in k] = 0.5 in 0.001..0.999
    var T[k] : K = 350 in 300..420
    var h[k] : J/mol = 6000
    var y[k] = 0.6
    var L[i in k] : mol/s = (if i > {trays // 2} then 1 else 2)*1[mol/s]
    var V[k] : mol/s = 1.5
    let zF = 0.5 + 0.1*sin(t/50[s])
    let hF : J/mol = 6000
    let Q : W = 5e4
    eq (x[i]*exp(10.9 - 3700[K]/T[i]) + (1 - x[i])*exp(10.9 - 3950[K]/T[i])) = 1 for i in k
    eq y[i] = x[i]*exp(10.9 - 3700[K]/T[i]) for i in k
    eq h[i] = (120 + 40*x[i])*1[J/mol/K]*(T[i] - 300[K]) for i in k
    eq M*d/dt x[i] = (if i == {trays} then 0.8[mol/s]*y[i] else L[i+1]*x[i+1])
      + (if i == 1 then 0[mol/s] else V[i-1]*y[i-1])
      + (if i == {trays // 2} then 1[mol/s]*zF else 0[mol/s]) - L[i]*x[i] - V[i]*y[i] for i in k
    eq d/dt (M*h[i]) = (if i == {trays} then 0.8[mol/s]*h[i] else L[i+1]*h[i+1])
      + (if i == 1 then Q else V[i-1]*(33000 - 1000*y[i-1])*1[J/mol])
      + (if i == {trays // 2} then 1[mol/s]*hF else 0[W]) - L[i]*h[i] - V[i]*(33000 - 1000*y[i])*1[J/mol] for i in k
    eq 0 = (if i == {trays} then 0.8[mol/s] else L[i+1]) + (if i == 1 then 0[mol/s] else V[i-1])
      + (if i == {trays // 2} then 1[mol/s] else 0[mol/s]) - L[i] - V[i] for i in k
    """


def column_by_hand(trays):
    """The flows from the balances with dT/dt by the implicit function theorem; linear in all flows."""

    def bubble(x):
        def excess(T):
            return x * np.exp(10.9 - 3700 / T) + (1 - x) * np.exp(10.9 - 3950 / T) - 1

        return optimize.brentq(excess, 250, 450, xtol=1e-12)

    def rates(t, x, whole=False):
        T = np.array([bubble(one) for one in x])
        ka, kb = np.exp(10.9 - 3700 / T), np.exp(10.9 - 3950 / T)
        y, h, H = x * ka, (120 + 40 * x) * (T - 300), 33000 - 1000 * x * ka
        slope = -(ka - kb) / (x * ka * 3700 / T**2 + (1 - x) * kb * 3950 / T**2)
        dh = 40 * (T - 300) + (120 + 40 * x) * slope
        feed, zF, n = trays // 2 - 1, 0.5 + 0.1 * np.sin(t / 50), trays
        # Unknown: x' (n), L (n), V (n).
        A, b = np.zeros((3 * n, 3 * n)), np.zeros(3 * n)
        for i in range(n):
            for row, liquid, vapour, hold in (
                (i, x, y, -20.0),
                (n + i, h, H, -20 * dh[i]),
                (2 * n + i, np.ones(n), np.ones(n), 0),
            ):
                A[row, i] = hold
                A[row, n + i], A[row, 2 * n + i] = -liquid[i], -vapour[i]
                if i < n - 1:
                    A[row, n + i + 1] = liquid[i + 1]
                if i > 0:
                    A[row, 2 * n + i - 1] = vapour[i - 1]
            top = i == n - 1
            b[i] = -(0.8 * y[i] if top else 0) - (zF if i == feed else 0)
            b[n + i] = -(0.8 * h[i] if top else 0) - (6000 if i == feed else 0) - (5e4 if i == 0 else 0)
            b[2 * n + i] = -(0.8 if top else 0) - (1 if i == feed else 0)
        found = np.linalg.solve(A, b)
        return (found, T) if whole else found[:n]

    return rates


@pytest.mark.parametrize("trays", [20, 40])
def test_a_column_with_perfect_pressure_and_level_control_finds_its_flows(trays):
    rates = column_by_hand(trays)
    x = integrate.solve_ivp(rates, (0, 60), np.full(trays, 0.5), "LSODA", rtol=1e-10, atol=1e-12).y[:, -1]
    found, T = rates(60.0, x, whole=True)
    last, middle = trays, trays // 2
    expected = {f"x[{i}]": x[i - 1] for i in (1, middle, last)} | {f"T[{middle}]": T[middle - 1]}
    expected |= {f"V[{middle}]": found[2 * trays + middle - 1], f"L[{middle}]": found[trays + middle - 1]}
    follows(column(trays), 60.0, expected)
