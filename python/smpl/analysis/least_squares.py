"""Least-squares problems of parameters: weighted residuals of runs and their derivatives.

Fits (`smpl.fit`) minimise the residuals; `smpl.analysis.information` reads the derivatives.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from smpl._native import SimulationError
from smpl.analysis.records import read_runs, without_computed
from smpl.analysis.replay import DISTANCE, Recorded, beside
from smpl.analysis.runs import Run
from smpl.analysis.sensors import sensors
from smpl.model import Model
from smpl.support.arguments import FloatArray, as_mapping, as_number, check_method, check_names, check_once
from smpl.support.options import Options

# Ratio of singular values below which a direction is not determined.
RANK = 1e-6
# Exact derivatives by all states cost more than differences by the fitted numbers above so many
# states for each.
_STATES = 8
DERIVATIVES = ("auto", "exact", "differences")


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


class Problem:
    """Residuals of runs over the standard deviations of the outputs.

    Numbers that are searched are the parameters, then the unknown starts of each run, over `scale`.

    Args:
        model, runs, parameters, options: as for `smpl.fit`.
        planned: a run without values of an output has a sample wherever its sensor reads.

    Attributes:
        names: of the numbers.
        guess, scale, low, high: of the numbers: first values, sizes, bounds; in units.
        outputs: names of what is compared.
        noise: standard deviation of each output; `known` where it is given or declared.
        masks: samples of each run, (H + 1 + instants, outputs).
    """

    def __init__(
        self,
        model: Model,
        runs: Any,
        parameters: Iterable[str] | Mapping[str, float],
        options: FitOptions,
        planned: bool = False,
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
        if planned:
            self._plan(options.outputs)
        else:
            self._warn_of_starts()
            self._warn_of_draws()
        self.outputs = self._chosen(options.outputs)
        self._start(guesses)
        self._weigh(as_mapping("noise", options.noise))
        self.evaluations = 0

    def replace(self, place: int, run: Run) -> None:
        """Give a run other actions or another start; its samples stay where they are."""
        self.runs[place] = run
        self.recorded.forget(place)

    @property
    def ends(self) -> list[int]:
        """Steps of each run until its end, at the last point whose derivatives were computed."""
        return [self.recorded.steps[place] for place in range(len(self.runs))]

    @property
    def samples(self) -> int:
        """Number of samples before the ends of the runs."""
        return sum(int(mask[self._before(place)].sum()) for place, mask in enumerate(self.masks))

    def _before(self, place: int) -> Any:
        """Rows of a run's samples that are not after its end."""
        run, end = self.runs[place], self.recorded.steps[place]
        within = [k + share <= end for k, share in run.instants]
        return np.concatenate([np.arange(len(run.actions) + 1) <= end, np.array(within, dtype=bool)])

    def keep_kind_of_derivatives(self) -> None:
        """Refuse points without exact derivatives from now on if they were exact so far."""
        self._strict = self._why is None

    def derivatives_of_samples(self, z: FloatArray) -> FloatArray:
        """Derivatives (m, d) of the weighted samples; those after the end of a run are zero."""
        slope = self._computed(z)
        counted = [np.broadcast_to(self._before(i)[:, None], mask.shape)[mask] for i, mask in enumerate(self.masks)]
        return slope * np.concatenate(counted)[:, None]

    def _plan(self, outputs: Iterable[str] | None) -> None:
        """Give runs without values of an output one at each instant; only their places are used."""
        chosen = self.model.observation_names if outputs is None else outputs
        for place, run in enumerate(self.runs):
            if not any(name in run.outputs for name in chosen):
                made = {name: np.zeros(len(run.actions) + 1) for name in chosen}
                self.runs[place] = replace(run, outputs={**run.outputs, **made})

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
        self.noise, self.known = np.array(sizes), np.array(known)
        # An exact fit would have infinite weight; the simulations have at least this error.
        self._least = 1e-6 * self.noise
        self.recorded = Recorded(
            self.model, self.runs, self.outputs, self.parameters, self.initial, self.fixed, declared, self._method
        )
        self.measured = [np.stack([run.values(name) for name in self.outputs], axis=-1) for run in self.runs]
        self.masks = [self._mask(run, declared) for run in self.runs]
        for run, mask in zip(self.runs, self.masks, strict=True):
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

    def choose(self, derivatives: str) -> None:
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

    def residuals(self, z: FloatArray) -> FloatArray:
        """Weighted residuals (m,)."""
        self.evaluations += 1
        return self._weighted((z * self.scale)[None])[0]

    def _weighted(self, points: FloatArray) -> FloatArray:
        """Weighted residuals (N, m) of points in units."""
        parts = []
        for place, (measured, mask) in enumerate(zip(self.measured, self.masks, strict=True)):
            one = ((self.recorded.values(place, points) - measured) / self.noise)[:, mask]
            # What cannot be simulated is far from everything, and the optimiser turns back.
            parts.append(np.where(np.isfinite(one), one, 1e6))
        return np.concatenate(parts, axis=1)

    def slopes(self, z: FloatArray) -> FloatArray:
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
            self.recorded.together = False
            found = self._assembled(z, exact=True)
            if not self._agrees(z, found):
                raise SimulationError(f"{self.model.name} remembers more than its states, which steps do not show")
        self._unchecked = False
        return found

    def _assembled(self, z: FloatArray, exact: bool) -> FloatArray:
        parts = []
        for place, mask in enumerate(self.masks):
            if exact:
                one = self.recorded.exact(place, z * self.scale, lambda: self._points(z))
            else:
                one = self.recorded.differences(place, self._points(z))
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

    def covariance(self, slope: FloatArray) -> tuple[FloatArray, tuple[tuple[str, ...], ...]]:
        """Covariance by singular values; infinite variance in directions without information."""
        length = np.linalg.norm(slope, axis=0)
        _, singular, directions = np.linalg.svd(slope / length, full_matrices=False)
        weak = singular <= RANK * singular[0]
        inverse = np.where(weak, 0.0, 1 / np.where(weak, 1.0, singular)) ** 2
        factor = self.scale / length
        covariance = (directions.T * inverse) @ directions * np.outer(factor, factor)
        groups = []
        for direction in directions[weak]:
            part = np.abs(direction) > 1e-3 * np.abs(direction).max()
            groups.append(tuple(name for name, one in zip(self.names, part, strict=True) if one))
            covariance[part, part] = np.inf
        return covariance, tuple(dict.fromkeys(groups))

    def kind_of_derivatives(self) -> str:
        """Kind of the derivatives, with the reason for differences."""
        if self._why is None:
            return "exact"
        return f"differences: {self._why}" if self._why else "differences"
