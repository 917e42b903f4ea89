"""The extended Kalman filter with samples that are rare and late."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from smpl._arguments import FloatArray
from smpl.controllers.base import TakesWrapped
from smpl.controllers.estimation import Prediction, discrete_of
from smpl.envs import Env
from smpl.model import Model


@dataclass
class _Instant:
    """What is kept of a step until no sample of it can arrive any more."""

    step: int
    mean: FloatArray
    covariance: FloatArray
    discrete: dict[str, float]
    action: FloatArray | None = None
    readings: dict[int, float] = field(default_factory=dict)


class ExtendedKalmanFilter(TakesWrapped, of_arguments=True):
    """Extended Kalman filter from an observation level, its noise, rare samples and delays as the file declares them.

    The mean is predicted by the model's own step, the covariance by its exact derivative. A sample that arrives late is
    taken up at the step at which it was taken, and the filter runs from there again. (D. Simon, Optimal State
    Estimation, 2006, sections 13.2 and 10.5; covariance in Joseph's form.)

    Args:
        model: a model, or an environment; its observation level is what is read.
        initial: mean of the states (and parameters) before the first reading, by name or as an array of states.
        deviation: their standard deviations, by name.
        process_noise: standard deviation of what each step adds to a state, by name.
        parameters: parameters to estimate with the states: name -> standard deviation of their drift in a step.
        noise: standard deviations of the readings by name, in place of the declared ones.
        p: values of parameters of the model that predicts.

    Attributes:
        covariance: of the estimate.
        innovation: last readings less predicted ones by name, physical units.
        derivatives: `exact`, or in how many steps of the episode they were differences, and why.
    """

    def __init__(
        self,
        model: Model | Env,
        *,
        initial: Mapping[str, float] | FloatArray | None = None,
        deviation: Mapping[str, float] | None = None,
        process_noise: Mapping[str, float] | None = None,
        parameters: Mapping[str, float] | None = None,
        noise: Mapping[str, float] | None = None,
        p: Mapping[str, float] | None = None,
    ) -> None:
        self.model = model if isinstance(model, Model) else model.model
        self.prediction = Prediction(self.model, parameters, process_noise, noise)
        self.prediction.fixed = dict(p or {})
        self.prediction.check_readings()
        self.sees = self.model.level
        self._initial, self._deviation = initial, deviation
        self._past: list[_Instant] = []
        self.innovation: dict[str, float] = {}

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
        """Which derivatives the covariance was predicted by."""
        return self.prediction.derivatives

    def reset(self, env: Env) -> None:
        """Forget the last episode."""
        self.prediction.begin(env)
        mean, covariance = self.prediction.start(env, self._initial, self._deviation)
        self._past = [_Instant(env.steps, mean, covariance, discrete_of(env))]
        self._updated = -1

    def update(self, env: Env) -> FloatArray:
        """The estimated states, from all that was read up to now."""
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
        """Put what arrives at the steps where it was taken; returns the place of the earliest one."""
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
            instant.mean, instant.covariance, found = correct(
                self.prediction, instant.mean, instant.covariance, instant.readings, instant.step, instant.discrete,
                self._any_action(instant),
            )  # fmt: skip
            names = self.model.observation_names
            self.innovation = {names[sensor]: value for sensor, value in found.items()}

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
    later, F = prediction.transition(mean, action, step, discrete)
    return prediction.clipped(later), F @ covariance @ F.T + np.diag(prediction.process**2)


def correct(
    prediction: Prediction,
    mean: FloatArray,
    covariance: FloatArray,
    readings: Mapping[int, float],
    step: int,
    discrete: Mapping[str, float],
    action: FloatArray,
) -> tuple[FloatArray, FloatArray, dict[int, float]]:
    """Mean and covariance after readings of that step, sensor -> value; and the innovations."""
    usable = [sensor for sensor, value in readings.items() if np.isfinite(value)]
    if not usable:
        return mean, covariance, {}
    expected, H = prediction.read_with_jacobian(mean, step, discrete, action)
    H = H[usable]
    innovation = np.array([readings[sensor] for sensor in usable]) - expected[usable]
    R = np.diag(prediction.noise[usable] ** 2)
    gain = np.linalg.solve(H @ covariance @ H.T + R, H @ covariance).T
    keep = np.eye(len(mean)) - gain @ H
    found: dict[int, float] = dict(zip(usable, innovation.tolist(), strict=True))
    after: Any = keep @ covariance @ keep.T + gain @ R @ gain.T
    return prediction.clipped(mean + gain @ innovation), (after + after.T) / 2, found
