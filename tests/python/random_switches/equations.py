"""Random models whose rates jump or bend where a signal passes a level, integrated piece by piece."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .events import ERROR, HEADER, threshold, turning_points
from .running import GRIDS, Case, Expected
from .signals import Function, Plant, Signal, Values, changes, literal, settings, signal

PIECES = 400  # of the horizon, besides those between control steps and levels
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


@dataclass
class Shape:
    """A rate of the model, its value over time, and the functions that are zero where it jumps or bends."""

    text: str
    value: Function
    levels: list[Function]
    slope: float = 0.0  # how much it amplifies an error of the states between levels


class Unclear(Exception):
    """A level that a signal touches, or that it does not reach: the draw is repeated."""


def level(plant: Plant, s: Signal) -> float:
    found = threshold(plant, s.value(plant.grid), s.gain)
    if found is None:
        raise Unclear
    return found


def clear(plant: Plant, s: Signal, levels: Values) -> None:
    """The signal turns and ends away from all levels."""
    values = s.value(plant.grid)
    extrema, unsure = turning_points(values)
    extrema, unsure = np.append(extrema, values[[0, -1]]), np.append(unsure, [0, 0])
    spread = values.max() - values.min()
    margin = np.minimum(10 * ERROR * s.gain, 0.2) * spread + 2 * unsure
    if np.any(np.abs(extrema[:, None] - levels) <= margin[:, None]):
        raise Unclear


def span(plant: Plant, s: Signal) -> tuple[float, float]:
    """A level and one above it, from 1e-3 to 0.5 of the signal's range apart."""
    low, high = s.spread(plant.grid)
    a = level(plant, s)
    b = float(f"{a + plant.logarithmic(1e-3, 0.5) * (high - low):.9g}")
    clear(plant, s, np.array([a, b]))
    return a, b


def at(s: Signal, *levels: float) -> list[Function]:
    return [lambda t, a=a: s.value(t) - a for a in levels]


def branch(plant: Plant) -> Shape:
    s = signal(plant)
    a, r, q = level(plant, s), plant.number(-2, 2), plant.number(-2, 2)
    sign = plant.choose([">", "<", ">=", "<="])
    if sign[0] == "<":
        return Shape(
            f"(if {s.text} {sign} {a!r} then {q} else {r})", lambda t: np.where(s.value(t) > a, r, q), at(s, a)
        )
    return Shape(f"(if {s.text} {sign} {a!r} then {r} else {q})", lambda t: np.where(s.value(t) > a, r, q), at(s, a))


def window(plant: Plant) -> Shape:
    s = signal(plant)
    (a, b), r, q = span(plant, s), plant.number(-2, 2), plant.number(-2, 2)
    text = plant.choose(
        [
            f"(if {s.text} > {a!r} and {s.text} < {b!r} then {r} else {q})",
            f"(if {s.text} < {a!r} or {s.text} > {b!r} then {q} else {r})",
            f"(if not ({s.text} < {a!r}) and {s.text} <= {b!r} then {r} else {q})",
        ]
    )
    return Shape(text, lambda t: np.where((s.value(t) > a) & (s.value(t) < b), r, q), at(s, a, b))


def nested(plant: Plant) -> Shape:
    s, other = signal(plant), branch(plant)
    a, smooth = level(plant, s), signal(plant)
    text = f"(if {s.text} > {a!r} then {other.text} else {smooth.text})"
    return Shape(
        text, lambda t: np.where(s.value(t) > a, other.value(t), smooth.value(t)), [*at(s, a), *other.levels], 1
    )


