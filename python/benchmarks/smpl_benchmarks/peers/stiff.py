"""Error against processor time on published problems: all methods, DiffSL, CVODE, LSODA and Radau.

`python -m smpl.bench stiff` prints the table. `python -m smpl_benchmarks.peers.stiff --write docs`,
with `python/benchmarks` in `PYTHONPATH`, writes it and its picture into the book. Peers evaluate
the same rates and Jacobians compiled by gcc or DiffSL; only SciPy's `Radau` calls them from Python.
Errors are those at the end, over the value or, if that is smaller, a hundredth of the scale (the
scale in the two problems that are not stiff). The reference is `rosenbrock` at 1e-12, and
`explicit` in those two.
"""

from __future__ import annotations

import argparse
import ctypes
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import smpl
from smpl.support.arguments import FloatArray
from smpl_benchmarks.peers.c import HERE, compiler, pointer
from smpl_benchmarks.peers.common import installed, scenario, title
from smpl_benchmarks.peers.precision import NONE, TOLERANCES
from smpl_benchmarks.peers.precision import PROBLEMS as FOLDER
from smpl_benchmarks.peers.stiff_picture import draw
from smpl_benchmarks.peers.stiff_problems import PROBLEMS, Problem

# A run at a tolerance: the states at the end, nothing after a failure, and the seconds.
Solve = Callable[[float], tuple[FloatArray | None, float]]
Found = dict[tuple[str, str, float], tuple[float, float]]
METHODS = ("rosenbrock", "explicit", "auto", "ida")
COMPILED = ("CVODE", "LSODA", "DiffSL BDF", "DiffSL ESDIRK34")
PEERS = (*COMPILED, "SciPy Radau")
# Errors at which times are compared.
EQUAL = (1e-3, 1e-6, 1e-9)
# Methods that would take millions of steps.
TOO_LONG = {(name, "explicit") for name in ("robertson", "e5", "orego", "pollution", "van_der_pol")}
SMOOTH = {"predator_prey", "arenstorf"}
TIGHT, SHORT, MOST_STEPS = 1e-12, 0.02, 1_000_000
BEGIN, END = "<!-- stiff -->\n", "<!-- end of stiff -->\n"
LIBRARIES = ["cvode", "nvecserial", "sunmatrixsparse", "sunmatrixdense", "sunlinsolklu", "sunlinsoldense"]
WRAPPER = """
void rates(double t, const double *y, double *out, void *data) {
  const double *arg[1] = { y }; double *res[1] = { out };
  casadi_rates(arg, res, 0, 0, 0);
}
void jacobian(double t, const double *y, double *out, void *data) {
  const double *arg[1] = { y }; double *res[1] = { out };
  casadi_jacobian(arg, res, 0, 0, 0);
}
"""


class CProblem(ctypes.Structure):
    """The structure `Problem` of `cvode.c`."""

    _fields_ = [
        ("rates", ctypes.c_void_p), ("jacobian", ctypes.c_void_p), ("size", ctypes.c_long), ("nonzeros", ctypes.c_long),
        ("columns", ctypes.c_void_p), ("rows", ctypes.c_void_p), ("data", ctypes.c_void_p),
    ]  # fmt: skip


def shared_library(text: str, folder: str, name: str, *libraries: str) -> Any:
    """A library of C text.

    Raises:
        OSError: the compiler refuses, for example because a library is missing.
    """
    source, shared = Path(folder) / f"{name}.c", Path(folder) / f"{name}.so"
    source.write_text(text)
    flags = ["-O3", "-march=native", "-shared", "-fPIC", "-I/usr/include/suitesparse"]
    command = ["gcc", *flags, "-o", str(shared), str(source), *libraries, "-lm"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        raise OSError(done.stderr)
    return ctypes.CDLL(str(shared))


def compiled_rates(problem: Problem, folder: str) -> Any:
    """Rates and the dense Jacobian by columns, in C by CasADi and gcc."""
    import casadi

    x = casadi.SX.sym("x", len(problem.rates))
    names: dict[str, Any] = {f"x{k}": x[k] for k in range(x.numel())} | {"exp": casadi.exp, "sqrt": casadi.sqrt}
    rates = casadi.vertcat(*(eval(text, {}, names) for text in problem.rates))
    generator = casadi.CodeGenerator(f"{problem.name}.c")
    generator.add(casadi.Function("casadi_rates", [x], [casadi.densify(rates)]))
    generator.add(casadi.Function("casadi_jacobian", [x], [casadi.densify(casadi.jacobian(rates, x))]))
    return shared_library(generator.dump() + WRAPPER, folder, problem.name)


def address(function: Any) -> int:
    """Address of a function of C."""
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)


