"""Derivatives of the first actions of a predictive controller, by the conditions of optimality.

A. V. Fiacco, Introduction to Sensitivity and Stability Analysis in Nonlinear Programming (1983).
At an optimum with a fixed active set, the conditions of Karush, Kuhn and Tucker determine the plan
as a function of the state, parameters, set-points and weights. Its derivative is the solution of
one linear system.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from smpl.controllers.collocation import Programme
from smpl.controllers.nmpc_solver import Solution
from smpl.support.arguments import FloatArray

# Distance from a bound, in scaled variables, within which it is active, and the least multiplier.
_NEAR, _PRESSED = 1e-5, 1e-7
# Largest residual of the linear system, relative to its right-hand side.
_SOLVED = 1e-6
# Compliance of bounds, in scaled variables, if they depend on each other.
_COMPLIANCE = 1e-10


@dataclass(frozen=True)
class ActionDerivatives:
    """Derivatives of the first actions, in physical units.

    Attributes:
        actions: names of the rows.
        by_state: by the predicted states, (actions, states).
        by_previous: by the actions before, (actions, actions).
        by: name to (actions,). Names are parameters and discrete variables (`U`; a parameter that
            is computed from it is another one) and set-points (`target:T`, of all intervals). With
            a tunable cost there are weights (`cost:T`, `terminal:T`, `rate:T_c`).
    """

    actions: tuple[str, ...]
    by_state: FloatArray
    by_previous: FloatArray
    by: Mapping[str, FloatArray]


class Sensitivity:
    """The derivative of the optimum of a programme by its parameters `p`."""

    def __init__(self, programme: Programme) -> None:
        import casadi as ca

        self._programme, f = programme, programme.functions
        kind = type(f["x"])
        x, p, multipliers = f["x"], f["p"], kind.sym("multipliers", f["g"].numel())
        gradient = ca.gradient(f["f"] + ca.dot(multipliers, f["g"]), x)
        parts = [
            ca.jacobian(gradient, x), ca.jacobian(f["g"], x), ca.jacobian(gradient, p), ca.jacobian(f["g"], p), f["g"],
        ]  # fmt: skip
        self._parts = ca.Function("conditions", [x, p, multipliers], parts)
        self._ca = ca

    def derivatives(self, solution: Solution, p: FloatArray) -> ActionDerivatives:
        """Derivatives of the first actions in physical units, see `NMPC.derivatives`."""
        task = self._programme.task
        e, n, m = task.expressions, len(task.expressions.state_names), len(task.actions)
        scale = e.action_scale[[e.export.action_names.index(name) for name in task.actions]]
        found = scale[:, None] * self(solution, p)
        constant = [key for key in task.given if key not in task.varying]
        first = n + m + len(constant)
        each = found[:, first:-1].reshape(m, task.horizon, len(task.varying)).sum(axis=1)
        columns = zip(
            (*constant, *task.varying), np.concatenate([found[:, n + m : first], each], axis=1).T, strict=True
        )
        by = {key.removeprefix("p:"): column for key, column in columns}
        return ActionDerivatives(task.actions, found[:, :n] / e.state_scale, found[:, n : n + m] / scale, by)

    def __call__(self, solution: Solution, p: FloatArray) -> FloatArray:
        """Derivative of the scaled first actions by the scaled parameters.

        Raises:
            ValueError: the active bounds do not determine the plan.
        """
        ca, programme = self._ca, self._programme
        hessian, slopes, mixed, moved, values = self._parts(solution.x, p, solution.lam_g)
        rows = _active(np.asarray(values).ravel(), programme.g_lower, programme.g_upper, solution.lam_g)
        fixed = _active(solution.x, programme.lower, programme.upper, solution.lam_x)
        size = len(solution.x)
        unit = ca.DM.eye(size)[fixed.tolist(), :] if len(fixed) else ca.DM(0, size)
        active = ca.vertcat(slopes[rows.tolist(), :], unit)
        right = -ca.vertcat(mixed, moved[rows.tolist(), :], ca.DM(len(fixed), mixed.size2()))
        matrix = ca.blockcat([[hessian, active.T], [active, ca.DM(active.size1(), active.size1())]])
        found = self._solved(matrix, right, size)
        error = np.abs(np.asarray(matrix @ ca.DM(found) - right)).max(initial=0.0)
        if not np.isfinite(found).all() or error > _SOLVED * max(float(np.abs(np.asarray(right)).max()), 1e-300):
            raise ValueError(
                "the active bounds of the last plan do not determine it: bounds that are active together depend on "
                "each other, or an action has no effect on the cost; give each action a weight"
            )
        return np.asarray(found[programme.actions[0]])

    def _solved(self, matrix: Any, right: Any, size: int) -> FloatArray:
        """The solution of the conditions; NaN if the linear system is singular.

        Bounds that depend on each other have multipliers that are not unique. A small compliance
        then selects some, which changes the plan by less than is checked for.
        """
        count = matrix.size1()
        soft = self._ca.diag(self._ca.DM([0.0] * size + [_COMPLIANCE] * (count - size)))
        for one in (matrix, matrix - soft):
            try:
                return np.asarray(self._ca.solve(one, right, "qr"))
            except RuntimeError:
                continue
        return np.full((count, right.size2()), np.nan)


def _active(values: FloatArray, low: FloatArray, high: FloatArray, multipliers: FloatArray) -> Any:
    """Places of equations, and of bounds that press."""
    near = np.minimum(np.abs(values - low), np.abs(high - values)) <= _NEAR
    return np.flatnonzero((low == high) | (near & (np.abs(multipliers) > _PRESSED)))
