"""Published problems as text for C, CasADi and DiffSL, and for this package where no file has them.

States are `x0`, `x1` and so on; the rates are products, sums, quotients, `exp` and `pow` of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smpl.support.arguments import FloatArray


@dataclass(frozen=True)
class Problem:
    """Rates, start, end of time, scales of the states; `path` is a model of `tests/problems`."""

    name: str
    rates: tuple[str, ...]
    start: tuple[float, ...]
    end: float
    scale: tuple[float, ...]
    path: str | None = None

    def model_text(self) -> str:
        """A model text of the problem."""
        lines = [f"model Problem{len(self.rates)}", "time t : s"]
        lines += [
            f"state x{k} = {x!r} scale {s!r}" for k, (x, s) in enumerate(zip(self.start, self.scale, strict=True))
        ]
        lines += [f"eq d/dt x{k} * 1 [s] = {text}" for k, text in enumerate(self.rates)]
        return "\n".join([*lines, f"episode {{ step = {self.end!r} [s], max_steps = 1 }}", ""])

    def atol(self, rtol: float) -> FloatArray:
        """Absolute tolerances as in this package: a hundredth of the scales times `rtol`."""
        return 1e-2 * rtol * np.array(self.scale)


ROBERTSON = ("-0.04*x0 + 1e4*x1*x2", "0.04*x0 - 1e4*x1*x2 - 3e7*x1*x1", "3e7*x1*x1")
# The third rate is the difference of the second and the fourth, also after rounding.
E5 = (
    "-7.89e-10*x0 - 1.1e7*x0*x2",
    "7.89e-10*x0 - 1.13e9*x1*x2",
    "(7.89e-10*x0 - 1.13e9*x1*x2) - (1.1e7*x0*x2 - 1.13e3*x3)",
    "1.1e7*x0*x2 - 1.13e3*x3",
)
HIRES = (
    "-1.71*x0 + 0.43*x1 + 8.32*x2 + 0.0007",
    "1.71*x0 - 8.75*x1",
    "-10.03*x2 + 0.43*x3 + 0.035*x4",
    "8.32*x1 + 1.71*x2 - 1.12*x3",
    "-1.745*x4 + 0.43*x5 + 0.43*x6",
    "-280.0*x5*x7 + 0.69*x3 + 1.71*x4 - 0.43*x5 + 0.69*x6",
    "280.0*x5*x7 - 1.81*x6",
    "-280.0*x5*x7 + 1.81*x6",
)
OREGONATOR = (
    "77.27*(x1 + x0*(1.0 - 8.375e-6*x0 - x1))",
    "(x2 - (1.0 + x0)*x1)/77.27",
    "0.161*(x0 - x2)",
)
VAN_DER_POL = ("x1", "((1.0 - x0*x0)*x1 - x0)*1e6")
# Pannocchia and Rawlings, AIChE J. 49 (2003): coolant at 305 K, the level at rest; time in minutes.
REACTION = "7.2e10*exp(-8750.0/x1)*x0"
DILUTION = f"0.1/({np.pi * 0.219**2!r}*0.659)"
STIRRED_TANK = (
    f"{DILUTION}*(1.0 - x0) - {REACTION}",
    f"{DILUTION}*(350.0 - x1) + {5e4 / 239.0!r}*{REACTION} + {2 * 54.94 / (0.219 * 239.0)!r}*(305.0 - x1)",
)
PREDATOR_PREY = ("x0*(1.0 - x1)", "x1*(x0 - 1.0)")
NEAR, FAR = 0.012277471, 0.987722529
EARTH, MOON = (f"(((x0 {shift})*(x0 {shift}) + x1*x1)*sqrt((x0 {shift})*(x0 {shift}) + x1*x1))"
               for shift in (f"+ {NEAR}", f"- {FAR}"))  # fmt: skip
ARENSTORF = (
    "x2",
    "x3",
    f"x0 + 2.0*x3 - {FAR}*(x0 + {NEAR})/{EARTH} - {NEAR}*(x0 - {FAR})/{MOON}",
    f"x1 - 2.0*x2 - {FAR}*x1/{EARTH} - {NEAR}*x1/{MOON}",
)
# Verwer 1994: constants, reactants and changes of species, counted from 1.
POLLUTION = """
0.35 1 : -1 2 3 | 26.6 2 4 : 1 -2 -4 | 12300 5 2 : 1 -2 -5 6 | 8.6e-4 7 : 5 5 -7 8 | 8.2e-4 7 : -7 8
15000 7 6 : 5 -6 -7 8 | 1.3e-4 9 : 5 8 -9 10 | 24000 9 6 : -6 -9 11 | 16500 11 2 : 1 -2 10 -11 12
9000 11 1 : -1 -11 13 | 0.022 13 : 1 11 -13 | 12000 10 2 : 1 -2 -10 14 | 1.88 14 : 5 7 -14
16300 1 6 : -1 -6 15 | 4.8e6 3 : -3 4 | 3.5e-4 4 : -4 16 | 0.0175 4 : 3 -4 | 1e8 16 : 6 6 -16
4.44e11 16 : 3 -16 | 1240 17 6 : 5 -6 -17 18 | 2.1 19 : 2 -19 | 5.78 19 : 1 3 -19 | 0.0474 1 4 : -1 -4 19
1780 19 1 : -1 -19 20 | 3.12 20 : 1 19 -20
"""


def pollution() -> tuple[str, ...]:
    """Rates of the twenty species."""
    rates = [""] * 20
    for line in POLLUTION.strip().replace("\n", "|").split("|"):
        law, changes = line.split(":")
        constant, *reactants = law.split()
        text = "*".join([repr(float(constant)), *(f"x{int(one) - 1}" for one in reactants)])
        for change in map(int, changes.split()):
            rates[abs(change) - 1] += f" {'+' if change > 0 else '-'} {text}"
    return tuple(f"0.0{text}" for text in rates)


def start_of_pollution() -> tuple[float, ...]:
    """Concentrations at the start."""
    given = {2: 0.2, 4: 0.04, 7: 0.1, 8: 0.3, 9: 0.01, 17: 0.007}
    return tuple(given.get(species, 0.0) for species in range(1, 21))


PROBLEMS = (
    Problem("robertson", ROBERTSON, (1.0, 0.0, 0.0), 1e11, (1e-4, 1e-10, 1.0), "robertson"),
    Problem("e5", E5, (1.76e-3, 0.0, 0.0, 0.0), 1e13, (1e-16,) * 4, "e5"),
    Problem("hires", HIRES, (1.0, *(0.0,) * 6, 0.0057), 321.8122, (1e-4,) * 8, "hires"),
    Problem("orego", OREGONATOR, (1.0, 2.0, 3.0), 360.0, (1.0,) * 3, "orego"),
    Problem("pollution", pollution(), start_of_pollution(), 60.0, (1e-6,) * 20, "pollution"),
    Problem("van_der_pol", VAN_DER_POL, (2.0, 0.0), 2.0, (1.0,) * 2, "van_der_pol"),
    Problem("stirred_tank", STIRRED_TANK, (0.878, 324.5), 5.0, (1.0, 100.0)),
    Problem("predator_prey", PREDATOR_PREY, (3.0, 0.5), 40.0, (1.0,) * 2),
    Problem(
        "arenstorf", ARENSTORF, (0.994, 0.0, 0.0, -2.00158510637908252240537862224), 17.0652165601579625, (1.0,) * 4
    ),
)
