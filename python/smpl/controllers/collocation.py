"""Direct collocation: an optimal control problem over a horizon as a sparse nonlinear programme.

L. T. Biegler, Nonlinear Programming (2010), chapter 10. States on an element are the polynomial
through its start and its nodes, the last of which is its end. The equations hold at the nodes, and
actions are constant over an interval. Variables and constraints are ordered stage by stage, states
first, as fatrop's recursion takes them (L. Vanroye et al., IROS 2023).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from smpl.controllers.nmpc_model import Expressions
from smpl.support.arguments import FloatArray

NODES = ("radau", "gauss")
# Above so many operations in all stages together, stages are calls of one function instead of one
# large graph.
_MOST_OPERATIONS = 600_000
# What an interval behind the end of the episode counts for, of its cost and of its broken bounds:
# not 0, so that the programme has one solution there too.
_AFTER = (1e-6, 1e-3)
_WITHIN = "within:episode"


def nodes(kind: str, degree: int) -> FloatArray:
    """Nodes in (0, 1]: Radau's, or Gauss' inner ones and the end."""
    import casadi as ca

    if kind == "radau":
        return np.array(ca.collocation_points(degree, "radau"))
    return np.append(ca.collocation_points(degree, "legendre"), 1.0)


def differentiation_matrix(points: FloatArray) -> FloatArray:
    """D[i, j]: derivative at point i of the Lagrange polynomial that is 1 at point j."""
    return np.stack([poly.deriv()(points) for poly in _lagrange(points)], axis=1)


def quadrature_weights(points: FloatArray) -> FloatArray:
    """Weights of the values at points with which their interpolant is integrated over (0, 1)."""
    return np.array([poly.integ()(1.0) - poly.integ()(0.0) for poly in _lagrange(points)])


def _lagrange(points: FloatArray) -> list[Any]:
    found = []
    for j, point in enumerate(points):
        others = np.delete(points, j)
        found.append(np.poly1d(others, r=True) / np.prod(point - others))
    return found


@dataclass(frozen=True)
class Limit:
    """Bounded quantity, at the end of each interval and at inner nodes where it has a value.

    Attributes:
        weight: of a broken bound, over the size of the quantity, in the objective; infinite for one
            that must hold.
    """

    name: str
    expression: Any
    low: float
    high: float
    size: float
    weight: float

    @property
    def soft(self) -> bool:
        """True if it may be broken at a price."""
        return bool(np.isfinite(self.weight))


@dataclass
class Task:
    """The problem to be transcribed.

    Attributes:
        horizon: intervals.
        actions: names of those that are chosen.
        stage, last: cost of an interval, and of the last one.
        integrate: costs are means over the interval instead of the value at its end.
        given: keys of what the expressions are given; `varying` those of which each interval has
            its own. With `within:episode`, 0 behind the end of the episode and 1 before, nothing
            happens there, nor counts.
        free: whether the actions of an interval are chosen anew; otherwise they stay.
        rates: largest change of each action between two intervals, infinite if any.
        convex: the cost is a sum of weighted squares.
        path: limits hold at inner nodes too.
        factor: scale of the cost.
        rows: sizes of the residuals behind the explicit rates, by which they are divided; 1 if
            None.
        offset: rates have a constant term for each state, key `offset:NAME`.
    """

    expressions: Expressions
    horizon: int
    actions: tuple[str, ...]
    stage: Any
    last: Any
    integrate: bool
    limits: list[Limit]
    given: tuple[str, ...]
    varying: tuple[str, ...]
    free: list[bool]
    rates: FloatArray
    low: FloatArray
    high: FloatArray
    kind: str = "radau"
    degree: int = 3
    elements: int = 1
    path: bool = True
    offset: bool = False
    convex: bool = False
    remembers: bool = False
    factor: float = 1.0
    rows: FloatArray | None = None


@dataclass
class Programme:
    """The programme and where its numbers are.

    Attributes:
        functions: `x`, `p`, `f`, `g` of CasADi.
        lower, upper, g_lower, g_upper: bounds.
        states, actions, inner, slack: places of scaled variables by interval; `actions` of a held
            interval are those of the last free one.
        softened: (place in g, place in x) of rows that a slack keeps from being negative, and of
            the slack.
        structure: the arguments for fatrop.
    """

    task: Task
    functions: dict[str, Any]
    lower: FloatArray
    upper: FloatArray
    g_lower: FloatArray
    g_upper: FloatArray
    states: Any
    actions: Any
    inner: Any
    slack: Any
    previous: Any
    softened: Any
    structure: dict[str, Any]


class Transcription:
    """Builds the programme of a task."""

    def __init__(self, task: Task) -> None:
        import casadi as ca

        self._ca, self.task, self.e = ca, task, task.expressions
        self.points = nodes(task.kind, task.degree)
        self.n, self.nz, self.m = len(self.e.state_names), len(self.e.algebraic_names), len(task.actions)
        self.at = [self.e.export.action_names.index(name) for name in task.actions]
        self.scale = self.e.action_scale[self.at]
        self.rows = np.ones(self.n + self.nz - len(self.e.explicit)) if task.rows is None else task.rows
        self.width = len(self.points) * (self.n + self.nz) * task.elements
        self.soft = [limit for limit in task.limits if limit.soft]
        # Places of the values of q among those that are common to all intervals and, behind them,
        # those of one.
        keys = [*(key for key in task.given if key not in task.varying), *task.varying]
        self.order = [keys.index(key) for key in task.given]
        self._equations = self.point_function("equations", self.e.equations)

    def point_function(self, name: str, value: Any) -> Any:
        """Function of (x, z, chosen actions, initial x, last actions, integrals, rates, t, q)."""
        e = self.e
        chosen, before = e.u[self.at], e.before[self.at]
        arguments = [e.x, e.z, chosen, e.start, before, e.integral, e.dx, e.time, e.symbols(self.task.given)]
        return self._ca.Function(name, arguments, [value])

    def _interval(self) -> dict[str, Any]:
        """Symbols of an interval, scaled, and its collocation equations."""
        ca, task, e = self._ca, self.task, self.e
        s, v = ca.SX.sym("s", self.n), ca.SX.sym("v", self.m)
        u, w = ca.SX.sym("a", self.m), ca.SX.sym("w", self.width)
        q, t = ca.SX.sym("q", len(task.given)), ca.SX.sym("t")
        matrix = differentiation_matrix(np.append(0.0, self.points))[1:]
        length = e.export.step / task.elements
        size, per, own = len(self.points), self.n + self.nz, e.explicit
        sx, sz = e.state_scale, e.algebraic_scale
        begin, equations, places = s, [], []
        action, last, zero = u * self.scale, v * self.scale, ca.SX(e.integral.numel(), 1)
        offset = self._offsets(q)
        # Behind the end of the episode everything rests: the effect there could not be
        # distinguished from an optimum.
        inside = q[task.given.index(_WITHIN)] if _WITHIN in task.given else 1.0
        for k in range(task.elements):
            cells = [w[(k * size + j) * per : (k * size + j + 1) * per] for j in range(size)]
            values = [begin, *(cell[: self.n, :] for cell in cells)]
            for j in range(size):
                x, z = cells[j][: self.n, :] * sx, cells[j][self.n :, :] * sz
                slope = sum(matrix[j, i] * values[i] for i in range(size + 1))
                moment = t + (k + float(self.points[j])) * length
                rates = slope * sx / length - offset
                found = self._equations(x, z, action, s * sx, last, zero, rates, moment, q)
                for i, one in enumerate(own):
                    equations.append(slope[one] - inside * length * (found[i] + offset[one]) / sx[one])
                equations.append(found[len(own) :, :] / self.rows)
                places.append((x, z, moment))
            begin = cells[-1][: self.n, :]
        return {"s": s, "v": v, "u": u, "w": w, "q": q, "t": t, "end": begin, "places": places,
                "equations": ca.vertcat(*equations), "action": action, "last": last}  # fmt: skip

    def _offsets(self, q: Any) -> Any:
        if not self.task.offset:
            return self._ca.SX(self.n, 1)
        places = [self.task.given.index(f"offset:{name}") for name in self.e.state_names]
        return q[places] / self.e.export.step

    def _stage(self, cost: Any, *, first: bool = False) -> tuple[Any, list[int]]:
        """Function of (s, v, u, w, slacks, q, t): end, equations, limits, rates of actions, cost.

        Also the slack of each row of the limits, -1 for one without.
        """
        ca, task, e = self._ca, self.task, self.e
        one = self._interval()
        slack = ca.SX.sym("slack", len(self.soft))
        integral = self._integral(one)
        common = (one["action"], one["s"] * e.state_scale, one["last"], integral, ca.SX(self.n, 1))

        def at(function: Any, place: tuple[Any, Any, Any]) -> Any:
            return function(place[0], place[1], *common, place[2], one["q"])

        function = self.point_function("cost", cost)
        if task.integrate:
            weights = np.tile(quadrature_weights(self.points), task.elements) / task.elements
            value = sum(b * at(function, place) for b, place in zip(weights, one["places"], strict=True))
        else:
            value = at(function, one["places"][-1])
        rows, price, owners, j = [], 0.0, list[int](), 0
        for limit in task.limits:
            inside = self._rows(limit, one, at, first)
            owners += [j if limit.soft else -1] * len(inside)
            if limit.soft:
                # One for the interval: it pays for the node that breaks the bound most.
                inside, price = [row + slack[j] for row in inside], price + limit.weight * (slack[j] + slack[j] ** 2)
                j += 1
            rows += inside
        changes = one["u"] - one["v"] if np.isfinite(task.rates).any() else ca.SX(0, 1)
        if _WITHIN in task.given:
            inside = one["q"][task.given.index(_WITHIN)]
            value, price = (part * (low + (1 - low) * inside) for part, low in zip((value, price), _AFTER, strict=True))
        value = task.factor * value + price
        inputs = [one["s"], one["v"], one["u"], one["w"], slack, one["q"], one["t"]]
        outputs = [one["end"], one["equations"], ca.vertcat(ca.SX(0, 1), *rows), changes, value]
        return ca.Function("stage", inputs, outputs), owners

    def _rows(self, limit: Limit, one: dict[str, Any], at: Any, first: bool) -> list[Any]:
        """Expressions that are nonnegative if limits hold, at the end and at inner nodes."""
        ca, e = self._ca, self.e
        function = self.point_function("limit", limit.expression)
        *inner, end = [at(function, place) / limit.size for place in one["places"]]
        low, high = limit.low / limit.size, limit.high / limit.size
        below = above = 0.0
        if not self.task.path or not e.within(limit.expression, algebraic=not first):
            inner = []
        elif first:
            # A start that is out of bounds takes its time to come back: no node may be further out.
            begin = at(function, (one["s"] * e.state_scale, one["places"][0][1], one["t"])) / limit.size
            below, above = ca.fmax(low - begin, 0.0), ca.fmax(begin - high, 0.0)
        rows = [end - low, *(value - low + below for value in inner)] if np.isfinite(low) else []
        rows += [high - end, *(high - value + above for value in inner)] if np.isfinite(high) else []
        return rows

    def _integral(self, one: dict[str, Any]) -> Any:
        ca, e = self._ca, self.e
        if not e.integral.numel():
            return e.integral
        function = self.point_function("integrals", e.call(e.export.integrals))
        weights = np.tile(quadrature_weights(self.points), self.task.elements) * e.export.step / self.task.elements
        zero = ca.SX(e.integral.numel(), 1)
        begin = (one["action"], one["s"] * e.state_scale, one["last"], zero, ca.SX(self.n, 1))
        return sum(b * function(x, z, *begin, t, one["q"]) for b, (x, z, t) in zip(weights, one["places"], strict=True))

    def step_function(self) -> Any:
        """(x, u, q, t) -> x at the end of an interval and its inner variables, by Newton's method.

        States and actions have physical units, inner variables are scaled.
        """
        ca, e = self._ca, self.e
        one = self._interval()
        parameters = ca.vertcat(one["s"], one["v"], one["u"], one["q"], one["t"])
        residual = ca.Function("residual", [one["w"], parameters], [one["equations"]])
        quiet = {"error_on_fail": False, "show_eval_warnings": False}
        found = ca.rootfinder("found", "newton", residual, {**quiet, "abstol": 1e-11, "max_iter": 30})
        x, u, q, t = (
            ca.MX.sym("x", self.n),
            ca.MX.sym("u", self.m),
            ca.MX.sym("q", len(self.task.given)),
            ca.MX.sym("t"),
        )
        s, v = x / e.state_scale, u / self.scale
        cell = ca.vertcat(s, e.algebraic_nominal / e.algebraic_scale if self.nz else ca.MX(0, 1))
        guess = ca.repmat(cell, len(self.points) * self.task.elements, 1)
        w = found(guess, ca.vertcat(s, v, v, q, t))
        end = w[self.width - self.n - self.nz : self.width - self.nz] * e.state_scale
        return ca.Function("step", [x, u, q, t], [end, w])

    def given_of(self, constant: FloatArray, varying: FloatArray, k: int) -> FloatArray:
        """Numbers of q in an interval: those of all intervals, then those of this one."""
        values = np.concatenate([constant, varying.reshape(self.task.horizon, -1)[k]])
        return np.asarray(values[self.order])

    def programme(self) -> Programme:
        """The whole."""
        task, N = self.task, self.task.horizon
        first = self._stage(task.stage if N > 1 else task.last, first=True)
        stage, last = (self._stage(cost) if N > 1 else first for cost in (task.stage, task.last))
        large = first[0].n_instructions() * N > _MOST_OPERATIONS
        symbol = self._ca.MX.sym if large else self._ca.SX.sym
        constant = len(task.given) - len(task.varying)
        inputs = [symbol("state", self.n), symbol("previous", self.m), symbol("constant", constant)]
        inputs += [symbol("varying", len(task.varying) * N), symbol("begin")]
        parts = _Parts(self, symbol, inputs)
        for k in range(N):
            parts.add(k, *(first if k == 0 else last if k == N - 1 else stage))
        return parts.finish()


class _Parts:
    """Collects variables, constraints and bounds stage by stage."""

    def __init__(self, of: Transcription, symbol: Any, inputs: list[Any]) -> None:
        task = of.task
        self.of, self.task, self.symbol, self.inputs = of, task, symbol, inputs
        self.x: list[Any] = []
        self.g: list[Any] = []
        self.cost: Any = 0.0
        self.low: list[FloatArray] = []
        self.high: list[FloatArray] = []
        self.g_low: list[FloatArray] = []
        self.g_high: list[FloatArray] = []
        self.count = self.g_count = 0
        self.places: dict[str, list[Any]] = {key: [] for key in ("states", "actions", "inner", "slack", "held")}
        self.softened: list[tuple[int, int]] = []
        self.nx: list[int] = []
        self.nu: list[int] = []
        self.ng: list[int] = []
        # The action before is a state only where somebody asks for it.
        self.held = of.m if task.remembers else 0
        self.state = self._variables("states", of.n)
        self.previous = self._variables("held", self.held) if self.held else inputs[1]

    def _variables(self, kind: str, size: int, low: Any = -np.inf, high: Any = np.inf) -> Any:
        found = self.symbol(f"{kind}{len(self.x)}", size)
        self.x.append(found)
        self.low.append(np.broadcast_to(low, size))
        self.high.append(np.broadcast_to(high, size))
        self.places[kind].append(np.arange(self.count, self.count + size))
        self.count += size
        return found

    def _constraints(self, value: Any, low: Any = 0.0, high: Any = 0.0) -> int:
        size = int(value.numel())
        self.g.append(value)
        self.g_low.append(np.broadcast_to(low, size))
        self.g_high.append(np.broadcast_to(high, size))
        self.g_count += size
        return size

    def add(self, k: int, stage: Any, owners: list[int]) -> None:
        """The variables and constraints of an interval."""
        of, task = self.of, self.task
        before = self.count
        if task.free[k]:
            action = self._variables("actions", of.m, task.low / of.scale, task.high / of.scale)
        else:
            action = self.previous
            self.places["actions"].append(self.places["actions"][-1])
        inner = self._variables("inner", of.width)
        slack = self._variables("slack", len(of.soft), 0.0)
        self.nx.append(of.n + self.held)
        self.nu.append(self.count - before)
        q = self._given(k)
        end, equations, rows, changes, cost = stage(
            self.state, self.previous, action, inner, slack, q, self.inputs[4] + k * of.e.export.step
        )
        self.cost = self.cost + cost
        start_state, start_previous = self.state, self.previous
        self.state = self._variables("states", of.n)
        self._constraints(self.state - end)
        if self.held:
            self.previous = self._variables("held", self.held)
            self._constraints(self.previous - action)
        count = 0
        if k == 0:
            count += self._constraints(start_state - self.inputs[0])
            count += self._constraints(start_previous - self.inputs[1]) if self.held else 0
        count += self._constraints(equations)
        self.softened += [(self.g_count + i, self.places["slack"][-1][j]) for i, j in enumerate(owners) if j >= 0]
        count += self._constraints(rows, 0.0, np.inf)
        if task.free[k] and changes.numel():
            limited = np.isfinite(task.rates)
            width = (task.rates / of.scale)[limited]
            count += self._constraints(changes[[int(i) for i in np.flatnonzero(limited)]], -width, width)
        self.ng.append(count)

    def _given(self, k: int) -> Any:
        """The vector q of an interval, in the order of the keys."""
        size = len(self.task.varying)
        both = self.of._ca.vertcat(self.inputs[2], self.inputs[3][k * size : (k + 1) * size])
        return both[self.of.order] if self.of.order else both

    def finish(self) -> Programme:
        ca, N = self.of._ca, self.task.horizon
        self.nx.append(self.of.n + self.held)
        self.nu.append(0)
        self.ng.append(0)
        functions = {"x": ca.vertcat(*self.x), "p": ca.vertcat(*self.inputs), "f": self.cost, "g": ca.vertcat(*self.g)}
        places = {key: np.array(value, dtype=int) for key, value in self.places.items()}
        g_bounds = np.concatenate(self.g_low), np.concatenate(self.g_high)
        return Programme(
            self.task, functions, np.concatenate(self.low), np.concatenate(self.high), *g_bounds,
            places["states"], places["actions"], places["inner"], places["slack"], places["held"],
            np.array(self.softened, dtype=int).reshape(-1, 2),
            {"structure_detection": "manual", "N": N, "nx": self.nx, "nu": self.nu, "ng": self.ng},
        )  # fmt: skip
