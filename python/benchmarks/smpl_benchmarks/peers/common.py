"""Times, errors and the way they are printed."""

from __future__ import annotations

import importlib.util
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import smpl
from smpl import _native
from smpl.support.arguments import FloatArray
from smpl.support.files import model_path

Step = Callable[[], object]


def installed(peer: str, *modules: str) -> bool:
    """True if the modules of a peer are there; otherwise it is skipped by its name."""
    missing = [module for module in modules if importlib.util.find_spec(module) is None]
    if missing:
        print(f"  {peer}: skipped, {', '.join(missing)} is not installed")
    return not missing


def seconds(action: Step, repeats: int = 5) -> float:
    """Median processor time of an action in this thread."""
    times = []
    for _ in range(repeats):
        begin = time.thread_time()
        action()
        times.append(time.thread_time() - begin)
    return statistics.median(times)


def title(text: str) -> None:
    """A heading."""
    print(f"\n## {text}\n")


def goal(what: str, measured: float, target: float, unit: str) -> None:
    """A figure that should be at most its goal."""
    verdict = "met" if measured <= target else "missed"
    print(f"  {what}: {measured:.3g} {unit}; goal {target:g} {unit}, {measured / target:.2f} of it: {verdict}")


def at_least(what: str, measured: float, target: float) -> None:
    """A ratio that should be at least its goal."""
    verdict = "met" if measured >= target else "missed"
    print(f"  {what}: {measured:.1f} times; goal {target:g} times: {verdict}")


@contextmanager
def scenario(text: str) -> Iterator[str]:
    """A scenario of this text as a file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.yaml"
        path.write_text(text)
        yield str(path)


def environment(model: str | Path, rtol: float | None, *, parent: str = "", **arguments: Any) -> smpl.Env:
    """An environment in physical units with a given tolerance and without a time limit.

    Args:
        model: name or path.
        rtol: relative tolerance, the model's own if none.
        parent: further lines of the scenario.
        arguments: of `smpl.Env`.
    """
    solver = f"solver: {{rtol: {rtol!r}}}\n" if rtol else ""
    with scenario(solver + parent + "max_steps: 1000000000\n") as path:
        return smpl.Env(model, normalize=False, scenario=path, **arguments)


def compile_time(model: str | Path, settings: Mapping[str, float] | None = None, repeats: int = 7) -> float:
    """Median seconds from text to machine code, with reading files, without lists of names.

    Compilation has its own threads: the time is that of all of them together.
    """
    given = {name: repr(value) for name, value in (settings or {}).items()}
    path = str(model if isinstance(model, Path) else model_path(model))
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        _native.Model(path, None, None, [], given, "default", None)
        times.append(time.process_time() - begin)
    return statistics.median(times)


def where_time_goes(env: smpl.Env, step_seconds: float, steps: int, state: FloatArray, action: FloatArray) -> None:
    """Counts of the solver a step, and what of its time are residuals and Jacobians."""
    counts = {name: count / steps for name, count in env.solver_statistics.items()}
    residual, jacobian = env.model.native.evaluation_times(0.0, state, action, 1.0)
    shares = (counts["residuals"] * residual / step_seconds, counts["jacobians"] * jacobian / step_seconds)
    print(
        "  a step takes "
        + ", ".join(f"{counts[name]:.1f} {name.replace('_', ' ')}" for name in ("steps", "residuals", "jacobians"))
        + f", {counts['factorisations']:.1f} factorisations, {counts['linear_solves']:.1f} linear solves"
    )
    print(
        f"  time: residuals {shares[0]:.0%} ({residual * 1e6:.2f} us each), Jacobians {shares[1]:.0%}"
        f" ({jacobian * 1e6:.2f} us each), integrator and linear algebra {max(0.0, 1 - sum(shares)):.0%}"
    )


MEMORY = """
import sys, smpl
def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096
import numpy as np
settings = {settings!r}
before = resident()
env = smpl.Env({model!r}, normalize=False, settings=settings)
env.reset(options={{"start": "nominal"}})
env.step(env.model.native.defaults("action"))
print(resident() - before)
"""


def memory(model: str | Path, settings: Mapping[str, float]) -> float | None:
    """Growth of a process in bytes by compiling a model and a step; None if unknown."""
    if not Path("/proc/self/statm").exists():
        return None
    code = MEMORY.format(model=str(model), settings=dict(settings))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=os.environ)
    return float(done.stdout) if done.returncode == 0 else None


def largest(values: FloatArray, reference: FloatArray, scale: FloatArray) -> float:
    """Largest error over the larger of the reference and the scale."""
    return float(np.max(np.abs(values - reference) / np.maximum(np.abs(reference), scale)))
