"""Pictures of fits (extra `report`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from smpl._arguments import FloatArray
from smpl._optional import load


def fit_figure(
    simulated: Sequence[Mapping[str, FloatArray]],
    residuals: Sequence[Mapping[str, FloatArray]],
    times: Sequence[FloatArray],
    noise: Mapping[str, float],
    units: Mapping[str, str],
    time: str,
) -> Any:
    """Runs with what was measured, an output a row, and beside them the residuals over their deviation.

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
    names = list(noise)
    figure = figure_class(figsize=(10, 0.6 + 2.1 * len(names)), layout="constrained")
    axes = figure.subplots(len(names), 2, sharex=True, squeeze=False, width_ratios=[3, 2])
    for (left, right), name in zip(axes, names, strict=True):
        for number, (line, rest) in enumerate(zip(simulated, residuals, strict=True)):
            instants, color = times[number], f"C{number % 10}"
            read = np.isfinite(rest[name])
            left.plot(instants[read], (line[name] + rest[name])[read], ".", ms=4, color=color, alpha=0.5)
            left.plot(instants, line[name], color=color, lw=1.2, label=f"run {number}")
            right.plot(instants[read], rest[name][read] / noise[name], ".", ms=4, color=color)
        unit = units.get(name, "1")
        left.set_ylabel(name if unit == "1" else f"{name} [{unit}]")
        right.axhspan(-1.96, 1.96, color="0.92", zorder=0)
        right.axhline(0.0, color="0.6", lw=0.8)
        right.set_ylabel("residual / deviation")
    if len(simulated) > 1:
        axes[0, 0].legend(fontsize="small", ncols=min(len(simulated), 5))
    axes[0, 0].set_title("fit (lines) and readings (points)", fontsize="medium")
    axes[0, 1].set_title("residuals; the band holds 95 %", fontsize="medium")
    for axis in axes[-1]:
        axis.set_xlabel(time)
    return figure
