"""Starts that are hard for Newton's method, from chemical engineering.

Right values are by SciPy from good guesses, on equations written anew.

Run as a program, it prints a table: solved by smpl, and by `scipy.optimize.fsolve` from the same guesses.
"""

import math
import sys
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.optimize

import smpl

HEAD = (
    "time t : s\nstate x = 1 in 0..10\neq d/dt x = -x/1 [s]\nobserve x in 0..10\n"
    "episode { step = 0.01 [s], max_steps = 2 }\n"
)


@dataclass
class Start:
    """A model, its guesses by name, the residuals of the same equations, and a good guess."""

    text: str
    guess: dict[str, float]
    residual: object
    near: dict[str, float]

    def right(self):
        """Solution from the good guess."""
        found = scipy.optimize.root(self.residual, list(self.near.values()), tol=1e-13)
        assert np.max(np.abs(self.residual(found.x))) < 1e-8 * max(1, np.max(np.abs(found.x)))
        return dict(zip(self.near, found.x, strict=True))

    def scipy_solves(self):
        """True if SciPy's hybrid method solves it from the same guess."""
        with np.errstate(all="ignore"):
            try:
                found, _, flag, _ = scipy.optimize.fsolve(self.residual, list(self.guess.values()), full_output=True)
            except (ValueError, ZeroDivisionError, OverflowError):
                return False
        right = np.array(list(self.right().values()))
        return bool(flag == 1 and np.allclose(found, right, rtol=1e-5, atol=1e-8))

    def source(self):
        return HEAD + self.text


def psat(a, b, c, temperature):
    return 10 ** (a - b / (temperature + c))


def bubble(v):
    (temperature,) = v
    benzene, toluene = psat(6.90565, 1211.033, 220.79, temperature), psat(6.95464, 1344.8, 219.482, temperature)
    return [0.4 * benzene + 0.6 * toluene - 760]


FEED, K = np.array([0.3, 0.3, 0.4]), np.array([4.0, 1.2, 0.3])


def rachford_rice(v):
    return [np.sum(FEED * (K - 1) / (1 + v[0] * (K - 1)))]


def flash(v):
    vapour, temperature = v
    ratio = np.array([psat(6.9, 1211.0, 220.8, temperature), psat(6.95, 1344.8, 219.5, temperature)]) / 760
    feed = np.array([0.5, 0.5])
    return [np.sum(feed * (ratio - 1) / (1 + vapour * (ratio - 1))), 33.0 * vapour - 0.15 * (120 - temperature)]


def phosphoric(v):
    (ph,) = v
    h = 10**-ph
    k1, k2, k3 = 7.5e-3, 6.2e-8, 2.14e-13
    d = h**3 + k1 * h**2 + k1 * k2 * h + k1 * k2 * k3
    return [(h + 0.15 - 1e-14 / h - 0.1 * (k1 * h**2 + 2 * k1 * k2 * h + 3 * k1 * k2 * k3) / d) * 10]


def colebrook(v):
    (f,) = v
    return [1 / np.sqrt(f) + 2 * np.log10(1e-4 / 3.7 + 2.51 / (1e5 * np.sqrt(f)))]


def network(v):
    a, b, c = v
    return [a + b + c - 1, 2 * a * abs(a) - 3 * b * abs(b), 3 * b * abs(b) - 50 * c * abs(c)]


def van_der_waals(v):
    (volume,) = v
    return [(10 + 5.5 / volume**2) * (volume - 0.0305) - 0.0831 * 250]


def diode(v):
    current, voltage = v
    return [current - (8 - 1e-9 * (np.exp(voltage / 0.026) - 1)), voltage - 0.05 * current - 0.2]


