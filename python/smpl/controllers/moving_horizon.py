"""Moving-horizon estimation: a bounded least-squares problem over the last steps.

C. V. Rao, J. B. Rawlings, D. Q. Mayne, IEEE Transactions on Automatic Control 48 (2003) 246-258;
the states of all steps of the window are unknowns (multiple shooting), the optimiser is SciPy's
trust-region reflective Gauss-Newton.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from smpl.controllers.base import TakesWrapped, require_reset
from smpl.controllers.estimation import discrete_of
from smpl.controllers.kalman import Consistency, EstimatorOptions, consistency, correct, predict
from smpl.envs import Env
from smpl.model import Model
from smpl.support.arguments import FloatArray, as_count
from smpl.support.clock import Clock, as_seconds
from smpl.support.hints import refuse_attribute
from smpl.support.optional import load
from smpl.support.options import takes

# Deviation of a certain value, in parts of its size.
_CERTAIN = 1e-7


@dataclass
class _Instant:
    """A step of the window: its estimate, what was read of it, and the action that followed."""

    step: int
    point: FloatArray
    discrete: dict[str, float]
    action: FloatArray
    readings: dict[int, float] = field(default_factory=dict)


class _TimeUpError(Exception):
    """The budget of an update is used up."""


@dataclass
class _Best:
    """The point of the least squares so far."""

    point: FloatArray | None = None
    cost: float = np.inf

    def take(self, point: FloatArray, residual: FloatArray) -> None:
        """Keep a point if it costs less."""
        cost = float(residual @ residual)
        if cost < self.cost:
            self.point, self.cost = point.copy(), cost


@dataclass(frozen=True, kw_only=True, repr=False)
class MovingHorizonOptions(EstimatorOptions):
    """Options of `MovingHorizonEstimator` in addition to `EstimatorOptions`.

    Attributes:
        horizon: length of the window in control steps, longer than the longest delay of a reading.
            Deviations of `EstimatorOptions` must be positive.
        iterations: limit of the optimiser's evaluations, after which the present point is used.
        budget: seconds for an update, after which the optimiser stops and the best estimate so far
            is used; None for no limit.
    """

    horizon: int = 10
    iterations: int = 6
    budget: float | None = None


class MovingHorizonEstimator(TakesWrapped):
    """Least squares over a window of steps, within the bounds that the model declares.

    Minimises a sum of squares over standard deviations: of measured less predicted readings, of the
    noise of each step, and of the deviation from the prior estimate (the arrival cost). Samples
    count at the step at which they were taken.

    Args:
        model: a model, or an environment; its observation level is what is read.
        options: `MovingHorizonOptions` or `EstimatorOptions`, and options as keyword arguments;
            `horizon` may follow the model by position.

    Attributes:
        failures: how often the optimiser failed, so that the prediction was taken; the first time
            warns.
        unfinished: how often the budget ended the optimiser.
        last_status: reason of the last failure or of the last end by the budget.
        square: sum of the weighted squares over the window; with the noises that there are its
            expected value is the number of the readings in the window, `degrees`.
        derivatives: as of `ExtendedKalmanFilter`.
    """

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Answer names of other packages by the right ones."""
            refuse_attribute(self, name)

    @takes(MovingHorizonOptions, "horizon")
    def __init__(self, model: Model | Env, options: MovingHorizonOptions) -> None:
        self.model = model if isinstance(model, Model) else model.model
        self.prediction = options.prediction(self.model)
        self.prediction.check_start(options.initial, options.deviation, "positive")
        self.prediction.check_readings()
        longest, expected = self.prediction.sensors.longest, "an integer above the longest delay"
        self.horizon = as_count("horizon", options.horizon, longest + 1, f"{expected}, {longest}")
        self.sees = self.model.level
        self.failures, self.unfinished, self.square, self.degrees = 0, 0, 0.0, 0
        self.last_status = ""
        self._budget = None if options.budget is None else as_seconds("budget", options.budget)
        self._iterations = as_count("iterations", options.iterations)
        self._initial, self._deviation = options.initial, options.deviation
        self._window: list[_Instant] = []

    @property
    def estimate(self) -> dict[str, float]:
        """Estimated states and parameters by name."""
        return dict(zip(self.prediction.names, self._window[-1].point.tolist(), strict=True))

    def consistency(self, level: float = 0.95) -> Consistency:
        """Sum of the window's weighted squares, and its chi-squared band.

        Raises:
            ValueError: there were no readings.
        """
        return consistency(self.square, self.degrees, level)

    @property
    def derivatives(self) -> str:
        """Kind of the derivatives of the optimiser."""
        return self.prediction.derivatives

    def reset(self, env: Env) -> None:
        """Forget the last episode."""
        self.prediction.begin(env)
        self._mean, self._covariance = self.prediction.start(env, self._initial, self._deviation)
        self._window, self._updated = [], -1
        self.square, self.degrees = 0.0, 0

    def update(self, env: Env) -> FloatArray:
        """The estimated states, from all that was read up to now.

        Raises:
            SimulationError: `reset` comes first.
        """
        require_reset(self, "update")
        if env.steps != self._updated:
            self._advance(env)
            self._solve()
            self._updated = env.steps
        return self._window[-1].point[: self.prediction.states].copy()

    def _advance(self, env: Env) -> None:
        """Adds the last action and new samples; the oldest step becomes the arrival cost."""
        discrete, nominal = discrete_of(env), self.model.native.defaults("action")
        if not self._window:
            self._window = [_Instant(env.steps, self.prediction.clipped(self._mean), discrete, nominal)]
        else:
            last = self._window[-1]
            last.action = env.action
            point = self.prediction.step(last.point[None], last.action, last.step, last.discrete)[0]
            self._window.append(_Instant(env.steps, self.prediction.clipped(point), discrete, nominal))
        first, readings = self._window[0].step, env.reading
        for taken, places in self.prediction.sensors.arriving(env.steps).items():
            if taken >= first:
                self._window[taken - first].readings.update({one: float(readings[one]) for one in places})
        if len(self._window) > self.horizon + 1:
            self._forget()

    def _forget(self) -> None:
        """Arrival cost of the next step: the filter's step around the estimate."""
        old = self._window.pop(0)
        mean, covariance, _ = correct(
            self.prediction, self._mean, self._covariance, old.readings, old.step, old.discrete, old.action
        )
        self._mean, self._covariance = predict(self.prediction, mean, covariance, old.action, old.step, old.discrete)

    def _solve(self) -> None:
        optimize = _optimize()
        low, high = np.tile(self.prediction.low, len(self._window)), np.tile(self.prediction.high, len(self._window))
        margin = 1e-9 * np.maximum(1.0, np.where(np.isfinite(high - low), high - low, 1.0))
        guess = np.clip(np.concatenate([one.point for one in self._window]), low + margin, high - margin)
        # SciPy asks for residual and Jacobian at the same point one after the other: both come from
        # the same rollouts.
        known: dict[bytes, tuple[FloatArray, FloatArray]] = {}
        clock, best = Clock(self._budget), _Best()

        def both(z: FloatArray) -> tuple[FloatArray, FloatArray]:
            key = z.tobytes()
            if key not in known:
                if clock.over() and best.point is not None:
                    raise _TimeUpError
                known.clear()
                known[key] = self._residual(z)
                best.take(z, known[key][0])
            return known[key]

        try:
            found = optimize.least_squares(
                lambda z: both(z)[0],
                guess,
                jac=lambda z: both(z)[1],
                bounds=(low, high),
                x_scale=np.tile(self.prediction.scale, len(self._window)),
                max_nfev=self._iterations,
                # Rollouts are exact to the model's own tolerance alone.
                xtol=1e-5,
                ftol=1e-5,
                gtol=1e-5,
            )
            points, square = found.x, 2 * float(found.cost)
        except _TimeUpError:
            self.unfinished += 1
            self.last_status = f"the budget of {self._budget:g} s ended the optimiser"
            points, square = (guess, np.inf) if best.point is None else (best.point, best.cost)
        except (ValueError, np.linalg.LinAlgError) as error:
            self.failures += 1
            self.last_status = str(error).splitlines()[0] if str(error) else type(error).__name__
            if self.failures == 1:
                warnings.warn(f"the estimator failed, and its prediction is taken: {error}", stacklevel=4)
            return
        self.square = square
        self.degrees = sum(np.isfinite(value) for one in self._window for value in one.readings.values())
        for one, point in zip(self._window, points.reshape(len(self._window), -1), strict=True):
            one.point = point

    def _whitening(self, covariance: FloatArray) -> FloatArray:
        """Factor W with W'W the inverse of a covariance; certain values have a small deviation."""
        floor = _CERTAIN * self.prediction.scale
        return np.linalg.inv(np.linalg.cholesky(covariance + np.diag(floor**2)))

    def _residual(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Weighted residuals and their derivative at the states of all steps."""
        size, count = len(self.prediction.names), len(self._window)
        points = z.reshape(count, size)
        inverse = self._whitening(self._covariance)
        values, rows = [inverse @ (points[0] - self._mean)], [_placed(inverse, 0, count)]
        for place, one in enumerate(self._window):
            now = one.action, one.step, one.discrete
            if place + 1 < count:
                later, F, added = self.prediction.transition(points[place], *now)
                W = self._whitening(added)
                values.append(W @ (points[place + 1] - later))
                rows.append(_placed(-W @ F, place, count) + _placed(W, place + 1, count))
            expected, H = self.prediction.read_with_jacobian(points[place], one.step, one.discrete, one.action)
            usable = [sensor for sensor, value in one.readings.items() if np.isfinite(value)]
            weight = 1 / self.prediction.noise[usable]
            read = np.array([one.readings[sensor] for sensor in usable])
            values.append(weight * (expected[usable] - read))
            rows.append(_placed(weight[:, None] * H[usable], place, count))
        return np.concatenate(values), np.vstack(rows)


def _placed(block: FloatArray, place: int, count: int) -> FloatArray:
    """Rows that depend on the states of one step alone."""
    height, width = block.shape
    whole = np.zeros((height, count * width))
    whole[:, place * width : (place + 1) * width] = block
    return whole


def _optimize() -> Any:
    return load("scipy.optimize", "moving-horizon estimation")
