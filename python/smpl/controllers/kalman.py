"""The extended Kalman filter with samples that are rare and late."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from smpl.controllers.base import TakesWrapped, require_reset
from smpl.controllers.estimation import Prediction, discrete_of
from smpl.envs import Env
from smpl.model import Model
from smpl.support.arguments import FloatArray, as_count, as_number
from smpl.support.hints import refuse_attribute
from smpl.support.options import Options, takes


@dataclass
class _Instant:
    """Data of a step, kept until no sample of it can arrive."""

    step: int
    mean: FloatArray
    covariance: FloatArray
    discrete: dict[str, float]
    action: FloatArray | None = None
    readings: dict[int, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Innovation:
    """Readings of a step against their prediction.

    Attributes:
        sensors: numbers of the sensors.
        values: readings less predicted ones.
        covariance: of these, as the filter expects it.
    """

    sensors: tuple[int, ...] = ()
    values: FloatArray = field(default_factory=lambda: np.zeros(0))
    covariance: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def square(self) -> float:
        """Normalised innovation squared."""
        return float(self.values @ np.linalg.solve(self.covariance, self.values)) if self.sensors else 0.0


@dataclass(frozen=True)
class Consistency:
    """A sum of normalised squares compared with its chi-squared distribution.

    Attributes:
        square: the sum.
        degrees: its degrees of freedom, which are its expected value.
        low, high: ends of the band that holds it with the probability that was asked for.
    """

    square: float
    degrees: int
    low: float
    high: float

    @property
    def holds(self) -> bool:
        """True if the sum is within the band."""
        return self.low <= self.square <= self.high

    def __str__(self) -> str:
        verdict = "consistent" if self.holds else "overconfident" if self.square > self.high else "too cautious"
        return (
            f"{verdict}: {self.square:.4g} of {self.degrees} degrees of freedom, band {self.low:.4g} to {self.high:.4g}"
        )


def consistency(square: float, degrees: int, level: float = 0.95) -> Consistency:
    """Compare a sum of normalised squares with its chi-squared distribution.

    Args:
        square: for example a sum of `nis`, or of squared estimation errors over their covariances.
        degrees: degrees of freedom: number of the readings, or of the states, over all steps.
        level: probability of the band, half of the rest on either side.

    Raises:
        ValueError: no degrees of freedom, or a level that is not between 0 and 1.
        ImportError: SciPy is missing.
    """
    count, share = as_count("degrees", degrees), as_number("level", level)
    if not 0 < share < 1:
        raise ValueError(f"level is {level!r}, expected a probability between 0 and 1")
    try:
        from scipy.stats import chi2
    except ImportError as error:
        raise ImportError("the chi-squared distribution needs SciPy: pip install scipy") from error
    low, high = chi2.ppf([(1 - share) / 2, (1 + share) / 2], count)
    return Consistency(as_number("square", square), count, float(low), float(high))


@dataclass(frozen=True, kw_only=True, repr=False)
class EstimatorOptions(Options):
    """Options of estimators: initial estimate, noise, and quantities estimated with the states.

    Attributes:
        initial: mean of the states (and parameters) before the first reading, by name or as an
            array of states.
        deviation: their standard deviations, by name. A declared disturbance that is named here is
            estimated.
        process_noise: standard deviation of the change that each step adds to a state or to a
            disturbance, by name. A disturbance that is named here is estimated.
        parameters: parameters to estimate with the states: name -> standard deviation of their
            drift in a step.
        noise: standard deviations of the readings by name; None for the declared ones.
        p: values of parameters of the predicting model, by name.
        disturbances: names of declared disturbances that are estimated with the states, by their
            rules; None for all that are random or leave their declared values by themselves. Drawn
            parameters of their rules are estimated too. The others follow their rules from the
            declared values on.
    """

    initial: Mapping[str, float] | FloatArray | None = None
    deviation: Mapping[str, float] | None = None
    process_noise: Mapping[str, float] | None = None
    parameters: Mapping[str, float] | None = None
    noise: Mapping[str, float] | None = None
    p: Mapping[str, float] | None = None
    disturbances: Iterable[str] | None = None

    def prediction(self, model: Model) -> Prediction:
        """The prediction of an estimator with these options."""
        return Prediction(
            model, self.parameters, self.process_noise, self.noise, self.p, self.disturbances, self.deviation
        )


class ExtendedKalmanFilter(TakesWrapped):
    """Extended Kalman filter with the declared noise, rare samples and delays of a level.

    The mean is predicted by the model's own step, the covariance by its exact derivative. A sample
    that arrives late is taken up at the step at which it was taken, and the filter runs from there
    again. (D. Simon, Optimal State Estimation, 2006, sections 13.2 and 10.5; covariance in Joseph's
    form.)

    Args:
        model: a model, or an environment; its observation level is what is read.
        options: `EstimatorOptions`, and options as keyword arguments.

    Attributes:
        covariance: of the estimate.
        innovation: last readings less predicted ones by name, physical units.
        innovation_covariance: of these, in their order.
        nis: normalised innovation squared of the last readings; its expected value is their number.
        derivatives: `exact`, or in how many steps of the episode they were differences, and why.
    """

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Answer names of other packages by the right ones."""
            refuse_attribute(self, name)

    @takes(EstimatorOptions)
    def __init__(self, model: Model | Env, options: EstimatorOptions) -> None:
        self.model = model if isinstance(model, Model) else model.model
        self.prediction = options.prediction(self.model)
        self.prediction.check_start(options.initial, options.deviation, "not negative")
        self.prediction.check_readings()
        self.sees = self.model.level
        self._initial, self._deviation = options.initial, options.deviation
        self._past: list[_Instant] = []
        self._innovations: dict[int, Innovation] = {}
        self._last = Innovation()

    @property
    def innovation(self) -> dict[str, float]:
        """Last readings less predicted ones by name."""
        names = self.model.observation_names
        return {names[one]: float(value) for one, value in zip(self._last.sensors, self._last.values, strict=True)}

    @property
    def innovation_covariance(self) -> FloatArray:
        """Covariance of the last innovation, in the order of `innovation`."""
        return self._last.covariance

    @property
    def nis(self) -> float:
        """Normalised innovation squared of the last readings, 0 without any."""
        return self._last.square

    def consistency(self, level: float = 0.95) -> Consistency:
        """Sum of the episode's normalised innovations squared, and its chi-squared band.

        A sum above its band means that the filter trusts itself too much: raise `process_noise`,
        `deviation` or `noise`, or estimate what the model has wrong.

        Raises:
            ValueError: there were no readings.
        """
        found = self._innovations.values()
        return consistency(sum(one.square for one in found), sum(len(one.sensors) for one in found), level)

    @property
    def estimate(self) -> dict[str, float]:
        """Estimated states and parameters by name."""
        return dict(zip(self.prediction.names, self._past[-1].mean.tolist(), strict=True))

    @property
    def covariance(self) -> FloatArray:
        """Covariance of states and estimated parameters."""
        return self._past[-1].covariance

    @property
    def derivatives(self) -> str:
        """Kind of the derivatives that predicted the covariance."""
        return self.prediction.derivatives

    def reset(self, env: Env) -> None:
        """Forget the last episode."""
        self.prediction.begin(env)
        mean, covariance = self.prediction.start(env, self._initial, self._deviation)
        self._past = [_Instant(env.steps, mean, covariance, discrete_of(env))]
        self._innovations, self._last = {}, Innovation()
        self._updated = -1

    def update(self, env: Env) -> FloatArray:
        """The estimated states, from all that was read up to now.

        Raises:
            SimulationError: `reset` comes first.
        """
        require_reset(self, "update")
        if env.steps == self._updated:
            return self._past[-1].mean[: self.prediction.states].copy()
        if env.steps > self._past[-1].step:
            self._past[-1].action = env.action
            self._past.append(_Instant(env.steps, np.zeros(0), np.zeros((0, 0)), discrete_of(env)))
        first = self._sort_in(env)
        self._run(first)
        self._updated = env.steps
        longest = self.prediction.sensors.longest
        del self._past[: max(0, len(self._past) - longest - 2)]
        return self._past[-1].mean[: self.prediction.states].copy()

    def _sort_in(self, env: Env) -> int:
        """Adds arriving samples to the steps of their sampling; returns the earliest place."""
        readings, earliest = env.reading, len(self._past) - 1
        base = self._past[0].step
        for taken, places in self.prediction.sensors.arriving(env.steps).items():
            place = taken - base
            if place < 0:  # taken before the estimator began
                continue
            earliest = min(earliest, place)
            self._past[place].readings.update({sensor: float(readings[sensor]) for sensor in places})
        return earliest

    def _run(self, first: int) -> None:
        for place in range(first, len(self._past)):
            instant = self._past[place]
            if place > 0:
                instant.mean, instant.covariance = self._predicted(self._past[place - 1])
            instant.mean, instant.covariance, self._last = correct(
                self.prediction, instant.mean, instant.covariance, instant.readings, instant.step, instant.discrete,
                self._any_action(instant),
            )  # fmt: skip
            self._innovations[instant.step] = self._last

    def _predicted(self, before: _Instant) -> tuple[FloatArray, FloatArray]:
        assert before.action is not None, "an instant that has a next one has an action"
        return predict(self.prediction, before.mean, before.covariance, before.action, before.step, before.discrete)

    def _any_action(self, instant: _Instant) -> FloatArray:
        """An action for readings that are taken before the next action is known."""
        return self.model.native.defaults("action") if instant.action is None else instant.action


