"""Random elements, conditions and expressions."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from .terms import (
    ATOM,
    COMPARISONS,
    FUNCTIONS,
    POWER,
    PRODUCT,
    REDUCTIONS,
    SUM,
    Array,
    Axis,
    Condition,
    Expr,
    Index,
    Member,
    Members,
    Number,
    Place,
    Scope,
    World,
    call,
    constant,
    greatest,
    if_else,
    infix,
    least,
    real,
)

LARGEST = 20.0  # magnitude beyond which an expression is scaled
DEAREST = 1200  # terms of reductions in one statement
SIZES = (2, 3, 4, 5, 7, 9, 12, 14, 15, 16, 17, 18, 19, 24, 31, 33, 40)
NAMES = ("i", "j", "k", "m")  # of indices

T = TypeVar("T")


@dataclass(frozen=True)
class Loop:
    """An index of a reduction: all members that it may have, and those where the others are bound."""

    name: str
    text: str
    members: Members
    over: Callable[[Scope], Iterable[Member]]


class Writer:
    """Draws expressions of what is declared in `arrays`, with indices over `axes`; `n` is the parameter of ranges."""

    random: np.random.Generator
    n: int
    axes: list[Axis]
    arrays: dict[str, list[Array]]

    # Small choices.

    def chance(self, p: float) -> bool:
        return bool(self.random.random() < p)

    def pick(self, items: Sequence[T]) -> T:
        return items[self.random.integers(len(items))]

    def names(self, axes: Iterable[Axis]) -> list[tuple[str, Axis]]:
        return list(zip(self.random.permutation(NAMES).tolist(), axes, strict=False))

    def digits(self) -> Expr:
        return constant(round(float(self.random.uniform(0.2, 1.5)), 2))

    def whole(self, k: int) -> str:
        """A whole number, at times by its distance from `n`."""
        if abs(k - self.n) > 3 or self.chance(0.4):
            return str(k)
        return "n" if k == self.n else f"n {'-' if k < self.n else '+'} {abs(k - self.n)}"

    def range_of(self, members: Members) -> str:
        return f"{self.whole(members[0])}..{self.whole(members[-1])}"

    # Elements.

    def _at(self, member: int | str) -> Index:
        return Index(member if isinstance(member, str) else self.whole(member), lambda s: member)

    def _shifted(self, name: str, offset: int) -> Index:
        if offset == 0:
            return Index(name, lambda s: s[name])
        return Index(f"{name} {'+' if offset > 0 else '-'} {abs(offset)}", lambda s: s[name] + offset)

    def _element(self, array: Array, indices: list[Index]) -> Expr:
        text = f"{array.name}[{', '.join(i.text for i in indices)}]" if indices else array.name
        return Expr(text, lambda w, s: w.get((array.name, tuple(i.of(s) for i in indices))), array.size)

    def _number(self, place: Place, name: str) -> Expr:
        return Expr(name, lambda w, s: float(s[name]), float(max(place.bound[name])))

    def reference(self, place: Place, arrays: list[Array]) -> Expr:
        """An element of one of the arrays; its indices follow those that are bound, or stay."""
        array = self.pick(arrays)
        return self._element(array, [self._subscript(place, axis) for axis in array.axes])

    def _subscript(self, place: Place, axis: Axis) -> Index:
        found: list[Index] = []
        low, high = axis.members[0], axis.members[-1]
        for name, members in place.bound.items():
            if isinstance(members[0], int) != axis.numbers:
                continue
            if not axis.numbers:
                found.append(self._shifted(name, 0))
                continue
            least_of, most_of = min(members), max(members)
            for offset in (0, 0, 0, 0, -1, -1, 1, 1, -2, 2, 3, low - least_of):
                if low <= least_of + offset and most_of + offset <= high:
                    found.append(self._shifted(name, offset))
            if self.chance(0.3):
                found += self._mirrored(place, name, low, high)
        return self.pick(found) if found and self.chance(0.9) else self._at(self.pick(axis.members))

    def _mirrored(self, place: Place, name: str, low: int, high: int) -> list[Index]:
        """A number, or another index, minus an index, where that stays on an axis."""
        members = place.bound[name]
        totals = [t for t in (low + high, low + max(members), high + min(members)) if t - max(members) >= low]
        found = [Index(f"{t} - {name}", lambda s, t=t: t - s[name]) for t in totals if t - min(members) <= high]
        for other, numbers in place.bound.items():
            if other != name and isinstance(numbers[0], int):
                ends = min(numbers) - max(members), max(numbers) - min(members)
                if low <= ends[0] and ends[1] <= high:
                    found.append(Index(f"{other} - {name}", lambda s, other=other: s[other] - s[name]))
        return found

    # Expressions.

    def condition(self, place: Place, fixed: bool = False) -> Condition:
        """A condition on an index, on values, or on both; `fixed`: known to the compiler."""
        if not place.bound or (not fixed and self.chance(0.2)):
            e, limit = self.leaf(place), round(float(self.random.uniform(0.3, 1.7)), 7)
            return Condition(f"{e.within(PRODUCT)} > {limit}", lambda w, s: real(e.value(w, s)) > limit, place, place)
        name = self.pick(list(place.bound))
        members = place.bound[name]
        operator = self.pick(list(COMPARISONS) if isinstance(members[0], int) else ["==", "!="])
        limit, compare = self.pick(members), COMPARISONS[operator]
        text = f"{name} {operator} {str(limit) if fixed else self._at(limit).text}"
        then = otherwise = place
        if "n" not in text.split():  # a parameter in a condition leaves both branches
            branches = [[m for m in members if compare(m, limit) == wanted] for wanted in (True, False)]
            then, otherwise = (place.bind(name, tuple(kept) or members) for kept in branches)
        form = self.pick(("plain", "plain", "plain", "not", "and", "or"))
        if form == "plain":
            return Condition(text, lambda w, s: compare(s[name], limit), then, otherwise)
        if form == "not":
            return Condition(f"not ({text})", lambda w, s: not compare(s[name], limit), otherwise, then)
        more = self.condition(place, fixed)
        if form == "and":
            text = f"{text} and ({more.text})"
            return Condition(text, lambda w, s: compare(s[name], limit) and more.holds(w, s), then, place)
        text = f"({text}) or ({more.text})"
        return Condition(text, lambda w, s: compare(s[name], limit) or more.holds(w, s), place, otherwise)

    def leaf(self, place: Place) -> Expr:
        numbers = [b for b, m in place.bound.items() if isinstance(m[0], int)]
        if numbers and self.chance(0.12):
            i = self._number(place, self.pick(numbers))
            return infix(constant(0.1), "*", i) if self.chance(0.5) else infix(i, "/", constant(30.0))
        if self.chance(0.12):
            return self.digits()
        if self.chance(0.03):
            return Expr("sin(t / 1 [s])", lambda w, s: np.sin(w.time))
        fixed = self.arrays["param"] + self.arrays["table"]
        arrays = [a for role in ("state", "action", "var", "let", "abbreviation") for a in self.arrays[role]]
        if self.chance(0.4):
            arrays = self.arrays["state"]
        e = self.reference(place, fixed if fixed and self.chance(0.25) else arrays)
        small = [b for b in numbers if min(place.bound[b]) >= 0 and max(place.bound[b]) <= 5]
        if e.size <= 2 and e.level == ATOM and small and self.chance(0.5):
            i = self._number(place, self.pick(small))
            return self._power(e, i, e.size**i.size)
        if e.size <= 2 and e.level == ATOM and self.arrays["order"] and self.chance(0.2):
            return self._power(e, self.reference(place, self.arrays["order"]), e.size**2)
        return e

    def _power(self, base: Expr, exponent: Expr, size: float) -> Expr:
        return Expr(f"{base.text}^{exponent.text}", lambda w, s: base.value(w, s) ** exponent.value(w, s), size, POWER)

    def expression(self, place: Place, depth: int) -> Expr:
        if depth == 0:
            return self.leaf(place)
        make = self.pick((self._binary, self._binary, self._function, self._choice, self._reduction))
        e = make(place, depth - 1)
        return e if e.size <= LARGEST else infix(constant(float(f"{2 / e.size:.2g}")), "*", e)

    def _binary(self, place: Place, depth: int) -> Expr:
        a, b = self.expression(place, depth), self.expression(place, int(self.random.integers(depth + 1)))
        form = self.pick(("+", "-", "*", "/", "min", "max"))
        if form == "/":
            return infix(a, "/", call("(0.7 + sq({}))", lambda x: 0.7 + x * x, 1.5, b))
        if form == "min":
            return call("min({}, {})", least, max(a.size, b.size), a, b)
        if form == "max":
            return call("max({}, {}, 0.4)", lambda x, y: greatest(x, y, 0.4), max(a.size, b.size, 0.4), a, b)
        return infix(a, form, b)

    def _function(self, place: Place, depth: int) -> Expr:
        text, f, size, level = self.pick(FUNCTIONS)
        e = self.expression(place, depth)
        if "{}^" in text:
            e = Expr(e.within(0), e.value, e.size)
        return call(text, f, size(e.size), e, level=level)

    def _choice(self, place: Place, depth: int) -> Expr:
        test = self.condition(place)
        return if_else(test, self.expression(test.then, depth), self.expression(test.otherwise, depth))

    def _reduction(self, place: Place, depth: int) -> Expr:
        kind, loops, inner = self.pick(list(REDUCTIONS)), [], place
        named = self.names([self.pick(self.axes) for _ in range(self.pick((1, 1, 1, 2)))])
        outer = Place({b: m for b, m in place.bound.items() if b not in dict(named)})
        for name, axis in named:
            loop = self._loop(outer, name, axis)
            if inner.count * len(loop.members) <= DEAREST:
                inner = inner.bind(name, loop.members, len(loop.members))
                loops.append(loop)
        if not loops:
            return self._function(place, depth)
        test = self._filter(kind, inner, loops[0]) if self.chance(0.4) else None
        body = self.expression(test.then if test else inner, depth)
        size = body.size * (inner.count / place.count if kind == "sum" else 1.0)
        if kind == "product":
            body, size = call("0.8 + 0.2 * tanh({})", lambda x: 0.8 + 0.2 * np.tanh(x), 1.0, body, level=SUM), 1.0

        def value(world: World, scope: Scope) -> Number:
            scopes = [scope]
            for loop in loops:
                scopes = [{**s, loop.name: m} for s in scopes for m in loop.over(s)]
            return REDUCTIONS[kind](*(body.value(world, s) for s in scopes if test is None or test.holds(world, s)))

        binders = ", ".join(f"{loop.name} in {loop.text}" for loop in loops)
        return Expr(f"{kind}({body.text} for {binders}{f' if {test.text}' if test else ''})", value, size)

    def _loop(self, outer: Place, name: str, axis: Axis) -> Loop:
        """An index over an axis, a part of it, or up to or from an outer index."""
        members = axis.members
        if not axis.numbers or self.chance(0.6):
            return Loop(name, axis.text, members, lambda s: members)
        low, high = members[0], members[-1]
        numbers = {b: m for b, m in outer.bound.items() if isinstance(m[0], int)}
        others = [b for b, m in numbers.items() if low <= min(m) and max(m) <= high]
        if not others or self.chance(0.4):
            a, b = sorted(self.random.integers(0, len(members), 2).tolist())
            part = members[a : b + 1]
            return Loop(name, self.range_of(part), part, lambda s: part)
        other = self.pick(others)
        if self.chance(0.5):
            most = tuple(range(low, max(numbers[other]) + 1))
            return Loop(name, f"{self.whole(low)}..{other}", most, lambda s: range(low, s[other] + 1))
        most = tuple(range(min(numbers[other]), high + 1))
        return Loop(name, f"{other}..{self.whole(high)}", most, lambda s: range(s[other], high + 1))

    def _filter(self, kind: str, place: Place, loop: Loop) -> Condition | None:
        """A condition of a reduction; where there must be a least or a mean, one that some member meets."""
        if kind in ("sum", "product"):
            return self.condition(place)
        test = self.condition(Place({loop.name: loop.members}), fixed=True)
        bounds = set(loop.text.split(".."))
        if bounds & set(NAMES) or not any(test.holds(None, {loop.name: m}) for m in loop.members):
            return None
        return Condition(test.text, test.holds, place.bind(loop.name, test.then.bound[loop.name]), place)
