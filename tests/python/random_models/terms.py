"""Expressions of random models: texts of the language, each with a function that evaluates it in NumPy."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import reduce
from itertools import product

import numpy as np

ATOM, POWER, PRODUCT, SUM, CHOICE = range(5)  # how loosely an expression binds

Number = np.ndarray | float
Member = int | str
Members = tuple[Member, ...]
Scope = Mapping[str, Member]
Key = tuple[str, Members]


@dataclass(frozen=True)
class Expr:
    """A text and its value in a world, for members bound to indices; `size` is about the largest magnitude."""

    text: str
    value: Callable[["World", Scope], Number]
    size: float = 1.0
    level: int = ATOM

    def within(self, level: int) -> str:
        """The text, in brackets if it binds more loosely than `level`."""
        return self.text if self.level <= level else f"({self.text})"


Definitions = dict[Key, tuple[Expr, Scope]]


@dataclass(frozen=True)
class Index:
    """An index of an array."""

    text: str
    of: Callable[[Scope], Member]


@dataclass(frozen=True)
class Axis:
    """Range of an index of an array: the name of a set, or numbers."""

    text: str
    members: Members
    named: bool

    @property
    def numbers(self) -> bool:
        return isinstance(self.members[0], int)


@dataclass(frozen=True)
class Array:
    """Something declared; a scalar has no axes."""

    name: str
    axes: tuple[Axis, ...] = ()
    size: float = 2.0

    def elements(self) -> Iterator[Key]:
        return ((self.name, index) for index in product(*(a.members for a in self.axes)))


@dataclass(frozen=True)
class Place:
    """Context of an expression: values of the bound indices, and how often it is evaluated."""

    bound: Mapping[str, Members] = field(default_factory=dict)
    count: int = 1

    def bind(self, name: str, members: Members, times: int = 1) -> "Place":
        return Place({**self.bound, name: members}, self.count * times)

    def scopes(self) -> list[dict[str, Member]]:
        return [dict(zip(self.bound, members, strict=True)) for members in product(*self.bound.values())]


@dataclass(frozen=True)
class Condition:
    """A condition, and the places where its two branches are evaluated."""

    text: str
    holds: Callable[["World | None", Scope], bool]
    then: Place
    otherwise: Place


class World:
    """Values by name and members; what is not given follows from its definition."""

    def __init__(self, definitions: Definitions, given: Mapping[Key, Number], time: float) -> None:
        self.definitions, self.values, self.time = definitions, dict(given), time
        for key in definitions:  # in the order of dependence: no deep recursion along chains
            self.get(key)

    def get(self, key: Key) -> Number:
        if key not in self.values:
            self.values[key] = self.evaluate(self.definitions[key])
        return self.values[key]

    def evaluate(self, definition: tuple[Expr, Scope]) -> Number:
        expression, scope = definition
        return expression.value(self, scope)


def flat(key: Key) -> str:
    """The name of an element."""
    return f"{key[0]}[{','.join(map(str, key[1]))}]" if key[1] else key[0]


def constant(x: float) -> Expr:
    return Expr(repr(x), lambda w, s: x, abs(x))


def call(template: str, f: Callable[..., Number], size: float, *of: Expr, level: int = ATOM) -> Expr:
    """A function of expressions; the template puts them into brackets where they need them."""
    return Expr(template.format(*(e.text for e in of)), lambda w, s: f(*(e.value(w, s) for e in of)), size, level)


def infix(a: Expr, operator: str, b: Expr) -> Expr:
    """Sum, difference, product, quotient."""
    f = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}[operator]
    level, size = (SUM, a.size + b.size) if operator in "+-" else (PRODUCT, a.size * b.size)
    text = f"{a.within(level)} {operator} {b.within(PRODUCT if level == SUM else POWER)}"
    return Expr(text, lambda w, s: f(a.value(w, s), b.value(w, s)), size, level)


def if_else(test: Condition, a: Expr, b: Expr) -> Expr:
    text = f"if {test.text} then {a.text} else {b.text}"
    return Expr(text, lambda w, s: (a if test.holds(w, s) else b).value(w, s), max(a.size, b.size), CHOICE)


def real(x: Number) -> float:
    """The value without its derivatives."""
    return float(np.max(np.real(x)))


def least(*values: Number) -> Number:
    return min(values, key=real)


def greatest(*values: Number) -> Number:
    return max(values, key=real)


def magnitude(x: Number) -> Number:
    return x * np.sign(real(x))


def root_of_cubic(e: Number) -> Number:
    """The root v of v^3 + v = e."""
    return 2 / 3**0.5 * np.sinh(np.arcsinh(1.5 * 3**0.5 * e) / 3)


REDUCTIONS: dict[str, Callable[..., Number]] = {
    "sum": lambda *values: sum(values),
    "product": lambda *values: reduce(np.multiply, values, 1.0),
    "min": least,
    "max": greatest,
    "mean": lambda *values: sum(values) / len(values),
}
COMPARISONS: dict[str, Callable[[Member, Member], bool]] = {
    "==": lambda a, b: a == b,
    "!=": lambda a, b: a != b,
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
}
# Text, value, magnitude, level. An argument before a power without brackets is an atom.
FUNCTIONS: tuple[tuple[str, Callable[..., Number], Callable[[float], float], int], ...] = (
    ("exp(-sq({}))", lambda a: np.exp(-a * a), lambda size: 1.0, ATOM),
    ("exp(sin({}))", lambda a: np.exp(np.sin(a)), lambda size: 2.8, ATOM),
    ("ln(1 + sq({}))", lambda a: np.log(1 + a * a), lambda size: 1 + size, ATOM),
    ("ln(0.5 + abs({}))", lambda a: np.log(0.5 + magnitude(a)), lambda size: 1 + size, ATOM),
    ("sqrt(0.1 + sq({}))", lambda a: np.sqrt(0.1 + a * a), lambda size: 1 + size, ATOM),
    ("tanh({})", np.tanh, lambda size: min(1.0, size), ATOM),
    ("sin({})", np.sin, lambda size: min(1.0, size), ATOM),
    ("abs({})", magnitude, lambda size: size, ATOM),
    ("clip({}, -0.7, 1.2)", lambda a: least(greatest(a, -0.7), 1.2), lambda size: 1.2, ATOM),
    ("sq({})", lambda a: a * a, lambda size: size**2, ATOM),
    ("{}^2", lambda a: a * a, lambda size: size**2, POWER),
    ("tanh({})^3", lambda a: np.tanh(a) ** 3, lambda size: 1.0, POWER),
    ("2^tanh({})", lambda a: np.exp(np.log(2) * np.tanh(a)), lambda size: 2.0, POWER),
    ("(0.5 + abs({}))^0.7", lambda a: (0.5 + magnitude(a)) ** 0.7, lambda size: 1 + size, POWER),
    ("(1 + sq({}))^-0.5", lambda a: (1 + a * a) ** -0.5, lambda size: 1.0, POWER),
    ("-{}^2 / 2", lambda a: -a * a / 2, lambda size: size**2, PRODUCT),
    ("1 - 0.3 - ({})", lambda a: 0.7 - a, lambda size: 1 + size, SUM),
)
