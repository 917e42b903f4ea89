"""Control steps and their derivatives, see `Model.step`, `sensitivity` and `linearize_step`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from smpl import _native
from smpl.analysis.rollout import _common, _each, _flattened, _rows, _threads, check_first_step, rollout
from smpl.support.arguments import FloatArray, as_mapping, as_numbers, check_method, check_names

if TYPE_CHECKING:
    from smpl.model import Model

# What derivatives are taken by, in the order of their columns.
ROLES = ("state", "action", "parameter", "discrete", "disturbance")

_NAMES = {
    "state": "state_names",
    "action": "action_names",
    "parameter": "parameter_names",
    "discrete": "discrete_names",
    "disturbance": "disturbance_names",
}

# Kinds of failures, see `Rollout.failure_kind`, that keep a step from its end.
_CUT = ("start", "solver", "events", "event", "not_finite")


@dataclass(frozen=True)
class StepDerivatives:
    """A control step with its exact derivatives; with N points every array has a leading axis N.

    Derivatives are named `d<of>_d<by>`: `dr_du` has shape (rewards, actions). They are those of
    states after the step (`dx`), rewards (`dr`) and observations (`dy`) by states (`dx`), actions
    (`du`), parameters (`dp`), discrete variables (`dd`) and disturbances (`dw`). Derivatives of a
    rollout have an axis of H steps after N and before the others; columns of actions are
    `NAME@STEP`.

    Attributes:
        states: states after the step, (states,).
        rewards: all rewards in the order of `Model.reward_names`; the error reward where the step
            fails.
        observations: what is measured after the step, (observations,): without noise, delay,
            sampling or clipping.
        by: names of what derivatives are taken by, for each role.
        derivatives: of states, rewards and observations, each with a column for every name in `by`,
            roles one after the other.
    """

    states: FloatArray
    rewards: FloatArray
    observations: FloatArray
    by: Mapping[str, tuple[str, ...]]
    derivatives: tuple[FloatArray, FloatArray, FloatArray] = field(repr=False)

    def _part(self, of: int, role: str) -> FloatArray:
        first = sum(len(self.by[other]) for other in ROLES[: ROLES.index(role)])
        part: FloatArray = self.derivatives[of][..., first : first + len(self.by[role])]
        return part

    @cached_property
    def dx_dx(self) -> FloatArray:
        """Of states by states."""
        return self._part(0, "state")

    @cached_property
    def dx_du(self) -> FloatArray:
        """Of states by actions."""
        return self._part(0, "action")

    @cached_property
    def dx_dp(self) -> FloatArray:
        """Of states by parameters."""
        return self._part(0, "parameter")

    @cached_property
    def dx_dd(self) -> FloatArray:
        """Of states by discrete variables at the start."""
        return self._part(0, "discrete")

    @cached_property
    def dx_dw(self) -> FloatArray:
        """Of states by disturbances."""
        return self._part(0, "disturbance")

    @cached_property
    def dr_dx(self) -> FloatArray:
        """Of rewards by states."""
        return self._part(1, "state")

    @cached_property
    def dr_du(self) -> FloatArray:
        """Of rewards by actions."""
        return self._part(1, "action")

    @cached_property
    def dr_dp(self) -> FloatArray:
        """Of rewards by parameters."""
        return self._part(1, "parameter")

    @cached_property
    def dr_dd(self) -> FloatArray:
        """Of rewards by discrete variables at the start."""
        return self._part(1, "discrete")

    @cached_property
    def dr_dw(self) -> FloatArray:
        """Of rewards by disturbances."""
        return self._part(1, "disturbance")

    @cached_property
    def dy_dx(self) -> FloatArray:
        """Of observations by states."""
        return self._part(2, "state")

    @cached_property
    def dy_du(self) -> FloatArray:
        """Of observations by actions."""
        return self._part(2, "action")

    @cached_property
    def dy_dp(self) -> FloatArray:
        """Of observations by parameters."""
        return self._part(2, "parameter")

    @cached_property
    def dy_dd(self) -> FloatArray:
        """Of observations by discrete variables at the start."""
        return self._part(2, "discrete")

    @cached_property
    def dy_dw(self) -> FloatArray:
        """Of observations by disturbances."""
        return self._part(2, "disturbance")


def step(
    model: Model,
    x: npt.ArrayLike,
    u: npt.ArrayLike,
    p: Mapping[str, npt.ArrayLike] | None = None,
    *,
    method: str | None = None,
    threads: int | None = None,
    first_step: int = 0,
) -> FloatArray:
    """States after a control step, see `Model.step`."""
    states, actions, count, single = _points(model, x, u)
    parameters, discrete, disturbances = _split(model, p)
    reached = rollout(
        model,
        states,
        actions[..., np.newaxis, :],
        parameters=parameters,
        discrete=discrete,
        disturbances={name: _sequence(value, count) for name, value in disturbances.items()},
        method=method,
        threads=threads,
        first_step=first_step,
    )
    for index, kind in enumerate(reached.failure_kind):
        if kind in _CUT:
            raise _native.SimulationError(f"point {index}: {reached.failure[index]}")
    after: FloatArray = reached.states[:, 1]
    return after[0] if single else after


def linearize_step(
    model: Model,
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
    """A control step with its derivatives, see `Model.linearize_step`."""
    states, actions, count, single = _points(model, x, u)
    names = _directions(model, by, {"parameter": parameters, "discrete": discrete, "disturbance": disturbances})
    found = _linearized(
        model, states, actions, _split(model, p), names, (count, check_first_step(first_step, 1), 1), method, threads
    )
    return _derivatives(names, [array[0] if single else array for array in found])


def linearize_rollout(
    model: Model,
    x: npt.ArrayLike,
    actions: npt.ArrayLike,
    p: Mapping[str, npt.ArrayLike] | None = None,
    *,
    by: Sequence[str] = ("state", "action"),
    actions_by: Iterable[str] | None = None,
    parameters: Iterable[str] = (),
    discrete: Iterable[str] = (),
    method: str | None = None,
    threads: int | None = None,
    first_step: int = 0,
) -> StepDerivatives:
    """Several control steps with their derivatives, see `Model.linearize_rollout`.

    `actions_by` has the names of the actions that derivatives are taken by; all by default.
    """
    states = _rows("x", x, len(model.state_names), 1)
    plan = _rows("actions", actions, len(model.action_names), 2)
    if not np.isfinite(plan).all():
        bad = np.argwhere(~np.isfinite(plan))[0]
        raise ValueError(f"actions{bad.tolist()} is {plan[tuple(bad)]}, expected a finite number")
    single, horizon = states.ndim == 1 and plan.ndim == 2, plan.shape[-2]
    count = _common(len(plan) if plan.ndim == 3 else 1, len(states) if states.ndim == 2 else 1)
    size = (count, check_first_step(first_step, horizon), horizon)
    named = {"parameter": parameters, "discrete": discrete, "disturbance": ()}
    names = _directions(model, by, named)
    chosen = names["action"]
    if actions_by is not None:
        chosen = tuple(actions_by)
        check_names("actions_by", chosen, model.action_names)
    names["action"] = tuple(f"{name}@{k}" for k in range(horizon) for name in chosen)
    found = _linearized(model, states, plan, _split(model, p), names, size, method, threads)
    rows = [array.reshape(count, horizon, *array.shape[1:]) for array in found]
    return _derivatives(names, [array[0] if single else array for array in rows])


def _linearized(
    model: Model,
    states: FloatArray,
    actions: FloatArray,
    given: tuple[dict[str, npt.ArrayLike], ...],
    names: Mapping[str, tuple[str, ...]],
    size: tuple[int, int, int],
    method: str | None,
    threads: int | None,
) -> Sequence[FloatArray]:
    """Values and derivatives, a row per step; `size` is (points, completed steps, steps)."""
    count, _, horizon = size
    chosen = [(role, _place(model, role, name)) for role in ROLES for name in names[role]]
    tasks = count * (1 + len(chosen) * len(model.state_names) // 100_000)
    found: Sequence[FloatArray] = model.native.sensitivity(
        states,
        actions,
        _each("p", _flattened(model, given[0], count), count),
        _each("p", given[1], count),
        _each("p", given[2], count) if horizon == 1 else _each("p", given[2], count, horizon),
        size,
        (chosen, min(_threads(threads), tasks), None, check_method(method)),
    )
    return found


def _place(model: Model, role: str, name: str) -> int:
    """Number of a quantity in its role; actions of later steps follow those of the first one."""
    places: tuple[str, ...] = getattr(model, _NAMES[role])
    base, _, step = name.rpartition("@")
    return int(step) * len(places) + places.index(base) if role == "action" and base else places.index(name)


def _derivatives(names: Mapping[str, tuple[str, ...]], values: Sequence[FloatArray]) -> StepDerivatives:
    return StepDerivatives(values[0], values[1], values[2], names, (values[3], values[4], values[5]))


def _points(model: Model, x: npt.ArrayLike, u: npt.ArrayLike) -> tuple[FloatArray, FloatArray, int, bool]:
    states = _rows("x", x, len(model.state_names), 1)
    actions = _rows("u", u, len(model.action_names), 1)
    bad = np.argwhere(~np.isfinite(actions))
    if len(bad):
        raise ValueError(f"u{bad[0].tolist()} is {actions[tuple(bad[0])]}, expected a finite number")
    single = states.ndim == 1 and actions.ndim == 1
    count = _common(len(actions) if actions.ndim == 2 else 1, len(states) if states.ndim == 2 else 1)
    return states, actions, count, single


def _split(model: Model, p: Mapping[str, npt.ArrayLike] | None) -> tuple[dict[str, npt.ArrayLike], ...]:
    """Values by what they belong to: parameters, discrete variables, disturbances."""
    parts: tuple[dict[str, npt.ArrayLike], ...] = ({}, {}, {})
    known = (model.parameter_names, model.discrete_names, model.disturbance_names)
    for name, value in as_mapping("p", p).items():
        places = [at for at, names in enumerate(known) if name in names]
        if not places and not (isinstance(name, str) and model.native.elements_of(name)):
            check_names("p", [name], [other for names in known for other in names])
        if not np.isfinite(as_numbers(f"p[{name!r}]", value, "() or (N,)")).all():
            raise ValueError(f"p[{name!r}] has a value that is not finite")
        parts[places[0] if places else 0][name] = value
    return parts


def _sequence(value: npt.ArrayLike, count: int) -> npt.ArrayLike:
    """A disturbance of one step, for all points or for each."""
    array = np.asarray(value, dtype=float)
    return array.reshape(-1, 1) if array.shape == (count,) and count > 1 else array


def _directions(model: Model, by: Sequence[str], named: Mapping[str, Iterable[str]]) -> dict[str, tuple[str, ...]]:
    roles = (by,) if isinstance(by, str) else tuple(by)
    for role in roles:
        if role not in ("state", "action"):
            raise ValueError(f"by has {role!r}, expected 'state', 'action' or both; others are given by name")
    names = {role: tuple(getattr(model, _NAMES[role])) if role in roles else () for role in ("state", "action")}
    for role, given in named.items():
        chosen = (given,) if isinstance(given, str) else tuple(given)
        known = getattr(model, _NAMES[role])
        argument = {"parameter": "parameters", "discrete": "discrete", "disturbance": "disturbances"}[role]
        if role == "parameter":
            # A whole array is all of its elements.
            whole = [[name] if name in known else model.native.elements_of(name) or [name] for name in chosen]
            chosen = tuple(name for part in whole for name in part)
        check_names(argument, chosen, known)
        names[role] = chosen
    return names


__all__ = ["StepDerivatives", "linearize_rollout", "linearize_step", "step"]
