"""Signals: expressions of a model whose values over time are known.

A signal is made of states, of time, and of sums, products, ratios and roots of these.
States have a closed solution (straight lines, polynomials, oscillations, exponentials, logistic growth) or are
integrated by SciPy (Van der Pol, Lotka and Volterra, a pendulum).
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp

POINTS = 100_001  # of the uniform grid on which signals are looked at
Values = np.ndarray
Function = Callable[[Values], Values]


def literal(value: float) -> str:
    """A number of a model's text, in parentheses where it is negative."""
    return f"({value!r})" if value < 0 else repr(value)


@dataclass
class Signal:
    """An expression of the model, its value over time, and how much it amplifies an error of a state."""

    text: str
    value: Function
    gain: float = 1.0

    def spread(self, grid: Values) -> tuple[float, float]:
        values = self.value(grid)
        return float(values.min()), float(values.max())


@dataclass
class Plant:
    """The states and equations that a model has so far."""

    generator: np.random.Generator
    horizon: float
    of_time: bool  # signals read `t` instead of states
    lines: list[str] = field(default_factory=list)
    implicit: bool = False  # an algebraic variable has to be solved for
    names: int = 0

    @property
    def grid(self) -> Values:
        return np.linspace(0, self.horizon, POINTS)

    def name(self, prefix: str) -> str:
        self.names += 1
        return f"{prefix}{self.names}"

    def number(self, low: float, high: float) -> float:
        """A number with few digits, the same in the text and in the evaluation."""
        return float(f"{self.generator.uniform(low, high):.6g}")

    def logarithmic(self, low: float, high: float) -> float:
        return float(f"{np.exp(self.generator.uniform(np.log(low), np.log(high))):.6g}")

    def choose(self, options):
        return options[int(self.generator.integers(len(options)))]

    def state(self, name: str, start: float, rate: str, scale: float = 1.0) -> None:
        self.lines += [f"state {name} = {start!r} scale {max(scale, 1e-3):.3g}", f"eq d/dt {name} = {rate}"]


def line(plant: Plant) -> Signal:
    slope, start = plant.number(0.2, 2) * plant.choose([1, -1]) / plant.horizon, plant.number(-1, 1)
    slope = float(f"{slope:.6g}")
    if plant.of_time:
        return Signal(f"({start!r} + {literal(slope)}*t)", lambda t: start + slope * t)
    x = plant.name("line")
    plant.state(x, start, literal(slope))
    return Signal(x, lambda t: start + slope * t)


def polynomial(plant: Plant) -> Signal:
    """A product of factors with roots on the horizon, integrated from its derivative along a clock."""
    roots = plant.generator.uniform(-0.1, 1.1, plant.choose([2, 3, 4]))
    curve = np.polynomial.Polynomial.fromroots(roots) * 4.0 ** len(roots)
    coefficients = [float(f"{c:.6g}") for c in curve.coef]
    slopes = [k * c / plant.horizon**k for k, c in enumerate(coefficients)][1:]
    tau = "t" if plant.of_time else plant.name("tau")
    if plant.of_time:
        text = " + ".join(f"{literal(c)}*(t/{plant.horizon!r})^{k}" for k, c in enumerate(coefficients))
        return Signal(f"({text})", lambda t: np.polynomial.Polynomial(coefficients)(t / plant.horizon))
    plant.state(tau, 0.0, "1", plant.horizon)
    x = plant.name("poly")
    plant.state(x, coefficients[0], " + ".join(f"{literal(c)}*{tau}^{k}" for k, c in enumerate(slopes)))
    return Signal(x, lambda t: np.polynomial.Polynomial(coefficients)(t / plant.horizon))


def oscillation(plant: Plant) -> Signal:
    periods, phase = plant.logarithmic(0.5, 30), plant.number(-3, 3)
    w = float(f"{2 * np.pi * periods / plant.horizon:.6g}")
    if plant.of_time:
        return Signal(f"sin({w!r}*t + {literal(phase)})", lambda t: np.sin(w * t + phase))
    s, c = plant.name("sine"), plant.name("cosine")
    plant.state(s, float(np.sin(phase)), f"{w!r}*{c}")
    plant.state(c, float(np.cos(phase)), f"-{w!r}*{s}")
    return Signal(s, lambda t: np.sin(w * t + phase))


def decay(plant: Plant) -> Signal:
    k, rest = float(f"{plant.number(0.5, 12) / plant.horizon:.6g}"), plant.number(-0.5, 0.5)
    if plant.of_time:
        return Signal(f"({rest!r} + {1 - rest!r}*exp(-{k!r}*t))", lambda t: rest + (1 - rest) * np.exp(-k * t))
    x = plant.name("decay")
    plant.state(x, 1.0, f"-{k!r}*({x} - {literal(rest)})")
    return Signal(x, lambda t: rest + (1 - rest) * np.exp(-k * t))