def combustion(v):
    # Meintjes and Morgan, ACM Trans. Math. Softw. 16 (1990) 143-151: equilibrium of propane in air, element variables.
    y1, y2, y3, y4, y5 = v
    root = math.sqrt(40)
    r, r5, r6, r7 = 10, 0.193, 0.002597 / root, 0.003448 / root
    r8, r9, r10 = 1.799e-5 / 40, 2.155e-4 / root, 3.846e-5 / 40
    return [
        y1 * y2 + y1 - 3 * y5,
        2 * y1 * y2 + y1 + 2 * r10 * y2**2 + y2 * y3**2 + r7 * y2 * y3 + r9 * y2 * y4 + r8 * y2 - r * y5,
        2 * y2 * y3**2 + r7 * y2 * y3 + 2 * r5 * y3**2 + r6 * y3 - 8 * y5,
        r9 * y2 * y4 + 2 * y4**2 - 4 * r * y5,
        y1 * y2
        + y1
        + r10 * y2**2
        + y2 * y3**2
        + r7 * y2 * y3
        + r9 * y2 * y4
        + r8 * y2
        + r5 * y3**2
        + r6 * y3
        + y4**2
        - 1,
    ]


def ignition(v):
    temperature, c = v
    rate = 1e10 * np.exp(-9000 / temperature) * c
    return [1 - c - rate, 300 - temperature + 200 * rate]


def exchanger(v):
    duty, hot, cold = v
    a, b = 90 - cold, hot - 20
    mean = (a - b) / np.log(a / b)
    return [duty - 2 * (90 - hot), duty - 2.5 * (cold - 20), duty - 3 * mean]


def butler_volmer(v):
    (overpotential,) = v
    return [1e-3 * (np.exp(19.46 * overpotential) - np.exp(-19.46 * overpotential)) - 5]


