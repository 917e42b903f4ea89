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
from smpl.analysis.adjoint import EpisodeGradient, gradient
from smpl.analysis.linearization import Linearization
from smpl.analysis.rollout import Rollout, rollout
from smpl.analysis.sensitivity import StepDerivatives, linearize_rollout, linearize_step
from smpl.analysis.step import Step
from smpl.notebooks.live import Live, live_of_model
from smpl.support.arguments import (
    FloatArray,
    as_count,
    as_finite,
    as_finite_number,
    as_mapping,
    as_numbers,
    as_vector,
    check_names,
    expand_parameters,
    pairs_of,
    shorten,
)
from smpl.support.drawing import model_as_html, of_model
from smpl.support.files import is_shipped, model_folders, model_path, models_directory
from smpl.support.names import Named
from smpl.support.optional import load
from smpl.support.options import listed

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

    from smpl.analysis.adjoint import EpisodeGradient
    from smpl.analysis.rollout import Rollout
    from smpl.analysis.sensitivity import StepDerivatives
    from smpl.notebooks.live import Live

Setting = bool | int | float | str | Sequence[float] | FloatArray

# Roles whose values the argument `p` may replace, in the order in which a name is looked up.
_REPLACEABLE = ("parameter", "discrete", "disturbance")


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


class Model(Named):
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
        self._times = _times(native.sources)

    def is_stale(self) -> bool:
        """True if a file of the model or of its imports has changed since it was compiled."""
        return self._times != _times(self._times)

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
        given = {name: value for name, value in _portable(self._arguments).items() if name not in ("path", "source")}
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
        return _recompile, (_portable(self._arguments),)

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

    @cached_property
    def unknown_names(self) -> tuple[str, ...]:
        """Names of the elements of `y`: states, then solved algebraic variables."""
        return (*self.state_names, *self.native.names("solved"))

    def residual(
        self,
        t: float,
        y: npt.ArrayLike,
        yp: npt.ArrayLike,
        u: npt.ArrayLike,
        p: Mapping[str, float] | None = None,
    ) -> FloatArray:
        """Residual: f - y' for differential rows, g for algebraic ones; shape of `y`.

        `initial(x)` and `previous(x)` are x, as at the start of an episode from there (actions at
        their nominal values), `steady(x)` is that of the model's own steady state. So it is for
        `jacobian`, `rhs` and `linearize`.

        Raises:
            ValueError: a wrong shape, a name in `p` that the model does not have, or a value in `u`
                or `p` that is not finite. Elements of `y` and `yp` may be: solvers try such points,
                and see it in the result.
        """
        return self.native.residual(as_finite_number("t", t), self._y(y), self._y(yp, "yp"), self._u(u), self._given(p))

    def jacobian(
        self,
        t: float,
        y: npt.ArrayLike,
        yp: npt.ArrayLike,
        u: npt.ArrayLike,
        cj: float,
        p: Mapping[str, float] | None = None,
    ) -> csc_matrix:
        """Jacobian of the residual, dF/dy + cj dF/dy', as a SciPy matrix in compressed columns.

        Raises:
            ValueError: as for `residual`.
            ImportError: SciPy is missing.
        """
        csc_matrix = load("scipy.sparse", "Model.jacobian").csc_matrix
        data, rows, columns = self.native.jacobian(
            as_finite_number("t", t),
            self._y(y),
            self._y(yp, "yp"),
            self._u(u),
            as_finite_number("cj", cj),
            self._given(p),
        )
        size = len(self.unknown_names)
        return csc_matrix((data, rows, columns), shape=(size, size))

    def rhs(self, t: float, y: npt.ArrayLike, u: npt.ArrayLike, p: Mapping[str, float] | None = None) -> FloatArray:
        """Right-hand side dy/dt of a model that is explicit and has no algebraic unknowns.

        What equations read of other instants is as for `residual`.

        Raises:
            ValueError: as for `residual`; also where the model is not explicit.
        """
        return self.native.rhs(as_finite_number("t", t), self._y(y), self._u(u), self._given(p))

    def steady_state(
        self,
        u: npt.ArrayLike,
        p: Mapping[str, float] | None = None,
        fixed: Mapping[str, float] | None = None,
        guess: Mapping[str, float] | None = None,
    ) -> FloatArray:
        """Steady state at the action `u`: the unknowns `y` with vanishing residual.

        `initial(x)`, `previous(x)` and `steady(x)` are x itself, for other actions than those of
        the `steady` block too. Discrete variables are held at their initial values, or those in
        `p`: updates `at start` and `at end` do not run.

        Args:
            u: actions.
            p: parameters and the like.
            fixed: values of states that the equations leave free, by name; those of the model's
                `steady` block by default.
            guess: where the search begins, states and solved algebraic variables by name
                (`unknown_names`); the others begin at the model's steady state, else where they
                start. It selects one of several steady states.

        Raises:
            ValueError: as for `residual`.
            SimulationError: none was found.
        """
        held = pairs_of("fixed", fixed, self.state_names)
        begin = pairs_of("guess", guess, self.unknown_names)
        return self.native.steady_state(self._u(u), self._given(p), held, begin)

    def trim(
        self,
        fixed: Mapping[str, float],
        free: Sequence[str],
        u: npt.ArrayLike | None = None,
        p: Mapping[str, float] | None = None,
        guess: Mapping[str, float] | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Steady state in which some unknowns have given values and as many actions are found.

        Args:
            fixed: values of states and solved algebraic variables (`unknown_names`), physical
                units.
            free: names of the actions that are found, as many as `fixed` has.
            u: actions; those of `free` are guesses. The nominal ones by default.
            p: parameters and the like.
            guess: initial guess of unknowns by name, as for `steady_state`.

        Returns:
            The unknowns `y` and the actions.

        Raises:
            ValueError: an unknown name, a wrong shape or number of actions.
            SimulationError: none was found.

        Example:
            >>> y, u = smpl.compile("reactor").trim({"h": 0.7}, ["q_out"])
        """
        held = pairs_of("fixed", fixed, self.unknown_names)
        check_names("free", free, self.action_names)
        if len(set(free)) != len(held):
            raise ValueError(f"free has {len(set(free))} actions, fixed has {len(held)} values: they must be as many")
        found = [self.action_names.index(name) for name in dict.fromkeys(free)]
        begin = pairs_of("guess", guess, self.unknown_names)
        given = self.native.defaults("action") if u is None else u
        return self.native.trim(self._u(given), self._given(p), held, found, begin)

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
        given = self._within(self._given(p))
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

    def rollout(
        self,
        states: npt.ArrayLike,
        actions: npt.ArrayLike,
        parameters: Mapping[str, npt.ArrayLike] | None = None,
        discrete: Mapping[str, npt.ArrayLike] | None = None,
        disturbances: Mapping[str, npt.ArrayLike] | None = None,
        seed: int | None = None,
        method: str | None = None,
        threads: int | None = None,
        *,
        first_step: int = 0,
        outputs: bool = False,
    ) -> Rollout:
        """Many trajectories at once, on all cores and without the interpreter lock.

        Each trajectory is an episode from a given state: the same, bit for bit, as steps of an
        `smpl.Env` that was reset to it, for any number of threads.

        Args:
            states: differential states at the start, physical units: (N, states), or (states,) for
                all trajectories.
            actions: physical units: (N, H, actions), or (H, actions) for all trajectories.
            parameters: values by name, one for all trajectories or one for each, shape (N,).
            discrete: discrete variables at the start, likewise.
            disturbances: recorded sequences by name, (H,) for all trajectories or (N, H), or one
                number throughout.
            seed: trajectory i has the random numbers of `reset(seed=seed + i)`. Without one, random
                numbers are at their means and observations without noise: what is expected.
            method: what takes the steps, `ida`, `rosenbrock`, `explicit` or `auto`; the model's or
                scenario's if none.
            threads: all processors if none.
            first_step: steps that count as completed at the start: the clock begins there.
            outputs: also return the algebraic outputs.

        Raises:
            ValueError: an unknown name, a wrong shape, no finite number; the message names the
                argument.
        """
        return rollout(
            self,
            states,
            actions,
            parameters=parameters,
            discrete=discrete,
            disturbances=disturbances,
            seed=seed,
            method=method,
            threads=threads,
            first_step=first_step,
            outputs=outputs,
        )

    def sensitivity(
        self,
        x: npt.ArrayLike,
        u: npt.ArrayLike,
        p: Mapping[str, npt.ArrayLike] | None = None,
        parameters: Iterable[str] = (),
        *,
        method: str | None = None,
        threads: int | None = None,
        first_step: int = 0,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """A control step with its exact derivatives by states, actions and the named parameters.

        Arguments and errors are those of `step`; `linearize_step` has derivatives of rewards and
        observations too.

        Returns:
            `(x_next, dx_dx, dx_du, dx_dp)` of shapes (n,), (n, n), (n, m) and (n, parameters), each
            with a leading axis N if `x` or `u` has points.
        """
        found = self.linearize_step(
            x, u, p, parameters=parameters, method=method, threads=threads, first_step=first_step
        )
        return found.states, found.dx_dx, found.dx_du, found.dx_dp

    def linearize_step(
        self,
        x: npt.ArrayLike,
        u: npt.ArrayLike,
        p: Mapping[str, npt.ArrayLike] | None = None,
        *,
        by: Sequence[str] = ("state", "action"),
        parameters: Iterable[str] = (),
        discrete: Iterable[str] = (),
        disturbances: Iterable[str] = (),
        method: str | None = None,
        threads: int | None = None,
        first_step: int = 0,
    ) -> StepDerivatives:
        """A control step with the exact derivatives of states, rewards and observations.

        Updates and resets at sampling instants are part of the step, and so are events, by their
        jump conditions. A step that has no derivative is refused by the name of the event.

        Args:
            x, u, p, method, threads, first_step: as for `step`.
            by: `"state"`, `"action"`, or both: what else derivatives are taken by.
            parameters: names of parameters, whole arrays too.
            discrete: names of discrete variables, by whose values at the start derivatives are
                taken.
            disturbances: names of disturbances.

        Raises:
            ValueError: as for `step`.
            SimulationError: the step does not come to its end, or has no derivative.
        """
        return linearize_step(
            self,
            x,
            u,
            p,
            by=by,
            parameters=parameters,
            discrete=discrete,
            disturbances=disturbances,
            method=method,
            threads=threads,
            first_step=first_step,
        )

    def linearize_rollout(
        self,
        x: npt.ArrayLike,
        actions: npt.ArrayLike,
        p: Mapping[str, npt.ArrayLike] | None = None,
        *,
        by: Sequence[str] = ("state", "action"),
        parameters: Iterable[str] = (),
        discrete: Iterable[str] = (),
        method: str | None = None,
        threads: int | None = None,
        first_step: int = 0,
    ) -> StepDerivatives:
        """Control steps with the exact derivatives of states, rewards and observations after each.

        Derivatives include the memory of a model: dead times, discrete variables, earlier values.
        The past before the first step is that of a reset to `x`.

        Args:
            x: states at the start, (states,) or (N, states).
            actions: (H, actions) or (N, H, actions), physical units.
            p: parameters and discrete variables by name, as for `step`; disturbances with one value
                per step.
            by: `"state"`, `"action"`, or both. Columns of actions are those of the first step, then
                of the next.
            parameters, discrete, method, threads, first_step: as for `linearize_step`.

        Returns:
            `StepDerivatives` with an axis of H steps: `dx_du` has shape (H, states, H * actions).

        Raises:
            ValueError: as for `step`.
            SimulationError: a step does not come to its end, or has no derivative.

        Example:
            found = model.linearize_rollout(x, actions, parameters=["theta"])
            found.dx_dp[:, 0, 0]    # of the first state after each step by the dead time
        """
        return linearize_rollout(
            self,
            x,
            actions,
            p,
            by=by,
            parameters=parameters,
            discrete=discrete,
            method=method,
            threads=threads,
            first_step=first_step,
        )

    def gradient(
        self,
        x: npt.ArrayLike,
        actions: npt.ArrayLike,
        p: Mapping[str, npt.ArrayLike] | None = None,
        *,
        reward: str | None = None,
        final: npt.ArrayLike | None = None,
        discount: float = 1.0,
        parameters: Iterable[str] = (),
        method: str | None = None,
        threads: int | None = None,
        first_step: int = 0,
    ) -> EpisodeGradient:
        """The value of an episode with its exact derivatives by start, actions and parameters.

        The value is the sum of the reward, each step's multiplied by another `discount`, and of
        `final` times the last states. Derivatives of the steps are accumulated backwards in time.

        Args:
            x: states at the start, (states,), or (N, states) for N episodes on all cores.
            actions: (steps, actions) or (N, steps, actions).
            p, method, threads, first_step: as for `step`, for all steps.
            reward: its name; the model's chosen one if none.
            final: what each of the last states is worth, (states,).
            discount: from 0 to 1.
            parameters: names of parameters, whole arrays too.

        Raises:
            ValueError: as for `step`; or the model remembers more than its states, so that an
                episode is not a chain of steps.
            SimulationError: the episode ends early, or a step has no derivative.
        """
        return gradient(
            self,
            x,
            actions,
            p,
            reward=reward,
            final=final,
            discount=discount,
            parameters=parameters,
            method=method,
            threads=threads,
            first_step=first_step,
        )

    def _y(self, values: npt.ArrayLike, name: str = "y") -> FloatArray:
        return as_vector(name, values, len(self.unknown_names))

    def _u(self, values: npt.ArrayLike) -> FloatArray:
        return as_finite("u", values, len(self.action_names))

    @cached_property
    def _replaceable(self) -> dict[str, tuple[str, int]]:
        places: dict[str, tuple[str, int]] = {}
        for role in _REPLACEABLE:
            for index, name in enumerate(self.native.names(role)):
                places.setdefault(name, (role, index))
        return places

    def _given(self, p: Mapping[str, float] | None) -> list[tuple[str, int, float]]:
        p = as_mapping("p", p)
        if not p:
            return []
        arrays = [name for name in p if name not in self._replaceable and self.native.elements_of(name)]
        values = {name: value for name, value in p.items() if name not in arrays}
        check_names("p", values, self._replaceable)
        expanded = expand_parameters("p", self, {name: p[name] for name in arrays})
        return [
            (*self._replaceable[name], as_finite_number(f"p[{name!r}]", value))
            for name, value in (expanded | values).items()
        ]

    def _within(self, given: list[tuple[str, int, float]]) -> list[tuple[str, int, float]]:
        """Values of discrete variables and disturbances, refused out of bounds like parameters."""
        for role, index, value in given:
            low, high = (float(bound[index]) for bound in self.native.bounds(role))
            if role != "parameter" and not low <= value <= high:
                name = self.native.names(role)[index]
                raise ValueError(f"p[{name!r}] is {value:g}, which is outside its bounds {low:g}..{high:g}")
        return given


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
    if (path is None) == (source is None):
        raise ValueError("give either the path of a model or its source")
    if extra is not None and not isinstance(extra, str):
        raise ValueError(f"extra is {shorten(extra)}, expected statements of the language as a text")
    arguments = (
        None if path is None else _resolve(_path("path", path)),
        source,
        None if scenario is None else _path("scenario", scenario),
        as_variants(variants),
        tuple(sorted((name, _text(name, value)) for name, value in as_mapping("settings", settings).items())),
        observation,
        reward,
        extra,
    )
    stamp = _stamp(arguments[0], arguments[2])
    model = _compile(*arguments, stamp)
    if model.is_stale():
        _compile.cache_clear()
        model = _compile(*arguments, stamp)
    for found in model.warnings:
        # What the shipped models repeat of publications, faults included, their texts say.
        if Path(found.file).is_relative_to(models_directory()):
            continue
        warnings.warn(f"{found}" + (f" ({found.help})" if found.help else ""), CompileWarning, stacklevel=3)
    return model


@lru_cache(maxsize=32)
def _compile(
    path: str | None,
    source: str | None,
    scenario: str | None,
    variants: tuple[str, ...],
    settings: tuple[tuple[str, str], ...],
    observation: str,
    reward: str | None,
    extra: str | None,
    stamp: tuple[int, ...],
) -> Model:
    """Compiles once for each set of arguments; `stamp` distinguishes versions of the files."""
    del stamp
    try:
        native = _native.Model(path, source, scenario, variants, dict(settings), observation, reward, extra)
    except _native.ScenarioError as error:
        _, found, rest = str(error).partition(f"unknown reward `{reward}`")
        if found:
            raise _native.ScenarioError(f"argument `reward`: {found}{rest}") from None
        raise
    arguments: dict[str, Any] = {
        "path": path,
        "source": source,
        "scenario": scenario,
        "variants": variants,
        "settings": dict(settings),
        "observation": observation,
        "reward": reward,
        # Omitted without a value: the arguments are part of a task's checksum.
        **({} if extra is None else {"extra": extra}),
    }
    return Model(native, arguments)


def _recompile(arguments: dict[str, Any]) -> Model:
    return compile(**arguments)


def _portable(arguments: dict[str, Any]) -> dict[str, Any]:
    """Arguments for other processes: names of shipped models, absolute paths of other files."""
    path, scenario = arguments["path"], arguments["scenario"]
    if path is not None:
        shipped = Path(path).parent in model_folders() and Path(path).suffix == ".eq"
        path = Path(path).stem if shipped else str(Path(path).absolute())
    if scenario is not None and Path(scenario).suffix in (".yaml", ".yml"):
        scenario = str(Path(scenario).absolute())
    return {**arguments, "path": path, "scenario": scenario}


def _path(name: str, value: Any) -> str:
    """The text of a path, or of a name.

    Raises:
        ValueError: it is neither.
    """
    if not isinstance(value, (str, os.PathLike)) or not isinstance(os.fspath(value), str):
        raise ValueError(f"{name} is {shorten(value)}, expected a name or a path")
    return str(os.fspath(value))


def as_variants(given: Any) -> tuple[str, ...]:
    """Variants one by one.

    Raises:
        ValueError: they are not texts.
    """
    if isinstance(given, str):
        return (given,)
    variants = tuple(given) if isinstance(given, Iterable) else (given,)
    if not all(isinstance(variant, str) for variant in variants):
        raise ValueError(f"variants is {shorten(given)}, expected names such as 'reward_floor' or 'scheme=legacy'")
    return variants


def _resolve(path: str | os.PathLike[str]) -> str:
    text = os.fspath(path)
    if isinstance(path, str) and (is_shipped(text) or (text.isidentifier() and not Path(text).exists())):
        return str(model_path(text))
    if not Path(text).exists() and text.startswith("smpl/"):
        raise FileNotFoundError(f"{text!r} is the id of an environment: gymnasium.make({text!r}) makes it")
    return text


def _stamp(path: str | None, scenario: str | None) -> tuple[int, ...]:
    """Times of change of the files next to the model, so that an edited file is compiled again."""
    if path is None:
        return ()
    folder = Path(path).parent
    files = [*folder.glob("*.eq"), *folder.glob("*.yaml"), *(folder / "lib").glob("*.eq")]
    if Path(path).suffix != ".eq" and Path(path).is_file():
        files.append(Path(path))
    if scenario is not None and Path(scenario).is_file():
        files.append(Path(scenario))
    return tuple(file.stat().st_mtime_ns for file in sorted(files))


def _times(files: Iterable[str]) -> dict[str, int]:
    """Times of change of those that are files."""
    return {file: Path(file).stat().st_mtime_ns for file in files if Path(file).is_file()}


def _text(name: str, value: Setting) -> str:
    """A setting as the command line would write it.

    Raises:
        ScenarioError: it is not a setting.
    """
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (int, np.integer, str)):
        return str(value)
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    what = f"settings[{name!r}]"
    if isinstance(value, (Sequence, np.ndarray)):
        try:
            numbers = as_numbers(what, value, "(elements,)")
        except ValueError as error:
            raise _native.ScenarioError(str(error)) from error
        if numbers.ndim == 1:
            return f"[{', '.join(map(repr, numbers.tolist()))}]"
    raise _native.ScenarioError(f"{what} is {shorten(value)}, expected a number, numbers, True, False or a text")
