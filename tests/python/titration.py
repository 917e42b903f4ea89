"""A weak acid to which a base flows: pH is an algebraic variable that rises by six within a thousandth of the base."""

from scipy import optimize

TEXT = """
model Titration "nothing but the pH says how short steps have to be"
time t : min
state n : mmol = 2 in 0..100 "base"
var pH : 1 = 4.5
action dose : mmol/min = 4 in 0..9
let H : mmol/L = 1e3*10^(-pH) * 1 [mmol/L]
let K : mmol/L = 1e3*10^(-4.76) * 1 [mmol/L]
eq n/1.5[L] + H = 12[mmol]/1.5[L]*K/(K + H) + 1e-8 [mmol^2/L^2]/H
eq d/dt n = dose
observe pH in 0..14
reward mean = integral(pH) / 1 [min]
episode { step = 1 [min], max_steps = 4 }
"""


def pH(base):
    """The pH of so much base, in mmol, by bisection."""
    K = 10.0 ** (3.0 - 4.76)

    def excess(value):
        H = 10.0 ** (3.0 - value)
        return base / 1.5 + H - 8.0 * K / (K + H) - 1e-8 / H

    return optimize.brentq(excess, 0.0, 14.0, xtol=1e-14)
