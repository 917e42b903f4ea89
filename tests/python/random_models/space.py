"""Random models on spatial domains, with an independent evaluation by the documented formulas."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from .domains import GEOMETRIES, SCHEMES, Domain, Field, Flux
from .terms import (
    FUNCTIONS,
    POWER,
    PRODUCT,
    SUM,
    Definitions,
    Expr,
    Key,
    Number,
    Scope,
    World,
    call,
    constant,
    greatest,
    infix,
    real,
)

SPECIES = ("A", "B", "C")

Bound = Mapping[str, tuple[int, int]]  # cells of a bound domain, places of a bound species
T = TypeVar("T")


@dataclass(frozen=True)
class Velocity:
    """A factor of face values; `turns`: its sign is not declared, and it is known at the ends."""

    factor: Expr
    turns: bool = False


@dataclass(frozen=True)
class Flow:
    """Content of a flux; the velocity given at an end, its direction there, the content that flows out."""

    inside: Expr
    given: Velocity | None
    forward: Callable[[World, Scope], bool]
    carried: Callable[[World, Scope], Number]


class RandomSpace:
    """A model drawn from a seed: two domains, fields over them and over a set, fluxes, algebraic variables."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.definitions: Definitions = {}
        self.rates: Definitions = {}
        self.observed: list[Key] = []
        self.roles: dict[str, list[Field]] = {"param": [], "action": [Field("u", ())], "state": [], "var": []}
        self.statements = ["set species = { A, B, C }", "action u = 0.5 in 0..2"]
        self.fluxes: list[Flux] = []
        self.positive: list[Field] = []  # states that are declared so
        self.domains = {name: self._domain(name) for name in "zr"}
        shapes = ((), ("z",), ("r",), ("z", "r"), ("i", "z"))
        for k, axes in enumerate([("z",), ("r",), *(self.pick(shapes) for _ in range(self.random.integers(3)))]):
            field = Field(f"x{k}", axes)
            self.roles["state"].append(field)
            if self.chance(0.5):
                self.positive.append(field)
            bounds = " in 0..inf" if field in self.positive else ""
            self.statements.append(f"state {self._declared(field)} = 1{bounds}")
        for k in range(self.random.integers(1, 4)):
            self._var(f"v{k}")
        for k in range(self.random.integers(1, 4)):
            self._flux(f"J{k}")
        for field in self.roles["state"]:
            self._equations(field, self.rates, f"d/dt {field.name}", " / 1 [s]")
        for k in range(2):
            e = self.expression({}, 3)
            self.statements.append(f"observe o{k} = {e.text}")
            self.definitions[f"o{k}", ()] = e, {}
            self.observed.append((f"o{k}", ()))
        self.text = "\n".join(self.statements) + "\n"

    def elements(self, *roles: str) -> list[Key]:
        fields = [field for role in roles for field in self.roles[role]]
        return [(f.name, tuple(s[a] for a in f.axes)) for f in fields for s in self._scopes(self._whole(f.axes))]

    # Small choices.

    def chance(self, p: float) -> bool:
        return bool(self.random.random() < p)

    def pick(self, items: Sequence[T]) -> T:
        return items[self.random.integers(len(items))]

    def digits(self) -> Expr:
        return constant(round(float(self.random.uniform(0.2, 1.5)), 2))

    def _whole(self, axes: tuple[str, ...]) -> dict[str, tuple[int, int]]:
        return {a: (1, len(SPECIES) if a == "i" else self.domains[a].cells) for a in axes}

    def _scopes(self, bound: Bound, outer: Scope | None = None) -> Iterator[dict]:
        """All members that the bound indices may have together."""
        if not bound:
            yield dict(outer or {})
            return
        *others, last = bound
        for scope in self._scopes({a: bound[a] for a in others}, outer):
            for k in range(bound[last][0], bound[last][1] + 1):
                yield {**scope, last: SPECIES[k - 1] if last == "i" else k}

    def _tail(self, bound: Bound) -> str:
        def text(a: str) -> str:
            low, high = bound[a]
            if a == "i":
                return "i in species"
            whole = (low, high) == (1, self.domains[a].cells)
            return a if whole else f"{a} in {low}..{a}.last - {self.domains[a].cells - high}"

        return f" for {', '.join(text(a) for a in bound)}" if bound else ""

    # Declarations.

    def _domain(self, name: str) -> Domain:
        d = Domain(name, int(self.pick((4, 5, 8, 17))), f"L_{name}", self.pick(SCHEMES), self.pick(tuple(GEOMETRIES)))
        e = self.digits()
        self.definitions[d.length, ()] = e, {}
        self.statements.append(f"param {d.length} = {e.text}")
        self.statements.append(
            f"domain {name} in 0..{d.length} cells {d.cells} scheme {d.scheme} geometry {d.geometry}"
        )
        return d

    def _declared(self, field: Field) -> str:
        indices = ", ".join("i in species" if a == "i" else a for a in field.axes)
        return f"{field.name}[{indices}]" if indices else field.name

    def _var(self, name: str) -> None:
        field = Field(name, self.pick(((), ("z",), ("r",), ("i", "z"))))
        self.statements.append(f"var {self._declared(field)} = 1")
        self._equations(field, self.definitions, name, "")
        self.roles["var"].append(field)

    def _equations(self, field: Field, into: Definitions, left: str, over: str) -> None:
        """Equations of all elements, one for the first cell and one for the others at times."""
        domain = field.axes[-1] if field.axes else ""
        cells = self.domains[domain].cells if domain else 1
        for low, high in ((1, 1), (2, cells)) if domain and self.chance(0.4) else ((1, cells),):
            bound = self._whole(field.axes)
            if domain:
                bound[domain] = low, high
            e = self.expression(bound, 3)
            if over and self.chance(0.7):
                e = infix(e, "-", infix(constant(0.3), "*", self._use(self.pick(self.fluxes), bound)))
            elif not over and low > 1:
                e = infix(e, "+", infix(constant(0.3), "*", self._element(field, bound, {domain: -1})))
            indices = f"[{', '.join(field.axes)}]" if field.axes else ""
            self.statements.append(f"eq {left}{indices} = {e.within(PRODUCT)}{over}{self._tail(bound)}")
            for scope in self._scopes(bound):
                into[field.name, tuple(scope[a] for a in field.axes)] = e, scope

    # Expressions in a cell.

    def _element(self, field: Field, bound: Bound, offsets: Mapping[str, int] | None = None) -> Expr:
        """An element in the bound cells, in neighbours that exist, or in another cell."""
        texts, moves = [], []
        for a in field.axes:
            if a not in bound:
                k = int(self.random.integers(1, self._whole((a,))[a][1] + 1))
                member = SPECIES[k - 1] if a == "i" else k
                texts.append(str(member))
                moves.append(lambda s, member=member: member)
                continue
            low, high = bound[a]
            free = [o for o in (0, 0, 0, -1, 1) if a != "i" and low + o >= 1 and high + o <= self.domains[a].cells]
            by = (offsets or {}).get(a, self.pick(free or [0]))
            texts.append(f"{a}{by:+d}" if by else a)
            moves.append(lambda s, a=a, by=by: s[a] + by if by else s[a])
        text = f"{field.name}[{', '.join(texts)}]" if texts else field.name
        return Expr(text, lambda w, s: w.get((field.name, tuple(m(s) for m in moves))), 2.0)

    def leaf(self, bound: Bound) -> Expr:
        domains = [self.domains[a] for a in bound if a != "i"]
        if domains and self.chance(0.25):
            d = self.pick(domains)
            form = self.pick(("{}", "width({})", "volume({})"))
            values = {
                "{}": lambda w, s: d.edge(w, s[d.name] - 0.5),
                "width({})": lambda w, s: d.edge(w, 1),
                "volume({})": lambda w, s: d.measure(w, s[d.name]),
            }
            return Expr(form.format(d.name), values[form])
        fields = [f for role in ("state", "state", "var", "action") for f in self.roles[role]]
        return self.digits() if self.chance(0.15) else self._element(self.pick(fields), bound)

    def expression(self, bound: Bound, depth: int) -> Expr:
        if depth == 0:
            return self.leaf(bound)
        form = self.pick(("infix", "infix", "function", "reduction"))
        free = [a for a in ("z", "r", "i") if a not in bound]
        if form == "reduction" and free:
            return self._reduction(bound, self.pick(free), depth - 1)
        a = self.expression(bound, depth - 1)
        if form == "function":
            text, f, size, level = self.pick([x for x in FUNCTIONS if "}^" not in x[0]])
            return call(text, f, size(a.size), a, level=level)
        b = self.expression(bound, depth - 1)
        if self.chance(0.3):
            return infix(a, "/", call("(0.7 + sq({}))", lambda x: 0.7 + x * x, 1.5, b))
        return infix(a, self.pick("+-*"), b)

    def _reduction(self, bound: Bound, a: str, depth: int) -> Expr:
        members = self._whole((a,))
        if a != "i" and self.chance(0.4):
            members[a] = int(self.pick((1, 2))), self.domains[a].cells - int(self.pick((1, 2)))
        e = call("tanh({})", np.tanh, 1.0, self.expression({**bound, **members}, depth))
        name = self.pick(("sum", "max") if a == "i" else ("sum", "max", "integral", "integral"))

        def value(world: World, scope: Scope) -> Number:
            inner = list(self._scopes(members, scope))
            if name == "max":
                return greatest(*(e.value(world, s) for s in inner))
            weights = [self.domains[a].measure(world, s[a]) if name == "integral" else 1.0 for s in inner]
            return sum(k * e.value(world, s) for k, s in zip(weights, inner, strict=True))

        return Expr(f"{name}({e.text}{self._tail(members)})", value, 5.0)

    # Fluxes.

    def _flux(self, name: str) -> None:
        axes = self.pick((("z",), ("r",), ("z", "r"), ("i", "z")))
        d, leading = self.domains[axes[-1]], self._whole(axes[:-1])
        field = Field(name, axes)
        kind = self.pick(("terms", "terms", "terms", "product", "named"))
        flow = {"terms": self._terms, "product": self._product, "named": self._named}[kind](d, leading)
        inside = infix(flow.inside, "-", infix(constant(0.1), "*", self._gradient(d, leading)))
        low, high = (self._end(d, flow, side) if self.chance(0.6) else None for side in ("low", "high"))
        ends = "".join(f", {side} = {e.text}" for side, e in (("low", low), ("high", high)) if e)
        self.statements.append(f"flux {self._declared(field)} = {inside.text}{ends}")
        self.fluxes.append(Flux(field, inside, (low, high)))

    def _velocity(self, d: Domain, leading: Bound) -> "Velocity":
        """A factor of face values: of one sign by what is declared, or of any sign."""
        e = self.digits()
        form = self.pick(("number", "bounded", "action", "action", "state", "state", "place"))
        if form == "number":
            return Velocity(constant(-e.value(None, {}) if self.chance(0.5) else e.value(None, {})))
        u = Expr("u", lambda w, s: w.get(("u", ())))
        if form == "bounded":
            return Velocity(infix(u, "*", e) if self.chance(0.5) else infix(constant(-1.0), "*", u))
        if form == "place":
            edge = Expr(d.name, lambda w, s: d.edge(w, s[d.name]))
            return Velocity(infix(edge, "-", infix(e, "*", Expr(d.length, lambda w, s: w.get((d.length, ()))))))
        other = (
            u if form == "action" else self._element(self.pick(self.roles["state"]), {a: leading[a] for a in leading})
        )
        return Velocity(infix(other, "-", e) if self.chance(0.5) else infix(e, "-", other), turns=True)

    def _terms(self, d: Domain, leading: Bound) -> "Flow":
        """Fields with a factor each; a field with two factors follows their sum."""
        terms = [(self._velocity(d, leading), *self._cells(d, leading)) for _ in range(self.random.integers(1, 3))]
        if len(terms) == 2 and all(v.factor.text.strip("-").replace(".", "").isdigit() for v, _, _ in terms):
            terms.pop()

        def along(world: World, scope: Scope, k: int) -> list[int]:
            """The terms with the field of one of them: indices may meet in one element."""
            own = terms[k][2](world, scope)[0]
            return [j for j, (_, _, cells) in enumerate(terms) if cells(world, scope)[0] is own]

        def speed(world: World, scope: Scope, k: int = 0) -> Number:
            return sum(terms[j][0].factor.value(world, scope) for j in along(world, scope, k))

        def part(world: World, scope: Scope, k: int = 0) -> Number:
            total = speed(world, scope, k)
            return total * d.at_face(scope[d.name], terms[k][2](world, scope), real(total) >= 0)

        def value(world: World, scope: Scope) -> Number:
            return sum(part(world, scope, k) for k in range(len(terms)) if along(world, scope, k)[0] == k)

        text = " + ".join(f"{v.factor.within(POWER)}*{e.text}" for v, e, _ in terms)
        given = terms[0][0] if terms[0][0].turns else None
        return Flow(Expr(text, value, 4.0, SUM), given, lambda w, s: real(speed(w, s)) >= 0, part)

    def _product(self, d: Domain, leading: Bound) -> "Flow":
        """Positive fields of one product come from one side."""
        v = self._velocity(d, leading)
        fields = [f for f in self.positive if d.name in f.axes]
        if not fields:
            return self._terms(d, leading)
        factors = [self._cells(d, leading, fields) for _ in range(2)]

        def value(world: World, scope: Scope) -> Number:
            total = v.factor.value(world, scope)
            for _, cells in factors:
                total = total * d.at_face(scope[d.name], cells(world, scope), real(v.factor.value(world, scope)) >= 0)
            return total

        text = f"{v.factor.within(POWER)}*{factors[0][0].text}*{factors[1][0].text}"
        return Flow(Expr(text, value, 4.0, PRODUCT), None, lambda w, s: True, value)

    def _named(self, d: Domain, leading: Bound) -> "Flow":
        """A velocity with a value in each cell, named by `upwind`: its mean at the face."""
        (v, speeds), (e, cells) = self._cells(d, leading), self._cells(d, leading)
        shift = self.digits()

        def value(world: World, scope: Scope) -> Number:
            face, all_speeds = scope[d.name], speeds(world, scope)
            if face in (0, d.cells):
                speed = all_speeds[0 if face == 0 else -1]
            else:
                speed = (all_speeds[face - 1] + all_speeds[face]) / 2
            forward = real(speed) >= real(shift.value(world, scope))
            carried = cells(world, scope)
            if d.directed or face in (0, d.cells):
                return d.at_face(face, carried, forward)
            return carried[face - 1] if forward else carried[face]

        return Flow(Expr(f"upwind({v.text} - {shift.text}, {e.text})", value, 2.0), None, lambda w, s: True, value)

    def _end(self, d: Domain, flow: "Flow", side: str) -> Expr:
        """A given flux: by itself, or carried by the velocity, which holds while the flow enters."""
        e = self.digits()
        if flow.given is None or self.chance(0.4):
            return e
        carried = infix(flow.given.factor, "*", e)
        face = 0 if side == "low" else d.cells

        def value(world: World, scope: Scope) -> Number:
            if not d.directed or flow.forward(world, scope) == (side == "low"):
                return carried.value(world, scope)
            return flow.carried(world, {**scope, d.name: face})

        return Expr(carried.text, value, carried.size, carried.level)

    def _cells(
        self, d: Domain, leading: Bound, fields: list[Field] | None = None
    ) -> tuple[Expr, Callable[[World, Scope], list[Number]]]:
        """An element of a field over the domain, and its values in all cells."""
        fields = fields or [f for role in ("state", "var") for f in self.roles[role] if d.name in f.axes]
        e = self._element(self.pick(fields), {**leading, d.name: (1, d.cells)})
        return e, lambda w, s: [e.value(w, {**s, d.name: k}) for k in range(1, d.cells + 1)]

    def _gradient(self, d: Domain, leading: Bound) -> Expr:
        e, cells = self._cells(d, leading)

        def value(world: World, scope: Scope) -> Number:
            face = scope[d.name]
            if face in (0, d.cells):
                return 0.0
            low, high = cells(world, scope)[face - 1 : face + 1]
            return (high**2 - low**2) / d.edge(world, 1)

        return Expr(f"grad(sq({e.text}))", value, 2.0)

    def _use(self, flux: Flux, bound: Bound) -> Expr:
        """The divergence in the bound cell, or the flux at an end."""
        d = self.domains[flux.field.axes[-1]]
        given = {a: self.pick(SPECIES) if a == "i" else 2 for a in flux.field.axes[:-1] if a not in bound}
        leading = [str(given.get(a, a)) for a in flux.field.axes[:-1]]
        if d.name not in bound:
            side = self.pick(("low", "high"))
            text = f"{flux.field.name}[{', '.join([*leading, f'{d.name}.{side}'])}]"
            face = 0 if side == "low" else d.cells
            return Expr(text, lambda w, s: flux.value(w, {**s, **given}, d, face), 5.0)

        def divergence(world: World, scope: Scope) -> Number:
            k, s = scope[d.name], {**scope, **given}
            low, high = (d.area(world, f) * flux.value(world, s, d, f) for f in (k - 1, k))
            return (high - low) / d.measure(world, k)

        return Expr(f"div({flux.field.name}[{', '.join([*leading, d.name])}])", divergence, 10.0)
