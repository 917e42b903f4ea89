"""Compiled models: equations, derivatives, steady states, linearisation."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from smpl import _native
from smpl.analysis.equations import Equations
from smpl.analysis.linearization import Linearization
from smpl.analysis.step import Step
from smpl.analysis.trajectories import Trajectories
from smpl.notebooks.live import live_of_model
from smpl.support.arguments import FloatArray, as_count, as_finite, shorten
from smpl.support.compiling import Compilation, Setting, portable, times_of
from smpl.support.drawing import model_as_html, of_model
from smpl.support.files import models_directory
from smpl.support.options import listed

if TYPE_CHECKING:
    from smpl.notebooks.live import Live


@dataclass(frozen=True)
class Port:
    """A port of a component.

    Attributes:
        name: its path, `R1.inlet`.
        connector: name of the connector that it is made of.
        members: for each member of the connector the names of its numbers among `algebraic_names`;
            `algebraic_units` and `env.algebraic` have their units and values.
        equals: for each member the name of the state, action, disturbance, parameter or discrete
            variable that it always is; a member that is computed has none.
    """

    name: str
    connector: str
    members: dict[str, tuple[str, ...]]
    equals: dict[str, str]

    @classmethod
    def of(cls, name: str, connector: str, members: list[tuple[str, list[str], str | None]]) -> Port:
        """The port that the native model describes."""
        equals = {member: equal for member, _, equal in members if equal is not None}
        return cls(name, connector, {member: tuple(numbers) for member, numbers, _ in members}, equals)


class CompileWarning(UserWarning):
    """Warning of the compiler about a probable mistake in a model."""


class Model(Equations, Trajectories):
    """A compiled model; made by `smpl.compile`.

    `y` are the states followed by the algebraic variables that are solved for (`unknown_names`).
    `yp` are their time derivatives, those of algebraic variables ignored, and `u` the actions, all
    in declared units. `p` maps names of parameters, discrete variables and disturbances to values;
    the others have their defaults.

    Attributes:
        name, text: name and describing text of the model.
        time_name, time_unit: the independent variable.
        explicit: whether `rhs` is available.
        delays: the calls of `delay` that the model reads, `delay(T, theta)`; its past is part of
            its state then.
        step: sampling interval in `time_unit`; called as `model.step(x, u)` it takes a control
            step, see `Step`.
        max_steps: time limit in steps.
        reward: the chosen reward; `levels`: observation levels.
        phases: names of the phases of the model's schedule, empty without one.
        ports: the ports of its components by their paths, see `Port`.
        policies: names of the policies that the model declares, see `smpl.Env.policy`.
        warnings: what the compiler warned of, each a `smpl.Diagnostic`.
    """

    def __init__(self, native: _native.Model, arguments: dict[str, Any]) -> None:
        self.native = native
        self._arguments = arguments
        self._take_names(native)
        self.name = native.name
        self.text = native.text
        self.time_name, self.time_unit = native.time_name, native.time_unit
        self.explicit = native.explicit
        self.delays = tuple(native.delays)
        self.step, self.max_steps = Step(native.step), native.max_steps
        self.step.model = self
        self.reward, self.levels = native.reward, tuple(native.levels)
        self.phases = tuple(native.phases)
        self.ports = {name: Port.of(name, connector, members) for name, connector, members in native.ports}
        self.policies = tuple(native.policies)
        self.warnings = tuple(native.warnings)
        self._times = times_of(native.sources)

    def is_stale(self) -> bool:
        """True if a file of the model or of its imports has changed since it was compiled."""
        return self._times != times_of(self._times)

    @property
    def sampling_interval(self) -> float:
        """Length of a control step in `time_unit`."""
        return float(self.step)

    @property
    def parameters(self) -> dict[str, float]:
        """Declared values of the parameters by name; `Env.parameters` has those of an episode."""
        return dict(zip(self.parameter_names, self.native.defaults("parameter").tolist(), strict=True))

    @property
    def action_low(self) -> FloatArray:
        """Lower bounds of the actions."""
        return self.native.bounds("action")[0]

    @property
    def action_high(self) -> FloatArray:
        """Upper bounds of the actions."""
        return self.native.bounds("action")[1]

    @property
    def action_nominal(self) -> FloatArray:
        """Nominal actions, the declared defaults."""
        return self.native.defaults("action")

    @property
    def observation_low(self) -> FloatArray:
        """Lower bounds of the observations."""
        return self.native.bounds("observation")[0]

    @property
    def observation_high(self) -> FloatArray:
        """Upper bounds of the observations."""
        return self.native.bounds("observation")[1]

    @property
    def level(self) -> str:
        """The observation level that the model was compiled with, by its scenario too."""
        return self.native.level

    def __repr__(self) -> str:
        plain = {"observation": "default"}
        given = {name: value for name, value in portable(self._arguments).items() if name not in ("path", "source")}
        chosen = [f", {name}={shorten(value)}" for name, value in given.items() if value and value != plain.get(name)]
        sizes = f"{len(self.state_names)} states, {len(self.action_names)} actions"
        return f"<smpl.Model {self.name}: {sizes}{''.join(chosen)}>"

    def picture(self, show: str | Sequence[str] = ()) -> _native.Picture:
        """At most 200 steps with the nominal policy, as `smpl simulate --plot` draws them.

        Args:
            show: names of quantities, `states`, `actions` and so on; a sensible choice where it is
                empty.

        Raises:
            ValueError: an unknown name.
            SimulationError: the episode cannot begin.
        """
        return of_model(self, show)

    def live(self, *, port: int = 0, browser: bool = True) -> Live:
        """Open the live page on the model, see `smpl.live`.

        Args:
            port: port of 127.0.0.1; 0 picks a free one.
            browser: open the browser; else only the address is returned.

        Raises:
            OSError: the server cannot start, for example because the port is in use.
        """
        return live_of_model(self, port, browser)

    def _repr_html_(self) -> str:
        return model_as_html(self)

    def _repr_svg_(self) -> str:
        return self.picture().svg()

    def __reduce__(self) -> tuple[Any, ...]:
        return _recompile, (portable(self._arguments),)

    # A model never changes: a copy of something that has one shares it.

    def __copy__(self) -> Model:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Model:
        return self

    def variant_of(self, **changes: Any) -> Model:
        """The model compiled with other arguments of `smpl.compile`, as `observation="full"`."""
        return compile(**{**self._arguments, **changes})

    def with_pade(self, order: int) -> Model:
        """The same model with Padé approximations of this order, 1 to 5, of its dead times.

        States of the approximations follow those of the model. The setting `pade` has the same
        effect.

        Raises:
            ValueError: another order.
            CompileError: a delay reads algebraic variables and has no value before the start.
        """
        number = as_count("pade", order, below=6)
        if not self.delays:
            return self
        settings = {**(self._arguments.get("settings") or {}), "pade": number}
        return self._approximations.setdefault(number, self.variant_of(settings=settings))

    @cached_property
    def _approximations(self) -> dict[int, Model]:
        return {}

    def linearize(
        self,
        y: npt.ArrayLike,
        u: npt.ArrayLike,
        p: Mapping[str, float] | None = None,
        *,
        pade: int | None = None,
        minimal: bool = True,
    ) -> Linearization:
        """Linearisation at (y, u) as A, B, C, D; algebraic unknowns are eliminated.

        d(dx)/dt = A dx + B du, dz = C dx + D du with states x, actions u and observations z,
        physical units. Discrete variables and values of other instants (`initial(x)`,
        `previous(x)`, `steady(x)`) are constant as for `residual`; `linearize_step` has the
        derivatives of a whole step, in which they change.

        Args:
            y: unknowns.
            u: actions.
            p: parameters and the like.
            pade: order of the Padé approximations of dead times, 1 to 5; required by a model with
                dead times. The states of the approximations follow those of the model in A, B and
                C (`with_pade(pade).state_names`), and rest at the point.
            minimal: return only free states of a model whose states are projected to constraints,
                `state_names` of the result; otherwise all states, with a mode that decays for each
                constraint.

        Raises:
            SimulationError: the algebraic equations are singular there, or `pade` is missing.
            ValueError: as for `residual`; also if an element of `y` is not finite, or a value of
                `p` exceeds its bounds.

        Example:
            >>> model = smpl.compile("reactor")
            >>> A, B, C, D = model.linearize(model.steady_state([26.85, 0.1]), [26.85, 0.1])
        """
        given = self._given(p)
        point = as_finite("y", y, len(self.unknown_names))
        model = self if pade is None or not self.delays else self.with_pade(pade)
        if model is not self:
            point = model._rested(self, point, u, p)
        *matrices, free = model.native.linearize(point, self._u(u), given, minimal)
        if free is None or not minimal:
            return Linearization(matrices, model.state_names, None)
        return Linearization(matrices, tuple(model.state_names[i] for i in free[0]), free[1])

    def _rested(self, exact: Model, y: FloatArray, u: npt.ArrayLike, p: Mapping[str, float] | None) -> FloatArray:
        """A point with the approximations of dead times at rest, by Newton's method."""
        known = dict(zip(exact.unknown_names, y.tolist(), strict=True))
        point = np.array([known.get(name, 0.0) for name in self.unknown_names])
        free = np.array([name not in exact.state_names for name in self.unknown_names])
        for _ in range(50):
            rows = self.residual(0.0, point, np.zeros(len(point)), u, p)[free]
            matrix = self.jacobian(0.0, point, np.zeros(len(point)), u, 0.0, p).toarray()[free][:, free]
            change = np.linalg.solve(matrix, rows)
            point[free] -= change
            if np.abs(change).max(initial=0.0) <= 1e-12 * np.abs(point[free]).max(initial=1e-300):
                break
        return point