def table(plant: Plant) -> Shape:
    s, kind, name = signal(plant), plant.choose(["from", "until", "linear"]), plant.name("T")
    a, b = span(plant, s)
    points = np.array([a, b, b + (b - a) * plant.number(0.5, 3)])
    if kind == "linear":
        points = np.array([a, 0.5 * (a + b), b])
    points = np.array([float(f"{p:.9g}") for p in points])
    clear(plant, s, points)
    outputs = [0.0, plant.number(-2, 2), plant.number(-2, 2) if kind != "linear" else 0.0]
    entries = ", ".join(f"{p!r}: {v!r}" for p, v in zip(points.tolist(), outputs, strict=True))
    plant.lines.append(f"table {name} over q : 1 {kind} {{ {entries} }}")
    values = {
        "from": lambda t: np.array(outputs)[np.clip(np.searchsorted(points, s.value(t)) - 1, 0, 2)],
        "until": lambda t: np.array(outputs)[np.clip(np.searchsorted(points, s.value(t)), 0, 2)],
        "linear": lambda t: np.interp(s.value(t), points, outputs),
    }
    slope = 4 / (b - a) if kind == "linear" else 0.0
    return Shape(f"{name}({s.text})", values[kind], at(s, *points), slope)


def signum(plant: Plant) -> Shape:
    s = signal(plant)
    a = level(plant, s)
    return Shape(f"sign({s.text} - {literal(a)})", lambda t: np.sign(s.value(t) - a), at(s, a))


def rounded(plant: Plant) -> Shape:
    """A staircase or a saw."""
    s, name = signal(plant), plant.choose(["floor", "ceil", "round", "mod"])
    low, high = s.spread(plant.grid)
    step = float(f"{(high - low) / plant.number(1.5, 20):.6g}")
    shift = 0.5 if name == "round" else 0.0
    levels = (np.arange(np.floor(low / step) - 1, np.ceil(high / step) + 1) + shift) * step
    levels = levels[(levels > low) & (levels < high)]
    if not len(levels):
        raise Unclear
    clear(plant, s, levels)
    if name == "mod":
        return Shape(
            f"mod({s.text}, {step!r})/{step!r}", lambda t: np.mod(s.value(t), step) / step, at(s, *levels), 1 / step
        )
    function = {"floor": np.floor, "ceil": np.ceil, "round": np.round}[name]
    return Shape(f"{name}({s.text}/{step!r})", lambda t: function(s.value(t) / step), at(s, *levels))


def bent(plant: Plant) -> Shape:
    """A function with a kink at one level or two."""
    s, name = signal(plant), plant.choose(["abs", "min", "max", "clip", "tent"])
    a, b = span(plant, s)
    w = float(f"{b - a:.6g}")
    clear(plant, s, np.array([a, a + w, a - w]))
    text, value, levels = {
        "abs": (f"abs({s.text} - {literal(a)})", lambda t: np.abs(s.value(t) - a), [a]),
        "min": (f"min({s.text}, {literal(a)})", lambda t: np.minimum(s.value(t), a), [a]),
        "max": (f"max({literal(a)}, {s.text})", lambda t: np.maximum(a, s.value(t)), [a]),
        "clip": (
            f"clip(({s.text} - {literal(a)})/{w!r}, 0, 1)",
            lambda t: np.clip((s.value(t) - a) / w, 0, 1),
            [a, a + w],
        ),
        "tent": (
            f"max(0, 1 - abs({s.text} - {literal(a)})/{w!r})",
            lambda t: np.maximum(0, 1 - np.abs(s.value(t) - a) / w),
            [a - w, a, a + w],
        ),
    }[name]
    return Shape(text, value, at(s, *levels), 1 / w if name in ("clip", "tent") else 1.0)


SHAPES: dict[str, Callable[[Plant], Shape]] = {
    "branch": branch,
    "window": window,
    "nested": nested,
    "table": table,
    "sign": signum,
    "rounded": rounded,
    "kink": bent,
}


