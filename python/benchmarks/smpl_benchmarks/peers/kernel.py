"""The kernel of many instances on the processor, with the native batch and a batch of JAX.

All take the same steps near rest on one thread, at one tolerance. `smpl.cuda.Batch` compiled as C
has the method of the native batch with `rosenbrock`; the native batch also runs with the method
that it chooses. JAX integrates the exported rates by Dormand-Prince, vectorised by `vmap`. A GPU is
not measured here.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

import smpl
import smpl.cuda
from smpl.support.arguments import FloatArray
from smpl_benchmarks.peers.batch import RTOL, actions, compiled
from smpl_benchmarks.peers.common import installed, largest, title

COUNT, STEPS = 256, 100


# Tolerance of the reference for the errors.
TIGHT = 1e-11

Run = Callable[[], float]
States = Callable[[], FloatArray]


def main(repeats: int) -> None:
    """Print microseconds of a step of one instance, and the largest error at the end."""
    title(f"The exported kernel as C, {COUNT} instances, one thread, processor time")
    for name in ("reactor", "beer"):
        model = compiled(name)
        env = smpl.VectorEnv(model, COUNT, num_threads=1)
        given = actions(env, STEPS)
        physical = np.stack([env.to_physical(each) for each in given])
        exact, states = native(compiled(name, TIGHT), "rosenbrock", given)
        exact()
        reference = states()
        print(f"  {name}, relative tolerance {RTOL:g}")
        for what, (run, states) in cases(model, given, physical).items():
            times = [run() for _ in range(repeats)]
            error = largest(states(), reference, np.abs(reference).max(axis=0))
            print(f"    {what}: {np.median(times) / (COUNT * STEPS) * 1e6:.2f} us, error {error:.0e}")


def cases(model: smpl.Model, given: FloatArray, physical: FloatArray) -> dict[str, tuple[Run, States]]:
    """Runs by name, each of which returns its seconds, and the states after them."""
    found = {f"native batch, `{method}`": native(model, method, given) for method in ("auto", "rosenbrock")}
    kernel, states = smpl.cuda.Batch(model, COUNT, device="cpu"), len(model.state_names)
    found["kernel as C, `rosenbrock`"] = timed(kernel.reset, kernel.step, physical), lambda: kernel.unknowns[:, :states]
    if installed("JAX", "jax"):
        found["JAX, `odeint`"] = jax_batch(model, physical)
    return found


def native(model: smpl.Model, method: str, given: FloatArray) -> tuple[Run, States]:
    """The batch of this package."""
    env = smpl.VectorEnv(model, COUNT, num_threads=1, method=method)
    reset = partial(env.reset, seed=0, options={"start": "nominal"})
    return timed(reset, env.step, given), lambda: np.asarray(env.state)


def timed(reset: Callable[[], Any], step: Callable[[Any], Any], each: FloatArray) -> Run:
    """A run of all steps after a reset."""

    def run() -> float:
        reset()
        begin = time.process_time()
        for one in each:
            step(one)
        return time.process_time() - begin

    return run


def jax_batch(model: smpl.Model, physical: FloatArray) -> tuple[Run, States]:
    """The steps with Dormand-Prince of JAX in double precision, compiled by a first step."""
    import jax
    import jax.numpy as jnp
    from jax.experimental.ode import odeint

    jax.config.update("jax_enable_x64", True)
    functions = smpl.export.jax(model)
    parameters, length = jnp.asarray(functions.parameters()), model.sampling_interval
    # One number: an absolute tolerance of `odeint` is not an array.
    atol = RTOL * min(float(element["scale"]) for element in smpl.export.json(model)["elements"]["states"])

    def one(x: Any, u: Any) -> Any:
        times = jnp.array([0.0, length])
        return odeint(lambda x, t: functions.rhs(t, x, u, parameters), x, times, rtol=RTOL, atol=atol)[-1]

    step = jax.jit(jax.vmap(one))
    start = jnp.tile(jnp.asarray(functions.state_nominal), (COUNT, 1))
    state = [start]

    def reset() -> None:
        state[0] = start

    def advance(action: FloatArray) -> None:
        state[0] = step(state[0], action)
        state[0].block_until_ready()

    advance(physical[0])
    return timed(reset, advance, physical), lambda: np.asarray(state[0])