@listed
def compile(
    path: str | os.PathLike[str] | None = None,
    *,
    source: str | None = None,
    scenario: str | os.PathLike[str] | None = None,
    variants: Iterable[str] = (),
    settings: Mapping[str, Setting] | None = None,
    observation: str = "default",
    reward: str | None = None,
    extra: str | None = None,
) -> Model:
    """Compile a model.

    Args:
        path: an `.eq` file, or the name of a shipped model (`reactor`), which goes before a file of
            that name. Also what `smpl compile` wrote (`.smplc`), and what `smpl export --to json`
            wrote (`.json`).
        source: the text of a model instead of a file.
        scenario: name of a scenario of the model, or a YAML file; none is `default`.
        variants: switches (`"reward_floor"`) and choices (`"axial_scheme=legacy"`).
        settings: values of settings and parameters by name, which override random draws. An array
            of parameters is named as a whole, with one value or one for each element, or element by
            element (`"fault[1]"`). Also `rtol`, `one_step_rtol`, `atol_factor`, `max_order`,
            `max_internal_steps` and `linear_solver` of the solver, and `step`, `integrate`,
            `max_steps` and `error_reward` of the episode.
        observation: observation level.
        reward: the reward that `step` returns; the model's default if none.
        extra: statements of the language that follow those of the file, such as `reward full = h /
            1 [m]`: a reward, a constraint, a variant, an observation level. Findings in them name
            `extra` and its line.

    Warns:
        CompileWarning: the compiler has doubts, about a model that is not shipped; `Model.warnings`
        has all of them.

    Raises:
        CompileError: the model is invalid.
        ScenarioError: the scenario, a variant or a setting is invalid.
        FileNotFoundError: there is no such file.
    """
    chosen = Compilation.of(path, source, scenario, variants, settings, (observation, reward, extra))
    model = _compile(chosen, chosen.stamp())
    if model.is_stale():
        _compile.cache_clear()
        model = _compile(chosen, chosen.stamp())
    for found in model.warnings:
        # What the shipped models repeat of publications, faults included, their texts say.
        if Path(found.file).is_relative_to(models_directory()):
            continue
        warnings.warn(f"{found}" + (f" ({found.help})" if found.help else ""), CompileWarning, stacklevel=3)
    return model


@lru_cache(maxsize=32)
def _compile(chosen: Compilation, stamp: tuple[int, ...]) -> Model:
    """Compiles once for each set of arguments; `stamp` distinguishes versions of the files."""
    del stamp
    return Model(chosen.native(), chosen.arguments())


def _recompile(arguments: dict[str, Any]) -> Model:
    return compile(**arguments)
