"""Many trajectories of a model at once, see `smpl.Model.rollout`."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from smpl import _native
from smpl.support.arguments import COUNTS, FloatArray, as_count, as_numbers, check_limit, check_method, check_names
from smpl.support.seeds import SEEDS, SeedError, check_seed, native_seed

if TYPE_CHECKING:
    from smpl.model import Model

Named = list[tuple[str, FloatArray]]


@dataclass(frozen=True)
class Rollout:
    """N trajectories of at most H steps, physical units.

    A trajectory that has ended keeps its last states, observations and outputs; its rewards, costs
    and violations are 0 from there on. A trajectory without a consistent start has NaN instead of
    states, no steps, and a failure that begins with `start`.

    Attributes:
        states: shape (N, H + 1, states); index 0 is the start.
        observations: (N, H + 1, observations), clipped to their boxes as an environment's are.
        outputs: algebraic outputs in the order of `Model.algebraic_names`, (N, H + 1, outputs);
            none unless asked for.
        rewards: the model's chosen reward, (N, H).
        cost: sum of the violations, (N, H).
        violations: (N, H, constraints), in the order of `constraint_names`.
        steps: steps taken, the ending one included, (N,).
        terminated: ended by a failure or a success, (N,).
        truncated: ended by the time limit, (N,).
        failure: N messages, empty where nothing failed.
        failure_kind: N causes as data: `""` (none), `"start"` (no consistent start), `"solver"`
            (the integration failed), `"events"` (events without end), or `"event"` (a declared
            failure within a step). After a step: `"not_finite"`, `"action_box"`, `"box"`,
            `"condition"`. If there are several, the first of this order.
        failure_name: N names of the declared failures of the kinds `"event"`, `"box"`,
            `"condition"`; otherwise empty.
        constraint_names: names of the limits.
        instant_states: states at the instants within steps that were asked for, (N, instants,
            states); NaN where a trajectory does not get there.
        measured: measurements there, (N, instants, observations), without noise, sampling, delay or
            clipping.
    """

    states: FloatArray
    observations: FloatArray
    outputs: FloatArray | None
    rewards: FloatArray
    cost: FloatArray
    violations: FloatArray
    steps: npt.NDArray[np.uint32]
    terminated: npt.NDArray[np.bool_]
    truncated: npt.NDArray[np.bool_]
    failure: list[str]
    failure_kind: list[str]
    failure_name: list[str]
    constraint_names: tuple[str, ...]
    instant_states: FloatArray
    measured: FloatArray

    def __len__(self) -> int:
        """Number of trajectories."""
        return len(self.steps)

    @property
    def returns(self) -> FloatArray:
        """Sum of the rewards of each trajectory, (N,)."""
        return self.rewards.sum(axis=1)


def rollout(
    model: Model,
    start: npt.ArrayLike | _native.Snapshot,
    actions: npt.ArrayLike,
    *,
    parameters: Mapping[str, npt.ArrayLike] | None = None,
    discrete: Mapping[str, npt.ArrayLike] | None = None,
    disturbances: Mapping[str, npt.ArrayLike] | None = None,
    seed: int | None = None,
    method: str | None = None,
    threads: int | None = None,
    first_step: int = 0,
    outputs: bool = False,
    max_steps: int | None = None,
    instants: Sequence[tuple[int, float]] = (),
    history: Mapping[str, npt.ArrayLike] | None = None,
) -> Rollout:
    """Trajectories from states or from a snapshot, see `Model.rollout` and `Env.rollout`.

    `instants` are places within steps at which states and measurements are returned too: the step,
    from 0, and the share of it, from 0 to 1.
    """
    given = _seed(seed)
    chosen = _rows("actions", actions, len(model.action_names), 2)
    count, horizon = len(chosen) if chosen.ndim == 3 else 1, chosen.shape[-2]
    origin: FloatArray | _native.Snapshot
    if isinstance(start, _native.Snapshot):
        origin = start
    else:
        origin = _rows("states", start, len(model.state_names), 1)
        count = _common(count, len(origin) if origin.ndim == 2 else 1)
    if seed is not None and count > 1 and int(seed) + count > SEEDS:
        raise SeedError(f"seed is {seed}, expected at most 2**64 - {count} for {count} trajectories")
    result = model.native.rollout(
        origin,
        chosen,
        _each("parameters", _flattened(model, parameters or {}, count), count),
        _each("discrete", _known("discrete", discrete or {}, model.discrete_names), count),
        _each("disturbances", _known("disturbances", disturbances or {}, model.disturbance_names), count, horizon),
        (count, horizon),
        (given, check_first_step(first_step, horizon), bool(outputs), list(instants), _history(model, history)),
        (min(_threads(threads), count), check_limit(max_steps), check_method(method)),
    )
    reached, observed, algebraic, rewards, cost, violations, steps, terminated, truncated = result[:9]
    failure, (kinds, names), (instant_states, measured) = result[9:]
    return Rollout(
        states=reached,
        observations=observed,
        outputs=algebraic if outputs else None,
        rewards=rewards,
        cost=cost,
        violations=violations,
        steps=steps,
        terminated=terminated,
        truncated=truncated,
        failure=failure,
        failure_kind=kinds,
        failure_name=names,
        constraint_names=tuple(model.native.constraint_names),
        instant_states=instant_states,
        measured=measured,
    )


def _history(
    model: Model, given: Mapping[str, npt.ArrayLike] | None
) -> tuple[list[float], list[float], list[float]] | None:
    """Times, states and actions before the start, row after row; empty if absent."""
    if given is None:
        return None
    known = _known("history", given, ("states", "actions", "times"))
    widths = {"states": len(model.state_names), "actions": len(model.action_names)}
    arrays = {name: _samples(f"history[{name!r}]", known[name], widths[name]) for name in widths if name in known}
    lengths = sorted({len(array) for array in arrays.values()})
    if not arrays:
        raise ValueError("history has neither states nor actions, expected one of them or both")
    if "times" in known:
        times = as_numbers("history['times']", known["times"], f"({lengths[0]},)")
        lengths = sorted({*lengths, len(times) if times.ndim == 1 else 0})
    else:
        times = model.sampling_interval * np.arange(-lengths[0], 0.0)
    if len(lengths) > 1:
        raise ValueError(f"history has arrays of lengths {', '.join(map(str, lengths))}, expected one length")
    states, actions = (arrays[name].ravel().tolist() if name in arrays else [] for name in ("states", "actions"))
    return times.tolist(), states, actions


def _samples(what: str, values: npt.ArrayLike, width: int) -> FloatArray:
    array = as_numbers(what, values, f"(k, {width})")
    if array.ndim != 2 or array.shape[1] != width or not len(array):
        raise ValueError(f"{what} has shape {array.shape}, expected (k, {width})")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{what} has a value that is not finite")
    return array


def _common(actions: int, states: int) -> int:
    if actions != states and actions > 1 and states > 1:
        raise ValueError(f"states has {states} trajectories, expected {actions} as actions has, or one for all")
    return max(actions, states)


def _seed(seed: int | None) -> int | None:
    given = check_seed(seed)
    return None if given is None else native_seed(given)


def _threads(threads: int | None) -> int:
    if threads is None:
        return os.cpu_count() or 1
    expected = "a positive integer, or 0 or None for all processors"
    return as_count("threads", threads, 0, expected, COUNTS) or os.cpu_count() or 1


def check_first_step(first_step: int, steps: int) -> int:
    """The number of completed steps, with so many behind it.

    Raises:
        ValueError: it is not a number of steps, or too large.
    """
    return as_count("first_step", first_step, 0, "a number of completed steps, 0 or more", COUNTS - steps)


def _rows(name: str, values: Any, width: int, single: int) -> FloatArray:
    """An array with `width` entries on its last axis and `single` axes, or one more axis."""
    shape = ("N, H, " if single == 2 else "N, ") + str(width)
    one = f"H, {width}" if single == 2 else f"{width},"
    array = as_numbers(name, values, f"({shape}) or ({one})")
    if array.ndim not in (single, single + 1) or array.shape[-1] != width or 0 in array.shape[:-1]:
        raise ValueError(f"{name} has shape {array.shape}, expected ({shape}) or ({one})")
    bad = np.argwhere(np.isnan(array) if name == "actions" else ~np.isfinite(array))
    if len(bad):
        raise ValueError(
            f"{name}{bad[0].tolist()} is {array[tuple(bad[0])]}, expected a {'finite ' * (name != 'actions')}number"
        )
    return array


def _known(argument: str, given: Mapping[str, npt.ArrayLike], names: tuple[str, ...]) -> Mapping[str, npt.ArrayLike]:
    if not isinstance(given, Mapping):
        raise ValueError(f"{argument} must be a mapping from names to values, got {type(given).__name__}")
    check_names(argument, given, names)
    return given


def _flattened(model: Model, given: Mapping[str, npt.ArrayLike], count: int) -> dict[str, npt.ArrayLike]:
    """Parameters by flattened names, for all trajectories or with a row for each."""
    if not isinstance(given, Mapping):
        raise ValueError(f"parameters must be a mapping from names to values, got {type(given).__name__}")
    columns: list[Sequence[npt.ArrayLike]] = []
    for name, value in given.items():
        size = len(model.native.elements_of(name)) if isinstance(name, str) else 0
        if name in model.parameter_names or not size:
            check_names("parameters", [name], model.parameter_names)
            columns.append([value])
            continue
        what = f"parameters[{name!r}]"
        array = as_numbers(what, value, f"({size},) or ({count}, {size})")
        if array.ndim and array.shape not in ((size,), (count, size)):
            raise ValueError(f"{what} has shape {array.shape}, expected (), ({size},) or ({count}, {size})")
        columns.append(list(np.broadcast_to(array, (count if array.ndim == 2 else 1, size)).T))
    determined = model.native.determined(list(given))
    return {element: columns[at][place] for element, at, place in determined}


def _each(argument: str, given: Mapping[str, npt.ArrayLike], count: int, horizon: int | None = None) -> Named:
    """One value for all trajectories or one for each; with a horizon, one a step."""
    pairs: Named = []
    for name, value in given.items():
        what = f"{argument}[{name!r}]"
        shapes: tuple[tuple[int, ...], ...] = (
            ((), (1,), (count,)) if horizon is None else ((), (horizon,), (count, horizon))
        )
        expected = " or ".join(map(str, dict.fromkeys(shapes)))
        array = as_numbers(what, value, expected)
        if np.ndim(value) == 0:
            array = array.reshape(())
        if array.shape not in shapes:
            raise ValueError(f"{what} has shape {array.shape}, expected {expected}")
        if not np.all(np.isfinite(array)):
            raise ValueError(f"{what} has a value that is not finite")
        if horizon is not None and array.ndim == 0:
            array = np.full(horizon, float(array))
        pairs.append((name, np.atleast_1d(array)))
    return pairs
