"""Random models with an event, a failure by an event, or phases."""

from dataclasses import dataclass

import numpy as np

from .running import Case, Expected
from .signals import Function, Plant, Signal, Values, changes, settings, signal

HEADER = "time t : 1"
ERROR = 3e-6  # of a state, relative to its range, allowed in the tolerances


@dataclass
class Condition:
    """A comparison of a function with a threshold."""

    text: str
    holds: Function
    function: Signal

    def inverted(self) -> "Condition":
        text = self.text.translate(str.maketrans("<>", "><"))
        return Condition(text, lambda t: ~self.holds(t), self.function)


def bump(plant: Plant) -> Signal:
    """A narrow peak over a signal, which crosses 0.1 to 0.9 of its height."""
    s = signal(plant)
    low, high = s.spread(plant.grid)
    steepest = np.abs(np.diff(s.value(plant.grid))).max()
    width = max(plant.logarithmic(1e-3, 0.5) * (high - low), 30 * steepest)
    width = float(f"{width:.6g}")
    a = plant.number(low + 0.05 * (high - low), high - 0.05 * (high - low))
    gain = s.gain * (high - low) / width
    return Signal(f"exp(-sq(({s.text} - {a!r})/{width!r}))", lambda t: np.exp(-(((s.value(t) - a) / width) ** 2)), gain)


def wave(plant: Plant) -> Signal:
    s, k = signal(plant), plant.number(1, 15)
    return Signal(f"sin({k!r}*{s.text})", lambda t: np.sin(k * s.value(t)), s.gain * k)


def square(plant: Plant) -> Signal:
    s, a = signal(plant), plant.number(-0.5, 0.5)
    return Signal(f"sq({s.text} - {a!r})", lambda t: (s.value(t) - a) ** 2, 2 * s.gain)


def extreme(plant: Plant) -> Signal:
    s, r, name = signal(plant), signal(plant), plant.choose(["min", "max"])
    pick = np.minimum if name == "min" else np.maximum
    return Signal(f"{name}({s.text}, {r.text})", lambda t: pick(s.value(t), r.value(t)), s.gain + r.gain)


def distance(plant: Plant) -> Signal:
    s, r = signal(plant), signal(plant)
    return Signal(f"abs({s.text} - {r.text})", lambda t: np.abs(s.value(t) - r.value(t)), s.gain + r.gain)


KINDS = {"signal": signal, "bump": bump, "wave": wave, "square": square, "extreme": extreme, "distance": distance}


def turning_points(values: Values) -> tuple[Values, Values]:
    """Values at the local extrema of a grid, and how far the true ones may be off."""
    slopes = np.diff(values)
    (inner,) = np.nonzero(slopes[1:] * slopes[:-1] <= 0)
    unsure = np.abs(slopes[inner + 1]) + np.abs(slopes[inner])
    return values[inner + 1], unsure


def threshold(plant: Plant, values: Values, gain: float) -> float | None:
    """A level that is crossed and not touched: near an extremum, or anywhere."""
    low, high = values.min(), values.max()
    extrema, unsure = turning_points(values)
    margin = ERROR * 10 * gain * (high - low)
    for _ in range(20):
        if len(extrema) and plant.generator.random() < 0.6:
            near = extrema[int(plant.generator.integers(len(extrema)))]
            c = near + plant.choose([1, -1]) * plant.logarithmic(1e-4, 0.2) * (high - low)
        else:
            c = plant.number(low, high)
        c = float(f"{c:.7g}")
        ends = np.abs(values[[0, -1]] - c)
        far = np.all(np.abs(extrema - c) > margin + 2 * unsure) and np.all(ends > 0.01 * (high - low))
        if far and low < c < high and margin < 0.2 * (high - low):
            return c
    return None


def comparison(plant: Plant, function: Signal) -> Condition | None:
    c = threshold(plant, function.value(plant.grid), function.gain)
    if c is None:
        return None
    sign = plant.choose([">", "<", ">=", "<="])
    text = f"{function.text} {sign} {c!r}" if plant.generator.random() < 0.5 else f"{function.text} - {c!r} {sign} 0"
    above = sign[0] == ">"
    return Condition(text.replace("- -", "+ "), lambda t: (function.value(t) > c) == above, function)


