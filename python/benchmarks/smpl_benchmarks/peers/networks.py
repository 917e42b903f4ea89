"""A large reaction network from a file: compilation, all methods, CVODE with KLU, LSODA.

`python -m smpl.bench network --file bcr.net`, for example the network of early signals of the B
cell receptor (1,122 species, 24,388 reactions; Barua, Hlavacek and Lipniacki 2012). The package
`bionetgen` of Python has BioNetGen: `BNG2.pl bcr.bngl` with the rules of the publication and
`generate_network({overwrite=>1})` writes `bcr.net`. Errors are those at the end, relative to the
amount or a millionth of the largest one at the start, against `rosenbrock` at 1e-11.
"""

from __future__ import annotations

import ctypes
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import smpl
from smpl.support.arguments import FloatArray
from smpl_benchmarks.peers.c import HERE, compiler, pointer
from smpl_benchmarks.peers.common import compile_time, installed, memory, scenario, title
from smpl_benchmarks.peers.network import Indices, Network, model_text, read_network, scale_of
from smpl_benchmarks.peers.stiff import LIBRARIES, CProblem, address, shared_library

ENDS = (100.0, 20_000.0)
# Errors are relative to an amount or this share of the largest at the start.
LEAST = 1e-6
TOLERANCES = (1e-4, 1e-6, 1e-8)
RATES = """
typedef struct { long size, reactions, entries, nonzeros, slopes; const double *constants, *counts, *weights;
  const long *first, *second, *rows, *numbers, *other, *places; double *rate, *amount; } Network;
void rates(double t, const double *y, double *out, void *data) {
  const Network *n = data;
  for (long i = 0; i < n->size; i++) n->amount[i] = y[i], out[i] = 0;
  n->amount[n->size] = 1;
  for (long r = 0; r < n->reactions; r++)
    n->rate[r] = n->constants[r] * n->amount[n->first[r]] * n->amount[n->second[r]];
  for (long k = 0; k < n->entries; k++) out[n->rows[k]] += n->counts[k] * n->rate[n->numbers[k]];
}
void jacobian(double t, const double *y, double *out, void *data) {
  const Network *n = data;
  for (long i = 0; i < n->size; i++) n->amount[i] = y[i];
  n->amount[n->size] = 1;
  for (long k = 0; k < n->nonzeros; k++) out[k] = 0;
  for (long k = 0; k < n->slopes; k++) out[n->places[k]] += n->weights[k] * n->amount[n->other[k]];
}
"""


ARRAYS = (
    "constants", "counts", "weights", "first", "second", "rows", "numbers", "other", "places", "rate", "amount",
)  # fmt: skip
Run = Callable[[float], tuple[FloatArray | None, float, int]]


class CNetwork(ctypes.Structure):
    """The structure `Network` of the rates in C."""

    _fields_ = [
        *((name, ctypes.c_long) for name in ("size", "reactions", "entries", "nonzeros", "slopes")),
        *((name, ctypes.c_void_p) for name in ARRAYS),
    ]


def main(repeats: int, path: str | None = None) -> None:
    """Print compile time, memory, errors and times."""
    title("A reaction network from a file")
    if path is None:
        print("  skipped: give a network of BioNetGen by --file")
        return
    network = read_network(Path(path))
    active = without_idle(network)
    print(f"  {len(network.start)} species, {len(network.constants)} reactions, {len(active.constants)} with a rate")
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / "network.eq"
        model.write_text(model_text(network, ENDS[-1], 1))
        compiled, grown = compile_time(model, repeats=3), memory(model, {"step": 1.0})
        print(f"  compiled in {compiled * 1e3:.0f} ms of processor time; {(grown or np.nan) / 1e6:.0f} MB with a step")
        for end in ENDS:
            at_an_end(network, active, model, folder, end)


def at_an_end(network: Network, active: Network, model: Path, folder: str, end: float) -> None:
    """Print errors and times of all programs to one instant."""
    print(f"  to t = {end:g} s")
    programs: dict[str, Run] = {f"`{method}`": own(model, method, end) for method in ("rosenbrock", "auto", "ida")}
    if compiler():
        compiled = compiled_network(active, folder)
        programs["CVODE, KLU"] = cvode(active, compiled, folder, end)
        if installed("LSODA", "numbalsoda"):
            programs["LSODA"] = lsoda(active, compiled, end)
    exact, *_ = programs["`rosenbrock`"](1e-11)
    if exact is None:
        print("    no reference")
        return
    size = np.maximum(np.abs(exact), LEAST * network.start.max())
    for rtol in TOLERANCES:
        for name, run in programs.items():
            states, taken, steps = run(rtol)
            if states is None:
                print(f"    {name} at {rtol:g}: fails")
                continue
            error = float(np.max(np.abs(states - exact) / size))
            each = f", {steps} steps of {taken / steps * 1e3:.2g} ms" if steps else ""
            print(f"    {name} at {rtol:g}: {taken:.3g} s{each}; error {error:.0e}", flush=True)


