"""The declarations and equations of a random model."""

import numpy as np

from .expressions import SIZES, Writer
from .terms import (
    PRODUCT,
    Array,
    Axis,
    Condition,
    Definitions,
    Expr,
    Index,
    Key,
    Member,
    Members,
    Place,
    call,
    constant,
    greatest,
    if_else,
    infix,
    root_of_cubic,
)

ROLES = ("param", "table", "action", "state", "let", "abbreviation", "var", "order")


class RandomModel(Writer):
    """A model drawn from a seed.

    `definitions` hold parameters, tables, algebraic variables and observations in the order of dependence.
    `initials` are the initial values and `rates` the time derivatives of the states; `arrays` are declarations by role.
    """

    sizes: tuple[int, ...] = SIZES
    parted = 0.3  # how many arrays are defined in equal parts

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.statements: list[str] = []
        self.definitions: Definitions = {}
        self.initials: Definitions = {}
        self.rates: Definitions = {}
        self.observed: list[Key] = []
        self.arrays: dict[str, list[Array]] = {role: [] for role in ROLES}
        self.n = int(self.random.choice(self.sizes))
        self.axes = self._axes()
        for role, most in (("param", 4), ("table", 3), ("action", 3), ("state", 4), ("let", 3), ("var", 4), ("let", 3)):
            for _ in range(self.random.integers(role == "state", most + 1)):
                getattr(self, f"_{role}")(f"{role[0]}{len(self.statements)}")
        for state in self.arrays["state"]:
            self._equations(state, "rate")
        self._observe()
        self.random.shuffle(self.statements)
        self.text = "\n".join(["model Random", *self.statements, ""])

    def elements(self, *roles: str) -> list[Key]:
        return [key for role in roles for array in self.arrays[role] for key in array.elements()]

    # Declarations.

    def _axes(self) -> list[Axis]:
        first, length = int(self.pick((-1, 0, 2, 3, 5, 11))), int(self.random.choice(self.sizes))
        names = ("a", "b", "rest", "water")[: self.random.integers(2, 5)]
        self.statements += [f"param n = {self.n}", f"set comps = {{ {', '.join(names)} }}"]
        axes = [Axis("comps", names, True)]
        for name, members in (("trays", range(1, self.n + 1)), ("cells", range(first, first + length))):
            axes.append(Axis(self.range_of(members), tuple(members), False))
            if self.chance(0.7):
                self.statements.append(f"set {name} = {self.range_of(members)}")
                axes.append(Axis(name, tuple(members), True))
        return axes

    def _array(self, name: str, scalar: float, pair: float = 0.3) -> Array:
        axes = [] if self.chance(scalar) else [self.pick(self.axes)]
        other = self.pick(self.axes)
        if axes and self.chance(pair) and len(other.members) * len(axes[0].members) <= 170:
            axes.insert(int(self.random.integers(2)), other)
        return Array(name, tuple(axes))

    def _plain(self, array: Array) -> str:
        """The array as it is declared where no value depends on its indices."""
        axes = [a.text if a.named and self.chance(0.7) else f"{b} in {a.text}" for b, a in self.names(array.axes)]
        return f"{array.name}[{', '.join(axes)}]" if axes else array.name

    def _indexed(self, array: Array) -> tuple[str, str, str, Place]:
        """The array as it is declared with its indices, as an element, the indices of an equation, and the place."""
        names = self.names(array.axes)
        place = Place({b: a.members for b, a in names}, len(list(array.elements())))
        binders = ", ".join(f"{b} in {a.text}" for b, a in names)
        if not binders:
            return array.name, array.name, "", place
        return f"{array.name}[{binders}]", f"{array.name}[{', '.join(place.bound)}]", f" for {binders}", place

    def _define(self, array: Array, place: Place, e: Expr, into: Definitions) -> None:
        into.update(((array.name, tuple(scope.values())), (e, scope)) for scope in place.scopes())

    def _fixed(self, place: Place, earlier: list[Array]) -> Expr:
        """A positive value known at the start."""
        e = self.digits()
        for name, members in place.bound.items():
            if isinstance(members[0], int) and self.chance(0.6):
                e = infix(e, "+", infix(constant(0.02), "*", self._number(place, name)))
        if earlier and self.chance(0.5):
            e = infix(e, "+", infix(constant(0.1), "*", self.reference(place, earlier)))
        return e

    def _param(self, name: str) -> None:
        array = self._array(name, 0.5)
        declared, _, _, place = self._indexed(array)
        e = self._fixed(place, self.arrays["param"])
        self.statements.append(f"param {declared} = {e.text}")
        self._define(array, place, e, self.definitions)
        self.arrays["param"].append(array)

    def _state(self, name: str) -> None:
        array = self._array(name, 0.2, 0.4)
        declared, element, tail, place = self._indexed(array)
        e = self._fixed(place, self.arrays["param"] + self.arrays["state"])
        if self.chance(0.3):
            self.statements += [f"state {self._plain(array)} = 1", f"initial {element} = {e.text}{tail}"]
        else:
            self.statements.append(f"state {declared}{' : 1' if self.chance(0.5) else ''} = {e.text}")
        self._define(array, place, e, self.initials)
        self.arrays["state"].append(array)

    def _action(self, name: str) -> None:
        array = self._array(name, 0.6, 0.0)
        self.statements.append(f"action {self._plain(array)} = 0.5 in 0..2")
        self.arrays["action"].append(array)

    def _table(self, name: str) -> None:
        """A table of positive numbers, or of small whole ones that serve as exponents."""
        named = [a for a in self.axes if a.named and a.members[0] != -1]
        array = Array(name, tuple(self.pick(named) for _ in range(self.random.integers(1, 3))))
        if len(list(array.elements())) > 150:
            array = Array(name, array.axes[:1])
        order = self.chance(0.25)
        rows: dict[Member, list[str]] = {}
        for key in array.elements():
            entry = constant(float(self.random.integers(3))) if order else self.digits()
            self.definitions[key] = entry, {}
            rows.setdefault(key[1][0], []).append(entry.text.removesuffix(".0"))
        axes = ", ".join(a.text for a in array.axes)
        body = "\n".join(f"  {member}: {', '.join(values)}" for member, values in rows.items())
        self.statements.append(f"table {name}[{axes}] {'= ' if len(array.axes) == 1 else ''}{{\n{body}\n}}")
        self.arrays["order" if order else "table"].append(array)

    def _let(self, name: str) -> None:
        array, output = self._array(name, 0.4), self.chance(0.6)
        declared, _, _, place = self._indexed(array)
        e = self.expression(place, 3)
        self.statements.append(f"let {declared}{' : 1' if output else ''} = {e.text}")
        self._define(array, place, e, self.definitions)
        self.arrays["let" if output else "abbreviation"].append(Array(name, array.axes, e.size))

    def _var(self, name: str) -> None:
        array = self._array(name, 0.3)
        self.statements.append(f"var {self._plain(array)} = 1")
        self._equations(array, "var")
        self.arrays["var"].append(Array(name, array.axes, 4.0))

    def _observe(self) -> None:
        for array in self.arrays["state"] + self.arrays["var"]:
            if self.chance(0.4):
                self.statements.append(f"observe {array.name}")
                self.observed += array.elements()
        for k in range(self.random.integers(1, 4)):
            e = self.expression(Place(), 3)
            self.statements.append(f"observe o{k} = {e.text}")
            self.definitions[f"o{k}", ()] = e, {}
            self.observed.append((f"o{k}", ()))

    # Equations.

    def _equations(self, array: Array, role: str) -> None:
        """Equations of all elements, the range of one index cut into parts; a `var` may need its neighbours."""
        ranges = [k for k, a in enumerate(array.axes) if a.numbers]
        if not ranges:
            return self._equation(array, role, -1, (), 0)
        along, step = int(self.pick(ranges)), int(self.pick((0, -1, 1))) if role == "var" else 0
        members = array.axes[along].members
        cuts = sorted({int(c) for c in self.random.integers(1, len(members), self.pick((0, 0, 1, 2, 3)))})
        if self.chance(self.parted):
            equal = int(self.pick((2, 2, 3)))
            cuts = [k * len(members) // equal for k in range(1, equal)] if len(members) >= equal else []
        if step and self.chance(0.6):
            cuts = [1] if step < 0 else [len(members) - 1]
        parts = [members[a:b] for a, b in zip([0, *cuts], [*cuts, len(members)], strict=True)]
        for part in parts[:: -1 if step > 0 else 1]:
            self._equation(array, role, along, part, step)
        return None

    def _equation(self, array: Array, role: str, along: int, part: Members, step: int) -> None:
        place, indices, binders = Place(), [], []
        for k, (name, axis) in enumerate(self.names(array.axes)):
            members = part if k == along else axis.members
            if len(members) == 1 and self.chance(0.8):
                indices.append(self._at(members[0]))
                continue
            offset = int(self.pick((0, 0, 0, 1, -1, 2))) if k == along else 0
            bound = tuple(m - offset for m in members) if offset else members
            binders.append(f"{name} in {axis.text if bound == axis.members else self.range_of(bound)}")
            indices.append(self._shifted(name, offset))
            place = place.bind(name, bound, len(members))
        self.random.shuffle(binders)
        e = self.expression(place, 3)
        if step:
            e = self._recursive(array, along, step, place, indices, e)
        left, tail = self._element(array, indices).text, f" for {', '.join(binders)}" if binders else ""
        into = self.definitions if role == "var" else self.rates
        masses = self.arrays["param"] + self.arrays["table"] if role == "rate" else []
        implicit = self.chance(0.4) if masses else role == "var" and self.chance(0.1)
        right = e.text
        if role == "rate":
            left, right = f"d/dt {left}", f"{e.within(PRODUCT)} / 1 [s]"
        if implicit and masses:
            mass = self.reference(place, masses)
            left, e = f"{mass.text} * {left}", infix(e, "/", mass)
        elif implicit:
            left, e = f"{left}^3 + {left}", call("{}", root_of_cubic, e.size, e)
        self.statements.append(f"eq {left} = {right}{tail}")
        elements = [((array.name, tuple(i.of(scope) for i in indices)), (e, scope)) for scope in place.scopes()]
        into.update(sorted(elements, key=lambda x: -step * x[0][1][along] if step else 0))

    def _recursive(self, array: Array, along: int, step: int, place: Place, indices: list[Index], e: Expr) -> Expr:
        """Add the neighbour before (step -1) or after (1), where there is one."""
        index, members = indices[along], array.axes[along].members
        end = members[0] if step < 0 else members[-1]
        own = [
            i if k == along or self.chance(0.7) else self._at(self.pick(array.axes[k].members))
            for k, i in enumerate(indices)
        ]
        own[along] = Index(f"{index.text} {'+' if step > 0 else '-'} 1", lambda s: index.of(s) + step)
        neighbour = infix(constant(self.pick((0.3, 0.5, 0.6))), "*", self._element(array, own))
        form = self.pick(("+", "-", "max"))
        further = call("max({}, {})", greatest, e.size, e, neighbour) if form == "max" else infix(e, form, neighbour)
        if end not in [index.of(scope) for scope in place.scopes()]:
            return further
        name = next((b for b in place.bound if index.text.startswith(b)), None)
        if name is None or len(place.bound[name]) == 1:
            return e
        boundary = next(scope[name] for scope in place.scopes() if index.of(scope) == end)
        test = Condition(f"{name} == {boundary}", lambda w, s: s[name] == boundary, place, place)
        return if_else(test, self.expression(place, 1), further)


class PartedModel(RandomModel):
    """A random model whose algebraic arrays are mostly defined by loops of equal length, and read across these."""

    sizes = (32, 34, 36, 48, 51)
    parted = 0.8

    def _axes(self) -> list[Axis]:
        axes = super()._axes()
        return [*axes, *[a for a in axes if a.numbers] * 3]

    def leaf(self, place: Place) -> Expr:
        arrays = [a for a in self.arrays["var"] if a.axes]
        return self.reference(place, arrays) if arrays and self.chance(0.5) else super().leaf(place)
