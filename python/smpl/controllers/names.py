"""Measurements, actions and operating points by their names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from smpl._native import SimulationError
from smpl.envs import Env
from smpl.model import Model
from smpl.support.arguments import FloatArray, as_mapping, as_number
from smpl.support.names import listing


@dataclass(frozen=True)
class Measured:
    """A quantity that a controller looks at: position and unit of an observation or a state."""

    name: str
    unit: str
    index: int
    of_state: bool

    def value(self, env: Env) -> float:
        """Its present value in physical units."""
        return float((env.state if self.of_state else env.reading)[self.index])

    def steady(self, env: Env) -> float:
        """Its value at the environment's steady state.

        Raises:
            ValueError: the model has none, so that a set-point must be given.
        """
        state = env.steady_state
        if state is None:
            raise ValueError(f"{env.model.name} has no steady state: give set_point for {self.name} [{self.unit}]")
        states = state[: len(env.state_names)]
        if self.of_state:
            return float(states[self.index])
        action = env.steady_action
        found = env.model.rollout(states, np.atleast_2d(action if action is not None else operating_action(env)))
        return float(found.observations[0, 0, self.index])


def measured(env: Env, name: str, sees: str) -> Measured:
    """The observation or state of a name.

    Raises:
        ValueError: unknown name; the message lists the valid ones with their units.
    """
    if sees not in ("observation", "state"):
        raise ValueError(f"sees is {sees!r}, expected 'observation' or 'state'")
    names, units = (
        (env.state_names, env.state_units) if sees == "state" else (env.observation_names, env.observation_units)
    )
    if name in names:
        index = names.index(name)
        return Measured(name, units[index], index, sees == "state")
    level = env.model.level
    hint = ""
    if sees == "observation" and name in env.state_names:
        hint = f" {name} is a state that the level {level!r} does not show: sees='state' looks at it all the same."
    where = f"the level {level!r} of {env.model.name}" if sees == "observation" else f"the states of {env.model.name}"
    raise ValueError(f"measurement {name!r} is not in {where}.{hint} There are: {listing(names, units)}")


def action_index(model: Model, name: str) -> int:
    """Position of an action.

    Raises:
        ValueError: unknown name.
    """
    if name not in model.action_names:
        raise ValueError(
            f"action {name!r} is not one of {model.name}; there are: {listing(model.action_names, model.action_units)}"
        )
    return model.action_names.index(name)


def operating_action(env: Env) -> FloatArray:
    """The action of the steady state, where there is one, else the declared defaults."""
    try:
        action = env.steady_action
    except SimulationError:
        action = None
    return env.model.native.defaults("action") if action is None else np.array(action)


def operating_point(
    model: Model, at: tuple[Any, Any] | None = None, p: Mapping[str, float] | None = None
) -> tuple[FloatArray, FloatArray]:
    """Unknowns y and actions u where a model is linearised.

    Args:
        model: the model.
        at: (y, u), y the unknowns, or the states of a model without algebraic unknowns. None for
            its steady state at the action of its `steady` block, else at the declared actions.
        p: parameters and the like.
    """
    if at is not None:
        y, u = (np.asarray(part, dtype=np.float64) for part in at)
        return y, u
    env = Env(model, normalize=False)
    env.reset(seed=0, options={"start": "nominal"})
    action = operating_action(env)
    try:
        return model.steady_state(action, p), action
    except SimulationError as error:
        raise SimulationError(f"{model.name} has no steady state to linearise at: give at=(y, u) ({error})") from error


# Most states of a model that is linearised only to look at a sign.
_MOST_STATES = 200


def slow_gain(model: Model, action: int, measurement: Measured) -> float:
    """Change of a measurement by a slow change of an action, per unit, at the model's steady state.

    It is the real gain at a frequency far below the poles, large where the process integrates. 0
    where the model has no steady state, where that is unstable, so that the sign of a loop does not
    follow from it, and for large models.
    """
    n = len(model.state_names)
    if n > _MOST_STATES:
        return 0.0
    try:
        A, B, C, D = model.linearize(*operating_point(model), minimal=False)
    except (SimulationError, ValueError):
        return 0.0
    row = np.eye(n)[measurement.index] if measurement.of_state else C[measurement.index]
    direct = 0.0 if measurement.of_state else float(D[measurement.index, action])
    poles = np.linalg.eigvals(A)
    if not np.isfinite(poles).all():
        return 0.0
    size = np.abs(poles).max(initial=0.0) or 1.0
    if (poles.real > 1e-9 * size).any():
        return 0.0
    slow = 1e-6 * min(size, *(np.abs(poles[np.abs(poles) > 1e-9 * size])), 1 / model.step)
    try:
        found = float(row @ np.linalg.solve(slow * np.eye(n) - A, B[:, action])) + direct
    except np.linalg.LinAlgError:
        return 0.0
    # Rounding of the sums is not a gain.
    scale = float(
        np.abs(row) @ np.abs(np.linalg.solve(slow * np.eye(n) - A, np.diag(np.abs(B[:, action])))).sum(axis=1)
    )
    return found if abs(found) > 1e-9 * (scale + abs(direct)) else 0.0


def weights(argument: str, given: Any, names: tuple[str, ...], units: tuple[str, ...]) -> FloatArray | None:
    """Weights by names, as a vector; names that are left out weigh nothing.

    Raises:
        ValueError: an unknown name, or a negative weight.
    """
    if given is None:
        return None
    wanted = as_mapping(argument, given)
    wrong = [name for name in wanted if name not in names]
    if wrong:
        raise ValueError(f"{argument}: unknown {', '.join(map(repr, wrong))}; there are: {listing(names, units)}")
    found = np.array([as_number(f"{argument}[{name!r}]", wanted.get(name, 0.0)) for name in names])
    if not (np.isfinite(found).all() and (found >= 0).all()):
        raise ValueError(f"{argument}: {dict(wanted)}, expected finite numbers that are not negative")
    return found