def without_idle(network: Network) -> Network:
    """The network without reactions whose constant is zero, which the compiler also removes."""
    keep = network.constants != 0
    number = np.cumsum(keep) - 1
    entries = keep[network.reactions]
    return Network(
        network.start, network.constants[keep], network.first[keep], network.second[keep], network.rows[entries],
        number[network.reactions[entries]], network.counts[entries],
    )  # fmt: skip


def own(model: Path, method: str, end: float) -> Run:
    """States at the end by this package, processor time, internal steps."""

    def run(rtol: float) -> tuple[FloatArray | None, float, int]:
        with scenario(f"solver: {{rtol: {rtol!r}}}\n") as path:
            compiled = smpl.compile(model, scenario=path, settings={"step": end})
        env = smpl.Env(compiled, normalize=False, method=method)
        env.reset(options={"start": "nominal"})
        begin = time.thread_time()
        env.step(np.zeros(0))
        taken = time.thread_time() - begin
        failed = env.native.failure_kind == "solver"
        return None if failed else np.array(env.state), taken, env.solver_statistics["steps"]

    return run


def slopes(network: Network) -> tuple[Indices, Indices, FloatArray]:
    """Positions by columns, other reactants and factors of the terms of the Jacobian."""
    size = len(network.start)
    found = []
    for own_reactant, other in ((network.first, network.second), (network.second, network.first)):
        column = own_reactant[network.reactions]
        kept = column < size
        weight = network.counts * network.constants[network.reactions]
        found.append((network.rows[kept], column[kept], other[network.reactions][kept], weight[kept]))
    rows, columns, others, weights = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return columns * size + rows, others, weights


@dataclass(frozen=True)
class Compiled:
    """Rates and sparse Jacobian of a network in C, with the arrays that they read."""

    problem: CProblem
    data: CNetwork
    arrays: tuple[NDArray[Any], ...]
    library: Any


def compiled_network(network: Network, folder: str) -> Compiled:
    """The rates, compiled by gcc, and the pattern of the Jacobian by columns."""
    size = len(network.start)
    positions, others, weights = slopes(network)
    pattern, places = np.unique(np.append(positions, np.arange(size) * (size + 1)), return_inverse=True)
    arrays: dict[str, NDArray[Any]] = {
        "constants": network.constants, "counts": network.counts, "weights": weights, "first": network.first,
        "second": network.second, "rows": network.rows, "numbers": network.reactions,
        "other": others, "places": places[: len(weights)],
        "rate": np.zeros(len(network.constants)), "amount": np.zeros(size + 1),
    }  # fmt: skip
    kept = [np.ascontiguousarray(arrays[name]) for name in ARRAYS]
    rows, columns = pattern % size, np.searchsorted(pattern, np.arange(size + 1) * size)
    counts = size, len(network.constants), len(network.rows), len(pattern), len(weights)
    data = CNetwork(*counts, *(pointer(array) for array in kept))
    library = shared_library(RATES, folder, "network")
    problem = CProblem(
        address(library.rates), address(library.jacobian), size, len(pattern), pointer(columns), pointer(rows),
        ctypes.cast(ctypes.pointer(data), ctypes.c_void_p),
    )  # fmt: skip
    return Compiled(problem, data, (*kept, rows, columns), library)


def cvode(network: Network, compiled: Compiled, folder: str, end: float) -> Run:
    """CVODE (BDF, Newton, sparse LU of KLU) from C, with the exact Jacobian."""
    libraries = [*(f"-lsundials_{name}" for name in LIBRARIES), "-lklu"]
    driver = shared_library((HERE / "cvode.c").read_text(), folder, "driver", *libraries)
    driver.solve.restype = ctypes.c_double
    size = len(network.start)

    def run(rtol: float) -> tuple[FloatArray | None, float, int]:
        out, made, atol = np.zeros(size), (ctypes.c_long * 2)(), np.full(size, 1e-2 * rtol * scale_of(network))
        taken = driver.solve(
            ctypes.byref(compiled.problem), pointer(network.start), pointer(atol), ctypes.c_double(rtol),
            ctypes.c_double(end), ctypes.c_long(1), pointer(out), made,
        )  # fmt: skip
        return None if taken < 0 else out, taken, int(made[0])

    return run


def lsoda(network: Network, compiled: Compiled, end: float) -> Run:
    """LSODA in C++ (numbalsoda): dense Jacobians by differences; it does not report its steps."""
    import numbalsoda

    # The package passes an array of numbers to the rates: here the bytes of their structure.
    data, times = np.frombuffer(bytes(compiled.data), dtype=np.float64).copy(), np.array([0.0, end])
    rates = address(compiled.library.rates)

    def run(rtol: float) -> tuple[FloatArray | None, float, int]:
        atol = 1e-2 * rtol * scale_of(network)
        begin = time.thread_time()
        states, good = numbalsoda.lsoda(rates, network.start, times, data=data, rtol=rtol, atol=atol, mxstep=1_000_000)
        return (states[-1] if good else None), time.thread_time() - begin, 0

    return run
