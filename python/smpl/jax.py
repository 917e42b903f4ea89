"""Control steps as differentiable functions of JAX, under `jit` and `vmap`.

The step runs on the host (`jax.pure_callback`); the derivatives are those of
`Model.linearize_step`, exact across events, updates and resets inside of the step.
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
from smpl.support.arguments import as_flag
from smpl.support.optional import load
from smpl.support.options import listed

Array = Any

__all__ = ["Trajectory", "Transition", "rollout", "step"]


@listed
def step(
    model: Model,
    x: Array,
    u: Array,
    p: Mapping[str, Any] | Array | None = None,
    *,
    parameters: Iterable[str] | None = None,
    outputs: bool = False,
    keep: bool = True,
    method: str | None = None,
    threads: int | None = None,
    first_step: Any = 0,
) -> Any:
    """States after a control step, with reverse-mode derivatives by `x`, `u` and `p`.

    Leading axes are points, which run in parallel; those of `x`, `u` and `p` are broadcast. The
    step is computed in double precision, results have the type of `x`: call
    `jax.config.update("jax_enable_x64", True)` for doubles.

    Args:
        model: a compiled model.
        x: states, (..., states).
        u: actions in physical units, (..., actions).
        p: values of parameters, discrete variables and disturbances by name: numbers or arrays
            (elements of an array parameter on the last axis). Or one array with a column per name
            of `parameters`.
        parameters: names of the columns of an array `p`; all parameters of the model by default. An
            entry of a computed parameter sets it.
        outputs: return a `Transition`, with all rewards and observations (without noise, delay and
            clipping).
        keep: keep the Jacobians for the backward pass; otherwise only `x`, `u` and `p` are kept,
            and the step is integrated again there.
        method, threads: as for `Model.step`.
        first_step: steps that count as completed before, an integer or a traced one.

    Returns:
        The states, (..., states), or a `Transition`.

    Raises:
        ImportError: JAX is missing.
        ValueError: an unknown name or a wrong shape. What fails inside of the step is raised by
            JAX, with the message of `Model.step`.

    Example:
        jax.grad(lambda u: smpl.jax.step(model, x, u)[1])(u)    # of the temperature
    """
    jax = load("jax", "smpl.jax")
    options = {"outputs": outputs, "method": method, "threads": threads, "horizon": 1}
    return _steps(jax, (model, x, u, p, parameters), options, keep, first_step)


def _steps(jax: Any, arguments: tuple[Any, ...], options: dict[str, Any], keep: bool, first_step: Any) -> Any:
    """The steps of a layer; `arguments` are model, `x`, `u`, `p` and the names of its columns."""
    model, x, u, p, parameters = arguments
    layer, columns = arranged(model, p, parameters, lambda one: _is_array(jax, one), **options)
    if not isinstance(first_step, jax.core.Tracer):
        check_first_step(first_step, layer.horizon)
    x, u = jax.numpy.asarray(x), jax.numpy.asarray(u)
    check_last_axis("x", x, layer.columns[0])
    check_last_axis("u", u, layer.columns[1])
    kind = jax.numpy.promote_types(x.dtype, jax.numpy.float32)
    given = [jax.numpy.asarray(one, dtype=kind) for one in columns]
    batch = np.broadcast_shapes(x.shape[:-1], u.shape[:-1], *(one.shape for one in given))
    q = [jax.numpy.broadcast_to(one, batch) for one in given]
    rows = jax.numpy.stack(q, axis=-1) if q else jax.numpy.zeros((*batch, 0), kind)
    wide = [jax.numpy.broadcast_to(one, batch + one.shape[-1:]).astype(kind) for one in (x, u)]
    values = _function(layer, as_flag("keep", keep))(*wide, rows, jax.numpy.asarray(first_step))
    return Transition.of(layer, values) if layer.outputs else values


@listed
def rollout(
    model: Model,
    x: Array,
    actions: Array | Callable[[Array, Array], Array],
    p: Mapping[str, Any] | Array | None = None,
    *,
    steps: int | None = None,
    rewards: Iterable[str] | None = None,
    parameters: Iterable[str] | None = None,
    checkpoint: bool = False,
    method: str | None = None,
    threads: int | None = None,
    first_step: int = 0,
) -> Trajectory:
    """A differentiable chain of steps from `x` by `jax.lax.scan`.

    The backward pass integrates each step again: between the passes only inputs are kept, no
    Jacobians. `checkpoint` applies `jax.checkpoint` to each step, which also drops what a policy
    keeps.

    Args:
        model: a compiled model, without a memory other than its states. One with dead times is
            integrated with its derivatives over all steps at once: `actions` is an array then, and
            `checkpoint` has no effect.
        x: states at the start, (..., states).
        actions: (..., H, actions) in physical units; or a policy, called with the states and the
            number of the step, which returns actions (..., actions).
        p, parameters, method, threads, first_step: as for `step`, for all steps.
        steps: H, with a policy.
        rewards: names of the rewards to return; the model's chosen one by default.
        checkpoint: compute the policy again in the backward pass.

    Raises:
        ValueError: as for `step`; or the model or a reward remembers more than the states, such as
            a reward relative to the start.
    """
    jax = load("jax", "smpl.jax")
    columns = chained_rewards(model, rewards)
    horizon = horizon_of(model, actions, steps)
    check_first_step(first_step, horizon)
    if model.delays:
        given = jax.numpy.asarray(with_past(model, actions))
        whole = {"outputs": True, "method": method, "threads": threads, "horizon": horizon}
        flat = given.reshape(*given.shape[:-2], -1)
        parts = _steps(jax, (model, x, flat, p, parameters), whole, True, first_step)
        after, gains, observations = (one[..., None, :] if horizon == 1 else one for one in parts)
        batch = after.shape[:-2]
        start = jax.numpy.broadcast_to(jax.numpy.asarray(x), batch + after.shape[-1:])[..., None, :]
        chosen = jax.numpy.broadcast_to(given, batch + given.shape[-2:])
        gains = gains[..., jax.numpy.array(columns, dtype=int)]
        return Trajectory(jax.numpy.concatenate([start, after], axis=-2), chosen, gains, observations)
    options: dict[str, Any] = {
        "parameters": parameters,
        "outputs": True,
        "keep": False,
        "method": method,
        "threads": threads,
    }
    plan = None if callable(actions) else jax.numpy.moveaxis(jax.numpy.asarray(actions), -2, 0)

    def one(state: Array, now: tuple[Array, Array]) -> tuple[Array, tuple[Array, ...]]:
        t, given = now
        u = actions(state, t) if callable(actions) else given
        found = step(model, state, u, p, first_step=first_step + t, **options)
        wide = jax.numpy.broadcast_to(u, found.states.shape[:-1] + u.shape[-1:])
        gains = found.rewards[..., jax.numpy.array(columns, dtype=int)]
        return found.states, (found.states, wide, gains, found.observations)

    x = jax.numpy.asarray(x)
    check_last_axis("x", x, len(model.state_names))
    start = x
    if plan is not None:
        shape = np.broadcast_shapes(x.shape[:-1], plan.shape[1:-1])
        start = jax.numpy.broadcast_to(x, shape + x.shape[-1:])
    body = jax.checkpoint(one) if as_flag("checkpoint", checkpoint) else one
    _, found = jax.lax.scan(body, start, (jax.numpy.arange(horizon), plan))
    states, chosen, gains, observations = (jax.numpy.moveaxis(part, 0, -2) for part in found)
    return Trajectory(jax.numpy.concatenate([start[..., None, :], states], axis=-2), chosen, gains, observations)


def _is_array(jax: Any, value: Any) -> bool:
    return isinstance(value, (jax.Array, np.ndarray, list, tuple))


@lru_cache(maxsize=64)
def _function(layer: Layer, keep: bool) -> Any:
    """`(x, u, q, first) -> values`, with a rule for its derivative."""
    jax = load("jax", "smpl.jax")

    @jax.custom_vjp  # type: ignore[untyped-decorator]
    def control_step(x: Array, u: Array, q: Array, first: Array) -> Array:
        return _called(jax, layer, None, x, u, q, first)[0]

    def forward(x: Any, u: Any, q: Any, first: Any) -> tuple[Array, tuple[Array, ...]]:
        # Jacobians of what does not vary are not computed: they have no columns.
        by = x.perturbed, u.perturbed, q.perturbed and bool(layer.names)
        given = x.value, u.value, q.value, first.value
        if keep:
            values, *kept = _called(jax, layer, by, *given)
        else:
            values = control_step(*given)
            kept = [*given, *(jax.numpy.zeros((0, int(one))) for one in by)]
        return values, tuple(kept)

    def backward(kept: tuple[Array, ...], after: Array) -> tuple[Any, ...]:
        shapes = layer.columns
        if isinstance(after, jax.custom_derivatives.SymbolicZero):
            return None, None, None, None
        if not keep:
            by = tuple(bool(one.shape[-1]) for one in kept[4:])
            kept = _called(jax, layer, by, *kept[:4])[1:]
        found = [
            jax.numpy.einsum("...i,...ij->...j", after, one)
            if one.shape[-1] == size
            else jax.numpy.zeros((*after.shape[:-1], size), after.dtype)
            for one, size in zip(kept, shapes, strict=True)
        ]
        return (*found, None)

    control_step.defvjp(forward, backward, symbolic_zeros=True)
    return control_step


def _called(jax: Any, layer: Layer, by: Any, x: Array, u: Array, q: Array, first: Array) -> Any:
    """Values and Jacobians of points with any leading axes, computed on the host.

    Without `by` values alone.
    """
    sizes = [] if by is None else [s if wanted else 0 for s, wanted in zip(layer.columns, by, strict=True)]
    batch, width = x.shape[:-1], layer.width
    shapes = [(*batch, width), *((*batch, width, size) for size in sizes)]
    result = [jax.ShapeDtypeStruct(shape, x.dtype) for shape in shapes]

    def host(*given: Any) -> list[Any]:
        return _on_host(layer, by, x.dtype, *map(np.asarray, given))

    return jax.pure_callback(host, result, x, u, q, first, vmap_method="broadcast_all")


def _on_host(layer: Layer, by: By | None, kind: Any, x: Any, u: Any, q: Any, first: Any) -> list[Any]:
    """The points of a call, those of each clock together."""
    batch = x.shape[:-1]
    flat = [one.reshape(math.prod(batch), one.shape[-1]).astype(np.float64) for one in (x, u, q)]
    lead = first.reshape(first.shape + (1,) * (len(batch) - first.ndim))
    clocks = np.broadcast_to(lead, batch).reshape(-1)
    out: list[Any] = []
    for clock in np.unique(clocks):
        mine = clocks == clock
        given = flat[0][mine], flat[1][mine], flat[2][mine]
        if by is None:
            found = [layer.values(given, int(clock))]
        else:
            values, jacobians = layer.linearized(given, int(clock), by)
            found = [values, *jacobians]
        if not out:
            out = [np.empty((len(clocks), *one.shape[1:]), kind) for one in found]
        for whole, part in zip(out, found, strict=True):
            whole[mine] = part
    return [one.reshape(*batch, *one.shape[1:]) for one in out]
