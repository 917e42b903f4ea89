"""Picture of processor time against error, a panel for each problem."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

LOOKS = {
    "rosenbrock": ("#c8553d", "s", "-"),
    "explicit": ("#2a7f9e", "^", "-"),
    "auto": ("#8a6bb1", "x", "-"),
    "ida": ("#6b7f99", "o", "-"),
    "CVODE": ("#3a9a5f", "D", "--"),
    "LSODA": ("#c58a1b", "v", "--"),
    "DiffSL BDF": ("#c2568f", "P", "--"),
    "DiffSL ESDIRK34": ("#8c8c3a", "*", "--"),
    "SciPy Radau": ("#8d7b6f", "<", ":"),
}
# A grey that is readable on white and on black.
INK, GRID = "#808080", "#80808055"


def draw(points: Mapping[tuple[str, str, float], tuple[float, float]], names: Sequence[str], path: Path) -> None:
    """Draw (error, seconds) by problem, program and tolerance."""
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    matplotlib.rcParams.update({"svg.hashsalt": "smpl", "svg.fonttype": "none", "font.size": 9})
    for part in ("text.color", "xtick.color", "ytick.color", "axes.labelcolor", "axes.edgecolor"):
        matplotlib.rcParams[part] = INK
    problems = list(dict.fromkeys(problem for problem, _, _ in points))
    rows = -(-len(problems) // 3)
    figure, axes = plt.subplots(rows, 3, figsize=(9.6, 2.6 * rows + 0.7), layout="constrained", squeeze=False)
    handles = {}
    for axis, problem in zip(axes.flat, problems, strict=False):
        for name in names:
            line = [point for (own, other, _), point in points.items() if (own, other) == (problem, name)]
            if line:
                colour, marker, style = LOOKS[name]
                x, y = [max(error, 1e-14) for error, _ in line], [seconds * 1e3 for _, seconds in line]
                handles[name] = axis.loglog(x, y, style, marker=marker, color=colour, lw=1.2, ms=4.5, mfc="none")[0]
        axis.set_title(problem.replace("_", " "), fontsize=10)
        axis.invert_xaxis()
        axis.patch.set_alpha(0)
        axis.grid(True, which="major", color=GRID, lw=0.6)
        for side in ("top", "right"):
            axis.spines[side].set_visible(False)
    for axis in axes[-1]:
        axis.set_xlabel("error at the end")
    for axis in axes[:, 0]:
        axis.set_ylabel("processor time, ms")
    for axis in list(axes.flat)[len(problems) :]:
        axis.set_visible(False)
    shown = [name for name in names if name in handles]
    figure.legend([handles[name] for name in shown], shown, loc="outside lower center", ncols=5, frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None}, transparent=True)
    plt.close(figure)
