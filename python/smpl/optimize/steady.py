"""The best steady state of a model by sequential quadratic programming with exact derivatives.

The steady state is solved for at every point (the reduced-space method). Its derivatives follow
from the implicit function theorem: with rates f(x, u) = 0 and a goal g(x, u), dg/du = g_u - g_x
f_x^-1 f_u. The derivatives f_x, f_u, g_x and g_u are exact. The quadratic programmes are those of
SciPy's SLSQP (D. Kraft, 1988).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl import _native
from smpl.model import Model, compile
from smpl.support.arguments import FloatArray, as_count, as_mapping, as_number, check_names
from smpl.support.clock import Clock
from smpl.support.optional import load
from smpl.support.options import Options, takes

Range = tuple[float | None, float | None]
Limits = Mapping[str, Range | float]
# What may be left of a limit, over its size.
_FEASIBLE = 1e-6


@dataclass(frozen=True)
class SteadyOptimum:
    """The best steady state that was found.

    Attributes:
        inputs: what was varied, by name, declared units.
        value: of the goal, in its units: the largest one of `maximize`, the smallest one of
            `minimize`.
        y, u: unknowns (`Model.unknown_names`) and actions of the model there.
        states: by name.
        limits: value of each limited expression.
        active: limits, bounds of states and ranges of inputs that hold with equality.
        gradient: of the goal, by input; zero in the directions in which nothing is active.
        stable: whether small deviations die out; states that are fixed do not count.
        evaluations: steady states that were solved for.
        values: of the goal at each of these, in their order; NaN where there was no steady state.
        converged: whether the method ended at an optimum; if not, the point keeps its limits and
            may not be the best.
        message: of the method.
    """

    inputs: dict[str, float]
    value: float
    y: FloatArray
    u: FloatArray
    states: dict[str, float]
    limits: dict[str, float]
    active: tuple[str, ...]
    gradient: dict[str, float]
    stable: bool
    evaluations: int
    values: FloatArray
    converged: bool
    message: str
    _ascending: bool = field(default=True, repr=False)

    def figure(self) -> Any:
        """The search as a Matplotlib figure: the goal at each steady state that was solved for."""
        from smpl.optimize.pictures import search_figure

        return search_figure(self.values, self._ascending, "steady state", "goal")

    def __str__(self) -> str:
        inputs = ", ".join(f"{name} = {value:.6g}" for name, value in self.inputs.items())
        active = f"; active: {', '.join(self.active)}" if self.active else ""
        kind = "stable" if self.stable else "unstable"
        ended = "" if self.converged else f"; not an optimum yet: {self.message}"
        return f"{self.value:.8g} at {inputs} ({kind}, {self.evaluations} steady states{active}{ended})"


@dataclass(frozen=True, kw_only=True, repr=False)
class SteadyOptions(Options):
    """Options of `steady`.

    Attributes:
        maximize, minimize: exactly one of them: an expression of the language in the model's names,
            in declared units: `q_out*c_B - 0.1*(T_c - T_f)`.
        limits: expressions with (low, high), None for an open end, or with one number for equality.
            The declared bounds of the states also hold.
        fixed: values of states that the equations leave free, as for `Model.steady_state`. If their
            rates depend on the varied inputs, they are kept at zero.
        start: initial guess of the inputs, by name; None for their declared values.
        p: values of other parameters, by name.
        guess: initial guess of the first steady state, as for `Model.steady_state`; the others
            begin at the last one.
        tolerance: of the goal, relative to its size.
        max_iterations: limit of the number of quadratic programmes.
        seconds: time after which no steady state is solved, and the best one within the limits
            counts; None for no limit.
    """

    maximize: str | None = None
    minimize: str | None = None
    limits: Limits | None = None
    fixed: Mapping[str, float] | None = None
    start: Mapping[str, float] | None = None
    p: Mapping[str, float] | None = None
    guess: Mapping[str, float] | None = None
    tolerance: float = 1e-10
    max_iterations: int = 100
    seconds: float | None = None


@takes(SteadyOptions)
def steady(model: Model | str, vary: Iterable[str] | Mapping[str, Range], options: SteadyOptions) -> SteadyOptimum:
    """The steady state with the largest or smallest value of an expression.

    Args:
        model: a model, or the name or path of one.
        vary: names of actions and parameters that are free, or a mapping from names to (low, high);
            where an end is None, and for names alone, the declared bounds count.
        options: `SteadyOptions`, and options as keyword arguments.

    Returns:
        A local optimum: another start may lead to a better one.

    Raises:
        ValueError: an unknown name, an empty range, or an invalid expression; the message names the
            place.
        SimulationError: there is no steady state at the start, or no point keeps the limits.
        ImportError: SciPy is missing.
    """
    clock = Clock(options.seconds)
    if (options.maximize is None) == (options.minimize is None):
        raise ValueError("give either maximize or minimize")
    problem = _Problem(compile(model) if isinstance(model, str) else model, vary, options)
    return problem.solve(options, clock)


class _SpentError(Exception):
    """The seconds are used up."""


@dataclass
class _Point:
    """A steady state, its goal and limits, and their derivatives by the scaled inputs."""

    z: FloatArray
    y: FloatArray
    goal: float
    by_goal: FloatArray
    limited: FloatArray
    by_limited: FloatArray
    matrix: FloatArray


class _Problem:
    """The goal and the limits as functions of inputs in [0, 1]."""

    def __init__(self, model: Model, vary: Iterable[str] | Mapping[str, Range], options: SteadyOptions) -> None:
        ranges: dict[str, Range] = (
            {str(name): (None, None) for name in vary} if not isinstance(vary, Mapping) else dict(vary)
        )
        if not ranges:
            raise ValueError("vary names nothing: give actions or parameters")
        if model.native.reads_other_instants():
            raise ValueError(
                "equations of the model read initial(...), previous(...) or steady(...), which move with the steady "
                "state, and derivatives by them are not known here: write what they are at rest, x for previous(x)"
            )
        check_names("vary", ranges, (*model.action_names, *model.parameter_names))
        check_names("fixed", as_mapping("fixed", options.fixed), model.state_names)
        self.sign = -1.0 if options.maximize is not None else 1.0
        self.fixed, self.p = options.fixed, options.p
        goal, limits = options.maximize or options.minimize or "", dict(as_mapping("limits", options.limits))
        self.names = tuple(ranges)
        self.low, self.high = _box(model, ranges)
        self.model = _with_actions(model, dict(zip(self.names, zip(self.low, self.high, strict=True), strict=True)))
        self.places = np.array([self.model.action_names.index(name) for name in self.names], dtype=int)
        self.expressions = (goal, *limits)
        self.limits = [_range(expression, given) for expression, given in limits.items()]
        self.augmented = _augmented(self.model, self.expressions)
        self._order()
        self.last: _Point | None = None
        self.points: list[_Point] = []
        self.values: list[float] = []

    def _order(self) -> None:
        """Places of the model's states and of the expressions in the augmented model."""
        unknowns = self.augmented.unknown_names
        self.own = np.array([unknowns.index(name) for name in self.model.unknown_names])
        states = self.augmented.state_names
        self.x = np.array([states.index(name) for name in self.model.state_names])
        self.g = np.array([states.index(_added(i)) for i in range(len(self.expressions))])
        low, high = self.model.native.bounds("state")
        held = set(self.fixed or {})
        self.free = np.array([i for i, name in enumerate(self.model.state_names) if name not in held], dtype=int)
        self.held = np.array([i for i, name in enumerate(self.model.state_names) if name in held], dtype=int)
        self.state_low, self.state_high = low, high

    def action(self, z: FloatArray) -> FloatArray:
        u = self.base.copy()
        u[self.places] = self.low + np.clip(z, 0, 1) * (self.high - self.low)
        return u

    def at(self, z: FloatArray) -> _Point:
        """The point at z; without a steady state one extrapolated from the last point."""
        if self.last is not None and np.array_equal(z, self.last.z):
            return self.last
        if self.last is not None and self.clock.over():
            raise _SpentError
        try:
            self.last = self._solved(z, self.last)
        except _native.SimulationError:
            self.values.append(float("nan"))
            if self.last is None:
                raise
            return self._extrapolated(z, self.last)
        self.values.append(self.last.goal)
        self.points.append(self.last)
        return self.last

    def _solved(self, z: FloatArray, near: _Point | None) -> _Point:
        u = self.action(z)
        guess = self.guess if near is None else dict(zip(self.model.unknown_names, near.y.tolist(), strict=True))
        y = self.model.steady_state(u, self.p, self.fixed, guess)
        whole = np.zeros(len(self.augmented.unknown_names))
        whole[self.own] = y
        rates = self.augmented.residual(0.0, whole, np.zeros_like(whole), u, self.p)
        A, B, _, _ = self.augmented.linearize(whole, u, self.p, minimal=False)
        A_x, A_g = A[np.ix_(self.x, self.x)], A[np.ix_(self.g, self.x)]
        scale = self.high - self.low
        B_x, B_g = B[np.ix_(self.x, self.places)] * scale, B[np.ix_(self.g, self.places)] * scale
        x_z = np.zeros_like(B_x)
        inner = A_x[np.ix_(self.free, self.free)]
        # Singular values of a large matrix cost more than all the rest: once is enough.
        if near is None and np.linalg.matrix_rank(_balanced(inner)) < len(inner):
            raise ValueError(f"the equations leave states free: give {self._suggestion(inner)} in fixed")
        x_z[self.free] = np.linalg.solve(inner, -B_x[self.free])
        by = B_g + A_g @ x_z
        drift = A_x[self.held] @ x_z + B_x[self.held]
        values = rates[[self.augmented.unknown_names.index(_added(i)) for i in range(len(self.expressions))]]
        x = y[: len(self.x)]
        limited = np.concatenate([values[1:], x[self.free], rates[self.own[self.held]]])
        by_limited = np.vstack([by[1:], x_z[self.free], drift])
        return _Point(z.copy(), y, float(values[0]), by[0], limited, by_limited, inner)

    def _suggestion(self, inner: FloatArray) -> str:
        """Names of the states whose equations depend on the others."""
        _, sizes, right = np.linalg.svd(_balanced(inner).T)
        null = right[sizes <= sizes.max(initial=0.0) * 1e-12]
        names = [
            self.model.state_names[self.free[i]] for i in np.flatnonzero(abs(null).max(axis=0, initial=0.0) > 1e-6)
        ]
        return f"{len(null)} of {', '.join(names)}"

    def _extrapolated(self, z: FloatArray, last: _Point) -> _Point:
        """As far as the derivatives tell, and worse than any: the line search comes back."""
        step = z - last.z
        goal = float(last.goal + last.by_goal @ step)
        size = float(np.abs(last.by_goal).sum()) + abs(last.goal) or 1.0
        worse = self.sign * 10 * size * (1 + float(np.linalg.norm(step)))
        limited = last.limited + last.by_limited @ step
        return _Point(z, last.y, goal + worse, last.by_goal, limited, last.by_limited, last.matrix)

    def solve(self, options: SteadyOptions, clock: Clock) -> SteadyOptimum:
        """Run the method."""
        minimize, tolerance = _minimize(), float(options.tolerance)
        iterations = as_count("max_iterations", options.max_iterations)
        self.guess, self.clock = options.guess, clock
        self.base = self._start(as_mapping("start", options.start))
        z = np.clip((self.base[self.places] - self.low) / (self.high - self.low), 0, 1)
        first = self.at(z)
        self._choose_rows(first)
        size = max(float(np.abs(first.by_goal).max(initial=0.0)), 1e-3 * abs(first.goal)) or 1.0
        try:
            found = minimize(
                lambda z: self.sign * self.at(z).goal / size,
                z,
                jac=lambda z: self.sign * self.at(z).by_goal / size,
                method="SLSQP",
                bounds=[(0.0, 1.0)] * len(z),
                constraints=self._constraints(),
                options={"ftol": tolerance, "maxiter": iterations},
            )
        except _SpentError:
            return self._unfinished()
        point = self._solved(np.clip(found.x, 0, 1), self.last)
        self._check(point, str(found.message))
        return self._result(point, bool(found.success), str(found.message))

    def _start(self, start: Mapping[str, float]) -> FloatArray:
        check_names("start", start, self.names)
        base: FloatArray = self.model.native.defaults("action").copy()
        for name in self.names:
            place = self.model.action_names.index(name)
            base[place] = as_number(f"start[{name!r}]", start.get(name, base[place]))
        return base

    def _choose_rows(self, first: _Point) -> None:
        """Scales and ends of limits, bounds of states, and varying rates of fixed states."""
        states = [self.model.state_names[i] for i in self.free]
        ends = [*self.limits, *zip(self.state_low[self.free], self.state_high[self.free], strict=True)]
        names = [*self.expressions[1:], *(f"bounds of {name}" for name in states)]
        slope = np.abs(first.by_limited).max(axis=1, initial=0.0)
        drifting = slope[len(ends) :] > 1e-12 * max(1.0, float(slope.max(initial=0.0)))
        ends += [(0.0, 0.0)] * len(self.held)
        names += [f"rate of {self.model.state_names[i]}" for i in self.held]
        self.ends = np.array(ends, dtype=np.float64).reshape(len(ends), 2)
        self.row_names = names
        width = np.where(np.isfinite(self.ends).all(axis=1), self.ends[:, 1] - self.ends[:, 0], 0.0)
        finite = np.where(np.isfinite(self.ends), np.abs(self.ends), 0.0).max(axis=1, initial=0.0)
        self.size = np.where(width > 0, width, np.maximum(np.maximum(finite, slope), 1e-12))
        self.equal = self.ends[:, 0] == self.ends[:, 1]
        self.equal[len(ends) - len(self.held) :] &= drifting
        self.unequal = self.ends[:, 0] < self.ends[:, 1]
        # A concentration that is not fed stays at its bound whatever is done.
        self.moving = (slope > 1e-9 * self.size) | (np.arange(len(ends)) < len(self.limits))

    def _constraints(self) -> list[dict[str, Any]]:
        def rows(which: npt.NDArray[np.intp], side: int, sense: float) -> tuple[Any, Any]:
            def value(z: FloatArray) -> FloatArray:
                return sense * (self.at(z).limited[which] - self.ends[which, side]) / self.size[which]

            def slope(z: FloatArray) -> FloatArray:
                return sense * self.at(z).by_limited[which] / self.size[which, None]

            return value, slope

        made = []
        for kind, mask, side, sense in (
            ("eq", self.equal, 0, 1.0),
            ("ineq", self.unequal & self.moving & np.isfinite(self.ends[:, 0]), 0, 1.0),
            ("ineq", self.unequal & self.moving & np.isfinite(self.ends[:, 1]), 1, -1.0),
        ):
            if mask.any():
                value, slope = rows(np.flatnonzero(mask), side, sense)
                made.append({"type": kind, "fun": value, "jac": slope})
        return made

    def _unfinished(self) -> SteadyOptimum:
        """The best point so far that keeps the limits, or the one that comes nearest to it."""
        message = "the time limit ended the search"
        excess = [max(float(self._beyond(point).max(initial=0.0)), _FEASIBLE) for point in self.points]
        ranks = [(left, self.sign * point.goal) for left, point in zip(excess, self.points, strict=True)]
        point = self.points[min(range(len(ranks)), key=ranks.__getitem__)]
        self._check(point, message)
        return self._result(point, False, message)

    def _beyond(self, point: _Point) -> FloatArray:
        """Excess of a point over its limits, relative to their size."""
        beyond: FloatArray = np.maximum(self.ends[:, 0] - point.limited, point.limited - self.ends[:, 1]) / self.size
        beyond[~(self.equal | self.unequal)] = -np.inf
        return beyond

    def _check(self, point: _Point, message: str) -> None:
        beyond = self._beyond(point)
        if len(beyond) and beyond.max() > _FEASIBLE:
            worst = int(np.argmax(beyond))
            low, high = self.ends[worst]
            raise _native.SimulationError(
                f"no steady state that keeps all limits was found: {self.row_names[worst]} is "
                f"{point.limited[worst]:.6g}, wanted {low:g} to {high:g} ({message}); try another start"
            )

    def _result(self, point: _Point, converged: bool, message: str) -> SteadyOptimum:
        near = np.minimum(np.abs(point.limited - self.ends[:, 0]), np.abs(point.limited - self.ends[:, 1])) / self.size
        rows = len(near) - len(self.held)
        near = np.where(self.moving, near, np.inf)
        active = [name for name, gap in zip(self.row_names[:rows], near[:rows], strict=True) if gap < 1e-6]
        at_end = np.minimum(point.z, 1 - point.z) < 1e-6
        active += [f"range of {name}" for name, end in zip(self.names, at_end, strict=True) if end]
        u = self.action(point.z)
        count = len(self.expressions) - 1
        return SteadyOptimum(
            inputs={name: float(u[place]) for name, place in zip(self.names, self.places, strict=True)},
            value=point.goal,
            y=point.y,
            u=u,
            states=dict(zip(self.model.state_names, point.y.tolist(), strict=False)),
            limits=dict(zip(self.expressions[1:], point.limited[:count].tolist(), strict=True)),
            active=tuple(active),
            gradient=dict(zip(self.names, (point.by_goal / (self.high - self.low)).tolist(), strict=True)),
            stable=bool(np.linalg.eigvals(point.matrix).real.max(initial=-1.0) < 0),
            evaluations=len(self.values),
            values=np.array(self.values),
            converged=converged,
            message=message,
            _ascending=self.sign < 0,
        )


