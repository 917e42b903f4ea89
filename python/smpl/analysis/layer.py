"""A control step with its Jacobians as a function of arrays, for `smpl.torch` and `smpl.jax`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from smpl.analysis.adjoint import _SAME
from smpl.analysis.rollout import _threads
from smpl.analysis.rollout import rollout as simulate
from smpl.analysis.sensitivity import linearize_rollout, linearize_step, step
from smpl.envs import Env
from smpl.model import Model
from smpl.support.arguments import FloatArray, as_count, as_flag, as_number, check_method, check_names, check_once

# Derivatives to compute: by states, by actions, by the columns of `q`.
By = tuple[bool, bool, bool]
# `x`, `u` and `q` of N points, and the Jacobians by each.
Points = tuple[FloatArray, FloatArray, FloatArray]
Jacobians = tuple[FloatArray, FloatArray, FloatArray]
# Steps of the episode on which a model is tried.
_TRIED = 20


@dataclass(frozen=True)
class Layer:
    """A control step of N points, `(x, u, q) -> values`; or several steps, with all actions in `u`.

    Attributes:
        model: the compiled model.
        names: parameters, discrete variables and disturbances in the columns of `q`.
        held: values of others, the same for all points.
        outputs: the values are states, rewards and observations; otherwise states alone.
        method, threads: as for `Model.step`.
        horizon: number of steps. Values are those of one step after another.
    """

    model: Model
    names: tuple[str, ...] = ()
    held: tuple[tuple[str, float], ...] = ()
    outputs: bool = False
    method: str | None = None
    threads: int | None = None
    horizon: int = 1

    @property
    def columns(self) -> tuple[int, int, int]:
        """Numbers of columns of `x`, `u` and `q`."""
        return len(self.model.state_names), self.horizon * len(self.model.action_names), len(self.names)

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers of states, rewards and observations."""
        model = self.model
        return len(model.state_names), len(model.reward_names), len(model.observation_names)

    @property
    def width(self) -> int:
        """Number of values of a point."""
        return self.horizon * (sum(self.sizes) if self.outputs else self.sizes[0])

    def values(self, points: Points, first_step: int) -> FloatArray:
        """Values after the step, shape (N, width)."""
        if self.outputs:
            return self.linearized(points, first_step, (False, False, False))[0]
        x, u, q = points
        return step(self.model, x, u, self._given(q), method=self.method, threads=self.threads, first_step=first_step)

    def linearized(self, points: Points, first_step: int, by: By) -> tuple[FloatArray, Jacobians]:
        """Values, and requested Jacobians by `x`, `u` and `q`; others have no columns."""
        x, u, q = points
        named = self._by_role() if by[2] else ([], [], [])
        options: dict[str, Any] = {
            "by": [role for role, wanted in zip(("state", "action"), by[:2], strict=True) if wanted],
            "parameters": named[0],
            "discrete": named[1],
            "method": self.method,
            "threads": self.threads,
            "first_step": first_step,
        }
        if self.horizon == 1:
            found = linearize_step(self.model, x, u, self._given(q), disturbances=named[2], **options)
        else:
            plan = u.reshape(len(u), self.horizon, -1)
            found = linearize_rollout(self.model, x, plan, self._given(q), **options)
        values, parts = found.states, [found.derivatives[0]]
        if self.outputs:
            values = np.concatenate([values, found.rewards, found.observations], axis=-1)
            parts = list(found.derivatives)
        whole = np.concatenate(parts, axis=-2)
        if self.horizon > 1:
            values, whole = values.reshape(len(u), -1), whole.reshape(len(u), -1, whole.shape[-1])
        ends = np.cumsum([len(found.by["state"]), len(found.by["action"])])
        by_x, by_u, by_q = np.split(whole, ends, axis=-1)
        columns = [name for role in named for name in role]
        order = [columns.index(name) for name in self.names] if by[2] else []
        return values, (by_x, by_u, by_q[..., order])

    @property
    def disturbed(self) -> list[str]:
        """Disturbances among the names and the held values."""
        names = (*self.names, *(name for name, _ in self.held))
        return [name for name in names if name in self.model.disturbance_names]

    def _given(self, q: FloatArray) -> dict[str, Any]:
        return {**dict(self.held), **{name: q[:, i] for i, name in enumerate(self.names)}}

    def _by_role(self) -> tuple[list[str], list[str], list[str]]:
        """Names of the columns as parameters, discrete variables and disturbances."""
        parts: tuple[list[str], list[str], list[str]] = ([], [], [])
        known = _known(self.model)
        for name in self.names:
            parts[next(at for at, names in enumerate(known) if name in names)].append(name)
        return parts


