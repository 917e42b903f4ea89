"""Pictures of searches (extra `report`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from smpl.support import style
from smpl.support.arguments import FloatArray
from smpl.support.optional import load


def search_figure(
    values: FloatArray,
    ascending: bool,
    what: str,
    goal: str,
    profiles: Sequence[tuple[str, FloatArray, FloatArray]] = (),
    time: str = "",
) -> Any:
    """Values over evaluations with the best so far, and below it the best point's profiles.

    Args:
        values: of the evaluations in their order; NaN where there was none.
        ascending: whether large values are good.
        what: what an evaluation is.
        goal: label of the values.
        profiles: label, instants and values of each.
        time: label of the instants.

    Raises:
        ImportError: Matplotlib is missing.
    """
    figure_class = load("matplotlib.figure", "a picture of a search").Figure
    with style.styled():
        rows = 1 + len(profiles)
        figure = figure_class(figsize=(style.WIDTH, 2.4 + 1.5 * len(profiles)), layout="constrained")
        axes = np.atleast_1d(figure.subplots(rows, 1, height_ratios=[2.4] + [1.5] * len(profiles)))
        count = np.arange(1, len(values) + 1)
        finite = np.isfinite(values)
        filled = np.where(finite, values, -np.inf if ascending else np.inf)
        best = np.maximum.accumulate(filled) if ascending else np.minimum.accumulate(filled)
        axes[0].plot(count[finite], values[finite], ".", ms=3, color=style.AXIS, label="evaluations")
        axes[0].step(
            count, np.where(np.isfinite(best), best, np.nan), where="post", color=style.BLUE, label="best so far"
        )
        axes[0].set_ylabel(goal)
        axes[0].set_xlabel(what)
        # What fails would leave no room for what matters.
        low, high = np.percentile(values[finite], [2, 98]) if finite.any() else (0.0, 1.0)
        ends = [low, best[np.isfinite(best)][-1]] if ascending else [best[np.isfinite(best)][-1], high]
        room = 0.05 * (max(ends) - min(ends)) or 0.5
        axes[0].set_ylim(min(ends) - room, max(ends) + room)
        axes[0].legend(loc="lower right" if ascending else "upper right")
        for axis, (label, instants, profile) in zip(axes[1:], profiles, strict=True):
            axis.step(instants, profile, where="post", color=style.VERMILION)
            style.heading(axis, label)
            style.ticks_of(axis)
        if profiles:
            axes[-1].set_xlabel(time)
    return figure
