"""A tube with at least 1700 states: compilation, evaluation, solution; compared with C."""

from __future__ import annotations

import ctypes
import time
from pathlib import Path
from typing import Any

import numpy as np

import smpl
from smpl.support.arguments import FloatArray
from smpl_benchmarks.peers import c
from smpl_benchmarks.peers.common import (
    at_least,
    compile_time,
    environment,
    goal,
    installed,
    largest,
    memory,
    seconds,
    title,
    where_time_goes,
)

MODEL = Path(__file__).parent / "advection_reaction.eq"
CELLS = 425
TRANSIT = 0.9
JACKETS = 330 + 15 * np.sin(np.arange(30) * 0.9)


def main(repeats: int) -> None:
    """Print all tables."""
    title("Advection and reaction, 425 cells x (A, B, C, T) = 1700 states")
    sizes(repeats)
    model = smpl.compile(MODEL)
    y = middle()
    u = np.array([330.0])
    residual, jacobian = model.native.evaluation_times(0.0, y, u, 1.0)
    goal("residual", residual * 1e6, 0.8, "us")
    goal("all entries of the Jacobian", jacobian * 1e6, 6, "us")
    against_c(model, y, u, residual, jacobian)
    own, exact = solve("solve to t = 3 at 1e-6", 3.0, np.array([330.0]), 12, repeats)
    diffsl(own, exact, repeats)
    in_transit(repeats)
    solve("30 control steps of 0.1 with a new jacket temperature each", 0.1, JACKETS, 35, repeats)


def sizes(repeats: int) -> None:
    """Compile time, time of a control step of 0.1 and memory against the number of cells."""
    print(
        f"  {'states':>8} {'compile':>11} {'a state':>10} {'a step of 0.1':>15} {'a state':>10} {'memory':>10}  a state"
    )
    compiled = {}
    for cells, steps in ((CELLS, 30), (10 * CELLS, 30), (100 * CELLS, 2)):
        states, few = 4 * cells, repeats if cells < 10_000 else 1
        compiled[cells] = compile_time(MODEL, {"n_cells": cells}, max(few, 3))
        env = tube(0.1, cells)
        each = seconds(lambda env=env, steps=steps: episode(env, JACKETS[:steps]), few) / steps  # type: ignore[misc]
        size = memory(MODEL, {"n_cells": cells, "sampling": 0.1})
        kept = f"{size / 1e6:7.0f} MB {size / states:6.0f} B" if size else "   unknown"
        internal = env.solver_statistics["steps"] / steps
        print(
            f"  {states:8} {compiled[cells] * 1e3:8.2f} ms {compiled[cells] / states * 1e9:7.0f} ns"
            f" {each * 1e3:12.1f} ms {each / states * 1e9:7.0f} ns {kept}; {internal:.0f} internal steps,"
            f" {each / internal / states * 1e9:.0f} ns each a state"
        )
    goal("compile", compiled[CELLS] * 1e3, 3, "ms")
    goal("compile of 17,000 states over that of 1700", compiled[10 * CELLS] / compiled[CELLS], 2, "times")


def middle() -> FloatArray:
    """A profile along the tube, in the order of the model: cell by cell."""
    z = np.linspace(0, 1, CELLS)
    return np.stack([1 - 0.4 * z, 1.2 - 0.4 * z, 0.4 * z, 350 - 8 * z], axis=1).ravel()


def by_species(y: FloatArray) -> FloatArray:
    """The order of the C code: species by species."""
    return np.ascontiguousarray(y.reshape(CELLS, 4).T).ravel()


def tube(sampling: float, cells: int = CELLS, rtol: float | None = None, method: str | None = None) -> smpl.Env:
    """The environment with a length of its control steps."""
    return environment(MODEL, rtol, settings={"sampling": sampling, "n_cells": cells}, method=method)


def episode(env: smpl.Env, jackets: FloatArray) -> None:
    """From the cold tube through all jacket temperatures."""
    env.reset(options={"start": "nominal"})
    for jacket in jackets:
        env.step([jacket])


def solve(
    what: str, sampling: float, jackets: FloatArray, target: float, repeats: int
) -> tuple[dict[str, float], FloatArray]:
    """Time and error of an episode by two methods and IDA called from C; returns times and end."""
    exact = tube(sampling, rtol=1e-10)
    episode(exact, jackets)
    times = {}
    for method, rtol in (("ida", None), ("auto", None), ("auto", 1e-5), ("explicit", None)):
        env = tube(sampling, rtol=rtol, method=method)
        name = method if rtol is None else f"{method} at {rtol:g}"
        times[name] = seconds(lambda env=env: episode(env, jackets), repeats)  # type: ignore[misc]
        end = env.state
        goal(f"{what}, {name}", times[name] * 1e3, target, "ms")
        print(f"  largest error at the end {largest(end, exact.state, np.ones_like(end)):.1e}")
        where_time_goes(env, times[name], 1, end, jackets[-1:])
    if c.compiler():
        ida_in_c(sampling, jackets, times["ida"], exact.state)
    return times, exact.state


