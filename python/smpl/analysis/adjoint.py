"""Derivatives of a value of an episode by actions, start and parameters, see `Model.gradient`.

Derivatives of each control step are exact (`Model.linearize_step`). Their products with the
derivative of the value by the state after the step are accumulated backwards in time. The memory is
that of the steps' derivatives, the work that of the steps.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from smpl import _native
from smpl.analysis.rollout import _common, _rows, check_first_step
from smpl.analysis.rollout import rollout as simulate
from smpl.analysis.sensitivity import StepDerivatives, _split, linearize_step
from smpl.support.arguments import FloatArray, check_names

if TYPE_CHECKING:
    from smpl.model import Model

# Steps one by one and an episode in one go take different internal steps; beyond this difference,
# relative to the largest value of a state or reward, they are different episodes.
_SAME = 1e-4


@dataclass(frozen=True)
class EpisodeGradient:
    """The value of an episode and its derivatives; N episodes add a leading axis N to all arrays.

    Attributes:
        value: the discounted sum of the reward, and of `final` times the last states.
        by_state: derivative by the states at the start, (states,).
        by_action: by the actions of all steps, (steps, actions).
        by_parameter: by the parameters asked for, (parameters,).
        states: states from the start to the end, (steps + 1, states).
        rewards: the reward of each step, (steps,).
        parameters: names of the parameters.
    """

    value: FloatArray
    by_state: FloatArray
    by_action: FloatArray
    by_parameter: FloatArray
    states: FloatArray
    rewards: FloatArray
    parameters: tuple[str, ...]


def gradient(
    model: Model,
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
    """The derivative of an episode's value, see `Model.gradient`."""
    starts = np.atleast_2d(_rows("x", x, len(model.state_names), 1))
    plan = _rows("actions", actions, len(model.action_names), 2)
    single = np.ndim(x) == 1 and plan.ndim == 2
    plan = plan if plan.ndim == 3 else plan[np.newaxis]
    count, horizon = _common(len(plan), len(starts)), plan.shape[1]
    starts = np.broadcast_to(starts, (count, starts.shape[1]))
    plan = np.broadcast_to(plan, (count, *plan.shape[1:]))
    first_step = check_first_step(first_step, horizon)
    at = _reward(model, reward)
    end = _final(model, final)
    if not np.isfinite(discount) or not 0 <= discount <= 1:
        raise ValueError(f"discount is {discount!r}, expected a number from 0 to 1")
    named = (parameters,) if isinstance(parameters, str) else tuple(parameters)

    steps: list[StepDerivatives] = []
    states = np.empty((count, horizon + 1, starts.shape[1]))
    states[:, 0] = starts
    for step in range(horizon):
        found = linearize_step(
            model,
            states[:, step],
            plan[:, step],
            p,
            parameters=named,
            method=method,
            threads=threads,
            first_step=first_step + step,
        )
        states[:, step + 1] = found.states
        steps.append(found)
    rewards = np.stack([found.rewards[:, at] for found in steps], axis=1)
    _check_chain(model, states, plan, p, rewards if at == _reward(model, None) else None, (method, threads, first_step))
    value = rewards @ discount ** np.arange(horizon) + states[:, -1] @ end
    by_state, by_action, by_parameter = _backward(steps, at, end, discount)
    parts: tuple[FloatArray, ...] = (value, by_state, by_action, by_parameter, states, rewards)
    kept = [part[0] if single else part for part in parts]
    return EpisodeGradient(kept[0], kept[1], kept[2], kept[3], kept[4], kept[5], steps[0].by["parameter"])


def _backward(
    steps: Sequence[StepDerivatives], at: int, end: FloatArray, discount: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Derivatives of the value by start, actions and parameters, from the last step back."""
    count = len(steps[0].states)
    by_state = np.broadcast_to(end, (count, len(end)))
    by_action, by_parameter = [], np.zeros((count, len(steps[0].by["parameter"])))
    for number in reversed(range(len(steps))):
        step, weight = steps[number], discount**number
        by_action.append(weight * step.dr_du[:, at] + np.einsum("ni,nij->nj", by_state, step.dx_du))
        by_parameter += weight * step.dr_dp[:, at] + np.einsum("ni,nij->nj", by_state, step.dx_dp)
        by_state = weight * step.dr_dx[:, at] + np.einsum("ni,nij->nj", by_state, step.dx_dx)
    return by_state, np.stack(by_action[::-1], axis=1), by_parameter


def _reward(model: Model, name: str | None) -> int:
    names = model.reward_names
    if name is None:
        name = model.reward
    check_names("reward", [name], names)
    return names.index(name)


def _final(model: Model, weights: npt.ArrayLike | None) -> FloatArray:
    if weights is None:
        return np.zeros(len(model.state_names))
    return np.asarray(_rows("final", weights, len(model.state_names), 1)).reshape(len(model.state_names))


def _check_chain(
    model: Model,
    states: FloatArray,
    plan: FloatArray,
    p: Mapping[str, npt.ArrayLike] | None,
    rewards: FloatArray | None,
    options: tuple[str | None, int | None, int],
) -> None:
    """An error where the episode is not what its steps make of its states alone."""
    method, threads, first_step = options
    given, discrete, disturbances = _split(model, p)
    count, horizon = len(states), plan.shape[1]
    held = {name: _over_steps(name, value, count, horizon) for name, value in disturbances.items()}
    whole = simulate(
        model,
        states[:, 0],
        plan,
        parameters=given,
        discrete=discrete,
        disturbances=held,
        method=method,
        threads=threads,
        first_step=first_step,
        max_steps=first_step + horizon,
    )
    ended = np.flatnonzero((whole.steps < horizon) | np.array([bool(text) for text in whole.failure]))
    if len(ended):
        episode = int(ended[0])
        text = whole.failure[episode] or "a condition of the model"
        raise _native.SimulationError(f"episode {episode} ends after {whole.steps[episode]} steps: {text}")
    pairs = [(name, states[..., i], whole.states[..., i]) for i, name in enumerate(model.state_names)]
    if rewards is not None:
        pairs.append(("the reward", rewards, whole.rewards))
    for name, chained, at_once in pairs:
        far = np.argwhere(np.abs(chained - at_once) > _SAME * max(np.abs(at_once).max(), 1e-300))
        if len(far):
            episode, step = far[0]
            raise ValueError(
                f"episode {episode}: {name} after {step} steps is {at_once[episode, step]:.6g}, but "
                f"{chained[episode, step]:.6g} from step to step: the model remembers more than its states (discrete "
                "variables, earlier or initial values), so its episode is not a chain of steps; `linearize_step` has "
                "the derivatives of each"
            )


def _over_steps(name: str, value: npt.ArrayLike, count: int, horizon: int) -> FloatArray:
    """A disturbance that stays what it is, one for all episodes or one for each."""
    array = np.asarray(value, dtype=float)
    if array.shape not in ((), (count,)):
        raise ValueError(f"{name} in p has shape {array.shape}, expected () or ({count},)")
    return np.broadcast_to(array.reshape(-1, 1), (count, horizon)) if array.shape else np.full(horizon, array)


__all__ = ["EpisodeGradient", "gradient"]
