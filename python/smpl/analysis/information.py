"""Information of experiments about parameters.

The Fisher information of an experiment is S'S, S the derivatives of all samples by the parameters
over the standard deviations of the samples. Its inverse bounds the covariance of every unbiased
estimate (Cramér-Rao). R. Brun, P. Reichert, H. R. Künsch, Water Resources Research 37 (2001)
1015-1030, equation 13 (collinearity index); R. N. Gutenkunst et al., PLoS Computational Biology 3
(2007) e189 (sloppy directions).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.analysis.fitting import Fit
from smpl.analysis.least_squares import RANK, FitOptions, Problem
from smpl.analysis.records import starting_states
from smpl.analysis.runs import Run
from smpl.model import Model
from smpl.support.arguments import FloatArray
from smpl.support.options import Options, takes


@dataclass(frozen=True)
class Information:
    """Information of an experiment about parameters.

    Attributes:
        names: parameters, then unknown starts as `run 0: NAME`.
        values: of them, at which the derivatives are taken.
        matrix: Fisher information, (d, d), in the inverse units of `names`.
        deviation: least standard deviation of an unbiased estimate by name; infinite where the
            experiment does not determine the parameter.
        correlation: of estimates, (d, d); NaN for parameters that are not determined.
        singular_values: of the derivatives by relative changes, descending: the inverse of one is
            the relative standard deviation in its direction.
        directions: (d, d), a row for each singular value: relative changes of the parameters.
        indistinct: groups of parameters of which only a combination is determined.
        silent: parameters without effect on any sample.
        collinearity: inverse of the least singular value of the derivatives with columns of length
            1. From about 10 on, other parameters compensate a change of one (Brun et al.).
        samples: number of samples that count.
        ends: steps of each run until its end, all or those before a declared failure.
        derivatives: `exact`, or `differences` with the reason.
    """

    names: tuple[str, ...]
    values: FloatArray
    matrix: FloatArray
    deviation: dict[str, float]
    correlation: FloatArray
    singular_values: FloatArray
    directions: FloatArray
    indistinct: tuple[tuple[str, ...], ...]
    silent: tuple[str, ...]
    collinearity: float
    samples: int
    ends: tuple[int, ...]
    derivatives: str

    def __str__(self) -> str:
        width = max(len(name) for name in self.names)
        rows = []
        for name, value in zip(self.names, self.values, strict=True):
            deviation = self.deviation[name]
            share = f"  ({100 * deviation / abs(value):.3g} %)" if value and np.isfinite(deviation) else ""
            shown = f"{deviation:.3g}{share}" if np.isfinite(deviation) else "not determined"
            rows.append(f"{name:{width}} = {value:.6g}  ± {shown}")
        rows += [f"no effect on the samples: {', '.join(self.silent)}"] if self.silent else []
        rows += [f"only a combination is determined of: {', '.join(group)}" for group in self.indistinct]
        rows.append(f"weakest direction: {self._weakest()}")
        rows.append(f"collinearity index {self.collinearity:.3g}, {self.samples} samples")
        return "\n".join(rows)

    def _weakest(self) -> str:
        """Relative changes of the least determined direction, with its standard deviation."""
        direction, value = self.directions[-1], self.singular_values[-1]
        parts = [(share, name) for share, name in zip(direction, self.names, strict=True) if abs(share) > 0.1]
        size = f"{1 / value:.3g}" if value > RANK * self.singular_values[0] else "infinite"
        return " ".join(f"{share:+.2f} {name}" for share, name in parts) + f", relative deviation {size}"


@dataclass(frozen=True, kw_only=True, repr=False)
class InformationOptions(Options):
    """Options of `information`.

    Attributes:
        outputs: names of observations or states that are measured; None for those of the
            experiments, or all observations of the level.
        noise: standard deviations of outputs by name, in their units; the level declares others.
        initial: states with unknown initial values, a number for each run.
        fixed: values of other parameters by name.
        prior: information of earlier experiments about the same names: an `Information`, a `Fit`,
            or a matrix (d, d).
        derivatives: as for `smpl.fit`.
        method: integration method, see `smpl.Model.rollout`; None for the model's own.
    """

    outputs: Iterable[str] | None = None
    noise: Mapping[str, float] | None = None
    initial: Iterable[str] = ()
    fixed: Mapping[str, float] | None = None
    prior: Information | Fit | npt.ArrayLike | None = None
    derivatives: str = "auto"
    method: str | None = "auto"


@takes(InformationOptions)
def information(
    model: Model, experiments: Any, parameters: Iterable[str] | Mapping[str, float], options: InformationOptions
) -> Information:
    """Information of experiments about parameters, before or after they are run.

    Args:
        model: any model, compiled with the observation level of the experiments.
        experiments: one or several: actions (H, actions) in physical units from the nominal start,
            or runs as for `smpl.fit`. A run with values of outputs has its samples where they are;
            one without has a sample wherever a sensor of the level reads.
        parameters: names, or a mapping from names to the values at which derivatives are taken;
            otherwise the declared values.
        options: `InformationOptions`, and options as keyword arguments.

    Raises:
        ValueError: names that do not fit, or an output without a standard deviation.
        SimulationError: an experiment cannot be simulated.

    Example:
        >>> import smpl
        >>> model = smpl.compile("reactor", observation="online")
        >>> print(information(model, [[26.85, 0.1]] * 20, ["U", "c_Af"]))  # doctest: +SKIP
    """
    problem = problem_of(model, _planned(model, experiments), parameters, options)
    return read_slope(problem, slope_of(problem), prior_of(problem, options.prior))


def _planned(model: Model, experiments: Any) -> Any:
    """Runs as of `smpl.fit`, arrays of actions as runs from the nominal start."""
    if isinstance(experiments, (np.ndarray, list)) and _is_array(experiments):
        return [_of_actions(model, experiments, "the experiment")]
    if not isinstance(experiments, (list, tuple)):
        return experiments
    pairs = enumerate(experiments)
    return [_of_actions(model, one, f"experiment {i}") if _is_array(one) else one for i, one in pairs]


def _is_array(one: Any) -> bool:
    """True for a matrix of numbers."""
    try:
        return np.asarray(one, dtype=np.float64).ndim == 2
    except (TypeError, ValueError):
        return False


def _of_actions(model: Model, actions: Any, name: str) -> Run:
    values = np.asarray(actions, dtype=np.float64)
    count = len(model.action_names)
    if values.shape[1] != count or not len(values) or not np.isfinite(values).all():
        raise ValueError(f"{name} has the shape {values.shape}, expected finite actions (H, {count})")
    return Run(name, starting_states(model, {}), values, {}, {}, {}, {})


def problem_of(model: Model, runs: Any, parameters: Any, options: InformationOptions) -> Problem:
    """The samples of runs, with known deviations, that are compared."""
    shared = {
        name: getattr(options, name) for name in ("outputs", "noise", "initial", "fixed", "derivatives", "method")
    }
    problem = Problem(model, runs, parameters, FitOptions(**shared), planned=True)
    unknown = [name for name, known in zip(problem.outputs, problem.known, strict=True) if not known]
    if unknown:
        given, others = (
            ", ".join(f"{name!r}: ..." for name in unknown),
            [one for one in model.levels if one != model.level],
        )
        raise ValueError(
            f"{', '.join(unknown)} of the level {model.level!r} has no standard deviation: give noise={{{given}}}, or "
            f"compile the model with a level that declares it (other levels: {', '.join(others)})"
        )
    problem.choose(options.derivatives)
    return problem


def slope_of(problem: Problem) -> FloatArray:
    """Derivatives of the samples over their deviations by relative changes, (m, d)."""
    return problem.derivatives_of_samples(problem.guess / problem.scale)


def prior_of(problem: Problem, prior: Any) -> FloatArray | None:
    """Information of earlier experiments, in the units of the parameters."""
    if prior is None:
        return None
    if isinstance(prior, (Information, Fit)):
        if prior.names != problem.names:
            raise ValueError(f"prior is about {', '.join(prior.names)}, expected {', '.join(problem.names)}")
        if isinstance(prior, Information):
            return prior.matrix
        if not np.isfinite(prior.covariance).all():
            raise ValueError("prior is a fit that determines only combinations: give its matrix of information")
        return np.asarray(np.linalg.inv(prior.covariance), dtype=np.float64)
    matrix, count = np.asarray(prior, dtype=np.float64), len(problem.names)
    if matrix.shape != (count, count) or not np.isfinite(matrix).all():
        raise ValueError(f"prior has the shape {matrix.shape}, expected a finite matrix ({count}, {count})")
    return matrix


def read_slope(problem: Problem, slope: FloatArray, prior: FloatArray | None) -> Information:
    """Information of derivatives by relative changes."""
    scale, names = problem.scale, problem.names
    matrix = slope.T @ slope
    if prior is not None:
        matrix = matrix + prior * np.outer(scale, scale)
    size = np.sqrt(np.diag(matrix))
    silent = tuple(name for name, one in zip(names, size, strict=True) if not one > 0)
    length = np.where(size > 0, size, 1.0)
    normed, turned = np.linalg.eigh(matrix / np.outer(length, length))
    weak = np.sqrt(np.maximum(normed, 0.0)) <= RANK * np.sqrt(normed[-1])
    inverse = np.where(weak, 0.0, 1 / np.where(weak, 1.0, normed))
    covariance = (turned * inverse) @ turned.T / np.outer(length, length)
    groups, lost = [], np.array(size <= 0)
    for direction in turned.T[weak]:
        part = np.abs(direction) > 1e-3 * np.abs(direction).max()
        lost |= part
        group = tuple(name for name, one in zip(names, part, strict=True) if one)
        if not set(group) <= set(silent):
            groups.append(group)
    deviation = np.where(lost, np.inf, scale * np.sqrt(np.maximum(np.diag(covariance), 0.0)))
    spread = np.where(lost, np.nan, np.sqrt(np.maximum(np.diag(covariance), 0.0)))
    values, directions = np.linalg.eigh(matrix)
    return Information(
        names=names,
        values=problem.guess.copy(),
        matrix=matrix / np.outer(scale, scale),
        deviation=dict(zip(names, deviation.tolist(), strict=True)),
        correlation=covariance / np.outer(spread, spread),
        singular_values=np.sqrt(np.maximum(values[::-1], 0.0)),
        directions=directions.T[::-1],
        indistinct=tuple(dict.fromkeys(groups)),
        silent=silent,
        collinearity=float(1 / np.sqrt(max(normed[0], 0.0))) if normed[0] > 0 else np.inf,
        samples=problem.samples,
        ends=tuple(problem.ends),
        derivatives=problem.kind_of_derivatives(),
    )
