"""Pictures of fits (extra `report`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from smpl.support import style
from smpl.support.arguments import FloatArray
from smpl.support.optional import load


def fit_figure(
    simulated: Sequence[Mapping[str, FloatArray]],
    residuals: Sequence[Mapping[str, FloatArray]],
    times: Sequence[FloatArray],
    noise: Mapping[str, float],
    units: Mapping[str, str],
    time: str,
) -> Any:
    """Runs with their measurements, one row per output, and residuals over their deviation.

    Args:
        simulated: of each run, output -> values at its times.
        residuals: measured less simulated, NaN where nothing was read.
        times: of each run.
        noise: deviations by outputs.
        units: of the outputs.
        time: label of the instants.

    Raises:
        ImportError: Matplotlib is missing.
    """
    figure_class = load("matplotlib.figure", "a picture of a fit").Figure
    with style.styled():
        names = list(noise)
        figure = figure_class(figsize=(style.WIDTH, 0.7 + 1.8 * len(names)), layout="constrained")
        axes = figure.subplots(len(names), 2, sharex=True, squeeze=False, width_ratios=[3, 2])
        for (left, right), name in zip(axes, names, strict=True):
            for number, (line, rest) in enumerate(zip(simulated, residuals, strict=True)):
                instants, color = times[number], style.colour(number)
                read = np.isfinite(rest[name])
                left.plot(instants[read], (line[name] + rest[name])[read], ".", ms=4, color=color, alpha=0.5)
                left.plot(instants, line[name], color=color, linestyle=style.dashes(number), label=f"run {number}")
                right.plot(instants[read], rest[name][read] / noise[name], ".", ms=4, color=color)
            style.heading(left, name, units.get(name, "1"), "line: fit, points: readings")
            right.axhspan(-1.96, 1.96, color="#efefef", zorder=0)
            right.axhline(0.0, color=style.AXIS, lw=0.8)
            style.heading(right, "residual / deviation", "", "band: 95 %")
            for axis in (left, right):
                style.ticks_of(axis)
        style.legend(figure, axes[0, 0])
        for axis in axes[-1]:
            axis.set_xlabel(time)
        # Ticks are laid out here, with the sizes that hold here.
        figure.draw_without_rendering()
    return figure
