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

from smpl._native import SimulationError
from smpl.analysis.records import read_runs, without_computed
from smpl.analysis.replay import DISTANCE, Recorded, beside
from smpl.analysis.runs import Run
from smpl.analysis.sensors import sensors
from smpl.model import Model
from smpl.support.arguments import FloatArray, as_count, as_mapping, as_number, check_method, check_names, check_once
from smpl.support.optional import load
from smpl.support.options import Options, takes

# Most rounds of estimating deviations.
_ROUNDS = 20
# Ratio of singular values below which a direction is not determined.
_RANK = 1e-6
# Residuals over their deviations, above which they are not noise.
_MISFIT = 1.5
# Exact derivatives by all states cost more than differences by the fitted numbers above so many
# states for each.
_STATES = 8
DERIVATIVES = ("auto", "exact", "differences")


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


@dataclass(frozen=True, kw_only=True, repr=False)
class FitOptions(Options):
    """Options of `fit`.

    Attributes:
        outputs: names of observations or states that are compared; None for all observations that
            the runs have.
        noise: standard deviations of outputs by name, in their units.
        initial: states with unknown initial values, which are estimated for each run.
        fixed: values of other parameters by name.
        iterations: limit of the optimiser's steps.
        derivatives: `exact` (forward sensitivities), `differences` of simulations, or `auto`: exact
            for models with few states, and differences if a step cannot be differentiated.
            `Fit.derivatives` shows the choice and its reason.
        method: integration method, see `smpl.Model.rollout`; None for the model's own.
        resample: actions and disturbances between the times of a table with a column `time`: `hold`
            or `linear`. Steps take the mean over their interval.
    """

    outputs: Iterable[str] | None = None
    noise: Mapping[str, float] | None = None
    initial: Iterable[str] = ()
    fixed: Mapping[str, float] | None = None
    iterations: int = 50
    derivatives: str = "auto"
    method: str | None = "auto"
    resample: str = "hold"


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
    problem = _Problem(model, runs, parameters, options)
    return problem.solve(as_count("iterations", options.iterations), options.derivatives)