def predict(
    prediction: Prediction,
    mean: FloatArray,
    covariance: FloatArray,
    action: FloatArray,
    step: int,
    discrete: Mapping[str, float],
) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance a step later."""
    later, F, added = prediction.transition(mean, action, step, discrete)
    return prediction.clipped(later), F @ covariance @ F.T + added


def correct(
    prediction: Prediction,
    mean: FloatArray,
    covariance: FloatArray,
    readings: Mapping[int, float],
    step: int,
    discrete: Mapping[str, float],
    action: FloatArray,
) -> tuple[FloatArray, FloatArray, Innovation]:
    """Mean and covariance after readings of that step, sensor -> value; and the innovation."""
    usable = [sensor for sensor, value in readings.items() if np.isfinite(value)]
    if not usable:
        return mean, covariance, Innovation()
    expected, H = prediction.read_with_jacobian(mean, step, discrete, action)
    H = H[usable]
    innovation = np.array([readings[sensor] for sensor in usable]) - expected[usable]
    R = np.diag(prediction.noise[usable] ** 2)
    expected_covariance = H @ covariance @ H.T + R
    gain = np.linalg.solve(expected_covariance, H @ covariance).T
    keep = np.eye(len(mean)) - gain @ H
    found = Innovation(tuple(usable), innovation, expected_covariance)
    after: Any = keep @ covariance @ keep.T + gain @ R @ gain.T
    return prediction.clipped(mean + gain @ innovation), (after + after.T) / 2, found
