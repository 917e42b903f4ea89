"""Profile likelihoods: what a parameter's value costs when all others are fitted again.

A. Raue et al., Bioinformatics 25 (2009) 1923-1929; D. M. Bates, D. G. Watts, Nonlinear Regression Analysis and Its
Applications (1988), section 6.1.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl._arguments import FloatArray, as_numbers, check_names
from smpl.identification import fit
from smpl.model import Model


@dataclass(frozen=True)
class Profile:
    """The profile of one parameter.

    Attributes:
        values: of the parameter, ascending.
        excess: sum of squares over that of the best fit, with the noise of the best fit.
        interval: where the excess is below 3.84, the 95 % quantile of the chi-squared distribution with one degree of
            freedom; infinite on a side on which it stays below up to the last value.
    """

    values: FloatArray
    excess: FloatArray
    interval: tuple[float, float]


def profile(
    model: Model,
    runs: Any,
    parameters: Iterable[str] | Mapping[str, float],
    name: str,
    values: npt.ArrayLike | None = None,
    **options: Any,
) -> Profile:
    """Profile likelihood of one of the fitted parameters.

    Args:
        model, runs, parameters: as for `smpl.fit`.
        name: the parameter.
        values: at which the others are fitted; 21 values over twice the interval of the fit if none.
        options: further arguments of `smpl.fit`.

    Raises:
        ValueError: as for `smpl.fit`; `name` is not fitted, or nothing else is.
    """
    names = list(parameters)
    check_names("name", [name], names)
    best = fit(model, runs, parameters, **options)
    low, high = best.interval[name]
    centre = best.parameters[name]
    if values is None:
        if not np.isfinite(high - low):
            raise ValueError(f"the fit does not determine {name}: give values")
        values = np.linspace(2 * low - centre, 2 * high - centre, 21)
    bounds = model.native.bounds("parameter")
    place = model.parameter_names.index(name)
    points = np.unique(np.clip(as_numbers("values", values, "(n,)"), bounds[0][place], bounds[1][place]))
    others = {other: best.parameters[other] for other in names if other != name}
    if not others and not tuple(options.get("initial", ())):
        raise ValueError(f"{name} alone is fitted: its profile is the sum of squares itself")
    # The noise of the best fit weighs everywhere: sums of squares of different weights cannot be compared.
    options = {**options, "noise": best.noise}
    base = best.residual_norm**2
    found = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for value in points:
            fixed = {**(options.get("fixed") or {}), name: float(value)}
            one = fit(model, runs, others, **{**options, "fixed": fixed})
            found.append(one.residual_norm**2 - base)
    excess = np.array(found)
    return Profile(points, excess, _crossings(points, excess, centre))


def _crossings(values: FloatArray, excess: FloatArray, centre: float) -> tuple[float, float]:
    """Where the excess passes 3.84 on either side, between two values by a straight line in its root."""
    from scipy.stats import chi2

    height = np.sqrt(chi2.ppf(0.95, 1))
    root = np.sqrt(np.maximum(excess, 0.0))
    left, right = values < centre, values > centre
    low, high = -np.inf, np.inf
    if left.any() and root[left].max() > height:
        low = float(np.interp(-height, [*-root[left], 0.0], [*values[left], centre]))
    if right.any() and root[right].max() > height:
        high = float(np.interp(height, [0.0, *root[right]], [centre, *values[right]]))
    return low, high
