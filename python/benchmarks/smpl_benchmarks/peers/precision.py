"""Error against tolerance of every method: models, test problems, invariants, orbits.

`python -m smpl.bench precision` prints the tables. `python -m smpl_benchmarks.peers.precision
--write docs`, with `python/benchmarks` in `PYTHONPATH`, writes them and their picture into the
book. The exact solution is that of `rosenbrock` at 1e-12, and of `ida` where that is not taken; how
far the two are apart there is printed too. Errors are those of the states at the end, over their
value or, if that is smaller, a hundredth of their scale.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import smpl
from smpl.support.arguments import FloatArray
from smpl.support.files import model_path
from smpl_benchmarks.peers.common import installed, scenario, title

METHODS = ("ida", "rosenbrock", "explicit", "auto")
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10)
TIGHT = 1e-12
PROBLEMS = Path(smpl.__file__).parents[2] / "tests" / "problems"
# Names and steps; the actions move about their nominal values, or follow the model's recipe.
MODELS = {"reactor": 30, "beer": 140, "pensim": 200, "atropine": 3, "mab": 3, "mab_plant": 3}
SEVERAL = {"column_a": 5, "four_tanks": 20, "van_de_vusse": 40}
# Fresh columns under nominal actions: others soon leave the boxes.
AT_REST = {"mab", "mab_plant"}
BY_RECIPE = {"pensim"}
INVARIANTS = ("reactor", "beer", "pensim", "atropine")
PANELS = ("robertson", "hires", "transistor_amplifier", "reactor", "pensim", "atropine")
# What a method is not asked for: the eigenvalues of these would take it millions of steps.
TOO_STIFF = {"e5", "robertson", "van_der_pol", "orego", "pollution", "atropine", "mab", "mab_plant"}
PROMISE = 100
SHORT = 0.05
NONE = "\N{EN DASH}"
BEGIN, END = "<!-- precision -->\n", "<!-- end of precision -->\n"


@dataclass(frozen=True)
class Case:
    """An integration: a model or a problem, and its steps."""

    name: str
    path: str | Path
    steps: int


@dataclass(frozen=True)
class Run:
    """States at the end and what they took."""

    end: FloatArray
    evaluations: int
    seconds: float


@dataclass(frozen=True)
class Point:
    """A run compared with the exact solution."""

    error: float
    evaluations: int
    seconds: float


Points = dict[tuple[str, str, float], Point]


def cases() -> Iterator[Case]:
    """All models, and the problems where the package runs from a checkout."""
    for name, steps in MODELS.items():
        yield Case(name, name, steps)
    if not PROBLEMS.is_dir():
        print("  test problems: skipped, they are in a checkout only")
        return
    for path in sorted(PROBLEMS.glob("*.eq")):
        yield Case(path.stem, path, SEVERAL.get(path.stem, 1))


def solve(case: Case, method: str, rtol: float) -> Run | None:
    """The end of the case; nothing where the method refuses the model or gives up."""
    if method == "explicit" and case.name in TOO_STIFF:
        return None
    try:
        with scenario(f"solver: {{rtol: {rtol!r}, max_steps: 1000000}}\nmax_steps: 1000000000\n") as path:
            env = smpl.Env(case.path, normalize=False, scenario=path, method=method, observation="full")
    except ValueError:
        return None
    env.reset(seed=1, options={"start": "nominal"})
    low, high = env.action_low, env.action_high
    nominal = env.model.native.defaults("action")
    moves = 0.0 if case.name in AT_REST else 0.02
    width = moves * np.where(np.isfinite(high - low), high - low, 0.0)
    recipe = env.model.native.policies[0] if case.name in BY_RECIPE else None
    begin = time.thread_time()
    for step in range(case.steps):
        action = env.native.policy(recipe) if recipe else nominal + (step % 3 - 1) * width
        _, _, terminated, _, _ = env.step(action)
        if terminated and step + 1 < case.steps:
            return None
    seconds = time.thread_time() - begin
    if env.native.failure_kind == "solver":
        return None
    return Run(env.state, env.solver_statistics["residuals"], seconds)


def least(case: Case, method: str, rtol: float) -> Run | None:
    """A run, and the least of the times of three where it is short."""
    run = solve(case, method, rtol)
    if run is None or run.seconds > SHORT:
        return run
    others = [other for _ in range(2) if (other := solve(case, method, rtol)) is not None]
    return replace(run, seconds=min(one.seconds for one in (run, *others)))


def points(case: Case) -> tuple[Points, float]:
    """Errors of all methods at all tolerances, and how far the two tight solutions are apart."""
    elements: list[dict[str, Any]] = smpl.export.json(smpl.compile(case.path))["elements"]["states"]
    scale = 1e-2 * np.array([element["scale"] for element in elements])
    tight = [run.end for method in ("rosenbrock", "ida") if (run := solve(case, method, TIGHT)) is not None]
    if not tight:
        return {}, np.nan
    size = np.maximum(np.abs(tight[0]), scale)
    found: Points = {}
    for method in METHODS:
        for rtol in TOLERANCES:
            run = least(case, method, rtol)
            if run is not None:
                error = float(np.max(np.abs(run.end - tight[0]) / size))
                found[case.name, method, rtol] = Point(error, run.evaluations, run.seconds)
    apart = float(np.max(np.abs(tight[-1] - tight[0]) / size)) if len(tight) == 2 else np.nan
    return found, apart


def table() -> tuple[Points, list[str]]:
    """All errors, and the lines of their table."""
    lines = [
        "| 1e-4, 1e-6, 1e-8, 1e-10 | " + " | ".join(METHODS) + " | distance |",
        "|---" * (2 + len(METHODS)) + "|",
    ]
    everything: Points = {}
    for case in cases():
        found, apart = points(case)
        everything.update(found)
        cells = []
        for method in METHODS:
            errors = [found.get((case.name, method, rtol)) for rtol in TOLERANCES]
            cells.append(
                ", ".join(NONE if one is None else f"{one.error:.0e}" for one in errors) if any(errors) else NONE
            )
        lines.append(f"| {case.name} | " + " | ".join(cells) + f" | {NONE if np.isnan(apart) else f'{apart:.0e}'} |")
        print("  " + lines[-1], flush=True)
    return everything, lines


def beyond(found: Points) -> list[str]:
    """Errors above a hundred tolerances, one line per method."""
    lines = []
    for method in METHODS:
        own = {key: point for key, point in found.items() if key[1] == method}
        worse = [f"{name} at {rtol:.0e} ({point.error / rtol:.0f})" for (name, _, rtol), point in own.items()
                 if point.error > PROMISE * rtol]  # fmt: skip
        within = len(own) - len(worse)
        rest = f"; beyond: {', '.join(worse)}" if worse else ""
        lines.append(f"- `{method}`: {within} of {len(own)} errors are within {PROMISE} tolerances{rest}.")
    return lines


def invariants() -> list[str]:
    """Drift of the invariants over an episode, over their magnitude, by method and tolerance."""
    lines = ["| 1e-4, 1e-6, 1e-8, 1e-10 | " + " | ".join(METHODS) + " |", "|---" * (1 + len(METHODS)) + "|"]
    for model in INVARIANTS:
        cells = [", ".join(drift(model, method, rtol) for rtol in TOLERANCES) for method in METHODS]
        if model in TOO_STIFF:
            cells[METHODS.index("explicit")] = NONE
        lines.append(f"| {model} | " + " | ".join(cells) + " |")
        print("  " + lines[-1], flush=True)
    return lines


def drift(model: str, method: str, rtol: float) -> str:
    """Largest drift of a model's invariants over their magnitudes, from the command."""
    if method == "explicit" and model in TOO_STIFF:
        return NONE
    with scenario(f"solver: {{rtol: {rtol!r}, method: {method}}}\n") as path:
        command = [sys.executable, "-m", "smpl", "check", "--invariants", str(model_path(model)), "--scenario", path]
        text = subprocess.run(command, capture_output=True, text=True).stdout
    shares = [float(found) for found in re.findall(r"\(([-+.0-9e]+) of its magnitude\)", text)]
    return f"{max(shares):.0e}" if shares else "?"


