"""Design of experiments: actions that show most about parameters.

G. Franceschini, S. Macchietto, Chemical Engineering Science 63 (2008) 4846-4872, section 3
(criteria of designs). The search is an exchange of actions (V. V. Fedorov, Theory of Optimal
Experiments, 1972, chapter 3) with L-BFGS-B of SciPy at its end.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl._native import SimulationError
from smpl.analysis.fitting import Fit
from smpl.analysis.information import Information, InformationOptions, prior_of, problem_of, read_slope, slope_of
from smpl.analysis.records import starting_states
from smpl.analysis.runs import Run
from smpl.model import Model
from smpl.support.arguments import FloatArray, as_count, as_mapping, as_number, check_names
from smpl.support.optional import load
from smpl.support.options import Options, takes

CRITERIA = ("D", "A", "E")
# Shares of the range at which an exchange tries an action, and the distance of differences.
_LEVELS = (0.0, 0.25, 0.5, 0.75, 1.0)
_DISTANCE = 1e-4
# Part of the largest information that is added to each direction, so that the criterion of an
# experiment that leaves one undetermined is a number.
_LEAST = 1e-14


@dataclass(frozen=True)
class Design:
    """An experiment that was searched for.

    Attributes:
        actions: (H, actions), physical units.
        names: of the actions.
        information: of the experiment, with the prior.
        nominal: information of the nominal actions over the same steps, with the prior.
        criterion: `D`, `A` or `E`.
        gain: factor by which the design improves on the nominal actions, infinite if these leave a
            direction undetermined. It compares the volume of the confidence ellipsoid per parameter
            (D), the mean relative variance (A), or the variance in the weakest direction (E).
        evaluations: number of experiments that were computed.
    """

    actions: FloatArray
    names: tuple[str, ...]
    information: Information
    nominal: Information
    criterion: str
    gain: float
    evaluations: int

    def __str__(self) -> str:
        """Moves of the actions, the gain and the deviations."""
        changes = np.flatnonzero(np.r_[True, (self.actions[1:] != self.actions[:-1]).any(axis=1)])
        ends = np.append(changes[1:], len(self.actions))
        rows = [
            f"steps {start} to {end - 1}: "
            + ", ".join(f"{name} = {value:.6g}" for name, value in zip(self.names, self.actions[start], strict=True))
            for start, end in zip(changes, ends, strict=True)
        ]
        gain = f"criterion {self.criterion}: {self.gain:.3g} times better than the nominal actions"
        return "\n".join([*rows, gain, str(self.information)])

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the actions as a table for `smpl simulate --actions`."""
        with Path(path).open("w", newline="", encoding="utf-8") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(self.names)
            table.writerows([[repr(float(value)) for value in row] for row in self.actions])


@dataclass(frozen=True, kw_only=True, repr=False)
class DesignOptions(Options):
    """Options of `design`.

    Attributes:
        hold: steps for which an action is constant.
        criterion: `D`: the volume of the confidence ellipsoid; `A`: the mean variance of relative
            errors; `E`: the variance in the weakest direction.
        limits: (low, high) by name of an action, within its bounds.
        keep: actions that stay nominal.
        start: states at the start by name; others are nominal.
        candidates: random sequences that are compared first.
        starts: number of the best sequences whose actions are exchanged; the best result counts.
        rounds: exchanges of every action, at most.
        seed: of the random sequences.
        outputs, noise, fixed, prior, derivatives, method: as for `information`.
    """

    hold: int = 1
    criterion: str = "D"
    limits: Mapping[str, tuple[float, float]] | None = None
    keep: Sequence[str] = ()
    start: Mapping[str, float] | None = None
    candidates: int = 32
    starts: int = 4
    rounds: int = 20
    seed: int = 0
    outputs: Iterable[str] | None = None
    noise: Mapping[str, float] | None = None
    fixed: Mapping[str, float] | None = None
    prior: Information | Fit | npt.ArrayLike | None = None
    derivatives: str = "auto"
    method: str | None = "auto"


