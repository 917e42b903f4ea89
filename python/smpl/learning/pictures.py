"""Pictures of an evaluation (extra `report`): trajectories, returns, violations, where which controller is better."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from smpl._arguments import FloatArray
from smpl.evaluation import Episode
from smpl.learning.plan import Plan
from smpl.learning.scores import Score, physical

# The most rows of trajectories that are drawn.
_PANELS = 8


def pictures(plan: Plan, scores: Sequence[Score]) -> dict[str, tuple[str, bytes]]:
    """Name of each picture to its title and its PNG."""
    made: dict[str, tuple[str, Figure]] = {
        "trajectories": ("Trajectories: median, 5 to 95 %, and bounds (dotted)", _trajectories(plan, scores)),
        "returns": ("Returns: share of episodes below", _returns(scores)),
    }
    if any(sum(one.violations.values()) for score in scores for one in score.summaries):
        made["violations"] = ("Violations: mean over episodes, of a range, summed over steps", _violations(scores))
    if len(scores) > 1 and len(scores[0].summaries[0].start) > 1:
        made["starts"] = (f"Starts: return less that of {scores[0].name}", _starts(plan, scores))
    return {name: (title, _png(figure)) for name, (title, figure) in made.items()}


def _trajectories(plan: Plan, scores: Sequence[Score]) -> Figure:
    model = plan.task.model
    observed = list(range(min(len(model.observation_names), _PANELS - min(len(model.action_names), 3))))
    acted = list(range(min(len(model.action_names), _PANELS - len(observed))))
    figure = Figure(figsize=(9, 1.8 * (len(observed) + len(acted))), layout="constrained")
    axes = np.atleast_1d(figure.subplots(len(observed) + len(acted), 1, sharex=True))
    for axis, i in zip(axes, observed, strict=False):
        values = [[physical(plan, one.observations)[:, i] for one in score.kept] for score in scores]
        _band(axis, scores, values)
        _bounds(axis, model.native.bounds("observation"), i)
        axis.set_ylabel(_label(model.observation_names[i], model.observation_units[i]))
    for axis, i in zip(axes[len(observed) :], acted, strict=True):
        _band(axis, scores, [[_actions(one)[:, i] for one in score.kept] for score in scores])
        _bounds(axis, model.native.bounds("action"), i)
        axis.set_ylabel(_label(model.action_names[i], model.action_units[i]))
    axes[-1].set_xlabel(f"time, {model.time_unit}")
    axes[0].legend(loc="best", fontsize="small")
    return figure


def _band(axis: Any, scores: Sequence[Score], values: Sequence[Sequence[FloatArray]]) -> None:
    """Median and band of the episodes that still run at each time."""
    for score, series in zip(scores, values, strict=True):
        if not series:
            continue
        longest = max(map(len, series))
        table = np.full((len(series), longest), np.nan)
        for row, one in zip(table, series, strict=True):
            row[: len(one)] = one
        times = max((one.times for one in score.kept), key=len)[:longest]
        low, middle, high = np.nanquantile(table, [0.05, 0.5, 0.95], axis=0)
        (line,) = axis.plot(times, middle, label=score.name)
        axis.fill_between(times, low, high, alpha=0.2, color=line.get_color(), linewidth=0)


def _bounds(axis: Any, bounds: tuple[FloatArray, FloatArray], i: int) -> None:
    """Bounds as dotted lines where they are near what is shown."""
    bottom, top = axis.get_ylim()
    reach = 0.5 * (top - bottom)
    for bound in (bounds[0][i], bounds[1][i]):
        if np.isfinite(bound) and bottom - reach <= bound <= top + reach:
            axis.axhline(bound, color="0.4", linestyle=":", linewidth=1)


def _returns(scores: Sequence[Score]) -> Figure:
    figure = Figure(figsize=(8, 4), layout="constrained")
    axis = figure.subplots()
    for score in scores:
        values = np.sort(score.returns)
        axis.step(values, np.arange(1, len(values) + 1) / len(values), where="post", label=score.name)
    axis.set_xlabel("return")
    axis.set_ylabel("share of episodes")
    axis.legend(loc="best", fontsize="small")
    return figure


def _violations(scores: Sequence[Score]) -> Figure:
    names = list(scores[0].summaries[0].violations)
    figure = Figure(figsize=(8, 0.8 + 0.4 * len(names)), layout="constrained")
    axis = figure.subplots()
    height = 0.8 / len(scores)
    for number, score in enumerate(scores):
        values = [float(np.mean([one.violations[name] for one in score.summaries])) for name in names]
        axis.barh(np.arange(len(names)) + number * height, values, height, label=score.name)
    axis.set_yticks(np.arange(len(names)) + 0.4 - height / 2, names)
    axis.legend(loc="best", fontsize="small")
    return figure


def _starts(plan: Plan, scores: Sequence[Score]) -> Figure:
    """Where each controller beats the first, over the two observations that vary most at the start."""
    starts = np.stack([one.start for one in scores[0].summaries])
    extent = np.ptp(starts, axis=0) / np.maximum(np.abs(starts).max(axis=0), 1e-300)
    x, y = sorted(np.argsort(extent)[-2:])
    figure = Figure(figsize=(4.5 * (len(scores) - 1) + 1, 4), layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, len(scores) - 1))
    names, units = plan.task.model.observation_names, plan.task.model.observation_units
    for axis, score in zip(axes, scores[1:], strict=True):
        difference = score.returns - scores[0].returns
        # The extreme tenth would hide all others.
        limit = float(np.quantile(np.abs(difference), 0.9)) or 1.0
        drawn = axis.scatter(starts[:, x], starts[:, y], c=difference, s=12, cmap="RdBu", vmin=-limit, vmax=limit)
        figure.colorbar(drawn, ax=axis)
        axis.set_title(score.name)
        axis.set_xlabel(_label(names[x], units[x]))
        axis.set_ylabel(_label(names[y], units[y]))
    return figure


def _actions(one: Episode) -> FloatArray:
    """Physical actions with the last one held, one an instant."""
    given = one.actions.astype(np.float64) if one.details is None else one.details.physical
    return np.concatenate([given, given[-1:]])


def _label(name: str, unit: str) -> str:
    return name if unit in ("", "1") else f"{name}, {unit}"


def _png(figure: Figure) -> bytes:
    target = io.BytesIO()
    figure.savefig(target, format="png", dpi=110, metadata={"Software": None})
    return target.getvalue()
