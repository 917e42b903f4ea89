"""State estimation from an observation level: what filters and estimators over a window have in common.

The prediction is the model's own step (`Model.rollout`), so that phases, events, sums over a step and clamps are those
of the plant; its derivatives are exact (`Model.linearize_step`), and differences of rollouts where a step has none. The
derivatives of readings, which no integration blurs, are central differences.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from smpl._arguments import FloatArray, as_number
from smpl._native import SimulationError
from smpl.controllers.names import listing, weights
from smpl.controllers.sensors import Sensors, sensors
from smpl.envs import Env
from smpl.model import Model
from smpl.rollout import rollout
from smpl.sensitivity import linearize_step

# Points by states from which on threads bring more than they cost.
_LARGE = 400


class Estimator(Protocol):
    """Estimates the state of an episode from what is observed."""

    sees: str
    model: Model

    def reset(self, env: Env) -> None:
        """Begin an episode; called after `env.reset`."""

    def update(self, env: Env) -> FloatArray:
        """The estimated state, physical units; called once a step, before the action."""


class Prediction:
    """A model as a filter sees it: x = (states, estimated parameters), one step, and the readings.

    Args:
        model: the model that predicts.
        parameters: names of parameters that are estimated with the states; they stay as they are over a step.
        process_noise: standard deviation of what a step adds to each state, by name; of those that are left out a
            thousandth of their size.
        noise: of the readings, by name, in place of what the level declares.
    """

    def __init__(
        self,
        model: Model,
        parameters: Mapping[str, float] | None,
        process_noise: Mapping[str, float] | None,
        noise: Mapping[str, float] | None,
    ) -> None:
        self.model = model
        self.states = len(model.state_names)
        self.parameters = tuple(parameters or ())
        self._check_parameters()
        self.names = (*model.state_names, *self.parameters)
        self.scale = np.concatenate([self._sizes(), [self._size_of(name) for name in self.parameters]])
        self.low, self.high = self._bounds()
        declared = weights("process_noise", process_noise, model.state_names, model.state_units)
        given = set(process_noise or ())
        deviation = [
            declared[i] if declared is not None and name in given else 1e-3 * self.scale[i]
            for i, name in enumerate(model.state_names)
        ]
        drift = [as_number(f"parameters[{name!r}]", value) for name, value in (parameters or {}).items()]
        self.process = np.array([*deviation, *drift])
        self.sensors: Sensors = sensors(model, noise)
        low, high = model.native.bounds("observation")
        width = np.where(np.isfinite(high - low), high - low, 1.0)
        # An exact reading has the precision of the numbers that it is returned in.
        self.noise = np.where(self.sensors.noise > 0, self.sensors.noise, 1e-6 * width)
        self.fixed: dict[str, float] = {}
        self.limit = model.max_steps + 1
        self._by_differences, self._why = 0, ""

    @property
    def derivatives(self) -> str:
        """`exact`, or in how many steps of the episode derivatives were differences, and why at last."""
        return f"differences in {self._by_differences} steps: {self._why}" if self._by_differences else "exact"

    def check_readings(self) -> None:
        """Leave out readings that a state alone does not tell, as these are predicted from states; warns by name.

        Looked at numerically: readings at the end of a step against those at the state where it ended.

        Raises:
            ValueError: no reading is left.
        """
        model = self.model
        env = Env(model, normalize=False)
        known = {name: value for name, value in self.fixed.items() if name in model.parameter_names}
        try:
            env.reset(seed=0, options={"start": "nominal", "parameters": known})
            low, high = (np.where(np.isfinite(bound), bound, np.nan) for bound in model.native.bounds("action"))
            nominal = model.native.defaults("action")
            actions = [
                np.where(np.isnan(low + high), nominal + 0.1, low + share * (high - low)) for share in (0.4, 0.7)
            ]
            env.step(actions[0])
            given = {**self.fixed, **discrete_of(env)}
            found = linearize_step(model, env.state, actions[1], given, by=(), first_step=1)
            _, _, terminated, truncated, _ = env.step(actions[1])
            point = np.append(found.states, [env.parameters[name] for name in self.parameters])
            there = self._rollout(point[None], nominal, 2, discrete_of(env)).observations[0, 0]
        except (RuntimeError, SimulationError, ValueError):  # an episode that does not come to two steps shows nothing
            return
        if terminated or truncated:
            return
        low, high = model.native.bounds("observation")
        width = np.where(np.isfinite(high - low), high - low, 1.0)
        far = np.abs(found.observations - there) > 1e-4 * np.abs(there) + 1e-6 * width
        if not np.any(far):
            return
        names = ", ".join(name for name, one in zip(model.observation_names, far, strict=True) if one)
        text = (
            f"of the level {model.level!r} of {model.name} the estimator does not read {names}: this depends on more "
            "than the state (the action, rates, the step before, an integral over the step, a disturbance)"
        )
        if np.all(far):
            raise ValueError(f"{text}; no reading is left")
        warnings.warn(text, stacklevel=4)
        self.sensors = replace(self.sensors, unused=frozenset(np.flatnonzero(far).tolist()))

    def begin(self, env: Env) -> None:
        """Check the environment of an episode.

        Raises:
            ValueError: it has other states, actions or readings than the model that predicts.
        """
        if env.observation_names != self.model.observation_names or env.action_names != self.model.action_names:
            raise ValueError(
                f"the estimator reads {', '.join(self.model.observation_names)} (level {self.model.level!r} of "
                f"{self.model.name}), the environment shows {', '.join(env.observation_names)} "
                f"(level {env.model.level!r} of {env.model.name})"
            )
        # The environment may have another time limit than the model; readings are taken at its last step too.
        self.limit = env.max_steps + 1
        self._by_differences, self._why = 0, ""

    def step(self, points: FloatArray, action: FloatArray, at: int, discrete: Mapping[str, float]) -> FloatArray:
        """The points (N, x) a step later.

        Raises:
            ValueError: the model could not be integrated from one of them.
        """
        found = self._rollout(points, action, at, discrete)
        return np.concatenate([found.states[:, -1], points[:, self.states :]], axis=1)

    def read(self, points: FloatArray, at: int, discrete: Mapping[str, float], action: FloatArray) -> FloatArray:
        """Readings (N, observations) without noise of samples taken at the points."""
        return self._rollout(points, action, at, discrete).observations[:, 0]

    def transition(
        self, x: FloatArray, action: FloatArray, at: int, discrete: Mapping[str, float]
    ) -> tuple[FloatArray, FloatArray]:
        """The point (x,) a step later and its derivative (x, x)."""
        return self.step(x[None], action, at, discrete)[0], self._slope(x, action, at, discrete)

    def linearized(
        self, x: FloatArray, action: FloatArray, at: int, discrete: Mapping[str, float]
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The point a step later and its derivative, the readings now and theirs."""
        points, width = self._beside(x)
        found = self._rollout(np.vstack([x, points]), action, at, discrete)
        later, read = np.append(found.states[0, -1], x[self.states :]), found.observations[:, 0]
        return later, self._slope(x, action, at, discrete), read[0], _slopes(read[1:], width)

    def _slope(self, x: FloatArray, action: FloatArray, at: int, discrete: Mapping[str, float]) -> FloatArray:
        """Derivative (x, x) of a step."""
        try:
            return self._exact(self.clipped(x), action, at, discrete)
        except SimulationError as error:
            self._by_differences, self._why = self._by_differences + 1, str(error).removeprefix("point 0: ")
        points, width = self._beside(x)
        return _slopes(self.step(points, action, at, discrete), width)

    def _exact(self, x: FloatArray, action: FloatArray, at: int, discrete: Mapping[str, float]) -> FloatArray:
        """Forward sensitivities of the step, (x, x); estimated parameters stay as they are."""
        values = dict(zip(self.parameters, x[self.states :].tolist(), strict=True))
        found = linearize_step(
            self.model, x[: self.states], action, {**self.fixed, **discrete, **values}, by=("state",),
            parameters=self.parameters, first_step=at,
        )  # fmt: skip
        whole = np.eye(len(x))
        whole[: self.states] = np.concatenate([found.dx_dx, found.dx_dp], axis=1)
        return whole

    def read_with_jacobian(
        self, x: FloatArray, at: int, discrete: Mapping[str, float], action: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The readings (observations,) at a point and their derivative (observations, x)."""
        points, width = self._beside(x)
        found = self.read(np.vstack([x, points]), at, discrete, action)
        return found[0], _slopes(found[1:], width)

    def _beside(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points beside x, (2 x, x), two in each direction within the bounds, and how far these are apart."""
        distance = 1e-4 * np.maximum(self.scale, np.abs(x))
        below, above = np.maximum(x - distance, self.low), np.minimum(x + distance, self.high)
        return np.vstack([x + np.diag(below - x), x + np.diag(above - x)]), above - below

    def start(self, env: Env, initial: Any, deviation: Any) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance before the first reading.

        Args:
            env: the environment of the episode.
            initial: states by name or as an array; the others, and all if None, at the nominal start of the model.
            deviation: standard deviations by name; a tenth of the size for those that are left out.
        """
        nominal = Env(self.model, normalize=False)
        nominal.reset(seed=0, options={"start": "nominal"})
        mean = np.concatenate([nominal.state, [nominal.parameters[name] for name in self.parameters]])
        spread = 0.1 * self.scale
        if isinstance(initial, Mapping):
            self._put(mean, "initial", initial)
        elif initial is not None:
            mean[: self.states] = np.asarray(initial, dtype=np.float64)
        if deviation is not None:
            self._put(spread, "deviation", deviation)
        return mean, np.diag(spread**2)

    def clipped(self, x: FloatArray) -> FloatArray:
        """A point inside of the bounds that the model declares."""
        return np.clip(x, self.low, self.high)

    def _put(self, vector: FloatArray, what: str, given: Mapping[str, float]) -> None:
        for name, value in given.items():
            if name not in self.names:
                raise ValueError(f"{what}: unknown {name!r}; there are: {', '.join(self.names)}")
            vector[self.names.index(name)] = as_number(f"{what}[{name!r}]", value)

    def _rollout(self, points: FloatArray, action: FloatArray, at: int, discrete: Mapping[str, float]) -> Any:
        inside = self.clipped(points)
        given: dict[str, Any] = {name: inside[:, self.states + i] for i, name in enumerate(self.parameters)}
        found = rollout(
            self.model,
            inside[:, : self.states],
            action[None, None, :].repeat(len(points), axis=0),
            parameters={**self.fixed, **given},
            discrete=discrete,
            first_step=at,
            max_steps=self.limit,
            threads=1 if points.size < _LARGE else None,
        )
        bad = [i for i, failure in enumerate(found.failure) if failure.startswith(("start", "solver"))]
        if bad:
            raise ValueError(f"the prediction of the estimator failed at step {at}: {found.failure[bad[0]]}")
        return found

    def _check_parameters(self) -> None:
        model = self.model
        wrong = [name for name in self.parameters if name not in model.parameter_names]
        if wrong:
            known = listing(model.parameter_names, model.parameter_units)
            raise ValueError(f"parameters: unknown {', '.join(map(repr, wrong))}; there are: {known}")

    def _size_of(self, name: str) -> float:
        index = self.model.parameter_names.index(name)
        return abs(float(self.model.native.defaults("parameter")[index])) or 1.0

    def _sizes(self) -> FloatArray:
        low, high = self.model.native.bounds("state")
        values = np.abs(self.model.native.defaults("state"))
        width = np.where(np.isfinite(high - low), high - low, 1.0)
        return np.where(values > 0, values, width)

    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        low, high = self.model.native.bounds("state")
        places = [self.model.parameter_names.index(name) for name in self.parameters]
        least, most = self.model.native.bounds("parameter")
        return np.concatenate([low, least[places]]), np.concatenate([high, most[places]])


def _slopes(found: FloatArray, width: FloatArray) -> FloatArray:
    """Derivative (of, x) from values (2 x, of) beside a point."""
    return ((found[len(width) :] - found[: len(width)]) / width[:, None]).T


def discrete_of(env: Env) -> dict[str, float]:
    """Discrete variables of the environment: what the controller of a plant itself keeps is known."""
    return dict(zip(env.discrete_names, env.discrete.tolist(), strict=True))
