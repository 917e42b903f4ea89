"""A batch of reactors side by side in JAX: `python python/examples/jax_batch.py [COUNT]`.

The model is exported as pure functions; Runge-Kutta steps of the whole batch and the derivative of
where it ends by the coolant temperature are one compiled function each.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np

import smpl
from smpl.export import JaxModel
from smpl.export import jax as to_jax

STEPS, SUBSTEPS = 20, 100


def episode(functions: JaxModel, jax: Any) -> Any:
    """States of one reactor after `STEPS` control steps, from a start and constant actions."""
    h = functions.step / SUBSTEPS

    def end(x: Any, u: Any, p: Any) -> Any:
        def substep(_: int, x: Any) -> Any:
            k1 = functions.rhs(0.0, x, u, p)
            k2 = functions.rhs(0.0, x + 0.5 * h * k1, u, p)
            k3 = functions.rhs(0.0, x + 0.5 * h * k2, u, p)
            k4 = functions.rhs(0.0, x + h * k3, u, p)
            return x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

        return jax.lax.fori_loop(0, STEPS * SUBSTEPS, substep, x)

    return end


def main(count: int = 4096) -> tuple[Any, Any]:
    """Integrates `count` reactors; returns ends and the derivative of the first by actions."""
    import jax

    jax.config.update("jax_enable_x64", True)
    functions = to_jax(smpl.compile("reactor"))
    end = episode(functions, jax)
    random = np.random.default_rng(0)
    nominal, u, p = functions.state_nominal, functions.action_nominal, functions.parameters()
    x = nominal * random.uniform(0.95, 1.05, (count, len(nominal)))
    batch = jax.jit(jax.vmap(end, in_axes=(0, None, None)))
    batch(x, u, p).block_until_ready()
    begin = time.perf_counter()
    ends = batch(x, u, p).block_until_ready()
    print(f"{count} reactors, {STEPS} steps each: {time.perf_counter() - begin:.2f} s")
    slope = jax.jit(jax.jacfwd(end, argnums=1))(x[0], u, p)
    print(f"d{functions.state_names} / d{functions.action_names} of the first:\n{slope}")
    return ends, slope


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
