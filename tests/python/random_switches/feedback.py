"""Random models whose switches move what they depend on, integrated by SciPy from switch to switch."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from .events import HEADER
from .running import Case, Expected
from .signals import Plant, Values, settings

TOLERANCE = 1e-4


@dataclass
class Loop:
    """A system with sides: +1 where a level function is positive, else -1; `rates(t, y, sides)` holds between them."""

    names: list[str]
    start: list[float]
    rates: Callable[[float, Values, Values], list[float]]
    levels: list[Callable[[float, Values], float]]
    lines: list[str]


def solution(loop: Loop, horizon: float) -> Callable[[float], Values]:
    """Integrates by DOP853, stopping at each level; the rates of one side hold up to the level and beyond it."""
    t, y = 0.0, np.array(loop.start)
    sides = np.array([1.0 if g(t, y) > 0 else -1.0 for g in loop.levels])
    parts = []
    while t < horizon:
        watched = []
        for g, side in zip(loop.levels, sides, strict=True):

            def crossed(time, state, g=g):
                return g(time, state)

            crossed.terminal, crossed.direction = True, -side
            watched.append(crossed)
        found = solve_ivp(
            lambda time, state: loop.rates(time, state, sides),
            (t, horizon),
            y,
            "DOP853",
            events=watched,
            max_step=horizon / 300,
            dense_output=True,
            rtol=1e-11,
            atol=1e-13,
        )
        parts.append((found.t[-1], found.sol))
        t, y = found.t[-1], found.y[:, -1]
        for k, times in enumerate(found.t_events):
            if len(times):
                sides[k] = -sides[k]
        if len(parts) > 500:
            raise RuntimeError("switches without end")

    def at(time: float) -> Values:
        return next((sol(time) for end, sol in parts if time <= end), y)

    return at


def scheduled_tank(plant: Plant) -> Loop:
    """A level that rises through the rows of a table of outflows."""
    a, w, kind = plant.number(0.2, 0.6), plant.logarithmic(2e-3, 0.3), plant.choose(["from", "until"])
    points, flows = [a, a + w, a + 2 * w], [0.0, plant.number(0.2, 0.9), plant.choose([0.0, plant.number(0, 0.9)])]
    points = [float(f"{p:.9g}") for p in points]
    rate = plant.number(1.2, 1.8) / plant.horizon
    entries = ", ".join(f"{p!r}: {f!r}" for p, f in zip(points, flows, strict=True))
    lines = [
        f"table flow over level : 1 {kind} {{ {entries} }}",
        "state h = 0",
        f"eq d/dt h = {rate!r}*(1 - flow(h))",
    ]
    steps = {"until": points[:2], "from": points[1:]}[kind]

    def rates(t, y, sides):
        return [rate * (1 - flows[int(sum(sides > 0))])]

    return Loop(["h"], [0.0], rates, [lambda t, y, p=p: y[0] - p for p in steps], lines)


def bent_tank(plant: Plant) -> Loop:
    """A level that rises through a peak of outflow between three points."""
    a, w, top = plant.number(0.2, 0.6), plant.logarithmic(2e-3, 0.3), plant.number(0.3, 0.9)
    points = [float(f"{p:.9g}") for p in (a, a + w, a + 2 * w)]
    rate = plant.number(1.2, 1.8) / plant.horizon
    lines = [
        f"table flow over level : 1 linear {{ {points[0]!r}: 0, {points[1]!r}: {top!r}, {points[2]!r}: 0 }}",
        "state h = 0",
        f"eq d/dt h = {rate!r}*(1 - flow(h))",
    ]

    def rates(t, y, sides):
        p, k = points, int(sum(sides > 0))
        slopes = [0, top * (y[0] - p[0]) / (p[1] - p[0]), top * (p[2] - y[0]) / (p[2] - p[1]), 0]
        return [rate * (1 - slopes[k])]

    return Loop(["h"], [0.0], rates, [lambda t, y, p=p: y[0] - p for p in points], lines)


def damped_window(plant: Plant) -> Loop:
    """An oscillation that is damped near its middle only."""
    w, a, k = 2 * np.pi * plant.number(1, 8) / plant.horizon, plant.logarithmic(5e-3, 0.5), plant.number(0.2, 1)
    w = float(f"{w:.6g}")
    k = float(f"{k * w:.6g}")
    lines = [
        "state x = 1",
        f"eq d/dt x = {w!r}*v",
        "state v = 0",
        f"eq d/dt v = -{w!r}*x - (if abs(x) < {a!r} then {k!r}*v else 0)",
    ]

    def rates(t, y, sides):
        inside = sides[0] < 0 < sides[1]
        return [w * y[1], -w * y[0] - (k * y[1] if inside else 0.0)]

    return Loop(["x", "v"], [1.0, 0.0], rates, [lambda t, y: y[0] - a, lambda t, y: y[0] + a], lines)


def springy_floor(plant: Plant) -> Loop:
    """A ball on a stiff floor with damping."""
    g, k, c = (
        20 / plant.horizon**2,
        plant.logarithmic(1e3, 3e5) / plant.horizon**2,
        plant.number(0.1, 1) / plant.horizon,
    )
    g, k, c = (float(f"{v:.6g}") for v in (g, k, c))
    lines = [
        "state h = 1",
        f"state v = 0 scale {10 / plant.horizon!r}",
        "eq d/dt h = v",
        f"eq d/dt v = -{g!r} + (if h < 0 then -{k!r}*h - {c!r}*v else 0)",
    ]

    def rates(t, y, sides):
        return [y[1], -g + (-k * y[0] - c * y[1] if sides[0] < 0 else 0.0)]

    return Loop(["h", "v"], [1.0, 0.0], rates, [lambda t, y: y[0]], lines)


def relay(plant: Plant) -> Loop:
    """A relay round three lags, which cycles."""
    k, a = plant.number(20, 60) / plant.horizon, plant.number(0.2, 0.8)
    k = float(f"{k:.6g}")
    lines = [
        *("state x = 0", "state y = 0", "state z = 0"),
        f"eq d/dt x = {k!r}*((if z < {a!r} then 1 else 0) - x)",
        f"eq d/dt y = {k!r}*(x - y)",
        f"eq d/dt z = {k!r}*(y - z)",
    ]

    def rates(t, y, sides):
        return [k * (float(sides[0] < 0) - y[0]), k * (y[0] - y[1]), k * (y[1] - y[2])]

    return Loop(["x", "y", "z"], [0.0] * 3, rates, [lambda t, y: y[2] - a], lines)


def spring(plant: Plant, edge: float, text: str, pull: Callable[[float, bool, bool], float]) -> Loop:
    """An oscillator whose force bends at both edges, `pull(x, above, below)`."""
    w = float(f"{2 * np.pi * plant.number(1, 8) / plant.horizon:.6g}")
    lines = ["state x = 1", f"eq d/dt x = {w!r}*v", "state v = 0.3", f"eq d/dt v = -{w!r}*({text})"]

    def rates(t, y, sides):
        return [w * y[1], -w * pull(y[0], sides[0] > 0, sides[1] < 0)]

    return Loop(["x", "v"], [1.0, 0.3], rates, [lambda t, y: y[0] - edge, lambda t, y: y[0] + edge], lines)


def play(plant: Plant) -> Loop:
    a = plant.logarithmic(5e-3, 0.3)
    text = f"max(x - {a!r}, 0) + min(x + {a!r}, 0)"
    return spring(plant, a, text, lambda x, high, low: x - a if high else x + a if low else 0.0)


def saturation(plant: Plant) -> Loop:
    b = plant.number(0.3, 0.8)
    return spring(plant, b, f"clip(x, -{b!r}, {b!r})", lambda x, high, low: b if high else -b if low else x)


def stairs(plant: Plant) -> Loop:
    """A rise that is faster on every other tread of a staircase."""
    k, r = plant.number(2, 25), plant.number(0.3, 1)
    rate = float(f"{1 / plant.horizon:.6g}")
    lines = ["state x = 0.001", f"eq d/dt x = {rate!r}*(1 + {r!r}*mod(floor({k!r}*x), 2))"]

    def rates(t, y, sides):
        return [rate * (1 + r * (int(sum(sides > 0)) % 2))]

    levels = [lambda t, y, n=n: k * y[0] - n for n in range(1, int(2.1 * k) + 2)]
    return Loop(["x"], [0.001], rates, levels, lines)


LOOPS = {
    "table of steps": scheduled_tank,
    "table of lines": bent_tank,
    "window": damped_window,
    "floor": springy_floor,
    "relay": relay,
    "play": play,
    "saturation": saturation,
    "stairs": stairs,
}


def random_feedback(seed: int) -> Case:
    generator = np.random.default_rng((seed, 3))
    plant = Plant(generator, float(generator.choice([1.0, 10.0, 300.0])), False)
    kind = plant.choose(list(LOOPS))
    loop = LOOPS[kind](plant)
    at = solution(loop, plant.horizon)
    scale = np.abs([at(t) for t in np.linspace(0, plant.horizon, 50)]).max(axis=0)
    states = {
        name: (lambda t, k=k: float(at(t)[k]), TOLERANCE * max(float(scale[k]), 1e-3))
        for k, name in enumerate(loop.names)
    }
    expected = Expected({}, states, "", (plant.horizon, 1e-9 * plant.horizon))
    return Case(f"feedback, {kind}", "\n".join([HEADER, *loop.lines, settings(plant)]), plant.horizon, False, expected)