class _Problem:
    def __init__(
        self, model: Model, runs: Any, parameters: Iterable[str] | Mapping[str, float], options: FitOptions
    ) -> None:
        self._method = check_method(options.method)
        self.model, self.fixed = model, dict(as_mapping("fixed", options.fixed))
        initial = (options.initial,) if isinstance(options.initial, str) else tuple(options.initial)
        check_names("fixed", self.fixed, model.parameter_names)
        guesses = dict(parameters) if isinstance(parameters, Mapping) else {}
        names = [parameters] if isinstance(parameters, str) else list(parameters)
        check_names("parameters", names, model.parameter_names)
        check_names("initial", initial, model.state_names)
        if not names and not initial:
            raise ValueError("parameters is empty, expected names of parameters to fit")
        check_once("parameters", names)
        check_once("initial", initial)
        self.runs = read_runs(model, runs, options.resample)
        if not self.runs:
            raise ValueError("runs is empty, expected at least one run")
        self.parameters, self.initial = tuple(names), initial
        self.runs = without_computed(model, self.runs, {*self.parameters, *self.fixed})
        self._warn_of_starts()
        self._warn_of_draws()
        self.outputs = self._chosen(options.outputs)
        self._start(guesses)
        self._weigh(as_mapping("noise", options.noise))
        self.evaluations = 0

    def _warn_of_starts(self) -> None:
        """Say where a start is not known, and is neither fitted."""
        for run in self.runs:
            names = [name for name in run.assumed if name not in self.initial]
            if names:
                shown = ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
                text = (
                    f"{run.name} does not say where {shown} started: the nominal start is taken, or name it in initial"
                )
                warnings.warn(text, stacklevel=5)

    def _warn_of_draws(self) -> None:
        """Say which parameters are one number here, and several in the runs."""
        for name in self.parameters:
            values = [run.parameters[name] for run in self.runs if name in run.parameters]
            if values and min(values) != max(values):
                text = f"{name} is fitted as one number, and was {min(values):.6g} to {max(values):.6g} in the runs"
                warnings.warn(text, stacklevel=5)

    # What is fitted: the parameters, then the unknown initial states of each run, over their
    # scales.

    def _start(self, guesses: Mapping[str, float]) -> None:
        model = self.model
        places = [model.parameter_names.index(name) for name in self.parameters]
        low, high = (bound[places] for bound in model.native.bounds("parameter"))
        declared = model.native.defaults("parameter")[places]
        values = [as_number(f"parameters[{n!r}]", guesses.get(n, declared[i])) for i, n in enumerate(self.parameters)]
        columns = [model.state_names.index(name) for name in self.initial]
        least, most = (bound[columns] for bound in model.native.bounds("state"))
        starts = [run.states[columns] for run in self.runs]
        self.names = (*self.parameters, *(f"run {i}: {n}" for i in range(len(self.runs)) for n in self.initial))
        self.guess = np.concatenate([values, *starts])
        self.low = np.concatenate([low, *[least] * len(self.runs)])
        self.high = np.concatenate([high, *[most] * len(self.runs)])
        self._columns = columns
        width = np.where(np.isfinite(self.high - self.low), self.high - self.low, 1.0)
        self.scale = np.where(self.guess != 0, np.abs(self.guess), width)

    def _chosen(self, outputs: Iterable[str] | None) -> tuple[str, ...]:
        """Outputs that are compared."""
        recorded = set.intersection(*(set(run.outputs) for run in self.runs))
        if outputs is None:
            chosen = tuple(name for name in self.model.observation_names if name in recorded)
            if not chosen:
                raise ValueError(
                    f"the runs have no column obs.NAME of the level {self.model.level!r}, which shows "
                    f"{', '.join(self.model.observation_names)}: compile the model with their level, or give outputs"
                )
            return chosen
        chosen = (outputs,) if isinstance(outputs, str) else tuple(outputs)
        known = (*self.model.observation_names, *self.model.state_names)
        check_names("outputs", chosen, known)
        check_once("outputs", chosen)
        missing = [name for name in chosen if name not in recorded]
        if missing:
            raise ValueError(
                f"the runs have no column for {', '.join(missing)}; they have: {', '.join(sorted(recorded))}"
            )
        return chosen

    def _weigh(self, noise: Mapping[str, float]) -> None:
        """Standard deviations of outputs, and which of them are known; which samples count."""
        check_names("noise", noise, self.outputs)
        declared = sensors(self.model)
        seen = self.model.observation_names
        sizes, known = [], []
        for name in self.outputs:
            deviation = declared.noise[seen.index(name)] if name in seen else 0.0
            if name in noise:
                deviation = as_number(f"noise[{name!r}]", noise[name])
                if not 0 < deviation < np.inf:
                    raise ValueError(f"noise[{name!r}] is {noise[name]!r}, expected a deviation above 0")
            known.append(deviation > 0)
            spread = float(np.nanstd(np.concatenate([run.values(name) for run in self.runs])))
            sizes.append(deviation if deviation > 0 else spread or 1.0)
        self.noise, self._known = np.array(sizes), np.array(known)
        # An exact fit would have infinite weight; the simulations have at least this error.
        self._least = 1e-6 * self.noise
        self._recorded = Recorded(
            self.model, self.runs, self.outputs, self.parameters, self.initial, self.fixed, declared, self._method
        )
        self._measured = [np.stack([run.values(name) for name in self.outputs], axis=-1) for run in self.runs]
        self._masks = [self._mask(run, declared) for run in self.runs]
        for run, mask in zip(self.runs, self._masks, strict=True):
            if not mask.any():
                raise ValueError(f"{run.name} has no value of {', '.join(self.outputs)}")

    def _mask(self, run: Run, declared: Any) -> Any:
        """Samples (H + 1 + instants, outputs) at their first reading; held readings count once."""
        seen = self.model.observation_names
        mask = np.stack([np.isfinite(run.values(name)) for name in self.outputs], axis=1)
        steps = len(run.actions) + 1
        for column, name in enumerate(self.outputs):
            if name not in seen:
                continue
            sensor = seen.index(name)
            fresh = np.array([any(sensor in on for on in declared.arriving(k).values()) for k in range(steps)])
            mask[:steps, column] &= fresh
        return mask

    # Simulation with derivatives.

    def solve(self, iterations: int, derivatives: str) -> Fit:
        optimize = _optimize()
        self._choose(derivatives)
        low, high = self.low / self.scale, self.high / self.scale
        point = np.clip(self.guess / self.scale, low + 1e-9, high - 1e-9)
        found: Any = None
        # Deviations that are not known and the parameters in turn, until they stay.
        for _ in range(1 if self._known.all() else _ROUNDS):
            found = optimize.least_squares(
                self._residuals,
                point,
                jac=self._slopes,
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

    def _choose(self, derivatives: str) -> None:
        """Chooses the derivatives; exact ones are compared with differences at the first point."""
        self._strict, self._unchecked = derivatives == "exact", True
        self._latest: tuple[bytes, FloatArray] = (b"", np.zeros((0, 0)))
        self._why: str | None = None if derivatives != "differences" else ""
        columns, most = len(self.model.state_names) + len(self.parameters), _STATES * (1 + 2 * len(self.names))
        if derivatives == "auto" and columns > most:
            self._why = f"exact ones would be by {columns} numbers"

    def _points(self, z: FloatArray) -> FloatArray:
        """The point and two neighbours in each direction, (1 + 2 d, d), in units."""
        return beside(z, self.scale, self.low, self.high)

    def _residuals(self, z: FloatArray) -> FloatArray:
        """Weighted residuals (m,)."""
        self.evaluations += 1
        return self._weighted((z * self.scale)[None])[0]

    def _weighted(self, points: FloatArray) -> FloatArray:
        """Weighted residuals (N, m) of points in units."""
        parts = []
        for place, (measured, mask) in enumerate(zip(self._measured, self._masks, strict=True)):
            one = ((self._recorded.values(place, points) - measured) / self.noise)[:, mask]
            # What cannot be simulated is far from everything, and the optimiser turns back.
            parts.append(np.where(np.isfinite(one), one, 1e6))
        return np.concatenate(parts, axis=1)

    def _slopes(self, z: FloatArray) -> FloatArray:
        """Derivative (m, d) of the weighted residuals by z."""
        key = z.tobytes() + self.noise.tobytes()
        if self._latest[0] != key:
            self._latest = (key, self._computed(z))
        return self._latest[1]

    def _computed(self, z: FloatArray) -> FloatArray:
        if self._why is None:
            try:
                return self._exact(z)
            except SimulationError as error:
                if self._strict:
                    raise
                self._why = str(error)
        return self._assembled(z, exact=False)

    def _exact(self, z: FloatArray) -> FloatArray:
        found = self._assembled(z, exact=True)
        if self._unchecked and not self._agrees(z, found):
            # Steps one by one, each at its time, before they are given up.
            self._recorded.together = False
            found = self._assembled(z, exact=True)
            if not self._agrees(z, found):
                raise SimulationError(f"{self.model.name} remembers more than its states, which steps do not show")
        self._unchecked = False
        return found

    def _assembled(self, z: FloatArray, exact: bool) -> FloatArray:
        parts = []
        for place, mask in enumerate(self._masks):
            if exact:
                one = self._recorded.exact(place, z * self.scale, lambda: self._points(z))
            else:
                one = self._recorded.differences(place, self._points(z))
            parts.append((one * self.scale / self.noise[:, None])[mask])
        slope = np.concatenate(parts)
        return np.where(np.isfinite(slope), slope, 0.0)

    def _agrees(self, z: FloatArray, slope: FloatArray) -> bool:
        """True if differences along one direction agree, within their error from two distances."""
        direction = np.where(np.arange(len(z)) % 2, -1.0, 1.0)
        steps = DISTANCE * np.array([1.0, -1.0, 3.0, -3.0])
        beyond = (z + steps[:, None] * direction) * self.scale
        if ((beyond < self.low) | (beyond > self.high)).any():
            return True
        a, b, c, d = self._weighted(beyond)
        near, wide = (a - b) / (2 * DISTANCE), (c - d) / (6 * DISTANCE)
        expected = slope @ direction
        apart, doubt = np.linalg.norm(near - expected), np.linalg.norm(near - wide)
        return bool(apart <= 0.03 * np.linalg.norm(expected) + 3 * doubt)

    def _estimate_noise(self, z: FloatArray) -> None:
        """Root mean square of the residuals of the outputs whose deviation is not known."""
        if self._known.all():
            return
        squares, counts = np.zeros(len(self.outputs)), np.zeros(len(self.outputs))
        for residual in self._unweighted(z):
            squares += np.nansum(residual**2, axis=0)
            counts += np.isfinite(residual).sum(axis=0)
        # Each output bears its share of the fitted numbers.
        freedom = np.maximum(counts - len(z) * counts / counts.sum(), 1.0)
        found = np.sqrt(squares / freedom)
        self.noise = np.where(self._known, self.noise, np.maximum(found, self._least))

    def _simulated(self, z: FloatArray) -> list[FloatArray]:
        """Outputs (H + 1, outputs) of each run."""
        point = (z * self.scale)[None]
        return [self._recorded.values(place, point)[0] for place in range(len(self.runs))]

    def _unweighted(self, z: FloatArray) -> list[FloatArray]:
        """Measured less simulated, NaN where nothing was read."""
        parts = zip(self._simulated(z), self._measured, self._masks, strict=True)
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
        residual, slope = self._residuals(z), self._slopes(z)
        silent = [name for name, column in zip(self.names, slope.T, strict=True) if not np.abs(column).max() > 0]
        if silent:
            raise ValueError(
                f"the runs say nothing about {', '.join(silent)}: in them {', '.join(self.outputs)} would be the same "
                "with another value; leave it out, or add runs in which it acts"
            )
        covariance, indistinct = self._covariance(slope)
        values = z * self.scale
        half = _quantile(len(residual) - len(z), bool(self._known.all())) * np.sqrt(np.diag(covariance))
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
            noise_known=bool(self._known.all()),
            freedom=len(residual) - len(z),
            _labels=(self._units(), f"{self.model.native.time_name} [{self.model.native.time_unit}]"),
            evaluations=self.evaluations,
            success=success,
            derivatives=self._said(),
        )

    def _warn_of_misfit(self, z: FloatArray) -> None:
        """Residuals above a known deviation: the model does not describe the runs."""
        from scipy.stats import chi2

        residual = np.concatenate([one / self.noise for one in self._unweighted(z)])
        for name, column, known in zip(self.outputs, residual.T, self._known, strict=True):
            read = column[np.isfinite(column)]
            square = float(np.mean(read**2)) if read.size else 0.0
            if known and square > max(_MISFIT**2, chi2.ppf(1 - 1e-6, max(read.size, 1)) / max(read.size, 1)):
                text = (
                    f"the residuals of {name} are {square**0.5:.3g} times the given noise: the model does not follow "
                    "the runs, and the intervals are too narrow. The row of an action is the one in which its step ends"
                )
                warnings.warn(text, stacklevel=5)

    def _said(self) -> str:
        """Kind of the derivatives, with the reason for differences."""
        if self._why is None:
            return "exact"
        return f"differences: {self._why}" if self._why else "differences"

    def _covariance(self, slope: FloatArray) -> tuple[FloatArray, tuple[tuple[str, ...], ...]]:
        """Covariance by singular values; infinite variance in directions without information."""
        length = np.linalg.norm(slope, axis=0)
        _, singular, directions = np.linalg.svd(slope / length, full_matrices=False)
        weak = singular <= _RANK * singular[0]
        inverse = np.where(weak, 0.0, 1 / np.where(weak, 1.0, singular)) ** 2
        factor = self.scale / length
        covariance = (directions.T * inverse) @ directions * np.outer(factor, factor)
        groups = []
        for direction in directions[weak]:
            part = np.abs(direction) > 1e-3 * np.abs(direction).max()
            groups.append(tuple(name for name, one in zip(self.names, part, strict=True) if one))
            covariance[part, part] = np.inf
        return covariance, tuple(groups)


def _quantile(freedom: int, known: bool) -> float:
    """Half width of the 95 % interval in standard deviations."""
    from scipy.stats import norm, t

    return float(norm.ppf(0.975) if known or freedom < 1 else t.ppf(0.975, freedom))


def _optimize() -> Any:
    return load("scipy.optimize", "smpl.fit")
