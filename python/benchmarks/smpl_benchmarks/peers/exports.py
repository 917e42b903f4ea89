"""Exported C against the machine code: residual and Jacobian of every model, gcc -O3."""

from __future__ import annotations

import ctypes
import re
import subprocess
import tempfile
from pathlib import Path

import numpy as np

import smpl
from smpl_benchmarks.peers.c import compiler, pointer

MODELS = ["reactor", "beer", "pensim", "atropine", "mab", "mab_plant"]
GOAL = 1.5

# Least mean of runs that last a millisecond.
TIMING = r"""
#define _POSIX_C_SOURCE 199309L
#include "model.h"
#include <time.h>

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

double least_time(int jacobian, double *y, double *yp, double *u, double *p, double *w, double *out)
{
    double best = 1e9;
    long count = 10;
    model_prepare(u, p, w);
    for (int run = 0; run < 60; ++run) {
        const double begin = now();
        for (long i = 0; i < count; ++i) {
            if (jacobian)
                model_jacobian(0.0, y, yp, 1.0, u, p, w, out);
            else
                model_residual(0.0, y, yp, u, p, w, out);
            __asm__ volatile("" : : : "memory");
        }
        const double mean = (now() - begin) / (double)count;
        best = mean < best ? mean : best;
        count *= mean * (double)count < 1e-3 ? 2 : 1;
    }
    return best;
}
"""


class _Element(ctypes.Structure):
    _fields_ = [
        ("name", ctypes.c_char_p),
        ("unit", ctypes.c_char_p),
        *((name, ctypes.c_double) for name in ("low", "high", "scale", "nominal")),
    ]


def times(model: smpl.Model, folder: Path) -> list[tuple[float, float]]:
    """Seconds of residual and Jacobian, in C and in machine code, at the nominal point."""
    _, header = smpl.export.write(model, "c", folder / "model.c")
    (folder / "timing.c").write_text(TIMING)
    command = ["gcc", "-std=c99", "-O3", "-shared", "-fPIC", "-o", "model.so", "model.c", "timing.c", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "model.so"))
    library.least_time.restype = ctypes.c_double
    size = {name: int(n) for name, n in re.findall(r"#define MODEL_(\w+) (\d+)", header.read_text())}

    def nominal(table: str) -> list[float]:
        rows = (_Element * size[table.upper()]).in_dll(library, f"model_{table}_table")
        return [row.nominal for row in rows]

    y = np.nan_to_num(np.array([*nominal("states"), *nominal("algebraic")]))
    u, p = np.array(nominal("actions")), np.array(nominal("parameters"))
    vectors = [y, np.zeros_like(y), u, p, np.zeros(size["WORK"] + 1), np.zeros(max(size["NONZEROS"], len(y)))]
    own = model.native.evaluation_times(0.0, y, u, 1.0)
    return [(library.least_time(which, *map(pointer, vectors)), own[which]) for which in (0, 1)]


def main(repeats: int) -> None:
    """Print the table; `repeats` does not matter, the least time is taken."""
    del repeats
    print(f"\nexported C, gcc -O3, over machine code (goal for the residual: {GOAL})")
    if not compiler():
        return
    for name in MODELS:
        with tempfile.TemporaryDirectory() as folder:
            pairs = times(smpl.compile(name), Path(folder))
        shown = [f"{c * 1e6:8.3f} us / {own * 1e6:8.3f} us = {c / own:4.2f}" for c, own in pairs]
        print(f"  {name:10} residual {shown[0]}   Jacobian {shown[1]}")