def logistic(plant: Plant) -> Signal:
    r, start = float(f"{plant.number(4, 25) / plant.horizon:.6g}"), plant.logarithmic(1e-4, 0.3)
    rate = float(np.log(1 / start - 1))
    if plant.of_time:
        return Signal(f"1/(1 + exp({rate!r} - {r!r}*t))", lambda t: 1 / (1 + np.exp(rate - r * t)))
    x = plant.name("logistic")
    plant.state(x, start, f"{r!r}*{x}*(1 - {x})")
    return Signal(x, lambda t: 1 / (1 + np.exp(rate - r * t)))


def integrated(plant: Plant) -> Signal:
    """States without a closed solution, by DOP853 with rtol 1e-12."""
    kind, q = plant.choose(["oscillator", "prey", "pendulum"]), plant.number(0.3, 1.5)
    speed = float(f"{plant.number(8, 30) / plant.horizon:.6g}")
    x, y = plant.name("x"), plant.name("y")
    rates, function, start = {
        "oscillator": (
            (f"{speed!r}*{y}", f"{speed!r}*({q!r}*(1 - sq({x}))*{y} - {x})"),
            lambda t, z: (speed * z[1], speed * (q * (1 - z[0] ** 2) * z[1] - z[0])),
            (0.5, 0.0),
        ),
        "prey": (
            (f"{speed!r}*{x}*(1 - {y})", f"{speed!r}*{q!r}*{y}*({x} - 1)"),
            lambda t, z: (speed * z[0] * (1 - z[1]), speed * q * z[1] * (z[0] - 1)),
            (1.8, 0.6),
        ),
        "pendulum": (
            (f"{speed!r}*{y}", f"-{speed!r}*(sin({x}) + {q / 10!r}*{y})"),
            lambda t, z: (speed * z[1], -speed * (np.sin(z[0]) + q / 10 * z[1])),
            (1.9, 0.3),
        ),
    }[kind]
    plant.state(x, start[0], rates[0])
    plant.state(y, start[1], rates[1])
    solved = solve_ivp(
        function, (0, plant.horizon), start, "DOP853", rtol=1e-12, atol=1e-13, dense_output=True, max_step=1 / speed
    ).sol
    return Signal(x, lambda t: solved(t)[0] if len(t) else t, 3.0)


def elementary(plant: Plant) -> Signal:
    kinds = [line, polynomial, oscillation, oscillation, decay, logistic]
    if not plant.of_time:
        kinds.append(integrated)
    return plant.choose(kinds)(plant)


def total(plant: Plant) -> Signal:
    a, b, c = elementary(plant), elementary(plant), plant.number(0.2, 1)
    return Signal(f"({a.text} + {c!r}*{b.text})", lambda t: a.value(t) + c * b.value(t), a.gain + b.gain)


def product(plant: Plant) -> Signal:
    a, b = elementary(plant), elementary(plant)
    return Signal(f"{a.text}*{b.text}", lambda t: a.value(t) * b.value(t), 2 * (a.gain + b.gain))


def ratio(plant: Plant) -> Signal:
    a, b, c = elementary(plant), elementary(plant), plant.number(0.5, 2)
    return Signal(f"{a.text}/({c!r} + sq({b.text}))", lambda t: a.value(t) / (c + b.value(t) ** 2), a.gain + 2 * b.gain)


def root(plant: Plant) -> Signal:
    """The algebraic variable z of z^3 + z = a, by Cardano's formula."""
    a, z = elementary(plant), plant.name("z")
    plant.lines += [f"var {z} = 0", f"eq {z}^3 + {z} = {a.text}"]
    plant.implicit = True
    return Signal(z, lambda t: 2 / np.sqrt(3) * np.sinh(np.arcsinh(1.5 * np.sqrt(3) * a.value(t)) / 3), a.gain)


def settings(plant: Plant) -> str:
    control = ", algebraic_error_control = true" if plant.implicit else ""
    return f"solver {{ rtol = 1e-9, max_steps = 200000{control} }}"


def signal(plant: Plant) -> Signal:
    """A random signal; half of them are elementary."""
    return plant.choose([elementary, elementary, elementary, total, product, ratio, root])(plant)


def changes(condition: Function, grid: Values) -> tuple[Values, Values]:
    """Times at which a value changes, by bisection to rounding, and for a truth value if it becomes true there."""
    held = condition(grid)
    (before,) = np.nonzero(held[1:] != held[:-1])
    low, high = grid[before].copy(), grid[before + 1].copy()
    start = held[before]
    for _ in range(60):
        middle = 0.5 * (low + high)
        same = condition(middle) == start
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return 0.5 * (low + high), np.logical_not(start)
