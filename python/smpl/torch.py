"""Control steps as layers of PyTorch: `smpl.torch.step(model, x, u, p)`.

The derivatives are those of `Model.linearize_step`, exact across events, updates and resets inside
of the step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from smpl.analysis.layer import (
    By,
    Layer,
    Points,
    Trajectory,
    Transition,
    arranged,
    chained_rewards,
    check_last_axis,
    horizon_of,
    with_past,
)
from smpl.analysis.rollout import check_first_step
from smpl.model import Model
from smpl.support.arguments import as_count, as_flag
from smpl.support.optional import load
from smpl.support.options import listed

Tensor = Any

__all__ = ["Trajectory", "Transition", "rollout", "step"]


@listed
def step(
    model: Model,
    x: Tensor,
    u: Tensor,
    p: Mapping[str, Any] | Tensor | None = None,
    *,
    parameters: Iterable[str] | None = None,
    outputs: bool = False,
    keep: bool = True,
    method: str | None = None,
    threads: int | None = None,
    first_step: int = 0,
) -> Any:
    """States after a control step, differentiable by `x`, `u` and `p`.

    Leading axes are points, which run in parallel; those of `x`, `u` and `p` are broadcast. The
    result has the type and device of `x`; the step is computed in double precision on the
    processor.

    Args:
        model: a compiled model.
        x: states, (..., states).
        u: actions in physical units, (..., actions).
        p: values of parameters, discrete variables and disturbances by name: numbers or tensors
            (elements of an array parameter on the last axis). Or one tensor with a column per name
            of `parameters`.
        parameters: names of the columns of a tensor `p`; all parameters of the model by default. An
            entry of a computed parameter sets it.
        outputs: return a `Transition`, with all rewards and observations (without noise, delay and
            clipping).
        keep: keep the Jacobians for the backward pass; otherwise only `x`, `u` and `p` are kept,
            and the step is integrated again there.
        method, threads, first_step: as for `Model.step`.

    Returns:
        The states, (..., states), or a `Transition`.

    Raises:
        ImportError: PyTorch is missing.
        ValueError: an unknown name or a wrong shape.
        SimulationError: a step does not come to its end, or has no derivative.

    Example:
        x = torch.tensor([0.88, 51.3, 0.66], dtype=torch.float64)
        u = torch.tensor([26.8, 0.1], dtype=torch.float64, requires_grad=True)
        smpl.torch.step(model, x, u)[1].backward()    # u.grad: of the temperature
    """
    torch = load("torch", "smpl.torch")
    options = {"outputs": outputs, "method": method, "threads": threads, "horizon": 1}
    return _steps(torch, (model, x, u, p, parameters), options, keep, first_step)


def _steps(torch: Any, given: tuple[Any, ...], options: dict[str, Any], keep: bool, first_step: int) -> Any:
    """The steps of a layer; `given` are model, `x`, `u`, `p` and the names of its columns."""
    model, x, u, p, parameters = given
    layer, columns = arranged(model, p, parameters, lambda one: _is_array(torch, one), **options)
    first = check_first_step(first_step, layer.horizon)
    states, actions = (_tensor(torch, name, one) for name, one in (("x", x), ("u", u)))
    check_last_axis("x", states, layer.columns[0])
    check_last_axis("u", actions, layer.columns[1])
    named = [_tensor(torch, f"p[{name!r}]", one) for name, one in zip(layer.names, columns, strict=True)]
    batch = _batch(torch, layer.names, states, actions, named)
    q = [one.to(states).expand(batch) for one in named]
    rows = torch.stack(q, dim=-1) if q else states.new_zeros((*batch, 0))
    inputs = [_flat(one, batch) for one in (states, actions.to(states), rows)]
    values = _apply(torch, layer, as_flag("keep", keep), first, inputs)
    values = values.reshape(*batch, layer.width)
    return Transition.of(layer, values) if layer.outputs else values


@listed
def rollout(
    model: Model,
    x: Tensor,
    actions: Tensor | Callable[[Tensor, int], Tensor],
    p: Mapping[str, Any] | Tensor | None = None,
    *,
    steps: int | None = None,
    rewards: Iterable[str] | None = None,
    parameters: Iterable[str] | None = None,
    checkpoint: int | None = None,
    method: str | None = None,
    threads: int | None = None,
    first_step: int = 0,
) -> Trajectory:
    """A chain of steps from `x`, differentiable by start, actions, `p` and the weights of a policy.

    The backward pass integrates each step again: between the passes only inputs are kept, no
    Jacobians. `checkpoint` also drops what a policy keeps, except at the beginning of each section.

    Args:
        model: a compiled model, without a memory other than its states. One with dead times is
            integrated with its derivatives over all steps at once: `actions` is a tensor then, and
            `checkpoint` has no effect.
        x: states at the start, (..., states).
        actions: (..., H, actions) in physical units; or a policy, called with the states and the
            number of the step, which returns actions (..., actions).
        p, parameters, method, threads, first_step: as for `step`, for all steps.
        steps: H, with a policy.
        rewards: names of the rewards to return; the model's chosen one by default.
        checkpoint: length of the sections.

    Raises:
        ValueError: as for `step`; or the model or a reward remembers more than the states, such as
            a reward relative to the start.
        SimulationError: as for `step`.

    Example:
        found = smpl.torch.rollout(model, x, lambda x, t: u0 + x @ gain, steps=20)
        (-found.rewards.sum()).backward()
    """
    torch = load("torch", "smpl.torch")
    columns = chained_rewards(model, rewards)
    horizon = horizon_of(model, actions, steps)
    check_first_step(first_step, horizon)
    if model.delays:
        plan = _tensor(torch, "actions", with_past(model, actions))
        whole = {"outputs": True, "method": method, "threads": threads, "horizon": horizon}
        found = _steps(torch, (model, x, plan.flatten(-2), p, parameters), whole, True, first_step)
        after, gains, observations = (one.unsqueeze(-2) if horizon == 1 else one for one in found)
        start = _tensor(torch, "x", x).to(after).expand(after.shape[:-2] + after.shape[-1:])
        wide = plan.to(after).expand(*after.shape[:-2], *plan.shape[-2:])
        return Trajectory(torch.cat([start.unsqueeze(-2), after], dim=-2), wide, gains[..., columns], observations)
    options: dict[str, Any] = {
        "parameters": parameters,
        "outputs": True,
        "keep": False,
        "method": method,
        "threads": threads,
    }

    given = actions if callable(actions) else _tensor(torch, "actions", actions)

    def section(state: Tensor, first: int, last: int) -> tuple[Tensor, ...]:
        parts: list[tuple[Tensor, ...]] = []
        for t in range(first, last):
            u = given(state, t) if callable(given) else given[..., t, :]
            found = step(model, state, u, p, first_step=first_step + t, **options)
            parts.append((found.states, u, found.rewards[..., columns], found.observations))
            state = found.states
        return tuple(_stacked(torch, column) for column in zip(*parts, strict=True))

    state = _tensor(torch, "x", x)
    check_last_axis("x", state, len(model.state_names))
    size = horizon if checkpoint is None else as_count("checkpoint", checkpoint)
    sections = []
    for first in range(0, horizon, size):
        ends = first, min(first + size, horizon)
        if checkpoint is None:
            sections.append(section(state, *ends))
        else:
            again = torch.utils.checkpoint.checkpoint
            sections.append(again(section, state, *ends, use_reentrant=False))
        state = sections[-1][0][..., -1, :]
    states, chosen, gains, observations = (torch.cat(part, dim=-2) for part in zip(*sections, strict=True))
    start = _tensor(torch, "x", x).to(states).expand(states.shape[:-2] + states.shape[-1:])
    return Trajectory(torch.cat([start.unsqueeze(-2), states], dim=-2), chosen, gains, observations)


# From here on torch is there.


def _is_array(torch: Any, value: Any) -> bool:
    return isinstance(value, (torch.Tensor, np.ndarray, list, tuple))


def _tensor(torch: Any, name: str, value: Any) -> Tensor:
    if not isinstance(value, torch.Tensor):
        try:
            value = torch.as_tensor(np.asarray(value, dtype=np.float64))
        except (TypeError, ValueError) as error:
            raise ValueError(f"{name} is {type(value).__name__}, expected a tensor of real numbers") from error
    if not torch.is_floating_point(value):
        raise ValueError(f"{name} has type {value.dtype}, expected a tensor of real numbers")
    return value


def _batch(torch: Any, names: tuple[str, ...], x: Tensor, u: Tensor, given: list[Tensor]) -> Any:
    try:
        return torch.broadcast_shapes(x.shape[:-1], u.shape[:-1], *(one.shape for one in given))
    except RuntimeError as error:
        parts = ", ".join(f"{name} {tuple(one.shape)}" for name, one in zip(names, given, strict=True))
        raise ValueError(
            f"the points of x {tuple(x.shape)}, u {tuple(u.shape)}{', ' if parts else ''}{parts} cannot be broadcast"
        ) from error


def _flat(tensor: Tensor, batch: Any) -> Tensor:
    return tensor.expand(*batch, tensor.shape[-1]).reshape(math.prod(batch), tensor.shape[-1])


def _apply(torch: Any, layer: Layer, keep: bool, first: int, inputs: list[Tensor]) -> Tensor:
    wanted = [torch.is_grad_enabled() and one.requires_grad for one in inputs]
    by = wanted[0], wanted[1], wanted[2] and bool(layer.names)
    return _function().apply(layer, keep, first, by, *inputs)[0]


def _stacked(torch: Any, column: tuple[Tensor, ...]) -> Tensor:
    return torch.stack(torch.broadcast_tensors(*map(torch.as_tensor, column)), dim=-2)


@lru_cache(maxsize=1)
def _function() -> Any:
    torch = load("torch", "smpl.torch")
    base: Any = torch.autograd.Function

    class ControlStep(base):  # type: ignore[misc]
        """`(x, u, q) -> values` of N points, and the Jacobians, which are not differentiable."""

        @staticmethod
        def forward(layer: Layer, keep: bool, first: int, by: By, x: Tensor, u: Tensor, q: Tensor) -> Any:
            if keep and any(by):
                values, jacobians = layer.linearized(_arrays(x, u, q), first, by)
            else:
                values, jacobians = layer.values(_arrays(x, u, q), first), (np.zeros((len(x), 0, 0)),) * 3
            return tuple(torch.as_tensor(one).to(x) for one in (values, *jacobians))

        @staticmethod
        def setup_context(context: Any, inputs: Any, output: Any) -> None:
            layer, keep, first, by, *given = inputs
            context.layer, context.keep, context.first, context.by = layer, keep, first, by
            context.save_for_backward(*(output[1:] if keep else given))
            context.mark_non_differentiable(*output[1:])

        @staticmethod
        @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
        def backward(context: Any, after: Tensor, *_: Any) -> Any:
            kept = context.saved_tensors
            if not context.keep:
                _, jacobians = context.layer.linearized(_arrays(*kept), context.first, context.by)
                kept = [torch.as_tensor(one).to(after) for one in jacobians]
            found = [
                torch.einsum("...i,...ij->...j", after, one) if wanted else None
                for one, wanted in zip(kept, context.by, strict=True)
            ]
            return None, None, None, None, *found

        @staticmethod
        def vmap(info: Any, dims: Any, layer: Layer, keep: bool, first: int, by: By, *given: Tensor) -> Any:
            size = info.batch_size
            whole = [
                one.movedim(at, 0) if at is not None else one.expand(size, *one.shape)
                for one, at in zip(given, dims[4:], strict=True)
            ]
            rows = [one.reshape(math.prod(one.shape[:-1]), one.shape[-1]) for one in whole]
            found = ControlStep.apply(layer, keep, first, by, *rows)
            return tuple(one.reshape(size, len(one) // size, *one.shape[1:]) for one in found), (0,) * len(found)

    return ControlStep


def _arrays(x: Tensor, u: Tensor, q: Tensor) -> Points:
    found = [one.detach().cpu().double().numpy() for one in (x, u, q)]
    return found[0], found[1], found[2]
