"""First guesses of a horizon's programme at which it has finite values and derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np

from smpl.controllers.collocation import Programme, Transcription
from smpl.support.arguments import FloatArray

# Shares of the ranges by which a guess keeps from the bounds of states, and by which it is
# displaced in turn.
_WITHIN, _DISPLACED = 1e-3, (0.0, 1e-2, 1e-1)


class Guesses:
    """Moves first guesses to where a programme is finite.

    Args:
        transcription, programme: of the task.
        solver: a solver of the programme, whose derivative functions are used.
    """

    def __init__(self, transcription: Transcription, programme: Programme, solver: Any) -> None:
        import casadi as ca

        self._t, self._programme = transcription, programme
        parts = programme.functions
        self._value = ca.Function("value", [parts["x"], parts["p"]], [parts["f"], parts["g"]])
        known = [solver.get_function(name) for name in solver.get_function()]
        self._slopes = [one for one in known if one.name() in ("nlp_grad_f", "nlp_jac_g", "nlp_jac_fg")]
        self._curvature = [one for one in known if one.name() == "nlp_hess_l"]
        self._ends = self._strict_ends()

    def value(self, x: FloatArray, p: FloatArray) -> tuple[float, FloatArray]:
        """Cost and constraints of a point."""
        f, g = self._value(x, p)
        return float(f), np.asarray(g).ravel()

    def finite(self, x: FloatArray, p: FloatArray) -> FloatArray | None:
        """The guess, or the first of the points near it at which all is finite; None if missing.

        A guess on the bound of a state, where a rate may have no slope, is moved inside of it.
        """
        usable = None
        for point in (x, *(self._displaced(x, share) for share in _DISPLACED)):
            if self._is_finite(point, p):
                if self._curves(point, p):
                    return point
                usable = point if usable is None else usable
        return usable

    def _is_finite(self, x: FloatArray, p: FloatArray) -> bool:
        values = [part for function in self._slopes for part in function.call([x, p])]
        return all(np.isfinite(part.nonzeros()).all() for part in (*self._value(x, p), *values))

    def _curves(self, x: FloatArray, p: FloatArray) -> bool:
        ones = np.ones(len(self._programme.g_lower))
        return all(
            np.isfinite(part.nonzeros()).all() for one in self._curvature for part in one.call([x, p, 1.0, ones])
        )

    def _strict_ends(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper ends of all variables, a share of their range inside of their bounds."""
        t, programme = self._t, self._programme
        low, high = programme.lower.copy(), programme.upper.copy()
        cells = t.width // (t.n + t.nz) if t.n + t.nz else 0
        for side, bound, free in ((low, t.e.state_low, -np.inf), (high, t.e.state_high, np.inf)):
            scaled = bound / t.e.state_scale
            side[programme.states] = scaled
            side[programme.inner] = np.tile(np.concatenate([scaled, np.full(t.nz, free)]), cells)
        width = np.where(np.isfinite(high - low), high - low, 1.0)
        inner = low + _WITHIN * width, high - _WITHIN * width
        slack = programme.slack.ravel()
        for side, bound in zip(inner, (programme.lower, programme.upper), strict=True):
            side[slack] = bound[slack]
        return inner

    def _displaced(self, x: FloatArray, share: float) -> FloatArray:
        """A guess within the bounds, displaced by another share of its range for each unknown."""
        t, programme = self._t, self._programme
        low, high = self._ends
        width = np.where(np.isfinite(high - low), high - low, 1.0)
        steps = np.zeros(len(x))
        along = 1 + 0.5 * np.arange(t.n + t.nz) / max(1, t.n + t.nz)
        steps[programme.states] = along[: t.n]
        steps[programme.inner] = np.tile(along, t.width // (t.n + t.nz) if t.n + t.nz else 0)
        inside = np.clip(x, low, high)
        with np.errstate(invalid="ignore"):  # without bounds there is no middle
            toward = np.where(inside > (low + high) / 2, -1.0, 1.0)
        return np.clip(inside + toward * share * steps * width, low, high)

    def reason(self, x: FloatArray, given: tuple[Any, ...]) -> str:
        """Names of what is not finite at a guess, and of what it depends on."""
        return Diagnosis(self._t).of(self._programme, x, given)


class Diagnosis:
    """Values and derivatives of a single point, by names."""

    def __init__(self, transcription: Transcription) -> None:
        import casadi as ca

        self._t = t = transcription
        e, task = t.e, t.task
        names = [f"the rate of `{e.state_names[i]}`" for i in e.explicit]
        names += [_equation(e.equations[i]) for i in range(len(names), int(e.equations.numel()))]
        self._names = [*names, "the cost", *(f"the bound of `{limit.name}`" for limit in task.limits)]
        self._value = ca.vertcat(e.equations, task.stage, *(limit.expression for limit in task.limits))
        self._unknowns = ca.vertcat(e.x, e.z, e.u[t.at])
        slopes = ca.jacobian(self._value, self._unknowns)
        self._function = t.point_function("point", ca.horzcat(self._value, slopes))

    def of(self, programme: Programme, x: FloatArray, given: tuple[Any, ...]) -> str:
        """A sentence about the first point of the horizon that is not finite."""
        t, e = self._t, self._t.e
        for k in range(t.task.horizon):
            inner = x[programme.inner[k]].reshape(-1, t.n + t.nz)
            for cell in inner:
                state, algebraic = cell[: t.n] * e.state_scale, cell[t.n :] * e.algebraic_scale
                action = x[programme.actions[k]] * t.scale
                q = t.given_of(given[2], given[3], k)
                zero = np.zeros(int(e.integral.numel()))
                rates = np.zeros(t.n)
                found = np.asarray(self._function(state, algebraic, action, state, action, zero, rates, given[4], q))
                if not np.isfinite(found).all():
                    return self._sentence(found, np.concatenate([state, algebraic, action]))
        return "a derivative is not finite at the first guess"

    def _sentence(self, found: FloatArray, values: FloatArray) -> str:
        import casadi as ca

        row, column = (int(i) for i in np.argwhere(~np.isfinite(found))[0])
        names = [self._unknowns[i].name().partition(":")[2] for i in range(len(values))]
        read = [i for i in range(len(values)) if ca.depends_on(self._value[row], self._unknowns[i])]
        units = [self._t.e.unit(names[i]) for i in read]
        at = [f"`{names[i]}` = {values[i]:.6g} {unit}" for i, unit in zip(read, units, strict=True)]
        what = f"slope by `{names[column - 1]}`" if np.isfinite(found[row, 0]) else "value"
        where = f", {', '.join(at[:6])}" if at else ""
        return f"{self._names[row]} has no finite {what} at the first guess{where}"


def _equation(residual: Any) -> str:
    """An equation by the algebraic variables that it has, else by the rates."""
    import casadi as ca

    keys = [symbol.name().partition(":") for symbol in ca.symvar(residual)]
    names = [name for kind, _, name in keys if kind == "z"] or [
        f"der({name})" for kind, _, name in keys if kind == "dx"
    ]
    return f"the equation with {', '.join(f'`{name}`' for name in names[:4])}"
