"""A crank with its piston, a batch distillation and a check valve against reduced forms."""

import numpy as np

from reduced import follows, solved


def test_a_crank_drives_a_piston_by_a_rod():
    """Energy: w^2 (1 + s'(a)^2) is constant, where s is the place of the piston and a the angle."""
    text = """
    state a = 0.3
    state w : 1/s = 5
    state b = 0
    state s : m = 0
    state v : m/s = 0
    var N : N
    var M : N
    param l : m = 2
    param r : m = 1
    eq d/dt a = w
    eq d/dt s = v
    eq 1 [kg*m^2]*d/dt w = N*r*sin(a) + M*r*cos(a)
    eq 1 [kg]*d/dt v = N
    eq r*sin(a) = l*sin(b)
    eq s = r*cos(a) + l*cos(b)
    eq M*cos(b) = N*sin(b)
    initial b = asin(r*sin(a)/l)
    initial s = r*cos(a) + l*cos(b)
    initial v = -r*w*(sin(a) + cos(a)*tan(b))
    """

    def slope(a):
        b = np.arcsin(np.sin(a) / 2)
        return -np.sin(a) - np.cos(a) * np.tan(b)

    def speed(a):
        return 5 * np.sqrt((1 + slope(0.3) ** 2) / (1 + slope(a) ** 2))

    (a,) = solved(lambda t, z: [speed(z[0])], [0.3], 4.0)
    b = np.arcsin(np.sin(a) / 2)
    expected = {"a": a, "w": speed(a), "s": np.cos(a) + 2 * np.cos(b), "v": slope(a) * speed(a)}
    follows(text, 4.0, expected, 1e-6)


def test_a_batch_boils_along_its_curve():
    """Open batch distillation: V from the energy balance with T' from the sum of fractions."""
    text = """
    set c = {a, b}
    state n[c] : mol = 50
    state T : K = 371.13389303774835
    var V : mol/s
    param A[c] = { a: 10, b: 9 }
    param B[c] : K = { a: 3600, b: 3500 }
    let N : mol = sum(n[i] for i in c)
    let y[i in c] = n[i]/N*exp(A[i] - B[i]/T)
    eq d/dt n[i] = -V*y[i] for i in c
    eq sum(y[i] for i in c) = 1
    eq d/dt (75 [J/mol/K]*N*(T - 300 [K])) = 300 [J/s] - V*(30000 [J/mol] + 75 [J/mol/K]*(T - 300 [K]))
    """
    A, B = np.array([10.0, 9.0]), np.array([3600.0, 3500.0])

    def rates(t, z):
        n, T = z[:2], z[2]
        P, N = np.exp(A - B / T), z[:2].sum()
        y = n * P / N
        rise = ((y * P).sum() - 1) / (n * P * B / T**2).sum()
        V = 300 / (30000 + 75 * N * rise)
        return [*(-V * y), V * rise]

    n_a, n_b, T = solved(rates, [50, 50, 371.13389303774835], 5000)
    follows(text, 5000.0, {"n[a]": n_a, "n[b]": n_b, "T": T}, 1e-6)


def test_a_check_valve_keeps_a_pressure_from_falling():
    """p = 1 + exp(-0.15 t) until it is 1.5 bar; then p1 rests and p2' = 0.15 - 0.2 p2."""
    text = """
    state p1 : bar = 2
    state p2 : bar = 2
    var w : bar/s
    eq d/dt p1 = 0.1 [1/s]*(3 [bar] - p1) - w
    eq d/dt p2 = w - 0.2 [1/s]*p2
    eq p1 = max(p2, 1.5 [bar])
    """
    shut = np.log(2) / 0.15
    follows(text, 20.0, {"p1": 1.5, "p2": 0.75 + 0.75 * np.exp(-0.2 * (20 - shut)), "w": 0.15}, 1e-6)