@takes(DesignOptions)
def design(model: Model, steps: int, parameters: Iterable[str] | Mapping[str, float], options: DesignOptions) -> Design:
    """Actions over `steps` steps that show most about the parameters.

    The best random sequences are improved by exchange of one action at a time among five levels,
    then the best of these by L-BFGS-B with differences of exact sensitivities. The result is a
    local optimum. Samples after a declared failure do not count, so that experiments that end early
    have less information.

    Args:
        model: a model with actions, compiled with the observation level of the experiment.
        steps: number of control steps.
        parameters: as for `information`: a design is for these values of the parameters.
        options: `DesignOptions`, and options as keyword arguments.

    Raises:
        ValueError: names or limits that do not fit, or a parameter without effect on the outputs
            in all sequences.
        SimulationError: no sequence can be simulated.
        ImportError: SciPy is missing.
    """
    if options.criterion not in CRITERIA:
        raise ValueError(f"criterion is {options.criterion!r}, expected one of {', '.join(CRITERIA)}")
    optimize = load("scipy.optimize", "smpl.analysis.design")
    return _Search(model, as_count("steps", steps), parameters, options).solve(optimize)


class _Search:
    """Search of the actions of an experiment, as shares of their ranges."""

    def __init__(self, model: Model, steps: int, parameters: Any, options: DesignOptions) -> None:
        self._options, self._nominal = options, np.asarray(model.native.defaults("action"))
        self._rows = np.repeat(np.arange(-(-steps // as_count("hold", options.hold))), options.hold)[:steps]
        self._moved, self._low, self._high = _ranges(model, options)
        self._names = model.action_names
        start = as_mapping("start", options.start)
        check_names("start", start, model.state_names)
        states = starting_states(model, {name: as_number(f"start[{name!r}]", value) for name, value in start.items()})
        self._run = Run("the experiment", states, np.tile(self._nominal, (steps, 1)), {}, {}, {}, {})
        shared = {name: getattr(options, name) for name in ("outputs", "noise", "fixed", "derivatives", "method")}
        self._problem = problem_of(model, [self._run], parameters, InformationOptions(**shared))
        self._prior = prior_of(self._problem, options.prior)
        self.evaluations = 0
        self._value = {"D": _volume, "A": _mean, "E": _weakest}[options.criterion]
        self._scale = self._problem.scale

    def solve(self, optimize: Any) -> Design:
        count = (int(self._rows[-1]) + 1) * len(self._moved)
        nominal = self._information(self._run.actions)
        self._problem.keep_kind_of_derivatives()
        exchanged = [self._exchanged(point) for point in self._best(count)]
        point = min(exchanged, key=self._loss)
        found = optimize.minimize(
            self._loss, point, jac=self._gradient, method="L-BFGS-B", bounds=[(0, 1)] * count, options={"maxiter": 50}
        )
        if found.fun < self._loss(point):
            point = found.x
        actions = self._actions(point)
        best = self._information(actions)
        if best.silent and self._prior is None:
            raise ValueError(f"no sequence of actions shows an effect of {', '.join(best.silent)}: leave it out")
        return Design(
            actions, self._names, best, nominal, self._options.criterion, self._gain(best, nominal), self.evaluations
        )

    def _gain(self, best: Information, nominal: Information) -> float:
        """Factor between the criteria of two experiments."""
        if nominal.silent or nominal.indistinct:
            return float("inf")
        size = np.outer(self._scale, self._scale)
        return float(np.exp(self._value(best.matrix * size) - self._value(nominal.matrix * size)))

    def _actions(self, point: FloatArray) -> FloatArray:
        """Actions (H, actions) of shares of the ranges."""
        actions = self._run.actions.copy()
        shares = point.reshape(-1, len(self._moved))
        actions[:, self._moved] = (self._low + shares * (self._high - self._low))[self._rows]
        return actions

    def _slope(self, actions: FloatArray) -> FloatArray:
        self.evaluations += 1
        self._problem.replace(0, replace(self._problem.runs[0], actions=actions))
        return slope_of(self._problem)

    def _information(self, actions: FloatArray) -> Information:
        return read_slope(self._problem, self._slope(actions), self._prior)

    def _loss(self, point: FloatArray) -> float:
        """Negative criterion; infinite where the experiment cannot be simulated."""
        try:
            slope = self._slope(self._actions(point))
        except SimulationError:
            return np.inf
        matrix = slope.T @ slope
        if self._prior is not None:
            matrix = matrix + self._prior * np.outer(self._scale, self._scale)
        return -self._value(matrix)

    def _gradient(self, point: FloatArray) -> FloatArray:
        base, found = self._loss(point), np.zeros(len(point))
        for i in range(len(point)):
            moved = point.copy()
            moved[i] += _DISTANCE if point[i] < 0.5 else -_DISTANCE
            found[i] = (self._loss(moved) - base) / (moved[i] - point[i])
        return np.where(np.isfinite(found), found, 0.0)

    def _best(self, count: int) -> list[FloatArray]:
        """The best different ones of the nominal and of random sequences."""
        random = np.random.default_rng(self._options.seed)
        width = np.where(self._high > self._low, self._high - self._low, 1.0)
        centre = np.clip((self._nominal[self._moved] - self._low) / width, 0, 1)
        points = [np.tile(centre, count // len(self._moved))]
        for number in range(as_count("candidates", self._options.candidates)):
            levels = np.array(_LEVELS[:: (4, 2, 1)[number % 3]])
            points.append(random.choice(levels, count))
        losses = [self._loss(point) for point in points]
        if not np.isfinite(losses).any():
            self._slope(self._actions(points[0]))  # raises the reason
        found: list[FloatArray] = []
        for place in np.argsort(losses).tolist():
            if np.isfinite(losses[place]) and not any((points[place] == one).all() for one in found):
                found.append(points[place])
        return found[: as_count("starts", self._options.starts)]

    def _exchanged(self, point: FloatArray) -> FloatArray:
        """Exchanges one action at a time while the criterion rises."""
        point, best = point.copy(), self._loss(point)
        for _ in range(as_count("rounds", self._options.rounds)):
            before = best
            for i in range(len(point)):
                for level in _LEVELS:
                    moved = point.copy()
                    moved[i] = level
                    loss = self._loss(moved) if level != point[i] else np.inf
                    if loss < best:
                        point, best = moved, loss
            if before - best <= 1e-3:
                break
        return point


def _volume(matrix: FloatArray) -> float:
    """Mean logarithm of the eigenvalues."""
    return float(np.mean(np.log(_eigenvalues(matrix))))


def _mean(matrix: FloatArray) -> float:
    """Logarithm of the inverse mean variance."""
    return -float(np.log(np.mean(1 / _eigenvalues(matrix))))


def _weakest(matrix: FloatArray) -> float:
    """Logarithm of the least eigenvalue."""
    return float(np.log(_eigenvalues(matrix)[0]))


def _eigenvalues(matrix: FloatArray) -> Any:
    found = np.linalg.eigvalsh(matrix)
    return np.maximum(found, _LEAST * max(float(found[-1]), 1e-300))


def _ranges(model: Model, options: DesignOptions) -> tuple[list[int], FloatArray, FloatArray]:
    """Numbers of the actions that are chosen, and their ranges."""
    limits, names = as_mapping("limits", options.limits), model.action_names
    check_names("limits", limits, names)
    check_names("keep", options.keep, names)
    moved = [place for place, name in enumerate(names) if name not in options.keep]
    if not moved:
        raise ValueError(f"{model.name} has no action to choose" if not names else "keep names all actions")
    low, high = (np.array(bound, dtype=np.float64) for bound in model.native.bounds("action"))
    for name, limit in limits.items():
        place = names.index(name)
        try:
            least, most = (as_number(f"limits[{name!r}]", one) for one in limit)
        except (TypeError, ValueError):
            raise ValueError(f"limits[{name!r}] is {limit!r}, expected (low, high)") from None
        if not low[place] <= least < most <= high[place]:
            raise ValueError(
                f"limits[{name!r}] is {least:g} to {most:g}, expected a range in {low[place]:g} to {high[place]:g}"
            )
        low[place], high[place] = least, most
    free = [names[place] for place in moved if not np.isfinite(high[place] - low[place])]
    if free:
        raise ValueError(f"{', '.join(free)} has no finite bounds: give limits, or keep it")
    return moved, low[moved], high[moved]
