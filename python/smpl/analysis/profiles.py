"""Profile likelihoods: what a parameter's value costs when all others are fitted again.

A. Raue et al., Bioinformatics 25 (2009) 1923-1929; D. M. Bates, D. G. Watts, Nonlinear Regression
Analysis and Its Applications (1988), section 6.1.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.analysis.fitting import Fit, fit
from smpl.model import Model
from smpl.support.arguments import FloatArray, as_numbers, check_names

# Steps away from the best value on each side at most, the growth from one to the next, and
# refinements of a crossing.
_MOST, _GROWTH, _REFINED = 40, 2.0, 8
# A fit that is better than the best one by this much takes its place.
_BETTER = 1e-3


@dataclass(frozen=True)
class Profile:
    """The profile of one parameter.

    Attributes:
        values: of the parameter, ascending.
        excess: sum of squares over that of the best fit, with the noise of the best fit.
        interval: where the excess is below `level`; infinite on a side without a crossing before a
            bound of the parameter or the last point.
        level: the 95 % quantile of the chi-squared distribution with one degree of freedom, 3.84,
            where the noise is known, else that of the F distribution.
        at_bounds: other fitted parameters that lie at a bound of theirs where the interval ends:
            the interval holds within these bounds.
    """

    values: FloatArray
    excess: FloatArray
    interval: tuple[float, float]
    level: float
    at_bounds: tuple[str, ...] = ()


def profile(
    model: Model,
    runs: Any,
    parameters: Iterable[str] | Mapping[str, float],
    name: str,
    values: npt.ArrayLike | None = None,
    **options: Any,
) -> Profile:
    """Profile likelihood of one of the fitted parameters.

    Without `values` the profile is followed from the best fit to both sides until it crosses its
    level, or until a bound of the parameter. Each value is fitted from where the one before ended.

    Args:
        model, runs, parameters: as for `smpl.fit`.
        name: the parameter.
        values: of the parameter, at which the others are fitted, instead of computed ones.
        options: further arguments of `smpl.fit`.

    Raises:
        ValueError: as for `smpl.fit`; `name` is not fitted, or nothing else is.
    """
    names = list(parameters)
    check_names("name", [name], names)
    if len(names) == 1 and not tuple(options.get("initial", ())):
        raise ValueError(f"{name} alone is fitted: its profile is the sum of squares itself")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        best = fit(model, runs, parameters, **options)
        for _ in range(5):
            search = _Search(model, runs, best, name, options)
            if values is None:
                search.follow()
            else:
                search.visit(as_numbers("values", values, "(n,)"))
            better = search.better()
            if better is None:
                break
            # Another valley: the fit had not found the lowest one.
            best = fit(model, runs, better, **options)
    return search.profile(with_best=values is None)


class _Search:
    """Fits at values of a parameter, from a best fit outwards."""

    def __init__(self, model: Model, runs: Any, best: Fit, name: str, options: Mapping[str, Any]) -> None:
        self._model, self._runs, self._best, self._name = model, runs, best, name
        # The noise of the best fit weighs everywhere: sums of squares of different weights cannot
        # be compared.
        self._options = {**options, "noise": best.noise}
        self._base = best.residual_norm**2
        place = model.parameter_names.index(name)
        self._low, self._high = (float(bound[place]) for bound in model.native.bounds("parameter"))
        self._centre = best.parameters[name]
        self.level = _level(best)
        self._others = {one: value for one, value in best.parameters.items() if one != name}
        self._found: dict[float, tuple[float, dict[str, float], tuple[str, ...]]] = {
            self._centre: (0.0, self._others, ())
        }

    def visit(self, values: FloatArray) -> None:
        """Fit at given values, from the inside outwards."""
        points = np.unique(np.clip(values, self._low, self._high))
        for side in (points[points >= self._centre], points[points < self._centre][::-1]):
            others = self._others
            for value in side:
                _, others = self._at(float(value), others)

    def follow(self) -> None:
        """Go to both sides until the level is crossed, or to the bound."""
        low, high = self._best.interval[self._name]
        width = (high - low) / 4 if np.isfinite(high - low) else 0.0
        width = width or 0.1 * (abs(self._centre) or 1.0)
        for side, bound in ((1.0, self._high), (-1.0, self._low)):
            self._go(side, bound, width)

    def _go(self, side: float, bound: float, width: float) -> None:
        value, others, excess = self._centre, self._others, 0.0
        for _ in range(_MOST):
            if value == bound:
                return
            before = value, excess, others
            value = value + side * width
            value = min(value, bound) if side > 0 else max(value, bound)
            excess, others = self._at(value, others)
            if excess > self.level:
                self._refine(before, (value, excess))
                return
            # Steps that grow where the profile is flat.
            width *= _GROWTH if excess < self.level / 2 else 1.0

    def _refine(self, inner: tuple[float, float, dict[str, float]], outer: tuple[float, float]) -> None:
        """Narrow the interval in which the root of the excess passes that of the level."""
        height = np.sqrt(self.level)
        for number in range(_REFINED):
            a, b = np.sqrt(max(inner[1], 0.0)), np.sqrt(outer[1])
            share = (height - a) / (b - a) if b < 3 * height and number % 3 < 2 else 0.5
            value = inner[0] + min(max(share, 0.05), 0.95) * (outer[0] - inner[0])
            excess, others = self._at(value, inner[2])
            if excess > self.level:
                outer = value, excess
            else:
                inner = value, excess, others
            if abs(np.sqrt(max(excess, 0.0)) - height) < 1e-3 * height:
                return

    def _at(self, value: float, others: dict[str, float]) -> tuple[float, dict[str, float]]:
        """Excess at a value and the other parameters, from its neighbour or from the best fit."""
        best: tuple[float, dict[str, float], tuple[str, ...]] | None = None
        for start in (others, self._others):
            if best is not None and (best[0] <= self.level or start == others):
                break
            fixed = {**(self._options.get("fixed") or {}), self._name: value}
            one = fit(self._model, self._runs, self._inside(start), **{**self._options, "fixed": fixed})
            excess = one.residual_norm**2 - self._base
            if best is None or excess < best[0]:
                best = excess, one.parameters, one.at_bounds
        assert best is not None
        if value not in self._found or best[0] < self._found[value][0]:
            self._found[value] = best
        return best[0], best[1]

    def _inside(self, start: dict[str, float]) -> dict[str, float]:
        """A start that does not lie on the bounds, from which an optimiser goes slowly."""
        bounds = self._model.native.bounds("parameter")
        moved = {}
        for name, value in start.items():
            low, high = (float(bound[self._model.parameter_names.index(name)]) for bound in bounds)
            margin = 1e-2 * (high - low if np.isfinite(high - low) else max(abs(value), 1e-300))
            moved[name] = min(max(value, low + margin), high - margin) if low + margin < high - margin else value
        return moved

    def better(self) -> dict[str, float] | None:
        """Parameters of a fit that is better than the best one, if there is one."""
        value, (excess, others, _) = min(self._found.items(), key=lambda item: item[1][0])
        if excess > -_BETTER:
            return None
        return {name: value if name == self._name else others[name] for name in self._best.parameters}

    def profile(self, with_best: bool) -> Profile:
        """The profile, without the best fit unless it was requested."""
        points = np.array(sorted(one for one in self._found if with_best or one != self._centre))
        excess = np.array([self._found[float(point)][0] for point in points])
        low, high = _crossings(points, excess, self._centre, self.level)
        ends = [points[np.abs(points - end).argmin()] for end in (low, high) if np.isfinite(end)]
        at = [name for end in ends for name in self._found[float(end)][2]]
        return Profile(points, excess, (low, high), self.level, tuple(dict.fromkeys(at)))


def _level(best: Fit) -> float:
    """Excess at the ends of a 95 % interval."""
    from scipy.stats import chi2, f

    if best.noise_known or best.freedom < 1:
        return float(chi2.ppf(0.95, 1))
    return float(f.ppf(0.95, 1, best.freedom))


def _crossings(values: FloatArray, excess: FloatArray, centre: float, level: float) -> tuple[float, float]:
    """The first crossings of the level on both sides, interpolated linearly in the root."""
    height, root = np.sqrt(level), np.sqrt(np.maximum(excess, 0.0))

    def crossing(x: FloatArray, y: FloatArray) -> float:
        above = np.flatnonzero(y > height)
        if not len(above):
            return np.inf
        k = above[0]
        a, b = (centre, 0.0) if k == 0 else (x[k - 1], y[k - 1])
        return float(a + (height - b) / (y[k] - b) * (x[k] - a))

    left, right = values < centre, values > centre
    low = crossing(values[left][::-1], root[left][::-1])
    return (-np.inf if np.isinf(low) else low), crossing(values[right], root[right])
