"""The model of a predictive controller: CasADi expressions of its variables and given values.

States of the chosen part, algebraic variables and actions are variables. Other symbols (parameters,
discrete variables, states of the rest of the plant, values at other instants) are *given* at every
decision by name: `p:T_f`, `x:h`, `steady:T`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from smpl.controllers.nmpc_elimination import eliminate
from smpl.export.modules import CasadiModel, casadi
from smpl.export.parts import chosen
from smpl.model import Model
from smpl.support.arguments import FloatArray
from smpl.support.names import listing
from smpl.support.optional import load

_INSTANT = re.compile(r"(previous|initial|steady|integral)\((.*)\)")


class Expressions(Mapping[str, Any]):
    """Expressions of a model; as a mapping, quantities by their names, in physical units.

    Args:
        model: a compiled model.
        part: states, components or arrays that are predicted; all if None. The others are given.
        smooth: as for `smpl.export.casadi`.

    Attributes:
        state_names, state_scale, state_low, state_high: of the part, with positive finite scales.
        algebraic_names, algebraic_scale, algebraic_nominal: algebraic unknowns of the collocation,
            without those that the equations define explicitly. None with a part.
        equations: rates of the states `explicit` (indices of the part), then other residuals.
        x, z, u, start, before, integral, time: symbols of states, algebraic variables and actions
            at a point, initial states of the interval, the last action, integrals and time.

    Raises:
        ImportError: CasADi is missing.
        ValueError: a name of the part means no state, or what is predicted jumps at sampling
            instants.
    """

    def __init__(self, model: Model, part: Iterable[str] | None = None, smooth: float = 0.0) -> None:
        self.model = model
        ca = load("casadi", "predictive control")
        self.export: CasadiModel = casadi(model, "SX", smooth)

        self._ca = ca
        e = self.export
        at = list(range(len(e.state_names))) if part is None else chosen(part, e.state_names)
        self.state_names = tuple(e.state_names[i] for i in at)
        self.state_low, self.state_high = e.state_low[at], e.state_high[at]
        self.state_scale = _sizes(e.state_scale[at], e.state_nominal[at])
        self.action_scale = _sizes(e.action_scale, e.action_nominal)
        self._symbols: dict[str, Any] = {}
        self.x = self._vector("x", self.state_names)
        self.u, self.start = self._vector("u", e.action_names), self._vector("start", self.state_names)
        self.before = self._vector("before", e.action_names)
        self.dx = self._vector("dx", self.state_names)
        self.integral = self._vector("integral", e.labels.get("integrals", ()))
        self.time = self._symbol("time")
        self._vectors = {
            "x": ca.vertcat(*(self._symbol(f"x:{name}") for name in e.state_names)),
            "z": ca.vertcat(*(self._symbol(f"z:{name}") for name in e.algebraic_names)),
            "u": self.u,
            "p": ca.vertcat(*(self._element(name) for name in e.parameter_names)),
            "c": ca.vertcat(*(self._element(name) for name in e.context_names)),
        }
        if part is not None:
            self.equations, self.explicit, kept = self._rates_of(at), list(range(len(at))), list[int]()
        else:
            self.equations, self.explicit, kept = self._dynamics()
        self.algebraic_names = tuple(e.algebraic_names[i] for i in kept)
        self.algebraic_nominal = e.algebraic_nominal[kept]
        self.algebraic_scale = _sizes(np.abs(self.algebraic_nominal), self.algebraic_nominal)
        self.z = self._vector("z", self.algebraic_names)
        self._refuse_jumps(at)
        self._quantities = self._named_quantities()

    def __getitem__(self, name: str) -> Any:
        if name not in self._quantities:
            raise ValueError(f"unknown {name!r}; {self.model.name} has {self.listing()}")
        return self._quantities[name]()

    def __iter__(self) -> Iterator[str]:
        return iter(self._quantities)

    def __len__(self) -> int:
        return len(self._quantities)

    def listing(self) -> str:
        """Names that costs and bounds may use, with units."""
        e = self.export
        lists = [("state", self.state_names), ("action", e.action_names), ("output", e.output_names)]
        parts = []
        for kind, names in lists:
            units = dict(zip(getattr(e, f"{kind}_names"), getattr(e, f"{kind}_units"), strict=True))
            if names:
                parts.append(f"the {kind}s {listing(names, [units[name] for name in names], 20)}")
        return "; ".join(parts)

    def unit(self, name: str) -> str:
        """Unit of a quantity."""
        e = self.export
        for kind in ("state", "algebraic", "action", "output", "observation", "parameter"):
            if name in getattr(e, f"{kind}_names"):
                return str(getattr(e, f"{kind}_units")[getattr(e, f"{kind}_names").index(name)])
        return "1"

    def scale(self, name: str) -> float:
        """Size of a quantity, positive."""
        e = self.export
        for kind in ("state", "action", "output"):
            names = getattr(e, f"{kind}_names")
            if name in names:
                i = names.index(name)
                return float(_sizes(getattr(e, f"{kind}_scale")[[i]], getattr(e, f"{kind}_nominal")[[i]])[0])
        return 1.0

    def call(self, function: Any) -> Any:
        """A function of the export at the symbols."""
        return function(*(self._vectors[name] for name in function.name_in()))

    def reward(self, name: str) -> Any:
        """A reward of the step that ends at the point.

        Raises:
            ValueError: unknown name, or a quantity that a horizon does not know.
        """
        e = self.export
        if name not in e.rewards:
            known = listing(e.reward_names, e.reward_units) or "none"
            raise ValueError(f"cost is {name!r}, no reward of {self.model.name}; there are: {known}")
        return self.call(e.rewards[name])

    def actions_read(self) -> tuple[str, ...]:
        """Actions that the equations of the part read."""
        read = {symbol.name() for symbol in self._ca.symvar(self.equations)}
        return tuple(name for name in self.export.action_names if f"u:{name}" in read)

    def given(self, expressions: Any, actions: tuple[str, ...]) -> tuple[str, ...]:
        """Keys of what the expressions read and the controller does not vary."""
        own = {f"x:{n}" for n in self.state_names} | {f"z:{n}" for n in self.algebraic_names}
        own |= {f"start:{n}" for n in self.state_names} | {f"dx:{n}" for n in self.state_names} | {"time"}
        own |= {f"u:{n}" for n in actions} | {f"before:{n}" for n in actions}
        own |= {f"integral:{n}" for n in self.export.labels.get("integrals", ())}
        return tuple(sorted({symbol.name() for symbol in self._ca.symvar(expressions)} - own))

    def symbols(self, keys: Iterable[str]) -> Any:
        """Symbols of given quantities, as a column."""
        return self._ca.vertcat(*(self._symbol(key) for key in keys))

    def limits(self) -> list[tuple[str, Any, float, float]]:
        """Limits of the model at the end of every step: (name, expression, low, high).

        Bounds of states, boxes of failures, root functions of failing events, violations of other
        failures and of declared constraints.
        """
        e, found = self.export, []
        for i, name in enumerate(self.state_names):
            if np.isfinite(self.state_low[i]) or np.isfinite(self.state_high[i]):
                found.append((name, self.x[i], float(self.state_low[i]), float(self.state_high[i])))
        low, high = self.model.native.bounds("observation")
        for name in e.labels.get("boxes", ()):
            if name in e.observation_names and name not in e.state_names:
                i = e.observation_names.index(name)
                found.append((name, self[name], float(low[i]), float(high[i])))
        found += self._violations()
        own = {f"x:{name}" for name in self.state_names} | {f"u:{name}" for name in e.action_names}
        return [one for one in found if own & {symbol.name() for symbol in self._ca.symvar(one[1])}]

    def _violations(self) -> list[tuple[str, Any, float, float]]:
        e, found = self.export, []
        events, failures = e.labels.get("events", ()), e.labels.get("failures", ())
        for name in failures[::2]:
            if name in events:
                found.append((name, self.call(e.events)[events.index(name)], -np.inf, 0.0))
            elif e.failures is not None and name not in ("state_box", "observation_box"):
                excess = self.call(e.failures)[failures.index(f"{name} excess")]
                if not self._keys(excess) <= {f"x:{state}" for state in self.state_names if self._bounded(state)}:
                    found.append((name, excess, -np.inf, 1e-6))
        if e.constraints is not None:
            values = self.call(e.constraints)
            found += [(name, values[i], -np.inf, 1e-6) for i, name in enumerate(e.labels["constraints"])]
        # Quantities of an episode (a counter, a reward) are not limits of a prediction.
        return [one for one in found if not any(key.startswith("c:") for key in self._keys(one[1]))]

    def _bounded(self, state: str) -> bool:
        i = self.state_names.index(state)
        return bool(np.isfinite(self.state_low[i]) or np.isfinite(self.state_high[i]))

    def within(self, expression: Any, *, algebraic: bool = True) -> bool:
        """Return whether it has a value at every point of a step, not only for the step as a whole.

        Args:
            algebraic: it may read algebraic variables too.
        """
        keys = self._keys(expression)
        step = (
            ("start:", "before:", "integral:", "dx:") if algebraic else ("start:", "before:", "integral:", "dx:", "z:")
        )
        return any(f"x:{name}" in keys for name in self.state_names) and not any(key.startswith(step) for key in keys)

    def _keys(self, expression: Any) -> set[str]:
        return {symbol.name() for symbol in self._ca.symvar(expression)}

    def _symbol(self, key: str) -> Any:
        if key not in self._symbols:
            self._symbols[key] = self._ca.SX.sym(key)
        return self._symbols[key]

    def _vector(self, prefix: str, names: Iterable[str]) -> Any:
        found = [self._symbol(f"{prefix}:{name}") for name in names]
        return self._ca.vertcat(*found) if found else self._ca.SX(0, 1)

    def _element(self, name: str) -> Any:
        """The symbol that stands for an element of p or c."""
        e = self.export
        if name == e.time_name and name == e.parameter_names[-1] and name not in self.model.parameter_names:
            return self.time
        if name == "step_length":
            return self._ca.SX(e.step)
        if name == "failed" or name.startswith("given("):
            return self._ca.SX(0.0)
        match = _INSTANT.fullmatch(name)
        if match is None:
            known = name in e.parameter_names
            return self._symbol(f"{'p' if known else 'c'}:{name}")
        when, what = match.groups()
        if when == "integral":
            return self._symbol(f"integral:{name}")
        if when == "previous" and what in self.state_names:
            return self._symbol(f"start:{what}")
        if when == "previous" and what in e.action_names:
            return self._symbol(f"before:{what}")
        return self._symbol(f"{when}:{what}")

    def _rates_of(self, at: list[int]) -> Any:
        e = self.export
        if e.dae is None:
            raise ValueError(f"{e.name} is not explicit in its rates")
        return self.call(e.dae)[0][at]

    def _dynamics(self) -> tuple[Any, list[int], list[int]]:
        """Equations, the states whose rates they give, and the algebraic variables that are left.

        Solved algebraic variables are replaced by their expressions wherever they are read.
        """
        e, ca = self.export, self._ca
        z = self._vectors["z"]
        if e.dae is not None:
            rates, residual = self.call(e.dae)
            unknowns, own = z, 0
        else:
            self._vectors["dx"] = self.dx
            residual = self.call(e.residual)
            rates, unknowns, own = self.dx, ca.vertcat(self.dx, z), len(self.state_names)
        found = eliminate(residual, unknowns, own)
        before, after = [unknowns[i] for i in found.solved], list(found.solved.values())
        explicit = [i for i in range(len(self.state_names)) if not own or i in found.solved]
        kept = [i for i in range(len(e.algebraic_names)) if own + i not in found.solved]
        # An empty list of indices takes an element of a scalar.
        equations = ca.vertcat(ca.SX(0, 1), *(rates[i] for i in explicit), *(residual[i] for i in found.rows))
        if before:
            equations, self._vectors["z"] = ca.substitute([equations, z], [ca.vertcat(*before)], [ca.vertcat(*after)])
        return equations, explicit, kept

    def _refuse_jumps(self, at: list[int]) -> None:
        """States that are reset at sampling instants have no smooth prediction.

        The projection to a constraint changes nothing where the equations keep the constraint.
        """
        e, ca = self.export, self._ca
        projected = set(self.model.native.projected)
        for name in ("start", "end"):
            if name not in e.functions:
                continue
            after = self.call(e.functions[name])[0]
            jumping = [
                e.state_names[i] for i in at if not ca.is_equal(after[i], self._symbol(f"x:{e.state_names[i]}"), 2)
            ]
            jumping = [one for one in jumping if name == "start" or one not in projected]
            if jumping:
                raise ValueError(
                    f"{e.name} sets {', '.join(jumping[:4])} at the {name} of a step, which derivatives cannot predict:"
                    " choose the other states as part=[...], or take SamplingMPC"
                )

    def _named_quantities(self) -> dict[str, Callable[[], Any]]:
        e = self.export
        found: dict[str, Callable[[], Any]] = {}

        def vector(names: Iterable[str], values: Callable[[], Any]) -> None:
            for i, name in enumerate(names):
                found.setdefault(name, lambda i=i: values()[i])  # type: ignore[misc]

        vector(self.state_names, lambda: self.x)
        vector(e.algebraic_names, lambda: self._vectors["z"])
        vector(e.action_names, lambda: self.u)
        vector(e.state_names, lambda: self._vectors["x"])
        if e.outputs is not None:
            vector(e.output_names, lambda: self.call(e.outputs))
        if e.observations is not None:
            vector(e.observation_names, lambda: self.call(e.observations))
        vector(e.parameter_names, lambda: self._vectors["p"])
        return found


def _sizes(scale: FloatArray, nominal: FloatArray) -> FloatArray:
    """Positive finite scales; a scale of 1 is ignored if the nominal value shows a size."""
    size = np.where(np.isfinite(nominal) & (nominal != 0), np.abs(nominal), 1.0)
    usable = np.isfinite(scale) & (scale > 0) & (scale != 1.0)
    return np.where(usable, scale, size)