def error_of_times(condition: Condition, times: Values, horizon: float) -> Values:
    """Tolerance of times: the error of the function over its slope."""
    h = 1e-6 * horizon
    value = condition.function.value
    slope = np.abs(value(times + h) - value(times - h)) / (2 * h)
    low, high = condition.function.spread(np.linspace(0, horizon, 2001))
    return 1e-7 * horizon + ERROR * condition.function.gain * (high - low) / np.maximum(slope, 1e-300)


def draw(seed: int, stream: int) -> tuple[Plant, str, Condition]:
    """A plant with a comparison that changes at least once inside of the horizon."""
    for attempt in range(100):
        generator = np.random.default_rng((seed, stream, attempt))
        plant = Plant(generator, float(generator.choice([1.0, 10.0, 20.0, 300.0])), bool(generator.random() < 0.15))
        kind = plant.choose(list(KINDS))
        condition = comparison(plant, KINDS[kind](plant))
        if condition is None:
            continue
        times, _ = changes(condition.holds, plant.grid)
        ends = np.abs(times[:, None] - np.array([0, plant.horizon])).min(axis=1) if len(times) else []
        if 0 < len(times) < 300 and np.all(np.asarray(ends) > 1e-3 * plant.horizon):
            return plant, kind, condition
    raise RuntimeError(f"no condition in 100 attempts, seed {seed}")


def random_event(seed: int) -> Case:
    """A model whose event, failure or phases happen at known times."""
    plant, kind, condition = draw(seed, 1)
    times, rising = changes(condition.holds, plant.grid)
    errors = error_of_times(condition, times, plant.horizon)
    make = plant.choose([counted, counted, failing, phased, combined, fired])
    return make(plant, kind, condition, (times, rising, errors))


def case(plant: Plant, kind: str, lines: list[str], expected: Expected, times: Values) -> Case:
    if plant.of_time:
        lines = ["state still = 0", "eq d/dt still = 0", *lines]
    text = "\n".join([HEADER, *plant.lines, *lines, settings(plant)])
    inner = np.diff(np.concatenate([[0], times, [plant.horizon]])) / plant.horizon
    about = f"{len(times)} changes, the narrowest interval is {inner.min():.1e} of the horizon"
    kind += ", time" if plant.of_time else ""
    return Case(kind, text, plant.horizon, plant.implicit, expected, about)


def counted(plant, kind, condition, found) -> Case:
    """An event that counts, and adds up its times."""
    times, rising, errors = found
    start = bool(condition.holds(np.zeros(1))[0])
    hits, summed, allowed = times[rising], times[rising].sum(), errors[rising].sum() + 1e-9 * plant.horizon
    last = (hits[-1], errors[rising][-1]) if len(hits) else (0.0 if start else -1.0, 1e-9)
    lines = [
        "discrete hits = 0",
        "discrete total = 0",
        "discrete last = -1",
        f"event e when {condition.text}",
        "at e { next hits = hits + 1 ; next total = total + t ; next last = t }",
    ]
    discrete = {"hits": (len(hits) + start, 0), "total": (summed, allowed), "last": last}
    return case(
        plant, f"event, {kind}", lines, Expected(discrete, {}, "", (plant.horizon, 1e-9 * plant.horizon)), times
    )


def failing(plant, kind, condition, found) -> Case:
    """A failure at the first time at which the condition becomes true."""
    times, _, errors = found
    if condition.holds(np.zeros(1))[0]:
        condition = condition.inverted()
    expected = Expected({}, {}, "low", (float(times[0]), float(errors[0])))
    return case(plant, f"failure, {kind}", [f"fail low event {condition.text}"], expected, times)


def phased(plant, kind, condition, found) -> Case:
    """Two phases that follow each other at both edges of the condition."""
    times, _, errors = found
    start = bool(condition.holds(np.zeros(1))[0])
    switches = times if not start else np.concatenate([[0], times])
    lines = [
        "discrete hits = 0",
        "discrete total = 0",
        f"phase off until {condition.text} then on {{ next hits = hits + 1 ; next total = total + t }}",
        f"phase on until not ({condition.text}) then off {{ next hits = hits + 1 ; next total = total + t }}",
    ]
    discrete = {"hits": (len(switches), 0), "total": (times.sum(), errors.sum() + 1e-9 * plant.horizon)}
    return case(
        plant, f"phases, {kind}", lines, Expected(discrete, {}, "", (plant.horizon, 1e-9 * plant.horizon)), times
    )


