"""Simulated results of plans: first guesses, what a solver left unfinished, errors of predictions.

An economic optimum is one of several, and which of them a solver ends at depends on where it
begins. Many plans are simulated here, and the best are where it begins (A. H. G. Rinnooy Kan, G. T.
Timmer, Mathematical Programming 39 (1987) 27-56). At a kink (`max`, `if`) a solver may alternate
around an optimum without end. Its last plan is then simulated by the equations and judged by the
result.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from smpl.controllers.collocation import Programme, Transcription
from smpl.support.arguments import FloatArray

# Plans that are simulated at once for the best ones among them.
_PLANS = 60
# Elements of an interval, times those of the programme, that a prediction is compared with.
_FINER = 4


class Simulation:
    """Plans as points of a programme at which its equations hold.

    Args:
        transcription, programme: of the task.
    """

    def __init__(self, transcription: Transcription, programme: Programme) -> None:
        import casadi as ca

        self._t, self._programme = transcription, programme
        parts = programme.functions
        self._value = ca.Function("value", [parts["x"], parts["p"]], [parts["f"], parts["g"]])
        self._step = transcription.step_function()
        self._steps = self._step.map(_PLANS)

    def step(self, state: FloatArray, action: FloatArray, given: FloatArray, at: float) -> FloatArray:
        """The state an interval later."""
        return np.asarray(self._step(state, action, given, at)[0]).ravel()

    def best(self, given: tuple[Any, ...], rest: FloatArray, p: FloatArray, count: int) -> list[FloatArray]:
        """Points of the plans that cost least, of many.

        Args:
            given: state, action before, values for all intervals, values of each, time.
            rest: the operating actions.
            p: parameters of the programme.
            count: at most so many.
        """
        points = self._points(given, self._plans(rest))
        costs = np.array([self.complete(x, p)[0] for x in points])
        order = np.argsort(costs, kind="stable")[:count]
        return [points[i] for i in order if np.isfinite(costs[i])]

    def follow(self, given: tuple[Any, ...], plan: FloatArray) -> FloatArray:
        """The point of a plan, (H, actions); NaN where the equations could not be solved."""
        found: FloatArray = self._points(given, plan[None])[0]
        return found

    def complete(self, x: FloatArray, p: FloatArray) -> tuple[float, float]:
        """Sets slacks by the violated bounds; returns cost and remaining violation."""
        programme = self._programme
        if not np.isfinite(x).all():
            return np.inf, np.inf
        x[programme.slack] = 0.0
        rows, rooms = programme.softened.T
        np.maximum.at(x, rooms, -np.asarray(self._value(x, p)[1]).ravel()[rows])
        f, g = (np.asarray(part).ravel() for part in self._value(x, p))
        sides = (programme.g_lower - g, g - programme.g_upper, programme.lower - x, x - programme.upper)
        broken = max(float(np.max(side, initial=0.0)) for side in sides)
        return (float(f[0]), broken) if np.isfinite(f[0]) and np.isfinite(broken) else (np.inf, np.inf)

    def _plans(self, rest: FloatArray) -> FloatArray:
        """Constant and linear plans (plans, H, actions), some near operating point and bounds."""
        task, random = self._t.task, np.random.default_rng(0)
        width = task.high - task.low
        ends = random.random((_PLANS, 2, len(width)))
        operating = (rest - task.low) / width
        ends[1::3] = np.clip(operating + 0.2 * random.standard_normal(ends[1::3].shape), 0, 1)
        ends[2::3] = np.where(random.random(ends[2::3].shape) < 0.5, ends[2::3] ** 4, 1 - ends[2::3] ** 4)
        ends[: _PLANS // 2, 1] = ends[: _PLANS // 2, 0]
        along = np.linspace(0, 1, task.horizon)[None, :, None]
        shares = ends[:, :1] + along * (ends[:, 1:] - ends[:, :1])
        # A held interval has the actions of the last free one.
        free = np.maximum.accumulate(np.where(task.free, np.arange(task.horizon), 0))
        return np.asarray(task.low + shares[:, free] * width)

    def _points(self, given: tuple[Any, ...], plans: FloatArray) -> FloatArray:
        t, programme = self._t, self._programme
        state, before, constant, varying, at = given
        count = len(plans)
        steps = self._steps if count == _PLANS else self._step
        points = np.zeros((count, len(programme.lower)))
        now = np.tile(state[:, None], (1, count))
        points[:, programme.states[0]] = state / t.e.state_scale
        if programme.previous.size:
            points[:, programme.previous[0]] = before / t.scale
        for k in range(t.task.horizon):
            q = np.tile(t.given_of(constant, varying, k)[:, None], (1, count))
            end, inner = steps(now, plans[:, k].T, q, np.full((1, count), at + k * t.e.export.step))
            now = np.asarray(end)
            points[:, programme.states[k + 1]] = now.T / t.e.state_scale
            points[:, programme.inner[k]] = np.asarray(inner).T
            points[:, programme.actions[k]] = plans[:, k] / t.scale
            if programme.previous.size:
                points[:, programme.previous[k + 1]] = plans[:, k] / t.scale
        return points


class Finer:
    """Plans by the same equations on more elements.

    Args:
        transcription: of the task.
    """

    def __init__(self, transcription: Transcription) -> None:
        task = transcription.task
        self._t = Transcription(replace(task, elements=_FINER * task.elements))
        self._step = self._t.step_function()

    def states(self, given: tuple[Any, ...], plan: FloatArray) -> FloatArray:
        """States of the simulated plan, (H + 1, states); NaN after a failed step."""
        state, _, constant, varying, at = given
        found = [np.asarray(state, dtype=np.float64)]
        for k, action in enumerate(plan):
            q = self._t.given_of(constant, varying, k)
            found.append(np.asarray(self._step(found[-1], action, q, at + k * self._t.e.export.step)[0]).ravel())
        return np.array(found)