def own(problem: Problem, method: str) -> Solve:
    """A method of this package: a control step over the whole interval."""

    def solve(rtol: float) -> tuple[FloatArray | None, float]:
        with scenario(f"solver: {{rtol: {rtol!r}, atol_factor: 0.01, max_steps: {MOST_STEPS}}}\n") as path:
            if problem.path:
                env = smpl.Env(FOLDER / f"{problem.path}.eq", normalize=False, scenario=path, method=method)
            else:
                model = smpl.compile(source=problem.model_text(), scenario=path)
                env = smpl.Env(model, normalize=False, method=method)
        env.reset(options={"start": "nominal"})
        begin = time.thread_time()
        env.step(np.zeros(0))
        taken = time.thread_time() - begin
        return (None if env.native.failure_kind == "solver" else np.array(env.state)), taken

    return solve


def cvode(problem: Problem, rates: Any, driver: Any) -> Solve:
    """CVODE (BDF, Newton, dense LU) from C."""
    size = len(problem.start)
    given = CProblem(address(rates.rates), address(rates.jacobian), size, size * size, None, None, None)
    driver.solve.restype = ctypes.c_double

    def solve(rtol: float) -> tuple[FloatArray | None, float]:
        out, counts, start, atol = np.zeros(size), (ctypes.c_long * 2)(), np.array(problem.start), problem.atol(rtol)
        taken = driver.solve(
            ctypes.byref(given), pointer(start), pointer(atol), ctypes.c_double(rtol),
            ctypes.c_double(problem.end), ctypes.c_long(1), pointer(out), counts,
        )  # fmt: skip
        return (None if taken < 0 else out), taken

    return solve


def lsoda(problem: Problem, rates: Any) -> Solve:
    """LSODA in C++ (numbalsoda): Jacobians by differences, one absolute tolerance, the smallest."""
    import numbalsoda

    start, times = np.array(problem.start), np.array([0.0, problem.end])

    def solve(rtol: float) -> tuple[FloatArray | None, float]:
        atol = float(problem.atol(rtol).min())
        begin = time.thread_time()
        states, good = numbalsoda.lsoda(address(rates.rates), start, times, rtol=rtol, atol=atol, mxstep=MOST_STEPS)
        taken = time.thread_time() - begin
        return (states[-1] if good else None), taken

    return solve


def diffsl(problem: Problem, solver: str) -> Solve:
    """A method of diffsol on DiffSL text (pydiffsol): LLVM, exact Jacobians, dense LU."""
    import pydiffsol

    states = ", ".join(f"x{k} = {value!r}" for k, value in enumerate(problem.start))
    text = "in_i { unused = 0 }\nu_i { " + states + " }\nF_i {\n" + ",\n".join(problem.rates) + "\n}\n"
    ode = pydiffsol.Ode(
        text, matrix_type=pydiffsol.nalgebra_dense, ode_solver=getattr(pydiffsol, solver), linear_solver=pydiffsol.lu
    )

    def solve(rtol: float) -> tuple[FloatArray | None, float]:
        ode.rtol, ode.atol = rtol, float(problem.atol(rtol).min())
        begin = time.thread_time()
        try:
            end = ode.solve(np.array([0.0]), problem.end).ys[:, -1]
        except Exception:  # the package raises exceptions of no narrower class
            return None, 0.0
        return np.array(end), time.thread_time() - begin

    return solve


def radau(problem: Problem, rates: Any) -> Solve:
    """Radau IIA in SciPy, written in Python, with the compiled rates and Jacobian."""
    from scipy.integrate import solve_ivp

    size, start = len(problem.start), np.array(problem.start)

    def call(function: Any, shape: tuple[int, ...]) -> Callable[[float, FloatArray], FloatArray]:
        function.argtypes = [ctypes.c_double, *[ctypes.c_void_p] * 3]

        def evaluate(t: float, y: FloatArray) -> FloatArray:
            y, out = np.ascontiguousarray(y), np.zeros(shape, order="F")
            function(t, y.ctypes.data, out.ctypes.data, None)
            return out

        return evaluate

    f, jac = call(rates.rates, (size,)), call(rates.jacobian, (size, size))

    def solve(rtol: float) -> tuple[FloatArray | None, float]:
        begin = time.thread_time()
        done = solve_ivp(f, (0, problem.end), start, "Radau", rtol=rtol, atol=problem.atol(rtol), jac=jac)
        return (done.y[:, -1] if done.success else None), time.thread_time() - begin

    return solve


def solvers(problem: Problem, folder: str, driver: Any) -> dict[str, Solve]:
    """All programs on a problem, by name."""
    found = {method: own(problem, method) for method in METHODS if (problem.name, method) not in TOO_LONG}
    if driver is not None:
        rates = compiled_rates(problem, folder)
        found["CVODE"] = cvode(problem, rates, driver)
        if installed("LSODA", "numbalsoda"):
            found["LSODA"] = lsoda(problem, rates)
        if installed("SciPy Radau", "scipy"):
            found["SciPy Radau"] = radau(problem, rates)
    if installed("DiffSL", "pydiffsol"):
        found |= {"DiffSL BDF": diffsl(problem, "bdf"), "DiffSL ESDIRK34": diffsl(problem, "esdirk34")}
    return found