def integral(shape: Shape, plant: Plant) -> tuple[Function, float]:
    """The integral from 0 to a time that is an end of a control step, and its tolerance."""
    horizon = plant.horizon
    crossings = [changes(lambda t, g=g: g(t) > 0, plant.grid)[0] for g in shape.levels]
    if sum(map(len, crossings)) > 300:
        raise Unclear
    ends = np.concatenate([np.arange(count + 1) / count * horizon for count in (PIECES, *GRIDS)])
    nodes = np.unique(np.concatenate([ends, *crossings]))
    half = 0.5 * np.diff(nodes)
    points = 0.5 * (nodes[1:] + nodes[:-1])[:, None] + half[:, None] * NODES
    values = shape.value(points.ravel()).reshape(points.shape)
    sums = np.concatenate([[0], np.cumsum(half * (values @ WEIGHTS))]) / horizon
    return lambda t: sums[np.abs(nodes - t).argmin()], tolerance(shape, crossings, values, horizon)


def tolerance(shape: Shape, crossings: list[Values], values: Values, horizon: float) -> float:
    """Bound of the error of the integral: by the times of jumps, and between them."""
    late, h = 0.0, 1e-6 * horizon
    for g, times in zip(shape.levels, crossings, strict=True):
        slopes = np.abs(g(times + h) - g(times - h)) / (2 * h)
        late += np.sum(3 * ERROR / np.maximum(slopes, 1e-300) + 1e-7 * horizon)
    spread = values.max() - values.min()
    return float(spread * late / horizon + 3 * ERROR * min(shape.slope, 20) + 1e-6 * (1 + np.abs(values).max()))


def looped(plant: Plant) -> list[tuple[str, Shape]]:
    """Twenty rates in one loop, each with its own level."""
    s = signal(plant)
    low, high = s.spread(plant.grid)
    first, apart = plant.number(low, high - 0.1 * (high - low)), float(f"{(high - low) / plant.number(20, 60):.6g}")
    width = float(f"{plant.logarithmic(0.02, 1) * apart:.6g}")
    bottoms = first + apart * np.arange(1, 21)
    clear(plant, s, np.concatenate([bottoms, bottoms + width]))
    plant.lines += [
        "set row = 1..20",
        "state y[i in row] = 0 scale 1",
        f"eq d/dt y[i] = (if {s.text} > {first!r} + {apart!r}*i and {s.text} < {first!r} + {apart!r}*i + {width!r}"
        f" then 1 else 0)/{plant.horizon!r}   for i in row",
    ]

    def one(a):
        return Shape("", lambda t: np.where((s.value(t) > a) & (s.value(t) < a + width), 1.0, 0.0), at(s, a, a + width))

    return [(f"y[{i + 1}]", one(float(a))) for i, a in enumerate(bottoms)]


def scalar(plant: Plant, name: str) -> list[tuple[str, Shape]]:
    shape = SHAPES[name](plant)
    if plant.generator.random() < 0.3:
        other = SHAPES[plant.choose(list(SHAPES))](plant)
        first, c = shape, plant.number(0.3, 1)
        shape = Shape(
            f"{first.text} + {c!r}*{other.text}",
            lambda t: first.value(t) + c * other.value(t),
            first.levels + other.levels,
            first.slope + other.slope,
        )
    plant.state("y", 0.0, f"({shape.text})/{plant.horizon!r}")
    return [("y", shape)]


def random_equation(seed: int) -> Case:
    """A model whose rates jump or bend at levels of states, of algebraic variables or of time."""
    for attempt in range(300):
        generator = np.random.default_rng((seed, 2, attempt))
        plant = Plant(generator, float(generator.choice([1.0, 10.0, 20.0, 300.0])), bool(generator.random() < 0.15))
        kind = plant.choose([*SHAPES, "loop"])
        try:
            found = looped(plant) if kind == "loop" else scalar(plant, kind)
            states = {name: integral(shape, plant) for name, shape in found}
        except Unclear:
            continue
        text = "\n".join([HEADER, *plant.lines, settings(plant)])
        kind += ", time" if plant.of_time else ""
        expected = Expected({}, states, "", (plant.horizon, 1e-9 * plant.horizon))
        return Case(kind, text, plant.horizon, plant.implicit, expected)
    raise RuntimeError(f"no model in 300 attempts, seed {seed}")