ORBIT = """
model Orbit
time t : s
state x = 0.994
state y = 0
state u = 0
state v = -2.00158510637908252240537862224
let a = (sq(x + 0.012277471) + sq(y))^1.5
let b = (sq(x - 0.987722529) + sq(y))^1.5
eq d/dt x = u / 1 [s]
eq d/dt y = v / 1 [s]
eq d/dt u = (x + 2*v - 0.987722529*(x + 0.012277471)/a - 0.012277471*(x - 0.987722529)/b) / 1 [s]
eq d/dt v = (y - 2*u - 0.987722529*y/a - 0.012277471*y/b) / 1 [s]
observe x
reward r default = 0
episode { step = 17.0652165601579625588917206249 [s], max_steps = 1 }
solver { max_steps = 1000000 }
"""


def rates_of_orbit(_: float, w: FloatArray) -> FloatArray:
    """Arenstorf's orbit (Hairer, Nørsett and Wanner, section II.0)."""
    m, n = 0.012277471, 0.987722529
    x, y, u, v = w
    a, b = ((x + m) ** 2 + y**2) ** 1.5, ((x - n) ** 2 + y**2) ** 1.5
    return np.array([u, v, x + 2 * v - n * (x + m) / a - m * (x - n) / b, y - 2 * u - n * y / a - m * y / b])


