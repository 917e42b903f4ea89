"""Modules that `smpl export` writes, run: models as CasADi and JAX functions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from smpl.export.calls import completing
from smpl.export.files import text
from smpl.export.parts import CasadiPart, cut
from smpl.model import Model
from smpl.support.arguments import FloatArray, check_names
from smpl.support.optional import load

# Name, unit, lower and upper bound, magnitude, nominal value.
Row = tuple[str, str, float, float, float, float]


def run(model: Model, target: str) -> dict[str, Any]:
    """The names that the exported module of a model defines."""
    (source,) = text(model, target).values()
    namespace: dict[str, Any] = {"__name__": f"smpl_{target}_{model.name}"}
    exec(compile(source, f"<smpl export --to {target} of {model.name}>", "exec"), namespace)
    return namespace


class Tables:
    """Names, units, bounds, magnitudes and nominal values of the vectors of an exported model.

    For each kind (`state`, `algebraic`, `action`, `parameter`, `context`, `output`) there are
    `KIND_names` and `KIND_units` (tuples), and the arrays `KIND_low`, `KIND_high`, `KIND_scale` and
    `KIND_nominal`. `labels` and `label_units` map the name of each function to the names and units
    of the numbers that it gives.
    """

    _kinds = ("state", "algebraic", "action", "parameter", "context", "output")

    def __init__(self, namespace: Mapping[str, Any]) -> None:
        self.name: str = namespace["NAME"]
        self.time_name, self.time_unit = namespace["TIME"]
        self.step: float = namespace["STEP"]
        self.explicit: bool = namespace["EXPLICIT"]
        self._rows: dict[str, list[Row]] = {
            kind: namespace["ALGEBRAIC" if kind == "algebraic" else f"{kind.upper()}S"]
            if kind != "context"
            else namespace["CONTEXT"]
            for kind in self._kinds
        }
        self._fixed: list[str] = namespace["FIXED"]
        self.labels = {name: tuple(names) for name, names in namespace["NAMES"].items()}
        self.label_units = {name: tuple(units) for name, units in namespace["UNITS"].items()}
        self.observation_names = self.labels.get("observations", ())
        self.observation_units = self.label_units.get("observations", ())
        self.reward_names = self.labels.get("rewards", ())
        self.reward_units = self.label_units.get("rewards", ())

    def __getattr__(self, name: str) -> Any:
        kind, _, what = name.partition("_")
        columns = {"names": 0, "units": 1, "low": 2, "high": 3, "scale": 4, "nominal": 5}
        if kind not in self._kinds or what not in columns or "_rows" not in self.__dict__:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}", name=name, obj=self)
        column = [row[columns[what]] for row in self._rows[kind]]
        value = tuple(column) if what in ("names", "units") else np.array(column, dtype=np.float64)
        setattr(self, name, value)
        return value

    functions: dict[str, Any]

    def parameters(self, values: Mapping[str, float] | None = None) -> FloatArray:
        """The vector p: nominal values, given values by name, and values computed from these.

        Raises:
            ValueError: an unknown name; the message lists the right ones.
        """
        p = self._filled("parameter", values)
        if not values or "parameters" not in self.functions:
            return p
        flags = {f"given({name})": 1.0 for name in values}
        c = self.context({name: flag for name, flag in flags.items() if name in self.context_names})
        return self._update("parameters", {"p": p, "c": c})

    def _update(self, name: str, changed: Mapping[str, FloatArray]) -> FloatArray:
        """The vector p after an update at the nominal point."""
        raise NotImplementedError

    def _arguments(self, names: Iterable[str], changed: Mapping[str, FloatArray]) -> list[Any]:
        nominal = {"x": self.state_nominal, "z": self.algebraic_nominal, "u": self.action_nominal, "t": 0.0}
        return [{**nominal, **changed}[name] for name in names]

    def context(self, values: Mapping[str, float] | None = None) -> FloatArray:
        """The vector c: nominal values with those by name in their place.

        Raises:
            ValueError: an unknown name; the message lists the right ones.
        """
        return self._filled("context", values)

    def _filled(self, kind: str, values: Mapping[str, float] | None) -> FloatArray:
        names: tuple[str, ...] = getattr(self, f"{kind}_names")
        check_names(kind, values or {}, names)
        vector: FloatArray = getattr(self, f"{kind}_nominal").copy()
        for name, value in (values or {}).items():
            at = names.index(name)
            if name in self._fixed and value != vector[at]:
                raise ValueError(f"{name!r} shaped the model, exported with {vector[at]}: compile it anew")
            vector[at] = value
        return vector


class CasadiModel(Tables):
    """A model as CasADi functions; made by `smpl.export.casadi`.

    Vectors are columns: states x, algebraic variables z, actions u, parameters p; `state_names`,
    `algebraic_names`, `action_names` and `parameter_names` name their elements. Parameters p are
    the declared ones, discrete variables and disturbances, and other inputs of the equations, time
    last. Functions of a whole step may also take c (`context_names`): values at other instants,
    counters. The `name_in()` of a function says what it takes. Calls may omit z in models without
    it, p (the nominal one) and c where it holds constants only; p may be a mapping.

    Attributes:
        rhs: `rhs(x, u, p)`, rates of the states; None unless the model is explicit without
            algebraic variables.
        dae: `dae(x, z, u, p)`, rates and residual of the algebraic equations; None unless explicit
            in the rates.
        residual: `residual(dx, x, z, u, p)`, for every model.
        outputs: algebraic outputs (`output_names`); None if missing, like the following.
        observations: observations in physical units (`observation_names`).
        rewards: mapping of the name of each reward to its function.
        failures, successes, constraints, invariants, events, integrals: vectors, named by `labels`.
        functions: all functions by name: also the updates `start`, `end`, `event_0`, ..., which map
            (x, z, p) to (x, z, p), and the policies `policy_NAME`.
    """

    def __init__(self, namespace: Mapping[str, Any], kind: str | None, smooth: float) -> None:
        super().__init__(namespace)
        self.kind: str = kind or namespace["KIND"]
        self._build, self._smooth = namespace["build"], smooth
        made = self._build(self.kind, smooth)
        rewards = made.pop("rewards")
        self.rewards: dict[str, Any] = {name: completing(function, self) for name, function in rewards.items()}
        made = {name: completing(function, self) for name, function in made.items()}
        self.functions = made
        self.rhs: Any = made.get("rhs")
        self.dae: Any = made.get("dae")
        self.residual = made["residual"]
        self.outputs: Any = made.get("outputs")
        self.observations: Any = made.get("observations")
        self.failures: Any = made.get("failures")
        self.successes: Any = made.get("successes")
        self.constraints: Any = made.get("constraints")
        self.invariants: Any = made.get("invariants")
        self.events: Any = made.get("events")
        self.integrals: Any = made.get("integrals")

    def part(self, states: Iterable[str]) -> CasadiPart:
        """The part of the model with some states: their rates, with other variables as inputs.

        Args:
            states: names of states, or of components and arrays for all that belongs to them:
                `["R1", "T"]`.

        Raises:
            ValueError: a name means no state, or the model is not explicit in its rates.
        """
        if self.dae is None:
            raise ValueError(f"{self.name} is not explicit in its rates")
        nominal = np.concatenate([self.state_nominal, self.algebraic_nominal])
        return cut(self._build, self._smooth, states, (self.state_names, self.algebraic_names), nominal)

    def _update(self, name: str, changed: Mapping[str, FloatArray]) -> FloatArray:
        function = self.functions[name]
        return np.asarray(function(*self._arguments(function.name_in(), changed))[2].full()).ravel()

    def __repr__(self) -> str:
        return f"<smpl.export.CasadiModel {self.name}: {len(self.state_names)} states, {self.kind}>"


class JaxModel(Tables):
    """A model as pure JAX functions; made by `smpl.export.jax`.

    Functions take time t first, then the vectors of `CasadiModel`: `rhs(t, x, u, p)`, `dae(t, x, z,
    u, p)`, `residual(t, dx, x, z, u, p)`, and others of (t, x, z, u, p), with c if `takes_context`
    names them. The others are `outputs`, `observations`, `rewards` (a vector, `reward_names`) and
    so on. Time is not in p.

    Attributes:
        functions: all functions by name, the updates included, which give (x, z, p).
    """

    def __init__(self, namespace: Mapping[str, Any]) -> None:
        super().__init__(namespace)
        self.functions = dict(namespace["FUNCTIONS"])
        for name in ("rhs", "dae"):
            if name in namespace:
                self.functions[name] = namespace[name]
        self.rhs: Any = self.functions.get("rhs")
        self.dae: Any = self.functions.get("dae")
        self.residual = self.functions["residual"]
        self.outputs: Any = self.functions.get("outputs")
        self.observations: Any = self.functions.get("observations")
        self.rewards: Any = self.functions.get("rewards")

    def takes_context(self, name: str) -> bool:
        """Return whether a function takes the vector c as its last argument."""
        code = self.functions[name].__code__
        return "c" in code.co_varnames[: code.co_argcount]

    def _update(self, name: str, changed: Mapping[str, FloatArray]) -> FloatArray:
        names = ["t", "x", "z", "u", "p", *(["c"] if self.takes_context(name) else [])]
        return np.array(self.functions[name](*self._arguments(names, changed))[2])

    def __repr__(self) -> str:
        return f"<smpl.export.JaxModel {self.name}: {len(self.state_names)} states>"


def casadi(model: Model, kind: str | None = None, smooth: float = 0.0) -> CasadiModel:
    """The model as CasADi functions.

    Args:
        model: a compiled model.
        kind: "MX" keeps loops as operations on vectors, "SX" writes every number out; by the
            model's size if None.
        smooth: width over which switches, absolute values, minima and maxima are made smooth, in
            the unit of what is compared; 0 leaves them exact.

    Raises:
        ImportError: CasADi is missing.
        ValueError: the model has what CasADi functions cannot carry.
    """
    load("casadi", "this export")
    return CasadiModel(run(model, "casadi"), kind, smooth)


def jax(model: Model) -> JaxModel:
    """The model as pure JAX functions.

    They compute in the precision of their arguments: call `jax.config.update("jax_enable_x64",
    True)` first for double precision.

    Raises:
        ImportError: JAX is missing.
        ValueError: the model has what JAX functions cannot carry.
    """
    load("jax", "this export")
    return JaxModel(run(model, "jax"))