def in_transit(repeats: int) -> None:
    """Time and error half way: at t = 3 all has come to rest, whatever was wrong before."""
    exact = tube(TRANSIT, rtol=1e-10)
    jackets = np.array([330.0])
    episode(exact, jackets)
    for method, rtol in (("ida", 1e-6), ("auto", 1e-6), ("auto", 1e-5)):
        env = tube(TRANSIT, rtol=rtol, method=method)
        each = seconds(lambda env=env: episode(env, jackets), repeats)  # type: ignore[misc]
        error = largest(env.state, exact.state, np.ones_like(env.state))
        print(f"  to t = {TRANSIT:g} at {rtol:g}, {method}: {each * 1e3:.1f} ms, error {error:.1e}")
    if not installed("DiffSL", "pydiffsol"):
        return
    problem = diffsl_problem()
    each = seconds(lambda: problem.solve(jackets, TRANSIT), repeats)
    error = largest(problem.solve(jackets, TRANSIT).ys[:, -1], by_species(exact.state), np.ones_like(exact.state))
    print(f"  to t = {TRANSIT:g} at 1e-6, DiffSL: {each * 1e3:.1f} ms, error {error:.1e}")


def against_c(model: smpl.Model, y: FloatArray, u: FloatArray, residual: float, jacobian: float) -> None:
    """The same in C, without and with -ffast-math, which calls a vector exponential."""
    if not c.compiler():
        return
    for flags in ([], ["-ffast-math"]):
        library = c.Library("timing", "advection", flags=flags)
        times = library.times(by_species(y), u, model.native.nonzeros)
        rates = by_species(model.rhs(0.0, y, u))
        apart = largest(library.residual(by_species(y), u), rates, np.ones_like(y))
        name = " ".join(["C -O3 -march=native", *flags])
        print(
            f"  {name}: residual {times[0] * 1e6:.2f} us, {times[0] / residual:.2f} of ours;"
            f" Jacobian {times[1] * 1e6:.2f} us, {times[1] / jacobian:.2f} of ours; rates agree to {apart:.0e}"
        )


def ida_in_c(sampling: float, jackets: FloatArray, own: float, exact: FloatArray) -> None:
    """The same with SUNDIALS called from C, restarted at every change as its manual says."""
    try:
        library = c.Library("advection", "advection_ida", flags=["-I/usr/include/suitesparse"], libraries=c.SUNDIALS)
    except OSError:
        print("  IDA from C: skipped, the headers of SUNDIALS are not installed")
        return
    solver = library.functions.solve
    solver.restype = ctypes.c_double
    times = []
    for _ in range(3):
        y = np.repeat([0.0, 0.0, 0.0, 330.0], CELLS)
        counts = (ctypes.c_long * 2)()
        times.append(
            solver(
                c.pointer(y), len(jackets), ctypes.c_double(sampling), c.pointer(jackets), ctypes.c_double(1e-6), counts
            )
        )
    each = sorted(times)[1]
    error = largest(y, by_species(exact), np.ones_like(y))
    print(
        f"  IDA + KLU called from C, the installed SUNDIALS: {each * 1e3:.1f} ms, {each / own:.1f} of ours;"
        f" {counts[0]} steps, {counts[1]} residuals, error {error:.1e}"
    )


def diffsl(own: dict[str, float], exact: FloatArray, repeats: int) -> None:
    """The same in DiffSL, by pydiffsol: LLVM, BDF, sparse LU of faer (its KLU crashes)."""
    if not installed("DiffSL", "pydiffsol"):
        return
    import pydiffsol

    begin = time.thread_time()
    problem = diffsl_problem()
    compiled = time.thread_time() - begin
    each = seconds(lambda: problem.solve(np.array([330.0]), 3.0), repeats)
    error = largest(problem.solve(np.array([330.0]), 3.0).ys[:, -1], by_species(exact), np.ones_like(exact))
    print(
        f"  DiffSL (pydiffsol {pydiffsol.version()}, LLVM, BDF, faer): compile {compiled * 1e3:.0f} ms,"
        f" solve to t = 3 {each * 1e3:.1f} ms, error {error:.1e}"
    )
    for method, seconds_of in own.items():
        at_least(f"DiffSL over {method}", each / seconds_of, 4)


def diffsl_problem() -> Any:
    """The tube by pydiffsol."""
    import pydiffsol

    problem = pydiffsol.Ode(
        diffsl_text(CELLS),
        matrix_type=pydiffsol.faer_sparse,
        ode_solver=pydiffsol.bdf,
        linear_solver=pydiffsol.lu,
    )
    problem.rtol = problem.atol = 1e-6
    return problem


def diffsl_text(n: int) -> str:
    """The equations in DiffSL, by slices of each species (w: temperature)."""
    rows = []
    for k, (name, feed, source) in enumerate(
        [
            ("a", 1.0, "- r{0}"),
            ("b", 1.2, "- r{0}"),
            ("c", 0.0, "+ r{0}"),
            ("w", 350.0, "+ 40.0 * r{0} - 0.5 * (w{0} - Tj)"),
        ]
    ):
        first, rest = source.format("_i[0:1]"), source.format(f"_i[1:{n}]")
        rows.append(f"({k * n}:{k * n + 1}): {n}.0 * ({feed} - {name}_i[0:1]) {first},")
        inner = f"{n}.0 * ({name}_i[0:{n - 1}] - {name}_i[1:{n}]) {rest}"
        rows.append(f"({k * n + 1}:{(k + 1) * n}): {inner},")
    states = f"(0:{n}): a = 0, ({n}:{2 * n}): b = 0, ({2 * n}:{3 * n}): c = 0, ({3 * n}:{4 * n}): w = 330"
    rate = "3e7 * exp(-6000.0 / w_i) * a_i * b_i"
    return f"in_i {{ Tj = 330 }}\nu_i {{ {states} }}\nr_i {{ {rate} }}\nF_i {{\n" + "\n".join(rows) + "\n}\n"
