"""Parameters from noisy runs: coverage of the intervals, and the time compared with SciPy.

    python -m smpl.bench fit

A draw is a run with new noise, and new actions and an unknown start if they vary, to which
parameters and unknown starts are fitted. The peer solves the same least-squares problem as a user
of SciPy would: `solve_ivp` with LSODA from one sampling instant to the next, `least_squares` with
its differences.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import smpl
from smpl.support.arguments import FloatArray
from smpl_benchmarks.peers.common import at_least, installed, title
from smpl_benchmarks.peers.fit_cases import CASES, Case, Peer

DRAWS = 100
GOAL = 10.0


@dataclass(frozen=True)
class Study:
    """Draws of one case.

    Attributes:
        inside: in how many draws the interval held the truth, by name.
        milliseconds: of a fit, processor time, of each draw.
        derivatives: which were taken, over all draws.
        estimates: (draws, parameters).
        widths: half widths of the intervals, likewise.
    """

    inside: dict[str, int]
    milliseconds: FloatArray
    derivatives: set[str]
    estimates: FloatArray
    widths: FloatArray


def study(case: Case, draws: int, derivatives: str = "auto", first: int = 0) -> Study:
    """Fit the draws of a case."""
    model = case.model()
    inside, times, kinds, estimates, widths = dict.fromkeys(case.truth, 0), [], set(), [], []
    smpl.fit(model, case.record(model, first), list(case.truth), initial=case.initial)
    for draw in range(first, first + draws):
        record = case.record(model, draw)
        found, seconds = timed(lambda record=record: smpl.fit(  # type: ignore[misc]
            model, record, list(case.truth), initial=case.initial, derivatives=derivatives
        ))  # fmt: skip
        times.append(1e3 * seconds)
        kinds.add(found.derivatives)
        estimates.append(list(found.parameters.values()))
        widths.append([(high - low) / 2 for low, high in found.interval.values()])
        for name, (low, high) in found.interval.items():
            inside[name] += low <= case.truth[name] <= high
    return Study(inside, np.array(times), kinds, np.array(estimates), np.array(widths))


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """A result and its processor time in seconds."""
    begin = time.process_time()
    found = work()
    return found, time.process_time() - begin


def main(repeats: int) -> None:
    """Print the figures."""
    title("Parameters from noisy runs")
    if not installed("fit", "scipy"):
        return
    for case in CASES:
        ours = study(case, DRAWS)
        held = ", ".join(f"{name} in {count}" for name, count in ours.inside.items())
        middle = float(np.median(ours.milliseconds))
        print(f"  {case.name}: of {DRAWS} intervals of 95 % the truth is inside of: {held}")
        print(f"    a fit takes {middle:.1f} ms (median); derivatives: {', '.join(sorted(ours.derivatives))}")
        plain = study(case, min(DRAWS, 4 * repeats), "differences")
        times, apart = _peer(case, ours, repeats)
        ratio = float(np.median(times / ours.milliseconds[:repeats]))
        at_least("SciPy least_squares over solve_ivp (LSODA) takes", ratio, GOAL)
        print(f"    its values are at most {apart:.1g} half widths of the intervals away")
        share = float(np.median(plain.milliseconds / ours.milliseconds[: len(plain.milliseconds)]))
        print(f"    differences over the same steps take {share:.2f} times")


def _peer(case: Case, ours: Study, draws: int) -> tuple[FloatArray, float]:
    """Milliseconds of SciPy, and its largest distance from our values, in half widths."""
    model = case.model()
    defaults = dict(zip(model.parameter_names, model.native.defaults("parameter").tolist(), strict=True))
    times, apart = [], 0.0
    for draw in range(draws):
        found, seconds = timed(Peer(case, model, case.record(model, draw)).solve)
        times.append(1e3 * seconds)
        theirs = found.x[: len(case.truth)] * [defaults[name] for name in case.truth]
        apart = max(apart, float(np.max(np.abs(theirs - ours.estimates[draw]) / ours.widths[draw])))
    return np.array(times), apart
