"""Residual and Jacobian of the small models against C of the same equations."""

from __future__ import annotations

import numpy as np

import smpl
from smpl.support.arguments import FloatArray
from smpl_benchmarks.peers import c
from smpl_benchmarks.peers.common import title

REACTOR = (np.array([0.8, 55.0, 0.6]), np.array([28.0, 0.11]))
BEER = (np.array([1.5, 1.0, 2.0, 90.0, 15.0, 0.3, 0.5]), np.array([13.0]))


def main(repeats: int) -> None:
    """Print the comparison."""
    title("Residual and Jacobian of one point, against C (gcc -O3 -march=native)")
    if not c.compiler():
        return
    for name, (y, u) in (("reactor", REACTOR), ("beer", BEER)):
        compare(name, y, u)


def compare(name: str, y: FloatArray, u: FloatArray) -> None:
    """Print times of a model and of C, and that both are the same equations."""
    model = smpl.compile(name)
    own = model.native.evaluation_times(0.0, y, u, 1.0)
    library = c.Library("timing", name)
    peer = library.times(y, u, len(y) ** 2)
    rates = model.rhs(0.0, y, u)
    apart = float(np.max(np.abs(library.residual(y, u) - rates) / np.maximum(np.abs(rates), 1e-12)))
    for what, mine, other in zip(("residual", "Jacobian"), own, peer, strict=True):
        print(f"  {name:8} {what}: {mine * 1e9:7.1f} ns; C {other * 1e9:7.1f} ns; C takes {other / mine:.2f} of it")
    print(f"  {name:8} rates agree to {apart:.0e}")