def _box(model: Model, ranges: Mapping[str, Range]) -> tuple[FloatArray, FloatArray]:
    """Ends of what is varied: those given, within the declared ones.

    Raises:
        ValueError: a range is empty or not finite.
    """
    low, high = [], []
    for name, given in ranges.items():
        role, known = ("action", model.action_names)
        if name not in known:
            role, known = ("parameter", model.parameter_names)
        declared_low, declared_high = model.native.bounds(role)
        place = known.index(name)
        bottom, top = _range(name, given)
        bottom, top = max(bottom, declared_low[place]), min(top, declared_high[place])
        if not (np.isfinite([bottom, top]).all() and bottom < top):
            raise ValueError(f"vary[{name!r}] is {bottom:g} to {top:g}, expected a finite range: give (low, high)")
        low.append(bottom)
        high.append(top)
    return np.array(low), np.array(high)


def _balanced(matrix: FloatArray) -> FloatArray:
    """A matrix scaled to entries of size one, so that its rank does not depend on units."""
    rows = np.abs(matrix).max(axis=1, initial=0.0, keepdims=True)
    scaled = matrix / np.where(rows > 0, rows, 1.0)
    columns = np.abs(scaled).max(axis=0, initial=0.0, keepdims=True)
    return scaled / np.where(columns > 0, columns, 1.0)