def measure(problem: Problem, folder: str, driver: Any, repeats: int) -> Found:
    """Errors and the least of the times, by program and tolerance."""
    exact = own(problem, "explicit" if problem.name in SMOOTH else "rosenbrock")(TIGHT)[0]
    if exact is None:
        return {}
    least = 1.0 if problem.name in SMOOTH else 1e-2
    size = np.maximum(np.abs(exact), least * np.array(problem.scale))
    found: Found = {}
    for name, solve in solvers(problem, folder, driver).items():
        for rtol in TOLERANCES:
            end, taken = solve(rtol)
            if end is None:
                continue
            more = repeats - 1 if taken < SHORT else 0
            taken = min([taken, *(solve(rtol)[1] for _ in range(more))])
            found[problem.name, name, rtol] = float(np.max(np.abs(end - exact) / size)), taken
    return found


def tables(repeats: int) -> tuple[Found, list[str]]:
    """Print the table; gives the points and the text for the book."""
    title("Error at the end and processor time at tolerances of 1e-4, 1e-6, 1e-8, 1e-10")
    names = (*METHODS, *PEERS)
    lines = ["| problem | rtol | " + " | ".join(names) + " |", "|---" * (2 + len(names)) + "|"]
    found: Found = {}
    with tempfile.TemporaryDirectory() as folder:
        driver = None
        if compiler() and installed("CVODE, LSODA, SciPy Radau", "casadi"):
            text = (HERE / "cvode.c").read_text()
            driver = shared_library(text, folder, "driver", *(f"-lsundials_{name}" for name in LIBRARIES), "-lklu")
        for problem in PROBLEMS:
            found |= measure(problem, folder, driver, repeats)
            for rtol in TOLERANCES:
                cells = [cell(found.get((problem.name, name, rtol))) for name in names]
                lines.append(f"| {problem.name} | {rtol:.0e} | " + " | ".join(cells) + " |")
                print("  " + lines[-1], flush=True)
    return found, lines


def cell(point: tuple[float, float] | None) -> str:
    """Error and time."""
    if point is None:
        return NONE
    error, seconds = point
    time_of = f"{seconds * 1e6:.0f} µs" if seconds < 1e-3 else f"{seconds * 1e3:.3g} ms"
    return f"{error:.0e}, {time_of}"


def least_time(line: Sequence[tuple[float, float]], error: float) -> float:
    """Least time of a program at an error, interpolated; infinite if no run is as accurate."""
    line = sorted(line)
    times = [seconds for own_error, seconds in line if own_error <= error]
    for (low, first), (high, second) in pairwise(line):
        if low <= error < high:
            share = np.log(error / low) / np.log(high / low)
            times.append(float(first ** (1 - share) * second**share))
    return min(times, default=np.inf)


def equal_errors(found: Found) -> list[str]:
    """Lines of the table of times at equal errors: `auto`, `ida`, the best compiled peer."""
    heads = ", ".join(f"{error:.0e}" for error in EQUAL)
    lines = [f"| problem, µs at {heads} | `auto` | `ida` | best compiled peer |", "|---|---|---|---|"]
    for problem in dict.fromkeys(name for name, _, _ in found):
        cells: list[list[str]] = [[], [], []]
        for error in EQUAL:
            times = {
                name: least_time([point for (of, by, _), point in found.items() if (of, by) == (problem, name)], error)
                for name in (*METHODS, *PEERS)
            }
            best = min(COMPILED, key=lambda name: times[name])
            for column, name in zip(cells, ("auto", "ida", best), strict=True):
                shown = f"{times[name] * 1e6:.0f}" if np.isfinite(times[name]) else NONE
                column.append(f"{shown} ({best})" if name == best and shown != NONE else shown)
        lines.append(f"| {problem} | " + " | ".join(", ".join(column) for column in cells) + " |")
    return lines


def main(repeats: int) -> None:
    """Print the tables."""
    found, _ = tables(repeats)
    title("Least time at equal error")
    print("\n".join("  " + line for line in equal_errors(found)))


def write(folder: Path) -> None:
    """Put table and picture into the book at this folder."""
    page = folder / "performance.md"
    text = page.read_text()
    if not re.search(f"{BEGIN}.*{END}", text, re.DOTALL):
        sys.exit(f"{page} has no lines `{BEGIN.strip()}` and `{END.strip()}`")
    found, lines = tables(5)
    before, _, rest = text.partition(BEGIN)
    picture = "![Processor time against error on nine problems, with peers](figures/stiff.svg)"
    equal = ["Least time at equal error, interpolated in the table:", "", *equal_errors(found)]
    text = "\n".join([*lines, "", picture, "", *equal])
    page.write_text(before + BEGIN + "\n" + text + "\n\n" + END + rest.partition(END)[2])
    draw(found, (*METHODS, *PEERS), folder / "figures" / "stiff.svg")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m smpl_benchmarks.peers.stiff", description="Work and precision.")
    parser.add_argument("--write", metavar="FOLDER", type=Path, help="the folder of the book, to be written")
    given = parser.parse_args()
    if given.write is None:
        tables(5)
    else:
        write(given.write)