class Transition(NamedTuple):
    """Values after a step: states (..., states), all rewards, observations."""

    states: Any
    rewards: Any
    observations: Any

    @classmethod
    def of(cls, layer: Layer, values: Any) -> Transition:
        """The parts of the values of a layer; of several steps time is the axis before the last."""
        states, rewards, _ = layer.sizes
        if layer.horizon > 1:
            values = values.reshape(*values.shape[:-1], layer.horizon, -1)
        return cls(values[..., :states], values[..., states : states + rewards], values[..., states + rewards :])


class Trajectory(NamedTuple):
    """Arrays of a rollout, time on the axis before the last.

    States (..., H + 1, states), actions (..., H, actions), and after each step the chosen rewards
    (..., H, rewards) and the observations (..., H, observations).
    """

    states: Any
    actions: Any
    rewards: Any
    observations: Any


def arranged(
    model: Model,
    p: Any,
    parameters: Iterable[str] | None,
    is_array: Callable[[Any], bool],
    *,
    outputs: bool,
    method: str | None,
    threads: int | None,
    horizon: int = 1,
) -> tuple[Layer, list[Any]]:
    """The layer of the arguments of `step`, and the columns of `q`, arrays of the caller's kind.

    Args:
        model: the compiled model.
        p: mapping from names to numbers and arrays, an array with one column per name of
            `parameters`, or None.
        parameters: those names; all parameters of the model if None.
        is_array: whether a value is an array of the caller's kind.
        outputs, method, threads, horizon: of the layer.

    Raises:
        TypeError: `model` is not a model.
        ValueError: an unknown name, a wrong number of columns, or `parameters` without an array.
    """
    if not isinstance(model, Model):
        raise TypeError(f"model is {type(model).__name__}, expected a compiled model: smpl.compile makes one")
    pairs = _pairs(model, p, parameters, is_array)
    names = [name for name, value in pairs if not isinstance(value, float)]
    held = tuple((name, value) for name, value in pairs if isinstance(value, float))
    if threads is not None:
        _threads(threads)
    layer = Layer(model, tuple(names), held, as_flag("outputs", outputs), check_method(method), threads, horizon)
    if horizon > 1 and layer.disturbed:
        raise ValueError(
            f"p has the disturbance {layer.disturbed[0]}, and {model.name} reads its past: leave it to its rule"
        )
    return layer, [value for _, value in pairs if not isinstance(value, float)]


def check_last_axis(name: str, array: Any, expected: int) -> None:
    """Refuse an array whose last axis does not have `expected` entries.

    Raises:
        ValueError: names the argument, its shape and the expected one.
    """
    if not array.shape or array.shape[-1] != expected:
        raise ValueError(f"{name} has shape {tuple(array.shape)}, expected (..., {expected})")


def chained_rewards(model: Model, rewards: Iterable[str] | None) -> list[int]:
    """Positions of the rewards of a rollout, the chosen one by default, after `_check_chain`.

    Raises:
        TypeError: `model` is not a model.
        ValueError: an unknown reward, or an episode of the model is not a chain of steps.
    """
    if not isinstance(model, Model):
        raise TypeError(f"model is {type(model).__name__}, expected a compiled model: smpl.compile makes one")
    names = (model.reward,) if rewards is None else (rewards,) if isinstance(rewards, str) else tuple(rewards)
    check_names("rewards", names, model.reward_names)
    for name in names or (model.reward,):
        if model.delays:
            break
        _check_chain(model, name, bool(names))
    return [model.reward_names.index(name) for name in names]