def orbits() -> list[str]:
    """Errors and evaluations of DOP853 here and in SciPy at equal tolerances, on an orbit."""
    if not installed("SciPy DOP853", "scipy"):
        return []
    from scipy.integrate import solve_ivp

    lines = ["| rtol | `explicit`: error, evaluations | SciPy DOP853: error, evaluations |", "|---|---|---|"]
    start = np.array([0.994, 0.0, 0.0, -2.00158510637908252240537862224])
    end = 17.0652165601579625588917206249
    model = smpl.compile(source=ORBIT)
    for rtol in TOLERANCES:
        with scenario(f"solver: {{rtol: {rtol!r}, atol_factor: 1.0e-4, method: explicit}}\n") as path:
            env = smpl.Env(smpl.compile(source=ORBIT, scenario=path), normalize=False)
        env.reset(seed=0)
        env.step(model.native.defaults("action"))
        own = float(np.max(np.abs(env.state - start)))
        peer = solve_ivp(rates_of_orbit, (0.0, end), start, method="DOP853", rtol=rtol, atol=1e-4 * rtol)
        other = float(np.max(np.abs(peer.y[:, -1] - start)))
        lines.append(f"| {rtol:.0e} | {own:.1e}, {env.solver_statistics['residuals']} | {other:.1e}, {peer.nfev} |")
        print("  " + lines[-1])
    return lines


def main(_repeats: int) -> None:
    """Print all tables."""
    tables()


def tables() -> tuple[Points, list[str]]:
    """Print all tables; gives the points and the text for the book."""
    title("Error at the end against tolerance")
    found, errors = table()
    text = [*errors, "", *beyond(found)]
    print("\n".join("  " + line for line in beyond(found)))
    title("Drift of invariants over an episode, over their magnitude")
    text += ["", "Drift of the invariants over an episode, over their magnitude:", "", *invariants()]
    title("Arenstorf's orbit compared with SciPy")
    beside = orbits()
    if beside:
        text += ["", "Arenstorf's orbit, which ends where it began, compared with SciPy:", "", *beside]
    return found, text


def draw(found: Points, path: Path) -> None:
    """Work against error, a panel a problem."""
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    matplotlib.rcParams.update({"svg.hashsalt": "smpl", "svg.fonttype": "none", "font.size": 9})
    figure, axes = plt.subplots(2, 3, figsize=(9.6, 5.6), layout="constrained")
    looks = {
        "ida": ("#4c5b70", "o"),
        "rosenbrock": ("#c8553d", "s"),
        "explicit": ("#2a7f9e", "^"),
        "auto": ("#8a6bb1", "x"),
    }
    for axis, name in zip(axes.flat, PANELS, strict=True):
        for method in METHODS:
            line = [found[name, method, rtol] for rtol in TOLERANCES if (name, method, rtol) in found]
            if line:
                colour, marker = looks[method]
                x = [max(point.error, 1e-14) for point in line]
                y = [point.seconds * 1e3 for point in line]
                axis.loglog(x, y, marker=marker, color=colour, label=method, lw=1.2, ms=5, mfc="none")
        axis.set_title(name.replace("_", " "), fontsize=10)
        axis.invert_xaxis()
        axis.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.yaxis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:.0e}"[0] in "235" else "")
        axis.grid(True, which="major", color="#dddddd", lw=0.6)
        for side in ("top", "right"):
            axis.spines[side].set_visible(False)
    for axis in axes[-1]:
        axis.set_xlabel("error at the end")
    for axis in axes[:, 0]:
        axis.set_ylabel("processor time, ms")
    handles = {
        label: handle for axis in axes.flat for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    shown = [method for method in METHODS if method in handles]
    figure.legend([handles[m] for m in shown], shown, loc="outside lower center", ncols=len(shown), frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def write(folder: Path) -> None:
    """Put tables and picture into the book at this folder."""
    page = folder / "performance.md"
    before, begin, rest = page.read_text().partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        sys.exit(f"{page} has no lines `{BEGIN.strip()}` and `{END.strip()}`")
    found, text = tables()
    page.write_text(before + BEGIN + "\n" + "\n".join(text) + "\n\n" + END + after)
    draw(found, folder / "figures" / "work_precision.svg")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        prog="python -m smpl_benchmarks.peers.precision",
        description="Error against tolerance.",
    )
    parser.add_argument("--write", metavar="FOLDER", type=Path, help="the folder of the book, to be written")
    given = parser.parse_args()
    if given.write is None:
        tables()
    else:
        write(given.write)
