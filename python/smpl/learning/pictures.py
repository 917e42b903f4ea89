"""Pictures of an evaluation (extra `report`): trajectories, returns, violations, comparisons."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from smpl.episodes import Episode
from smpl.learning.plan import Plan
from smpl.learning.scores import Score, physical
from smpl.support import style as look
from smpl.support.arguments import FloatArray

# The most rows of trajectories that are drawn.
_PANELS = 8
# A second panel leaves out a controller that makes the range this many times as wide as the others
# need.
_FAR = 6.0

_Bands = list[tuple[FloatArray, FloatArray, FloatArray, FloatArray] | None]


def pictures(plan: Plan, scores: Sequence[Score]) -> dict[str, tuple[str, bytes]]:
    """Name of each picture to its title and its PNG."""
    with look.styled():
        made: dict[str, tuple[str, Figure]] = {
            "trajectories": ("Trajectories: median, 5 to 95 %, and bounds (dashed)", _trajectories(plan, scores)),
            "returns": ("Returns: share of episodes below", _returns(scores)),
        }
        if any(sum(one.violations.values()) for score in scores for one in score.summaries):
            made["violations"] = ("Violations: mean over episodes, of a range, summed over steps", _violations(scores))
        if len(scores) > 1 and len(scores[0].summaries[0].start) > 1:
            made["starts"] = (f"Starts: return less that of {scores[0].name}", _starts(plan, scores))
        return {name: (title, _png(figure)) for name, (title, figure) in made.items()}


def _trajectories(plan: Plan, scores: Sequence[Score]) -> Figure:
    """A row for each observation and action; a second panel omits a controller far off."""
    rows, left_out = _rows(plan, scores)
    far = [_far(bands) for _, _, bands, _ in rows]
    figure = Figure(figsize=(look.WIDTH, 0.5 + 1.5 * len(rows)), layout="constrained")
    columns = 2 if any(far) else 1
    grid = figure.add_gridspec(len(rows), columns)
    shared: Any = None
    for i, (name, unit, bands, bounds) in enumerate(rows):
        for place, hidden in [(grid[i, 0], set()), (grid[i, 1], far[i])] if far[i] else [(grid[i, :], set())]:
            note = "without " + ", ".join(scores[k].name for k in sorted(hidden)) if hidden else ""
            axis = figure.add_subplot(place, sharex=shared)
            shared = shared or axis
            _draw(axis, scores, bands, hidden)
            _bounds(axis, bounds)
            look.heading(axis, name, unit, note)
            look.ticks_of(axis)
            if i == len(rows) - 1:
                axis.set_xlabel(f"time [{look.typeset(plan.task.model.time_unit)}]")
            else:
                axis.tick_params(labelbottom=False)
    look.legend(figure, figure.axes[0])
    if left_out:
        figure.supxlabel(
            f"Not shown ({len(left_out)}): {', '.join(left_out)}", x=0.01, ha="left", fontsize=7.5, color=look.GREY
        )
    return figure


def _rows(plan: Plan, scores: Sequence[Score]) -> tuple[list[tuple[str, str, _Bands, tuple[float, float]]], list[str]]:
    """Name, unit, bands and bounds of shown quantities, and the names of omitted ones."""
    model = plan.task.model
    observed = min(len(model.observation_names), _PANELS - min(len(model.action_names), 3))
    acted = min(len(model.action_names), _PANELS - observed)
    rows = []
    for i in range(observed):
        bands = _bands(scores, [[physical(plan, one.observations)[:, i] for one in score.kept] for score in scores])
        low, high = model.native.bounds("observation")
        rows.append((model.observation_names[i], model.observation_units[i], bands, (float(low[i]), float(high[i]))))
    for i in range(acted):
        bands = _bands(scores, [[_actions(one)[:, i] for one in score.kept] for score in scores])
        low, high = model.native.bounds("action")
        rows.append((model.action_names[i], model.action_units[i], bands, (float(low[i]), float(high[i]))))
    return rows, [*model.observation_names[observed:], *model.action_names[acted:]]


def _bands(scores: Sequence[Score], values: Sequence[Sequence[FloatArray]]) -> _Bands:
    """Times, and 5 %, median and 95 % of the episodes that still run then, for each controller."""
    found: _Bands = []
    for score, series in zip(scores, values, strict=True):
        if not series:
            found.append(None)
            continue
        longest = max(map(len, series))
        table = np.full((len(series), longest), np.nan)
        for row, one in zip(table, series, strict=True):
            row[: len(one)] = one
        times = max((one.times for one in score.kept), key=len)[:longest]
        low, middle, high = np.nanquantile(table, [0.05, 0.5, 0.95], axis=0)
        found.append((times, low, middle, high))
    return found


def _far(bands: _Bands) -> set[int]:
    """Controllers that widen a panel most, farthest first."""
    extents = {
        i: (float(np.nanmin(band[1])), float(np.nanmax(band[3]))) for i, band in enumerate(bands) if band is not None
    }

    def width(members: Sequence[int]) -> float:
        return max(extents[i][1] for i in members) - min(extents[i][0] for i in members)

    far: set[int] = set()
    while len(rest := [i for i in extents if i not in far]) > 1:
        one = min(rest, key=lambda i: width([other for other in rest if other != i]))
        others = width([i for i in rest if i != one])
        if not others > 0 or width(rest) < _FAR * others:
            break
        far.add(one)
    return far


def _draw(axis: Any, scores: Sequence[Score], bands: _Bands, hidden: set[int]) -> None:
    for i, (score, band) in enumerate(zip(scores, bands, strict=True)):
        if band is None or i in hidden:
            continue
        times, low, middle, high = band
        axis.plot(times, middle, label=score.name, color=look.colour(i), linestyle=look.dashes(i))
        axis.fill_between(times, low, high, alpha=0.18, color=look.colour(i), linewidth=0)


def _bounds(axis: Any, bounds: tuple[float, float]) -> None:
    """Bounds as dashed lines with their values, where they are near what is shown."""
    bottom, top = axis.get_ylim()
    reach = 0.5 * (top - bottom)
    for bound, align in zip(bounds, ("bottom", "top"), strict=True):
        if np.isfinite(bound) and bottom - reach <= bound <= top + reach:
            axis.axhline(bound, **look.BOUND)
            place = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points", "va": align, "ha": "right"}
            offset = (-3, 2 if align == "bottom" else -2)
            axis.annotate(look.number(bound), (1, bound), offset, color=look.INK, fontsize=7, **place)


def _returns(scores: Sequence[Score]) -> Figure:
    figure = Figure(figsize=(look.WIDTH, 3.2), layout="constrained")
    axis = figure.subplots()
    for i, score in enumerate(scores):
        values = np.sort(score.returns)
        (line,) = axis.step(values, np.arange(1, len(values) + 1) / len(values), where="post", label=score.name)
        line.set(color=look.colour(i), linestyle=look.dashes(i))
    look.widen(axis.set_xscale, [float(value) for score in scores for value in score.returns], 3)
    axis.set_xlabel("return")
    axis.set_ylabel("share of episodes")
    look.ticks_of(axis)
    look.legend(figure, axis)
    return figure


def _violations(scores: Sequence[Score]) -> Figure:
    names = list(scores[0].summaries[0].violations)
    means = [[float(np.mean([one.violations[name] for one in score.summaries])) for name in names] for score in scores]
    figure = Figure(figsize=(look.WIDTH, 0.9 + 0.35 * len(names)), layout="constrained")
    axis = figure.subplots()
    height = 0.8 / len(scores)
    for number, (score, values) in enumerate(zip(scores, means, strict=True)):
        place = np.arange(len(names)) + number * height
        axis.barh(place, values, height, label=score.name, color=look.colour(number))
    axis.set_yticks(np.arange(len(names)) + 0.4 - height / 2, names)
    axis.invert_yaxis()
    axis.grid(axis="x")
    axis.grid(visible=False, axis="y")
    positive = [value for values in means for value in values if value > 0]
    look.widen(axis.set_xscale, positive, 3)
    axis.set_xlabel("violation of an episode, of the range")
    look.legend(figure, axis)
    return figure


def _starts(plan: Plan, scores: Sequence[Score]) -> Figure:
    """Regions in which each controller beats the first, over two initial observations."""
    starts = np.stack([one.start for one in scores[0].summaries])
    extent = np.ptp(starts, axis=0) / np.maximum(np.abs(starts).max(axis=0), 1e-300)
    x, y = sorted(np.argsort(extent)[-2:])
    columns = min(len(scores) - 1, 3)
    rows = -(-(len(scores) - 1) // columns)
    figure = Figure(figsize=(look.WIDTH, 0.4 + 2.9 * rows), layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, max(columns, 2), squeeze=False)).ravel()
    names, units = plan.task.model.observation_names, plan.task.model.observation_units
    for axis, score in zip(axes, scores[1:], strict=False):
        difference = score.returns - scores[0].returns
        # The extreme tenth would hide all others.
        limit = float(np.quantile(np.abs(difference), 0.9)) or 1.0
        style = {"s": 16, "cmap": look.diverging(), "vmin": -limit, "vmax": limit}
        drawn = axis.scatter(starts[:, x], starts[:, y], c=difference, edgecolors="#505050", linewidths=0.3, **style)
        bar = figure.colorbar(drawn, ax=axis, extend="both")
        bar.outline.set_visible(False)
        axis.set_title(score.name)
        axis.set_xlabel(_label(names[x], units[x]))
        axis.set_ylabel(_label(names[y], units[y]))
        look.ticks_of(axis)
    for axis in axes[len(scores) - 1 :]:
        axis.set_axis_off()
    return figure


def _actions(one: Episode) -> FloatArray:
    """Physical actions with the last one held, one an instant."""
    given = one.actions.astype(np.float64) if one.details is None else one.details.physical
    return np.concatenate([given, given[-1:]])


def _label(name: str, unit: str) -> str:
    written = look.typeset(unit)
    return f"{name} [{written}]" if written else name


def _png(figure: Figure) -> bytes:
    target = io.BytesIO()
    figure.savefig(target, format="png", dpi=160, metadata={"Software": None})
    return target.getvalue()
