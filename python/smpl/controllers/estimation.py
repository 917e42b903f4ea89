"""State estimation from an observation level: the common part of filters and window estimators.

The prediction is the model's own step (`Model.rollout`), so that phases, events, sums over a step
and clamps are those of the plant. Its derivatives are exact (`Model.linearize_step`), or
differences of rollouts if a step has none. The derivatives of readings, which no integration blurs,
are central differences.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from smpl._native import SimulationError
from smpl.analysis.rollout import rollout
from smpl.analysis.sensitivity import linearize_step
from smpl.analysis.sensors import Sensors, sensors
from smpl.controllers.disturbances import Disturbances, drawn_parameters
from smpl.controllers.names import weights
from smpl.envs import Env
from smpl.model import Model
from smpl.support.arguments import FloatArray, as_finite, as_finite_number, as_mapping, as_number, refuse_past
from smpl.support.names import listing

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
    """Model of a filter: x = (states, estimated parameters and disturbances), a step, readings.

    Args:
        model: the model that predicts.
        parameters: names of parameters that are estimated with the states, and the standard
            deviations of their drift in a step.
        process_noise: standard deviation of what a step adds to each state, by name; of those that
            are left out a thousandth of their size.
        noise: of the readings, by name, instead of those of the level.
        fixed: values of parameters of the model.
        disturbances: names of declared disturbances that are estimated; if none, all that are
            random or depend on the value before, from their declared values on. Parameters and
            numbers that are drawn at a reset and move these are estimated too.
        deviation: standard deviations at the start by name, as for `start`. A disturbance with a
            deviation here or in `process_noise` is estimated.

    Raises:
        ValueError: unknown names, or a disturbance to estimate that is certain: its rule keeps the
            declared value, and no deviation is given.
    """

    def __init__(
        self,
        model: Model,
        parameters: Mapping[str, float] | None,
        process_noise: Mapping[str, float] | None,
        noise: Mapping[str, float] | None,
        fixed: Mapping[str, float] | None = None,
        disturbances: Iterable[str] | None = None,
        deviation: Mapping[str, float] | None = None,
    ) -> None:
        refuse_past(model, "an estimator")
        self.model = model
        self.fixed: dict[str, float] = dict(as_mapping("p", fixed))
        self.states = len(model.state_names)
        given = dict(as_mapping("parameters", parameters))
        spread = as_mapping("process_noise", process_noise)
        uncertain = {name for name, size in {**as_mapping("deviation", deviation), **spread}.items() if size}
        self.disturbances = Disturbances(model, disturbances, self.fixed, uncertain)
        certain = sorted(self.disturbances.still - uncertain)
        if certain:
            raise ValueError(
                f"disturbances: {', '.join(certain)} keeps the declared value, so that there is nothing to estimate; "
                f"give deviation={{{certain[0]!r}: ...}}, or process_noise for changes in each step"
            )
        moving = self.disturbances.parameters()
        given |= {name: 0.0 for name in moving if name not in given and name not in self.fixed}
        self.parameters = tuple(given)
        self._check_parameters()
        self._deviations = {**(drawn_parameters(model, self._known()) if given else {}), **moving}
        self.names = (*model.state_names, *self.parameters, *self.disturbances.names)
        self._tail = self.states + len(self.parameters)
        sizes = [self._size_of(name) for name in self.parameters]
        self.scale = np.concatenate([self._sizes(), sizes, self.disturbances.size])
        self.low, self.high = self._bounds()
        names, units = model.state_names + model.disturbance_names, model.state_units + model.disturbance_units
        weights("process_noise", process_noise, names, units)
        changes = [float(spread.get(name, 1e-3 * self.scale[i])) for i, name in enumerate(model.state_names)]
        drift = [as_deviation(f"parameters[{name!r}]", value) for name, value in given.items()]
        steps = [float(spread.get(name, 0.0)) for name in self.disturbances.names]
        self.process = np.array([*changes, *drift, *steps])
        self.sensors: Sensors = sensors(model, noise)
        low, high = model.native.bounds("observation")
        width = np.where(np.isfinite(high - low), high - low, 1.0)
        # An exact reading has the precision of the numbers that it is returned in.
        self.noise = np.where(self.sensors.noise > 0, self.sensors.noise, 1e-6 * width)
        self.limit = model.max_steps + 1
        self._by_differences, self._why = 0, ""

    @property
    def derivatives(self) -> str:
        """`exact`, or the number of steps of the episode with differences and the last reason."""
        return f"differences in {self._by_differences} steps: {self._why}" if self._by_differences else "exact"

    def check_readings(self) -> None:
        """Leaves out readings that do not follow from the state alone; warns by name.

        Looked at numerically: readings at the end of a step against those at the state where it
        ended.

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
            state, discrete = env.state, discrete_of(env)
            found = linearize_step(model, state, actions[1], {**self.fixed, **discrete}, by=(), first_step=1)
            _, _, terminated, truncated, _ = env.step(actions[1])
            carried = [env.parameters[name] for name in self.parameters]
            before = np.concatenate([state, carried, self.disturbances.start()])
            disturbed = self._next(before[None], actions[1], 1, discrete, None)[0]
            point = np.concatenate([found.states, carried, disturbed])
            there = self.read(point[None], 2, discrete_of(env), nominal)[0]
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
        # The environment may have another time limit than the model; readings are taken at its last
        # step too.
        self.limit = env.max_steps + 1
        self._by_differences, self._why = 0, ""

    def step(self, points: FloatArray, action: FloatArray, at: int, discrete: Mapping[str, float]) -> FloatArray:
        """The points (N, x) a step later.

        Raises:
            ValueError: the model could not be integrated from one of them.
        """
        nodes = self._spread(points[0], action, at, discrete)[1]
        return self._stepped(points, action, at, discrete, self._next(points, action, at, discrete, nodes))

    def _stepped(
        self, points: FloatArray, action: FloatArray, at: int, discrete: Mapping[str, float], later: FloatArray
    ) -> FloatArray:
        found = self._rollout(points, action, at, discrete, later)
        return np.concatenate([found.states[:, -1], points[:, self.states : self._tail], later], axis=1)

    def read(self, points: FloatArray, at: int, discrete: Mapping[str, float], action: FloatArray) -> FloatArray:
        """Readings (N, observations) without noise of samples taken at the points."""
        if not self.disturbances.names:
            return self._rollout(points, action, at, discrete, points[:, self._tail :]).observations[:, 0]
        inside = self.clipped(points)
        low, high = self.model.native.bounds("observation")
        read = self.disturbances.read(
            inside[:, : self.states], inside[:, self._tail :], action, at, discrete, self._named(inside)
        )
        return np.clip(read, low, high)

    def transition(
        self, x: FloatArray, action: FloatArray, at: int, discrete: Mapping[str, float]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The point (x,) a step later, its derivative (x, x), and its covariance (x, x)."""
        scatter, nodes = self._spread(x, action, at, discrete)
        disturbed = self._next(x[None], action, at, discrete, nodes)
        later = self._stepped(x[None], action, at, discrete, disturbed)[0]
        slope, by_disturbances = self._derivatives(x, action, at, discrete, disturbed[0], nodes)
        return later, slope, np.diag(self.process**2) + by_disturbances @ scatter @ by_disturbances.T

    def _spread(
        self, x: FloatArray, action: FloatArray, at: int, discrete: Mapping[str, float]
    ) -> tuple[FloatArray, FloatArray | None]:
        """Covariance of the disturbances of the coming step, and nodes of their mean."""
        if not self.disturbances.names:
            return np.zeros((0, 0)), None
        inside = self.clipped(x)
        values = self._named(inside[None])
        return self.disturbances.spread(inside[: self.states], inside[self._tail :], action, at, discrete, values)

    def _next(
        self, points: FloatArray, action: FloatArray, at: int, discrete: Mapping[str, float], nodes: FloatArray | None
    ) -> FloatArray:
        """Disturbances (N, disturbances) of the coming step, at their means."""
        if not self.disturbances.names:
            return np.zeros((len(points), 0))
        inside = self.clipped(points)
        states, present = inside[:, : self.states], inside[:, self._tail :]
        return self.disturbances.next(states, present, action, at, discrete, self._named(inside), nodes)

    def _derivatives(
        self,
        x: FloatArray,
        action: FloatArray,
        at: int,
        discrete: Mapping[str, float],
        disturbed: FloatArray,
        nodes: FloatArray | None,
    ) -> tuple[FloatArray, FloatArray]:
        """Derivative (x, x) of a step, and that (x, disturbances) by the disturbances during it."""
        count, size = len(disturbed), len(x)
        by_disturbances = np.zeros((size, count))
        by_disturbances[self._tail :] = np.eye(count)
        whole = np.eye(size)
        try:
            own, direct = self._exact(self.clipped(x), action, at, discrete, disturbed)
        except SimulationError as error:
            self._by_differences, self._why = self._by_differences + 1, str(error).removeprefix("point 0: ")
            own, direct = self._by_difference(x, action, at, discrete, disturbed)
        whole[: self.states] = own
        by_disturbances[: self.states] = direct
        if count:
            points, width = self._beside(x)
            rule = _slopes(self._next(points, action, at, discrete, nodes), width)
            whole[self._tail :] = 0.0
            whole += by_disturbances @ rule
        return whole, by_disturbances

    def _exact(
        self, x: FloatArray, action: FloatArray, at: int, discrete: Mapping[str, float], disturbed: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Sensitivities of the states after a step to x and to the disturbances during it."""
        values = dict(zip(self.parameters, x[self.states : self._tail].tolist(), strict=True))
        names = self.disturbances.names[: self.disturbances.moving]
        given = {**self.fixed, **discrete, **values, **dict(zip(names, disturbed.tolist(), strict=False))}
        found = linearize_step(
            self.model, x[: self.states], action, given, by=("state",), parameters=self.parameters,
            disturbances=names, first_step=at,
        )  # fmt: skip
        nothing = np.zeros((self.states, len(disturbed)))
        direct = nothing.copy()
        direct[:, : len(names)] = found.dx_dw
        return np.concatenate([found.dx_dx, found.dx_dp, nothing], axis=1), direct

    def _by_difference(
        self, x: FloatArray, action: FloatArray, at: int, discrete: Mapping[str, float], disturbed: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The same by differences of rollouts."""
        points, width = self._beside(x)
        held = np.tile(disturbed, (len(points), 1))
        own = _slopes(self._rollout(points, action, at, discrete, held).states[:, -1], width)
        count = len(disturbed)
        distance = 1e-4 * np.maximum(self.disturbances.size, np.abs(disturbed))
        moved = disturbed + np.vstack([-np.diag(distance), np.diag(distance)]) if count else np.zeros((0, 0))
        direct = np.zeros((self.states, count))
        if count:
            found = self._rollout(np.tile(x, (2 * count, 1)), action, at, discrete, moved)
            direct = _slopes(found.states[:, -1], 2 * distance)
        return own, direct

    def read_with_jacobian(
        self, x: FloatArray, at: int, discrete: Mapping[str, float], action: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The readings (observations,) at a point and their derivative (observations, x)."""
        points, width = self._beside(x)
        found = self.read(np.vstack([x, points]), at, discrete, action)
        return found[0], _slopes(found[1:], width)

    def _beside(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points next to x, (2 x, x), two per direction within the bounds, and their distances."""
        distance = 1e-4 * np.maximum(self.scale, np.abs(x))
        below, above = np.maximum(x - distance, self.low), np.minimum(x + distance, self.high)
        return np.vstack([x + np.diag(below - x), x + np.diag(above - x)]), above - below

    def start(self, env: Env, initial: Any, deviation: Any) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance before the first reading.

        Args:
            env: the environment of the episode.
            initial: states by name or as an array; the others, and all if None, at the nominal
                start of the model.
            deviation: standard deviations by name; a tenth of the size for those that are left out.
        """
        nominal = Env(self.model, normalize=False)
        nominal.reset(seed=0, options={"start": "nominal", "parameters": self._known()})
        carried = [nominal.parameters[name] for name in self.parameters]
        mean = np.concatenate([nominal.state, carried, self.disturbances.start()])
        spread = 0.1 * self.scale
        for i, name in enumerate(self.parameters, self.states):
            spread[i] = self._deviations.get(name, spread[i])
        spread[self._tail :] = self.disturbances.spread_at_start(env.steps == 0)
        if isinstance(initial, Mapping):
            self._put(mean, "initial", initial)
        elif initial is not None:
            mean[: self.states] = as_finite("initial", initial, self.states)
        if deviation is not None:
            self._put(spread, "deviation", deviation)
        return mean, np.diag(spread**2)

    def check_start(self, initial: Any, deviation: Any, least: str) -> None:
        """Refuse a start that cannot be right.

        Args:
            initial, deviation: as for `start`.
            least: `positive`, or `not negative`: what deviations may be.

        Raises:
            ValueError: unknown names, values that are not finite, or deviations that are not what
                they may be.
        """
        if isinstance(initial, Mapping):
            self._put(np.zeros(len(self.names)), "initial", initial)
        elif initial is not None:
            as_finite("initial", initial, self.states)
        self._put(np.zeros(len(self.names)), "deviation", as_mapping("deviation", deviation))
        for name, value in as_mapping("deviation", deviation).items():
            as_deviation(f"deviation[{name!r}]", value, least)

    def ahead(
        self, estimate: Mapping[str, float], action: FloatArray, at: int, discrete: Mapping[str, float], steps: int = 1
    ) -> dict[str, FloatArray]:
        """Values (steps,) of all disturbances in the coming steps, by their rules."""
        x = self.clipped(np.array([estimate[name] for name in self.names]))
        state, present = x[: self.states], x[self._tail :]
        return self.disturbances.ahead(state, present, action, at, discrete, self._named(x[None]), steps)

    def clipped(self, x: FloatArray) -> FloatArray:
        """A point inside of the bounds that the model declares."""
        return np.clip(x, self.low, self.high)

    def _put(self, vector: FloatArray, what: str, given: Mapping[str, float]) -> None:
        for name, value in given.items():
            if name not in self.names:
                raise ValueError(f"{what}: unknown {name!r}; there are: {', '.join(self.names)}")
            vector[self.names.index(name)] = as_finite_number(f"{what}[{name!r}]", value)

    def _known(self) -> dict[str, float]:
        """Given values of parameters."""
        return {name: value for name, value in self.fixed.items() if name in self.model.parameter_names}

    def _named(self, points: FloatArray) -> dict[str, FloatArray]:
        """Estimated parameters of points by name."""
        return {name: points[:, self.states + i] for i, name in enumerate(self.parameters)}

    def _rollout(
        self, points: FloatArray, action: FloatArray, at: int, discrete: Mapping[str, float], disturbed: FloatArray
    ) -> Any:
        inside = self.clipped(points)
        given: dict[str, Any] = dict(self._named(inside))
        names = self.disturbances.names[: self.disturbances.moving]
        found = rollout(
            self.model,
            inside[:, : self.states],
            action[None, None, :].repeat(len(points), axis=0),
            parameters={**self.fixed, **given},
            discrete=discrete,
            disturbances={name: disturbed[:, i : i + 1] for i, name in enumerate(names)},
            first_step=at,
            max_steps=self.limit,
            threads=1 if points.size < _LARGE else None,
        )
        bad = [i for i, kind in enumerate(found.failure_kind) if kind in ("start", "solver", "events", "not_finite")]
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
        known = self.disturbances
        return np.concatenate([low, least[places], known.low]), np.concatenate([high, most[places], known.high])


def _slopes(found: FloatArray, width: FloatArray) -> FloatArray:
    """Derivative (of, x) from values (2 x, of) next to a point."""
    return ((found[len(width) :] - found[: len(width)]) / width[:, None]).T


def as_deviation(name: str, value: Any, least: str = "not negative") -> float:
    """A standard deviation.

    Raises:
        ValueError: it is not a finite number that is `positive`, or `not negative`.
    """
    number = as_number(name, value)
    if not (np.isfinite(number) and (number > 0 or (number == 0 and least != "positive"))):
        raise ValueError(f"{name} is {value!r}, expected a finite deviation that is {least}")
    return number


def discrete_of(env: Env) -> dict[str, float]:
    """Discrete variables of the environment: the state of the plant's own controllers is known."""
    return dict(zip(env.discrete_names, env.discrete.tolist(), strict=True))