STARTS = {
    "bubble point from a cold guess": Start(
        "var T = -200 in -215..400\n"
        "eq 0.4*10^(6.90565 - 1211.033/(T + 220.79)) + 0.6*10^(6.95464 - 1344.8/(T + 219.482)) = 760\n",
        {"T": -200},
        bubble,
        {"T": 95},
    ),
    "flash with the guess beyond the vapour": Start(
        "var V = 3 in 0..1\nvar K1 = 4\nvar K2 = 1.2\nvar K3 = 0.3\neq K1 = 4\neq K2 = 1.2\neq K3 = 0.3\n"
        "eq 0.3*(K1 - 1)/(1 + V*(K1 - 1)) + 0.3*(K2 - 1)/(1 + V*(K2 - 1)) + 0.4*(K3 - 1)/(1 + V*(K3 - 1)) = 0\n",
        {"V": 3},
        rachford_rice,
        {"V": 0.5},
    ),
    "adiabatic flash from all liquid": Start(
        "var V = 0 in 0..1\nvar T = 20 in 0..200\nlet K1 = 10^(6.9 - 1211/(T + 220.8))/760\n"
        "let K2 = 10^(6.95 - 1344.8/(T + 219.5))/760\n"
        "eq 0.5*(K1 - 1)/(1 + V*(K1 - 1)) + 0.5*(K2 - 1)/(1 + V*(K2 - 1)) = 0\neq 33*V = 0.15*(120 - T)\n",
        {"V": 0, "T": 20},
        flash,
        {"V": 0.1, "T": 95},
    ),
    "pH of phosphoric acid from pH 0": Start(
        "var pH = 0 in 0..14\nlet h = 10^(-pH)\nlet d = h^3 + 7.5e-3*h^2 + 7.5e-3*6.2e-8*h + 7.5e-3*6.2e-8*2.14e-13\n"
        "eq (h + 0.15 - 1e-14/h - 0.1*(7.5e-3*h^2 + 2*7.5e-3*6.2e-8*h + 3*7.5e-3*6.2e-8*2.14e-13)/d)*10 = 0\n",
        {"pH": 0},
        phosphoric,
        {"pH": 7.2},
    ),
    "friction factor from zero": Start(
        "var f = 0 in 0..1\neq 1/sqrt(f) = -2*log10(1e-4/3.7 + 2.51/(1e5*sqrt(f)))\n", {"f": 0}, colebrook, {"f": 0.02}
    ),
    "pipe network from rest": Start(
        "var a = 0 in -2..2\nvar b = 0 in -2..2\nvar c = 0 in -2..2\neq a + b + c = 1\n"
        "eq 2*a*abs(a) = 3*b*abs(b)\neq 3*b*abs(b) = 50*c*abs(c)\n",
        {"a": 0, "b": 0, "c": 0},
        network,
        {"a": 0.5, "b": 0.4, "c": 0.1},
    ),
    "liquid root of van der Waals from the gas": Start(
        "var v = 2 in 0.031..0.08\neq (10 + 5.5/v^2)*(v - 0.0305) = 0.0831*250\n", {"v": 2}, van_der_waals, {"v": 0.045}
    ),
    "diode far above its knee": Start(
        "var I = 0 in -10..10\nvar U = 30 in -40..40\neq I = 8 - 1e-9*(exp(U/0.026) - 1)\neq U = 0.05*I + 0.2\n",
        {"I": 0, "U": 30},
        diode,
        {"I": 7, "U": 0.57},
    ),
    "combustion of propane": Start(
        "".join(f"var y{i} = 1 in 0..100\n" for i in range(1, 6))
        + "let R6 = 0.002597/sqrt(40)\nlet R7 = 0.003448/sqrt(40)\n"
        "let R8 = 1.799e-5/40\nlet R9 = 2.155e-4/sqrt(40)\nlet R10 = 3.846e-5/40\n"
        "eq y1*y2 + y1 - 3*y5 = 0\n"
        "eq 2*y1*y2 + y1 + 2*R10*y2^2 + y2*y3^2 + R7*y2*y3 + R9*y2*y4 + R8*y2 - 10*y5 = 0\n"
        "eq 2*y2*y3^2 + R7*y2*y3 + 2*0.193*y3^2 + R6*y3 - 8*y5 = 0\neq R9*y2*y4 + 2*y4^2 - 40*y5 = 0\n"
        "eq y1*y2 + y1 + R10*y2^2 + y2*y3^2 + R7*y2*y3 + R9*y2*y4 + R8*y2 + 0.193*y3^2 + R6*y3 + y4^2 - 1 = 0\n",
        {f"y{i}": 1 for i in range(1, 6)},
        combustion,
        {"y1": 0.003, "y2": 34, "y3": 0.065, "y4": 0.86, "y5": 0.037},
    ),
    "ignited reactor from a cold guess": Start(
        "var T = 300 in 400..600\nvar c = 1 in 0..1\nlet r = 1e10*exp(-9000/T)*c\neq 1 - c = r\neq T = 300 + 200*r\n",
        {"T": 300, "c": 1},
        ignition,
        {"T": 480, "c": 0.1},
    ),
    "exchanger with equal differences": Start(
        "var Q = 0 in 0..200\nvar h = 90 in 20..90\nvar k = 20 in 20..90\n"
        "eq Q = 2*(90 - h)\neq Q = 2.5*(k - 20)\neq Q = 3*((90 - k) - (h - 20))/ln((90 - k)/(h - 20))\n",
        {"Q": 0, "h": 90, "k": 20},
        exchanger,
        {"Q": 70, "h": 55, "k": 48},
    ),
    "overpotential from the far side": Start(
        "var eta = -2 in -3..3\neq 1e-3*(exp(19.46*eta) - exp(-19.46*eta)) = 5\n",
        {"eta": -2},
        butler_volmer,
        {"eta": 0.4},
    ),
}


def solve(start):
    env = smpl.Env(smpl.compile(source=start.source()))
    env.reset(seed=1)
    return dict(zip(env.algebraic_names, env.algebraic, strict=True))


@pytest.mark.parametrize("name", STARTS)
def test_hard_start_is_solved(name):
    start = STARTS[name]
    found = solve(start)
    for unknown, right in start.right().items():
        assert found[unknown] == pytest.approx(right, rel=1e-6, abs=1e-9), unknown


def main():
    solved, of_scipy = 0, 0
    for name, start in STARTS.items():
        right = start.right()
        try:
            found = solve(start)
            ours = all(math.isclose(found[n], v, rel_tol=1e-6, abs_tol=1e-9) for n, v in right.items())
        except smpl.SimulationError:
            ours = False
        theirs = start.scipy_solves()
        solved, of_scipy = solved + ours, of_scipy + theirs
        print(f"| {name} | {'yes' if ours else 'no'} | {'yes' if theirs else 'no'} |")
    print(f"| solved | {solved} of {len(STARTS)} | {of_scipy} of {len(STARTS)} |")


if __name__ == "__main__":
    sys.exit(main())
