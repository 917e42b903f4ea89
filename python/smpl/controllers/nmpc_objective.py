"""Cost of a predictive controller's horizon, and the scales of its cost and residuals."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from smpl.controllers.nmpc_given import Given
from smpl.controllers.nmpc_model import Expressions
from smpl.model import Model
from smpl.support.arguments import FloatArray, as_mapping, as_number
from smpl.support.names import listing

Cost = str | Mapping[str, float] | Callable[[Mapping[str, Any]], Any] | None
# Shares of their sizes by which the unknowns are displaced from the guess, where derivatives may be
# 0 or infinite.
_PLACES = (0.0, 0.1)


class Objective:
    """The cost of an interval and of the last one, as expressions.

    Attributes:
        targets: names of what has a set-point.
        convex: it is a sum of weighted squares.
        weights: values of weights that are symbols, by their keys; empty if it is not tunable.
    """

    def __init__(
        self,
        e: Expressions,
        actions: tuple[str, ...],
        cost: Cost,
        terminal: Any,
        rate_weight: Any,
        integrate: bool,
        tunable: bool = False,
    ) -> None:
        import casadi as ca

        self._e, self._ca = e, ca
        self.targets: dict[str, Any] = {}
        self._tunable, self.weights = tunable, dict[str, float]()
        weights = dict(as_mapping("cost", cost)) if isinstance(cost, Mapping) else None
        changes = by_action("rate_weight", rate_weight, e.model, actions, 0.0)
        at = [e.export.action_names.index(name) for name in actions]
        moves = [(name, w, i) for name, w, i in zip(actions, changes.tolist(), at, strict=True) if w > 0]
        move = sum(self._weight(f"rate:{name}", w) * (e.u[i] - e.before[i]) ** 2 for name, w, i in moves)
        self._weights, self.convex = weights or {}, weights is not None
        if weights is not None:
            self.stage = self._squares("cost", weights)
        elif callable(cost):
            self.stage = ca.SX(cost(e))
        else:
            self.stage = -e.reward(self._reward(cost))
        end = self.stage
        if terminal is not None and integrate:
            raise ValueError("terminal weighs the end of the horizon, which a cost that is integrated does not have")
        if terminal is not None:
            own = {k: v for k, v in self._weights.items() if k in e.export.action_names}
            squares = self._squares("terminal", {**own, **dict(as_mapping("terminal", terminal))})
            end = squares if weights is not None else self.stage + squares
        self.stage, self.last = self.stage + move, end + move

    def factor(self, given: Given) -> float:
        """Factor for a steepest slope of 10 in scaled variables, near the initial guess."""
        e, ca = self._e, self._ca
        at = ca.vertcat(e.x, e.z, e.u)
        sizes = np.concatenate([e.state_scale, e.algebraic_scale, e.action_scale])
        others = [s for s in ca.symvar(ca.vertcat(self.stage, self.last)) if not _among(s, at)]
        slope = ca.Function(
            "slope", [at, ca.vertcat(*others)], [ca.gradient(self.stage, at), ca.gradient(self.last, at)]
        )
        guess = np.concatenate([*given.guess, e.export.action_nominal])
        known = [given.nominal(symbol.name()) for symbol in others]
        found = [np.abs(np.asarray(one).ravel() * sizes) for one in slope(guess + 0.1 * sizes, known)]
        steepest = max((float(np.nanmax(one, initial=0.0)) for one in found), default=0.0)
        return 10.0 / steepest if np.isfinite(steepest) and steepest > 0 else 1.0

    def _weight(self, key: str, value: float) -> Any:
        """A weight: its number, or a symbol of a tunable cost."""
        if not self._tunable:
            return value
        self.weights[key] = value
        return self._e.symbols([key])

    def _reward(self, cost: Any) -> str:
        e = self._e
        if cost is not None and not isinstance(cost, str):
            raise TypeError(f"cost is {type(cost).__name__}, expected the name of a reward, weights, or a function")
        if cost is None and not e.export.reward_names:
            raise ValueError(f"{e.model.name} declares no reward: give cost as weights by names, {e.listing()}")
        return e.model.reward if cost is None else cost

    def _squares(self, argument: str, weights: Mapping[str, Any]) -> Any:
        value = self._ca.SX(0.0)
        for name, given in weights.items():
            weight = as_number(f"{argument}[{name!r}]", given)
            if not (np.isfinite(weight) and weight >= 0):
                raise ValueError(f"{argument}[{name!r}] is {weight}, expected a finite number that is not negative")
            try:
                quantity = self._e[name]
            except ValueError as error:
                raise ValueError(f"{argument}: {error}") from None
            self.targets[name] = quantity
            value += self._weight(f"{argument}:{name}", weight) * (quantity - self._e.symbols([f"target:{name}"])) ** 2
        return value


def _among(symbol: Any, vector: Any) -> bool:
    import casadi as ca

    return bool(ca.depends_on(vector, symbol))


def row_sizes(e: Expressions, given: Given) -> FloatArray:
    """The largest effect of an unknown, changed by its size, on each residual.

    A balance in W is as large as what its terms have, so that all equations count alike in a norm.
    """
    import casadi as ca

    residual = e.equations[len(e.explicit) :]
    if not residual.numel():
        return np.ones(0)
    at = ca.vertcat(e.x, e.z, e.u, e.dx)
    sizes = np.concatenate([e.state_scale, e.algebraic_scale, e.action_scale, e.state_scale / e.export.step])
    own = {at[i].element_hash() for i in range(at.numel())}
    others = [s for s in ca.symvar(residual) if s.element_hash() not in own]
    slope = ca.Function("slope", [at, ca.vertcat(ca.SX(0, 1), *others)], [ca.jacobian(residual, at)])
    known = [given.nominal(symbol.name()) for symbol in others]
    guess = np.concatenate([*given.guess, e.export.action_nominal, np.zeros(len(e.state_names))])
    found = np.zeros(residual.numel())
    for share in _PLACES:
        matrix = slope(guess + share * sizes, known)
        rows, columns = (np.array(part, dtype=int) for part in matrix.sparsity().get_triplet())
        effects = np.abs(np.array(matrix.nonzeros(), dtype=np.float64) * sizes[columns])
        usable = np.isfinite(effects)
        np.maximum.at(found, rows[usable], effects[usable])
    return np.where(found > 0, found, 1.0)


def by_action(argument: str, given: Any, model: Model, actions: tuple[str, ...], default: float) -> FloatArray:
    """Numbers of the chosen actions by their names.

    Raises:
        ValueError: an unknown name, or a negative number.
    """
    wanted = as_mapping(argument, given)
    wrong = [name for name in wanted if name not in actions]
    if wrong:
        units = dict(zip(model.action_names, model.action_units, strict=True))
        known = listing(actions, [units[name] for name in actions])
        raise ValueError(f"{argument}: unknown {', '.join(map(repr, wrong))}; there are: {known}")
    found = np.array([as_number(f"{argument}[{name!r}]", wanted.get(name, default)) for name in actions])
    if not (found >= 0).all():
        raise ValueError(f"{argument}: {dict(wanted)}, expected numbers that are not negative")
    return found
