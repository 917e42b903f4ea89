"""Robertson's reaction in many equal groups, up to 30,000 states: the benchmark of diffsol.

Groups are independent, which no program knows. Each program solves at three tolerances; its error
is that of one group at the end, against this package at 1e-11, relative. Packages other than
this one are skipped if they are missing.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from smpl.support.arguments import FloatArray
from smpl_benchmarks.peers.common import compile_time, environment, installed, seconds, title

MODEL = Path(__file__).parent / "robertson_groups.eq"
GROUPS = (1, 100, 1000, 10_000)
TOLERANCES = (1e-4, 1e-6, 1e-8)
END = 4e10
SCALE = np.array([1.0, 1e-4, 1.0])


def main(repeats: int) -> None:
    """Print the table."""
    title(f"Robertson's reaction in equal groups, to t = {END:g} s")
    exact = solver(1, 1e-11, "rosenbrock")()[:, 0]
    for groups in GROUPS:
        few = repeats if groups < 1000 else 1
        compiled = compile_time(MODEL, {"groups": groups}, 3)
        print(f"  {3 * groups} states; compiled in {compiled * 1e3:.1f} ms")
        for rtol in TOLERANCES:
            for name, solve in programs(groups, rtol).items():
                end = solve()
                each = seconds(solve, few)
                error = float(np.max(np.abs(end - exact[:, None]) / np.abs(exact[:, None])))
                print(
                    f"    at {rtol:g}, {name}: {each * 1e3:.2f} ms, {each / groups * 1e6:.1f} us a group; {error:.0e}"
                )


def programs(groups: int, rtol: float) -> dict[str, Any]:
    """Functions that integrate and return the end (3, groups), by the name of the program."""
    found = {f"smpl, `{method}`": solver(groups, rtol, method) for method in ("rosenbrock", "ida")}
    if installed("DiffSL", "pydiffsol"):
        found["DiffSL, BDF"] = diffsl(groups, rtol)
    if groups <= 100:
        found["SciPy, BDF"] = scipy_solver(groups, rtol)
    return found


def solver(groups: int, rtol: float, method: str) -> Any:
    """A function that integrates with this package."""
    env = environment(MODEL, rtol, settings={"groups": groups}, method=method)

    def solve() -> FloatArray:
        env.reset(options={"start": "nominal"})
        env.step(np.zeros(0))
        return np.asarray(env.state).reshape(3, groups)

    return solve


def diffsl(groups: int, rtol: float) -> Any:
    """The same in DiffSL, by pydiffsol: LLVM, BDF, sparse LU of faer."""
    import pydiffsol

    n = groups
    states = f"(0:{n}): x = 1, ({n}:{2 * n}): y = 0, ({2 * n}:{3 * n}): z = 0"
    rates = [
        f"(0:{n}): -0.04 * x_i + 1e4 * y_i * z_i",
        f"({n}:{2 * n}): 0.04 * x_i - 1e4 * y_i * z_i - 3e7 * y_i * y_i",
        f"({2 * n}:{3 * n}): 3e7 * y_i * y_i",
    ]
    text = f"in_i {{ unused = 0 }}\nu_i {{ {states} }}\nF_i {{\n" + ",\n".join(rates) + "\n}\n"
    problem = pydiffsol.Ode(
        text, matrix_type=pydiffsol.faer_sparse, ode_solver=pydiffsol.bdf, linear_solver=pydiffsol.lu
    )
    problem.rtol, problem.atol = rtol, rtol * 1e-4
    return lambda: problem.solve(np.array([0.0]), END).ys[:, -1].reshape(3, groups)


def scipy_solver(groups: int, rtol: float) -> Any:
    """BDF of SciPy with the sparsity of the Jacobian."""
    from scipy.integrate import solve_ivp
    from scipy.sparse import eye as identity
    from scipy.sparse import kron

    def rates(_: float, w: FloatArray) -> FloatArray:
        x, y, z = w.reshape(3, groups)
        first, second = 0.04 * x - 1e4 * y * z, 3e7 * y * y
        return np.concatenate([-first, first - second, second])

    pattern = kron(np.ones((3, 3)), identity(groups))
    start = np.repeat([1.0, 0.0, 0.0], groups)
    atol = rtol * np.repeat(SCALE, groups)

    def solve() -> FloatArray:
        done = solve_ivp(rates, (0, END), start, method="BDF", rtol=rtol, atol=atol, jac_sparsity=pattern)
        return np.asarray(done.y[:, -1]).reshape(3, groups)

    return solve
