"""Figures of the benchmark (extra `report`): learning curves and scores of each environment."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from smpl.support import style as look
from smpl_benchmarks.records import Result

_COLOURS = {"control": look.INK, "offline": look.BLUE, "online": look.VERMILION}


def draw(results: Iterable[Result], table: Mapping[str, Any], out: Path) -> list[Path]:
    """Draw results and their rows of `table.json` into `figures/`; nothing without Matplotlib."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return []
    rows = [row for row in table["rows"] if "skipped" not in row]
    folder, drawn, learned = out / "figures", [], [one for one in results if one.curve]
    folder.mkdir(exist_ok=True)
    with look.styled():
        for env in dict.fromkeys(row["env"] for row in rows):
            mine = [row for row in rows if row["env"] == env]
            figures = {f"{env}-scores": _scores(Figure, env, mine), f"{env}-curves": _curves(Figure, env, learned)}
            for name, figure in figures.items():
                if figure is not None:
                    drawn.append(folder / f"{name}.png")
                    figure.savefig(drawn[-1], format="png", dpi=110, metadata={"Software": None})
    return drawn


def _scores(figure_type: Any, env: str, rows: Sequence[Mapping[str, Any]]) -> Any:
    """Mean gain over the nominal policy with its interval; the return itself without this policy.

    Only rows of as many episodes as the longest are shown: others are not comparable.
    """
    most = max(row["episodes"] for row in rows)
    rows = [row for row in rows if row["episodes"] == most]
    key = "gain" if all(row["gain"] is not None for row in rows) else "return_mean"
    interval = "gain_interval" if key == "gain" else "return_interval"
    shown = [row for row in rows if key != "gain" or row["controller"] != "nominal"] or rows
    ordered = sorted(shown, key=lambda row: float(row[key]))
    figure = figure_type(figsize=(look.WIDTH, 1.4 + 0.2 * len(ordered)), layout="constrained")
    axis = figure.subplots()
    for suite, colour in _COLOURS.items():
        mine = [(place, row) for place, row in enumerate(ordered) if row["suite"] == suite]
        places = [place for place, _ in mine]
        ends = np.array([row[interval] for _, row in mine]).reshape(-1, 2)
        axis.hlines(places, ends[:, 0], ends[:, 1], color=colour, linewidth=2)
        axis.plot([row[key] for _, row in mine], places, "o", color=colour, markersize=4, label=suite if mine else None)
    axis.set_yticks(range(len(ordered)), [_label(row) for row in ordered])
    axis.set_ylim(-0.7, len(ordered) - 0.3)
    look.widen(axis.set_xscale, [float(value) for row in ordered for value in (row[key], *row[interval])], 3)
    if key == "gain":
        axis.axvline(0, color=look.AXIS, linewidth=1)
    what = "gain in the return of an episode over the nominal policy" if key == "gain" else "return of an episode"
    axis.set_xlabel(f"mean {what}, with its 95 % interval over seeds")
    axis.set_title(env)
    axis.legend(loc="lower right")
    axis.grid(axis="x")
    axis.grid(visible=False, axis="y")
    return figure


def _label(row: Mapping[str, Any]) -> str:
    seeds = row["seeds"]
    return str(row["controller"]) + (f" ({seeds} seed{'s' * (seeds > 1)})" if seeds < 3 else "")


def _curves(figure_type: Any, env: str, learned: Iterable[Result]) -> Any:
    """Mean reward of validation episodes over the steps of training, with the range of seeds."""
    panels: dict[str, dict[str, list[list[dict[str, float]]]]] = {}
    for one in learned:
        if one.run.env == env:
            panels.setdefault(one.run.suite, {}).setdefault(one.run.controller, []).append(one.curve)
    if not panels:
        return None
    deepest = max(-(-len(algorithms) // 4) for algorithms in panels.values())
    figure = figure_type(figsize=(look.WIDTH, 4 + 0.17 * deepest), layout="constrained")
    for axis, (suite, algorithms) in zip(np.atleast_1d(figure.subplots(1, len(panels))), panels.items(), strict=True):
        for number, (name, seeds) in enumerate(algorithms.items()):
            length = min(map(len, seeds))
            steps = [row["steps"] for row in seeds[0][:length]]
            values = np.array([[row["mean"] for row in one[:length]] for one in seeds])
            style = {"color": look.colour(number), "linestyle": look.dashes(number)}
            axis.plot(steps, values.mean(axis=0), label=name, marker=".", **style)
            axis.fill_between(
                steps, values.min(axis=0), values.max(axis=0), alpha=0.15, color=style["color"], linewidth=0
            )
        if suite == "online":
            axis.set_xscale("log")  # a policy gradient takes thirty times the steps of a learner that replays
        look.widen(axis.set_yscale, [row["mean"] for seeds in algorithms.values() for one in seeds for row in one])
        axis.set_title(f"{env}, {suite}")
        axis.set_xlabel("gradient steps" if suite == "offline" else "steps of the process")
        axis.set_ylabel("mean reward of a step, validation")
        axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), fontsize="x-small", ncols=3, handlelength=3.5)
    return figure