def fired(plant, kind, condition, found) -> Case:
    """A sum that an event puts back to zero, and a second event that holds shortly before each of these."""
    rate, w = plant.logarithmic(3, 100) / plant.horizon, plant.logarithmic(3, 60) / plant.horizon
    rate, w, depth = float(f"{rate:.6g}"), float(f"{w:.6g}"), plant.number(0, 0.9)
    near = float(f"{1 - plant.logarithmic(1e-3, 0.3):.6g}")
    lines = [
        f"state phi = 0 scale {plant.horizon!r}",
        "eq d/dt phi = 1",
        "state sum_up = 0 scale 1",
        f"eq d/dt sum_up = {rate!r}*(1 + {depth!r}*cos({w!r}*phi))",
        *("discrete hits = 0", "discrete total = 0", "discrete nearly = 0", "discrete nearly_total = 0"),
        "event full when sum_up >= 1",
        "at full { reset sum_up = 0 ; next hits = hits + 1 ; next total = total + t }",
        f"event almost when sum_up > {near!r}",
        "at almost { next nearly = nearly + 1 ; next nearly_total = nearly_total + t }",
    ]

    def reached(shift):
        return changes(lambda t: np.floor(rate * (t + depth * np.sin(w * t) / w) + shift), plant.grid)[0]

    full, nearly = reached(0), reached(1 - near)
    allowed = 1e-5 * plant.horizon * max(len(nearly), 1) / (1 - depth)
    if np.any(np.abs(np.concatenate([full, nearly]) - plant.horizon) < 1e-4 * plant.horizon):
        return counted(plant, kind, condition, found)
    discrete = {
        **{"hits": (len(full), 0), "total": (full.sum(), allowed)},
        **{"nearly": (len(nearly), 0), "nearly_total": (nearly.sum(), allowed)},
    }
    expected = Expected(discrete, {}, "", (plant.horizon, 1e-9 * plant.horizon))
    plant.lines, plant.implicit, plant.of_time = [], False, False
    return case(plant, "reset", lines, expected, np.sort(np.concatenate([full, nearly])))


def combined(plant, kind, condition, found) -> Case:
    """A phase that ends where two conditions hold together, or one of them."""
    function = KINDS[plant.choose(list(KINDS))](plant)
    other, word = comparison(plant, function), plant.choose(["and", "or"])
    if other is None:
        return counted(plant, kind, condition, found)

    def both(t):
        a, b = condition.holds(t), other.holds(t)
        return a & b if word == "and" else a | b

    times, rising = changes(both, plant.grid)
    near = np.concatenate([times, *(changes(c.holds, plant.grid)[0] for c in (condition, other))])
    near = np.sort(near)
    apart = np.diff(near)
    errors = [error_of_times(c, times, plant.horizon) for c in (condition, other)]
    errors = np.where(np.isfinite(errors), errors, 0)
    crossed = np.array(
        [c.holds(times - 1e-9 * plant.horizon) != c.holds(times + 1e-9 * plant.horizon) for c in (condition, other)]
    )
    allowed = np.where(crossed, errors, 0).max(axis=0) + 1e-7 * plant.horizon
    if np.any((apart > 1e-12 * plant.horizon) & (apart < 1e-4 * plant.horizon)):
        return counted(plant, kind, condition, found)  # which of them is first would be a matter of rounding
    first = np.concatenate([times[rising], [plant.horizon]])[0]
    error = np.concatenate([allowed[rising], [0]])[0]
    if both(np.zeros(1))[0]:
        first, error = 0.0, 1e-9 * plant.horizon
    ended = first < plant.horizon
    lines = [
        "discrete when_done = -1",
        f"phase run until {condition.text} {word} {other.text} then done {{ next when_done = t }}",
        "phase done",
    ]
    discrete = {"when_done": (float(first) if ended else -1.0, float(error))}
    expected = Expected(discrete, {}, "", (plant.horizon, 1e-9 * plant.horizon))
    return case(plant, f"phase with {word}, {kind}", lines, expected, times)