@lru_cache(maxsize=64)
def _check_chain(model: Model, reward: str, rewarded: bool) -> None:
    """Refuses a model whose episode is not a chain of steps, from one short episode.

    Raises:
        ValueError: the episode and the chain differ; the message names the first state that does,
            or the reward.
    """
    chosen = model if reward == model.reward else model.variant_of(reward=reward)
    env = Env(chosen, normalize=False)
    env.reset(seed=0, options={"start": "nominal"})
    low, high = model.native.bounds("action")
    width = np.where(np.isfinite(high - low), high - low, 1.0)
    noise = np.random.default_rng(0).uniform(-0.1, 0.1, (min(_TRIED, model.max_steps), len(low)))
    plan = np.clip(model.native.defaults("action") + noise * width, low, high)
    whole = simulate(chosen, env.state, plan)
    at, state, pairs = model.reward_names.index(reward), env.state, []
    for t in range(int(whole.steps[0]) - bool(whole.failure[0])):
        found = linearize_step(model, state, plan[t], by=(), first_step=t)
        state = found.states
        pairs.append(
            (np.append(found.states, found.rewards[at]), np.append(whole.states[0, t + 1], whole.rewards[0, t]))
        )
    names = [*model.state_names, f"reward {reward}"][: None if rewarded else -1]
    for i, name in enumerate(names):
        chain, episode = (np.array([pair[k][i] for pair in pairs]) for k in (0, 1))
        far = np.flatnonzero(np.abs(chain - episode) > _SAME * max(np.abs(episode).max(initial=0.0), 1e-300))
        if len(far):
            remedy = "choose others by rewards" if i == len(model.state_names) else "call `step` with those in p"
            raise ValueError(
                f"{model.name} remembers more than its states (discrete variables, earlier or initial values): "
                f"{name} after {far[0] + 1} steps of an episode is {episode[far[0]]:.6g}, but {chain[far[0]]:.6g} "
                f"from step to step; {remedy}"
            )


def horizon_of(model: Model, actions: Any, steps: int | None) -> int:
    """The number of steps of a rollout.

    Raises:
        ValueError: it is not given, or actions of another shape.
    """
    if callable(actions):
        if steps is None:
            raise ValueError("steps is None, expected the number of steps: actions is a policy")
        return as_count("steps", steps)
    shape = tuple(np.shape(actions))
    if len(shape) < 2 or shape[-1] != len(model.action_names) or shape[-2] < 1:
        raise ValueError(f"actions has shape {shape}, expected (..., H, {len(model.action_names)})")
    if steps not in (None, shape[-2]):
        raise ValueError(f"steps is {steps}, but actions has {shape[-2]}")
    return int(shape[-2])


def with_past(model: Model, actions: Any) -> Any:
    """The actions of a rollout of a model with dead times.

    Raises:
        ValueError: `actions` is a policy.
    """
    if callable(actions):
        raise ValueError(
            f"actions is a policy, and {model.name} reads its past (`{model.delays[0]}`): pass the actions of all steps"
        )
    return actions


def _pairs(model: Model, p: Any, parameters: Any, is_array: Callable[[Any], bool]) -> list[tuple[str, Any]]:
    if p is None or isinstance(p, Mapping):
        if parameters is not None:
            raise ValueError("parameters names the columns of p; pass p as one array, or leave parameters out")
        return [pair for name, value in (p or {}).items() for pair in _of_entry(model, name, value, is_array)]
    if not is_array(p):
        raise ValueError(f"p is {type(p).__name__}, expected a mapping from names to values, or an array")
    given = (parameters,) if isinstance(parameters, str) else parameters
    columns = model.parameter_names if given is None else [one for name in given for one in _elements(model, name)]
    check_once("parameters", columns)
    check_last_axis("p", p, len(columns))
    return [(name, p[..., i]) for i, name in enumerate(columns)]


def _of_entry(model: Model, name: Any, value: Any, is_array: Callable[[Any], bool]) -> list[tuple[str, Any]]:
    """One value of the mapping `p`, element by element."""
    elements = _elements(model, name)
    if not is_array(value):
        number = as_number(f"p[{name!r}]", value)
        if not np.isfinite(number):
            raise ValueError(f"p[{name!r}] is {number}, expected a finite number")
        return [(one, number) for one in elements]
    if len(elements) == 1 and elements[0] == name:
        return [(name, value)]
    if not value.shape:
        return [(one, value) for one in elements]
    check_last_axis(f"p[{name!r}]", value, len(elements))
    return [(one, value[..., i]) for i, one in enumerate(elements)]


def _elements(model: Model, name: Any) -> list[str]:
    known = _known(model)
    if any(name in names for names in known):
        return [name]
    elements = list(model.native.elements_of(name)) if isinstance(name, str) else []
    if not elements:
        check_names("p", [name], [other for names in known for other in names])
    return elements


def _known(model: Model) -> tuple[tuple[str, ...], ...]:
    return model.parameter_names, model.discrete_names, model.disturbance_names