def _added(place: int) -> str:
    return f"smpl_optimize_{place}"


def _augmented(model: Model, expressions: tuple[str, ...]) -> Model:
    """The model with a state for each expression, whose rate is the value of the expression.

    Raises:
        ValueError: an invalid expression; the message names it.
    """
    lines = []
    for place, text in enumerate(expressions):
        if not isinstance(text, str) or not text.strip() or any(sign in text for sign in "\n{}#"):
            raise ValueError(f"{text!r} is not an expression in the model's names")
        lines.append(f"state {_added(place)} = 0")
        lines.append(f"eq d/dt {_added(place)} = value({text}) / 1 [{model.time_unit}]")
    try:
        return _extended(model, "\n".join(lines))
    except _native.CompileError as error:
        for found in error.diagnostics:
            line = found.line - _lines(model) - 1
            if found.file == "extra" and 0 <= line < len(lines):
                reason = f"{found.message} ({found.help})" if found.help else found.message
                raise ValueError(f"{expressions[line // 2]!r}: {reason}") from error
        raise


def _with_actions(model: Model, ranges: Mapping[str, tuple[float, float]]) -> Model:
    """The model with the parameters among the names as actions, so that it has derivatives by them.

    Raises:
        ValueError: a parameter decides more than the equations: initial values, sizes, other
            parameters.
    """
    parameters = [name for name in ranges if name not in model.action_names]
    if not parameters:
        return model
    default = model.native.defaults("parameter")
    lines = ["variant smpl_optimize {"]
    for name in parameters:
        place = model.parameter_names.index(name)
        low, high = ranges[name]
        value = min(max(float(default[place]), low), high)
        unit = model.parameter_units[place]
        lines.append(f"  action {name} : {unit} = {value!r} in {float(low)!r}..{float(high)!r}")
    lines.append("}")
    try:
        return _extended(model, "\n".join(lines), ("smpl_optimize",))
    except _native.CompileError as error:
        raise ValueError(
            f"vary: {', '.join(parameters)}: a parameter that decides more than the equations cannot be varied: {error}"
        ) from error


def _extended(model: Model, text: str, variants: tuple[str, ...] = ()) -> Model:
    arguments = model._arguments
    before = arguments.get("extra")
    extra = text if before is None else f"{before}\n{text}"
    return model.variant_of(extra=extra, variants=(*arguments["variants"], *variants))


def _lines(model: Model) -> int:
    before = model._arguments.get("extra")
    return 0 if before is None else before.count("\n") + 1


def _range(name: str, given: Any) -> tuple[float, float]:
    """(low, high) of an argument.

    Raises:
        ValueError: not a range.
    """
    if given is None:
        return -np.inf, np.inf
    if np.ndim(given) == 0:
        value = as_number(f"the range of {name!r}", given)
        return value, value
    if len(given) != 2:
        raise ValueError(f"the range of {name!r} is {given!r}, expected (low, high)")
    low, high = (
        infinite if end is None else as_number(f"the range of {name!r}", end)
        for end, infinite in zip(given, (-np.inf, np.inf), strict=True)
    )
    if not low <= high:
        raise ValueError(f"the range of {name!r} is {given!r}, expected (low, high) with low below high")
    return low, high


def _minimize() -> Any:
    return load("scipy.optimize", "the best steady state").minimize
