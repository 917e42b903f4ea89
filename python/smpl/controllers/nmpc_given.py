"""Data of a decision of a predictive controller: parameters, set-points, forecasts and others."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from smpl._native import SimulationError
from smpl.controllers.names import operating_point
from smpl.controllers.nmpc_model import Expressions
from smpl.envs import Env
from smpl.support.arguments import FloatArray, as_finite_number, as_mapping, as_number, check_names

# What each interval of a horizon has its own value of, whatever is forecast.
_COUNTERS = ("p:clock", "c:steps", "c:last_step", "within:episode")


class Given:
    """Values by keys of `Expressions`: for all intervals, or for each.

    Args:
        expressions: of the model.
        horizon: intervals.
        p: parameters by name, `"episode"`, or None.
        forecast: by names, numbers, arrays or functions of the time.
        set_point: by names, numbers or functions of the time.
        targets: what has a set-point: name -> expression.
        weights: values of weights by their keys.

    Attributes:
        keys, varying: given names; those with a value for each interval.
        guess: states and algebraic variables at rest, or at the nominal start.
        first: all values of the first interval, in the order of the keys.
    """

    def __init__(
        self,
        expressions: Expressions,
        horizon: int,
        p: Mapping[str, float] | str | None,
        forecast: Mapping[str, Any] | None,
        set_point: Mapping[str, Any] | None,
        targets: Mapping[str, Any],
        weights: Mapping[str, float] | None = None,
    ) -> None:
        self._e, self._horizon = expressions, horizon
        self._episode = isinstance(p, str)
        if isinstance(p, str) and p != "episode":
            raise ValueError(f"p is {p!r}, expected values by names of parameters, or 'episode'")
        self._p = {} if isinstance(p, str) else dict(as_mapping("p", p))
        self._forecast = dict(as_mapping("forecast", forecast))
        self._set_point, self._targets = dict(as_mapping("set_point", set_point)), dict(targets)
        self._weights = dict(weights or {})
        check_names("set_point", self._set_point, tuple(targets))
        self._parameters = expressions.export.parameters(self._p)
        self._rest = self._at_rest()
        self.guess = self._guess()
        self.keys: tuple[str, ...] = ()
        self.varying: tuple[str, ...] = ()
        self.first = np.zeros(0)
        self._values: dict[str, float] = {}

    def prepare(self, keys: tuple[str, ...]) -> None:
        """Say what will be asked for.

        Raises:
            ValueError: a forecast of what no equation reads, or a set-point that has to be given.
        """
        self.keys = keys
        by_name = {key.partition(":")[2]: key for key in keys if key[:2] in ("p:", "u:", "x:", "z:")}
        check_names("forecast", self._forecast, tuple(by_name))
        self._forecast = {by_name[name]: value for name, value in self._forecast.items()}
        varying = [key for key in keys if key in _COUNTERS or key in self._forecast or key.startswith("target:")]
        self.varying = tuple(varying)
        self._constant = tuple(key for key in keys if key not in varying)
        lacking = [name for name in self._targets if name not in self._set_point]
        if lacking and self._rest is None:
            shown = ", ".join(f"{name} [{self._e.unit(name)}]" for name in lacking)
            raise ValueError(f"{self._e.model.name} has no steady state: give set_point for {shown}")
        self._default = {name: self._steady_value(name) for name in lacking}
        self._places = [[*self._constant, *self.varying].index(key) for key in keys]

    def nominal(self, key: str) -> float:
        """Value of a key at the nominal point."""
        e, (kind, _, name) = self._e.export, key.partition(":")
        if key in self._weights:
            return self._weights[key]
        if kind == "p":
            return float(self._parameters[e.parameter_names.index(name)])
        if kind == "within":
            return 1.0
        if kind == "c":
            return float(e.context_nominal[e.context_names.index(name)])
        if kind in ("u", "before"):
            return float(e.action_nominal[e.action_names.index(name)])
        if kind in ("target", "offset", "integral", "time", "dx"):
            given = self._set_point.get(name)
            return float(given) if isinstance(given, (int, float)) else self._default.get(name, 0.0)
        return self._state_value(name, start=kind in ("x", "z", "start", "initial", "previous"))

    def adjust(self, values: Mapping[str, float]) -> None:
        """Change weights, set-points and parameters.

        Raises:
            ValueError: an unknown name, or a number that is not finite or a negative weight.
        """
        names = self._e.export.parameter_names
        targets = {f"target:{name}": name for name in self._targets}
        check_names("values", values, (*self._weights, *targets, *names))
        parameters = {}
        for name, value in values.items():
            number = as_finite_number(f"values[{name!r}]", value)
            if name in self._weights:
                if number < 0:
                    raise ValueError(f"values[{name!r}] is {number}, expected a weight that is not negative")
                self._weights[name] = number
            elif name in targets:
                self._set_point[targets[name]] = number
            else:
                parameters[name] = number
        if parameters:
            self._p |= parameters
            self._parameters = self._e.export.parameters(self._p)

    def begin(self, env: Env, estimator: Any) -> None:
        """Values that stay over an episode."""
        e = self._e.export
        if self._episode:
            fixed = set(e._fixed)
            values = {n: v for n, v in env.parameters.items() if n in e.parameter_names and n not in fixed}
            self._parameters = e.parameters(values)
        by_name = dict(zip(env.state_names, env.state.tolist(), strict=True))
        by_name |= dict(zip(env.algebraic_names, env.algebraic.tolist(), strict=True))
        if estimator is not None:
            by_name = {}
        steady = self._steady_of(env)
        for key in self._constant:
            kind, _, name = key.partition(":")
            if kind == "initial":
                self._values[key] = by_name.get(name, self._state_value(name, start=True))
            elif kind == "steady":
                self._values[key] = steady.get(name, self._state_value(name, start=False))
            else:
                self._values[key] = self.nominal(key)
        self._limit = env.max_steps

    def update(self, env: Env, others: FloatArray, estimator: Any) -> None:
        """Values of this decision: discrete variables, other states, estimated parameters."""
        names = {"discrete": env.discrete, "disturbance": env.native.values("disturbance")}
        known = {f"p:{n}": v for n, v in zip(env.discrete_names, names["discrete"].tolist(), strict=True)}
        known |= {f"p:{n}": v for n, v in zip(env.disturbance_names, names["disturbance"].tolist(), strict=True)}
        known |= {f"u:{n}": v for n, v in zip(env.action_names, others.tolist(), strict=True)}
        known |= {f"before:{n}": v for n, v in zip(env.action_names, env.action.tolist(), strict=True)}
        if estimator is None:
            known |= {f"x:{n}": v for n, v in zip(env.state_names, env.state.tolist(), strict=True)}
            known |= {f"z:{n}": v for n, v in zip(env.algebraic_names, env.algebraic.tolist(), strict=True)}
        else:
            states, estimated = self._e.model.state_names, estimator.estimate
            known |= {f"p:{n}": self.nominal(f"p:{n}") for n in env.disturbance_names if f"p:{n}" in self._constant}
            known |= {f"{'x' if n in states else 'p'}:{n}": v for n, v in estimated.items()}
            known |= _disturbances(env, estimator)
        for key in self._constant:
            if key in known:
                self._values[key] = known[key]
            elif key.startswith("previous:"):
                name = key.partition(":")[2]
                found = [known[f"{kind}:{name}"] for kind in "pxz" if f"{kind}:{name}" in known]
                self._values[key] = found[0] if found else self._values[key]

    def vectors(self, env: Env, disturbance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values for all intervals, and those of each, (horizon x varying,)."""
        offsets = dict(zip((f"offset:{name}" for name in self._e.state_names), disturbance.tolist(), strict=True))
        fixed = np.array([offsets[key] if key in offsets else self._values[key] for key in self._constant])
        each = np.empty((self._horizon, len(self.varying)))
        for j, key in enumerate(self.varying):
            each[:, j] = self._series(key, env)
        self.first = np.concatenate([fixed, each[0]])[self._places]
        return fixed, each.ravel()

    def _series(self, key: str, env: Env) -> Any:
        kind, _, name = key.partition(":")
        starts = env.steps + np.arange(self._horizon)
        times = env.time + self._e.model.step * np.arange(self._horizon)
        if kind == "target":
            # Actions have theirs over an interval, what they lead to at its end.
            late = name not in self._e.export.action_names
            given = self._set_point.get(name, self._default.get(name, 0.0))
            return values_of(f"set_point[{name!r}]", given, starts + late, times + late * self._e.model.step)
        if key == "p:clock":
            return times
        if key == "c:steps":
            return starts
        if key == "c:last_step":
            return (starts + 1 >= self._limit).astype(float)
        if key == "within:episode":
            return (starts < self._limit).astype(float)
        return values_of(f"forecast[{name!r}]", self._forecast[key], starts, times)

    def _at_rest(self) -> FloatArray | None:
        """The unknowns of the model's steady state; none without one."""
        model = self._e.model
        try:
            env = Env(model, normalize=False)
            env.reset(seed=0, options={"start": "nominal"})
            if env.steady_state is None:
                return None
            return operating_point(model, None, self._p)[0]
        except (SimulationError, ValueError):
            return None

    def _guess(self) -> tuple[FloatArray, FloatArray]:
        e = self._e
        states = np.array([self._state_value(name, start=False) for name in e.state_names])
        return states, np.array([self._state_value(name, start=False) for name in e.algebraic_names])

    def _state_value(self, name: str, *, start: bool) -> float:
        """A state or algebraic variable at the nominal start, or at rest."""
        e = self._e.export
        names = e.state_names + e.algebraic_names
        if name not in names:
            return 0.0
        at = names.index(name)
        if not start and self._rest is not None:
            return float(self._rest[at])
        return float(np.concatenate([e.state_nominal, e.algebraic_nominal])[at])

    def _steady_value(self, name: str) -> float:
        """A quantity at rest."""
        import casadi as ca

        quantity = self._targets[name]
        symbols = ca.symvar(quantity)
        known = []
        for symbol in symbols:
            kind, _, what = symbol.name().partition(":")
            known.append(self._state_value(what, start=False) if kind in ("x", "z") else self.nominal(symbol.name()))
        return float(ca.Function("steady", [ca.vertcat(*symbols)], [quantity])(known))

    def _steady_of(self, env: Env) -> dict[str, float]:
        """The meaning of `steady(...)`: that of the plant, on which rewards depend."""
        if not any(key.startswith("steady:") for key in self._constant):
            return {}
        try:
            found = env.steady_state
        except SimulationError:
            found = None
        names = env.state_names + env.algebraic_names
        if found is None or len(found) != len(names):
            return {}
        return dict(zip(names, found.tolist(), strict=True))


def values_of(argument: str, given: Any, steps: Any, times: Any) -> Any:
    """Values at instants of a number, an array over the steps of the episode, or a function."""
    if callable(given):
        return [as_number(f"{argument} at {t:g}", given(float(t))) for t in times]
    if np.ndim(given) == 0:
        return as_number(argument, given)
    series = np.asarray(given, dtype=np.float64).ravel()
    if not len(series):
        raise ValueError(f"{argument} is empty, expected a value for each step")
    return series[np.minimum(steps, len(series) - 1)]


def _disturbances(env: Env, estimator: Any) -> dict[str, float]:
    """Disturbances of the coming step as the estimator predicts them, by key."""
    if not hasattr(estimator, "prediction"):
        return {}
    discrete = dict(zip(env.discrete_names, env.discrete.tolist(), strict=True))
    found = estimator.prediction.ahead(estimator.estimate, env.action, env.steps, discrete)
    return {f"p:{name}": float(values[0]) for name, values in found.items()}
