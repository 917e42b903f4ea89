"""Parameters from recorded runs by weighted least squares with exact derivatives.

Y. Bard, Nonlinear Parameter Estimation (1974), chapters 4 and 7; D. M. Bates, D. G. Watts,
Nonlinear Regression Analysis and Its Applications (1988), chapter 2. The optimiser is SciPy's
trust-region reflective Gauss-Newton.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from smpl.analysis.least_squares import DERIVATIVES, FitOptions, Problem
from smpl.model import Model
from smpl.support.arguments import FloatArray, as_count
from smpl.support.optional import load
from smpl.support.options import takes

# Most rounds of estimating deviations.
_ROUNDS = 20
# Residuals over their deviations, above which they are not noise.
_MISFIT = 1.5


@dataclass(frozen=True)
class Fit:
    """Result of a fit.

    Attributes:
        parameters: values by name.
        interval: (low, high) by name, 95 %, from the linearisation; infinite where a parameter is
            not determined.
        covariance: of the parameters in the order of `names`, then of the initial states.
        residual_norm: root of the sum of squares of the residuals over their standard deviations.
        names: fitted parameters, then initial states as `run 0: NAME`.
        initial: the estimated initial states of each run.
        noise: standard deviation of each output, declared or estimated.
        indistinct: groups of parameters of which only a combination is determined.
        residuals: measured less simulated of each run, output -> array over `times` (NaN where
            nothing was read).
        evaluations: how many points were simulated.
        success: whether the optimiser converged.
        derivatives: `exact`, or `differences` with the reason.
        at_bounds: those of `names` that lie at a bound of the file. Where there are any, the
            linearisation does not show how far the runs determine a parameter: intervals are
            infinite, and `smpl.analysis.profiles.profile` finds them.
        simulated: of each run at the values found, output -> array over `times`.
        times: of each run: the ends of its steps, and the times of samples between them.
        noise_known: whether all deviations are given or declared.
        freedom: number of residuals less that of fitted numbers.
    """

    parameters: dict[str, float]
    interval: dict[str, tuple[float, float]]
    covariance: FloatArray
    residual_norm: float
    names: tuple[str, ...]
    initial: list[dict[str, float]]
    noise: dict[str, float]
    indistinct: tuple[tuple[str, ...], ...]
    residuals: list[dict[str, FloatArray]]
    evaluations: int
    success: bool
    derivatives: str
    at_bounds: tuple[str, ...]
    simulated: list[dict[str, FloatArray]]
    times: list[FloatArray]
    noise_known: bool
    freedom: int
    _labels: tuple[dict[str, str], str] = field(repr=False)

    def figure(self) -> Any:
        """Matplotlib figure of runs, measurements and residuals (extra `report`)."""
        from smpl.analysis.fit_pictures import fit_figure

        return fit_figure(self.simulated, self.residuals, self.times, self.noise, *self._labels)

    def scenario(self) -> str:
        """Text of a scenario file with the values found."""
        lines = [f"  {name}: {value!r}" for name, value in self.parameters.items()]
        return "\n".join(["parameters:", *lines, ""])

    def __str__(self) -> str:
        rows = [
            f"{name} = {value:.6g}  ({self.interval[name][0]:.6g} .. {self.interval[name][1]:.6g})"
            for name, value in self.parameters.items()
        ]
        rows += [f"only a combination is determined of: {', '.join(group)}" for group in self.indistinct]
        rows += [] if self.success else ["not converged: more iterations, or other first guesses"]
        rows += [f"at a bound of the file: {', '.join(self.at_bounds)}"] if self.at_bounds else []
        rows += [f"derivatives are {self.derivatives}"] if ":" in self.derivatives else []
        return "\n".join([*rows, f"residual norm {self.residual_norm:.6g}"])


@takes(FitOptions)
def fit(model: Model, runs: Any, parameters: Iterable[str] | Mapping[str, float], options: FitOptions) -> Fit:
    """Fit parameters to recorded runs.

    The model is simulated with the recorded actions and disturbances from the recorded start,
    random numbers at their means. It is compared at the steps at which a sample was read for the
    first time. Residuals count over the standard deviation of their output: that which `noise`
    gives, else that which the observation level declares, else one that is estimated with the
    parameters (maximum likelihood).

    Args:
        model: any model, compiled with the observation level of the runs.
        runs: one or several: tables as `smpl simulate --out` writes them (.csv or .parquet), of one
            run or several, episodes of `smpl.evaluation`, or mappings from columns to arrays.
            Columns `param.NAME` are known values. A data set, or its folder, is one run an episode.
        parameters: names, or a mapping from names to first guesses; otherwise the declared values.
        options: `FitOptions`, and options as keyword arguments.

    A table with a column `time` and no column `step` has rows at any times. Its values of states
    and observations are samples taken at their times, empty cells are skipped, and the simulation
    is read there, also within steps. Inputs hold from their time on if the first row, at 0, has
    one; otherwise up to their time, as in written tables.

    Raises:
        ValueError: names that do not fit, runs without what is needed, or a parameter without any
            effect.
        SimulationError: `derivatives="exact"`, and a run has none.
        ImportError: SciPy is missing.
    """
    if options.derivatives not in DERIVATIVES:
        raise ValueError(f"derivatives is {options.derivatives!r}, expected one of {', '.join(DERIVATIVES)}")
    if options.resample not in ("hold", "linear"):
        raise ValueError(f"resample is {options.resample!r}, expected 'hold' or 'linear'")
    problem = _Fitting(model, runs, parameters, options)
    return problem.solve(as_count("iterations", options.iterations), options.derivatives)


class _Fitting(Problem):
    """Search of the numbers, with deviations that are not known."""

    def solve(self, iterations: int, derivatives: str) -> Fit:
        optimize = _optimize()
        self.choose(derivatives)
        low, high = self.low / self.scale, self.high / self.scale
        point = np.clip(self.guess / self.scale, low + 1e-9, high - 1e-9)
        found: Any = None
        # Deviations that are not known and the parameters in turn, until they stay.
        for _ in range(1 if self.known.all() else _ROUNDS):
            found = optimize.least_squares(
                self.residuals,
                point,
                jac=self.slopes,
                bounds=(low, high),
                max_nfev=iterations,
                ftol=1e-8,
                xtol=1e-8,
                gtol=1e-10,
            )
            point, before = found.x, self.noise
            self._estimate_noise(point)
            if (np.abs(self.noise - before) <= 1e-3 * before).all():
                break
        return self._result(point, bool(found.success))

    def _estimate_noise(self, z: FloatArray) -> None:
        """Root mean square of the residuals of the outputs whose deviation is not known."""
        if self.known.all():
            return
        squares, counts = np.zeros(len(self.outputs)), np.zeros(len(self.outputs))
        for residual in self._unweighted(z):
            squares += np.nansum(residual**2, axis=0)
            counts += np.isfinite(residual).sum(axis=0)
        # Each output bears its share of the fitted numbers.
        freedom = np.maximum(counts - len(z) * counts / counts.sum(), 1.0)
        found = np.sqrt(squares / freedom)
        self.noise = np.where(self.known, self.noise, np.maximum(found, self._least))

    def _simulated(self, z: FloatArray) -> list[FloatArray]:
        """Outputs (H + 1, outputs) of each run."""
        point = (z * self.scale)[None]
        return [self.recorded.values(place, point)[0] for place in range(len(self.runs))]

    def _unweighted(self, z: FloatArray) -> list[FloatArray]:
        """Measured less simulated, NaN where nothing was read."""
        parts = zip(self._simulated(z), self.measured, self.masks, strict=True)
        return [np.where(mask, measured - simulated, np.nan) for simulated, measured, mask in parts]

    def _by_time(self, found: list[FloatArray]) -> list[dict[str, FloatArray]]:
        """Values of each run by outputs, in the order of time."""
        orders = [np.argsort(run.times(self.model.step), kind="stable") for run in self.runs]
        pairs = zip(found, orders, strict=True)
        return [dict(zip(self.outputs, one[order].T, strict=True)) for one, order in pairs]

    def _at_bounds(self, z: FloatArray) -> tuple[str, ...]:
        near = 1e-6 * self.scale
        at = (z * self.scale <= self.low + near) | (z * self.scale >= self.high - near)
        return tuple(name for name, one in zip(self.names, at, strict=True) if one)

    def _units(self) -> dict[str, str]:
        model = self.model
        known = dict(zip(model.state_names, model.native.units("state"), strict=True))
        known |= dict(zip(model.observation_names, model.native.units("observation"), strict=True))
        return {name: known[name] for name in self.outputs}

    def _result(self, z: FloatArray, success: bool) -> Fit:
        residual, slope = self.residuals(z), self.slopes(z)
        silent = [name for name, column in zip(self.names, slope.T, strict=True) if not np.abs(column).max() > 0]
        if silent:
            raise ValueError(
                f"the runs say nothing about {', '.join(silent)}: in them {', '.join(self.outputs)} would be the same "
                "with another value; leave it out, or add runs in which it acts"
            )
        covariance, indistinct = self.covariance(slope)
        values = z * self.scale
        half = _quantile(len(residual) - len(z), bool(self.known.all())) * np.sqrt(np.diag(covariance))
        count = len(self.parameters)
        at_bounds = self._at_bounds(z)
        if at_bounds:
            half = np.full(len(half), np.inf)
            text = (
                f"the fit ends at a bound of {', '.join(at_bounds)}: intervals are infinite; widen the bound, or take "
                "smpl.analysis.profiles.profile for intervals within it"
            )
            warnings.warn(text, stacklevel=5)
        inside = zip(self.parameters, values[:count], half[:count], strict=True)
        interval = {name: (float(value - width), float(value + width)) for name, value, width in inside}
        if indistinct:
            groups = "; ".join(", ".join(group) for group in indistinct)
            warnings.warn(f"the runs determine only a combination of {groups}: fix one, or add runs", stacklevel=4)
        if success:
            self._warn_of_misfit(z)
        states = values[count:].reshape(len(self.runs), len(self.initial))
        return Fit(
            parameters=dict(zip(self.parameters, values[:count].tolist(), strict=True)),
            interval=interval,
            covariance=covariance,
            residual_norm=float(np.linalg.norm(residual)),
            names=self.names,
            initial=[dict(zip(self.initial, row.tolist(), strict=True)) for row in states],
            noise=dict(zip(self.outputs, self.noise.tolist(), strict=True)),
            indistinct=indistinct,
            residuals=self._by_time(self._unweighted(z)),
            simulated=self._by_time(self._simulated(z)),
            times=[np.sort(run.times(self.model.step)) for run in self.runs],
            at_bounds=at_bounds,
            noise_known=bool(self.known.all()),
            freedom=len(residual) - len(z),
            _labels=(self._units(), f"{self.model.native.time_name} [{self.model.native.time_unit}]"),
            evaluations=self.evaluations,
            success=success,
            derivatives=self.kind_of_derivatives(),
        )

    def _warn_of_misfit(self, z: FloatArray) -> None:
        """Residuals above a known deviation: the model does not describe the runs."""
        from scipy.stats import chi2

        residual = np.concatenate([one / self.noise for one in self._unweighted(z)])
        for name, column, known in zip(self.outputs, residual.T, self.known, strict=True):
            read = column[np.isfinite(column)]
            square = float(np.mean(read**2)) if read.size else 0.0
            if known and square > max(_MISFIT**2, chi2.ppf(1 - 1e-6, max(read.size, 1)) / max(read.size, 1)):
                text = (
                    f"the residuals of {name} are {square**0.5:.3g} times the given noise: the model does not follow "
                    "the runs, and the intervals are too narrow. The row of an action is the one in which its step ends"
                )
                warnings.warn(text, stacklevel=5)


def _quantile(freedom: int, known: bool) -> float:
    """Half width of the 95 % interval in standard deviations."""
    from scipy.stats import norm, t

    return float(norm.ppf(0.975) if known or freedom < 1 else t.ppf(0.975, freedom))


def _optimize() -> Any:
    return load("scipy.optimize", "smpl.fit")
