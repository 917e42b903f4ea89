"""Recorded runs simulated again, with derivatives by what is fitted; see `smpl.fit`.

Forward sensitivities are chained. With S the derivative of the state at a sampling instant, the
next one is (dx/dx) S + dx/dp of the step between, both exact (`smpl.Model.linearize_step`). Steps
that dead times join are integrated over the whole run (`smpl.Model.linearize_rollout`).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from smpl._native import SimulationError
from smpl.analysis.rollout import rollout
from smpl.analysis.runs import Run
from smpl.model import Model
from smpl.support.arguments import FloatArray

# Relative distance of differences.
DISTANCE = 3e-4
# Steps whose states are further than this from those of the run, in parts of the largest, are not
# those of the run; the first where all are computed as if they were the first one, which a model
# that reads the time does not bear.
_APART = {True: 1e-5, False: 1e-3}
# States by columns of derivatives from which on steps are spread over threads.
_LARGE = 400


class _Steps(NamedTuple):
    """States after each step (H, states), and derivatives by states, then parameters."""

    states: FloatArray
    of_states: FloatArray
    of_readings: FloatArray


class Recorded:
    """Simulations of runs at points: parameters, then the unknown starts of each run.

    Args:
        model: the model.
        runs: the records.
        outputs: names of observations or states that are compared.
        parameters, initial: names of what a point consists of.
        fixed: values of other parameters.
        sensors: of the observation level, see `smpl.analysis.sensors`.
        method: of integration.
    """

    def __init__(
        self,
        model: Model,
        runs: Sequence[Run],
        outputs: Sequence[str],
        parameters: tuple[str, ...],
        initial: tuple[str, ...],
        fixed: dict[str, float],
        sensors: Any,
        method: str | None = None,
    ) -> None:
        self.model, self.runs, self.parameters, self.initial = model, runs, parameters, initial
        self._fixed, self._sensors, self._method = fixed, sensors, method
        seen, states = model.observation_names, model.state_names
        self._outputs = [(name in seen, (seen if name in seen else states).index(name)) for name in outputs]
        self._columns = [states.index(name) for name in initial]
        by = (("state", states), ("parameter", parameters))
        known = {"state": states, "parameter": model.parameter_names}
        self._directions = [(role, known[role].index(name)) for role, names in by for name in names]
        # Whether the steps of a run are computed in one call.
        self.together = True
        # The last point that was simulated alone, and its run: derivatives are wanted there.
        self._latest: dict[int, tuple[bytes, Any]] = {}
        # Steps of each run until its end, where its derivatives were computed last.
        self.steps: dict[int, int] = {}
        self._edges = model.native.bounds("observation")

    def forget(self, place: int) -> None:
        """Drop what is known of a run that has changed."""
        self._latest.pop(place, None)

    def _own(self, place: int) -> list[int]:
        """Columns of a point that belong to a run."""
        count, width = len(self.parameters), len(self.initial)
        return [*range(count), *range(count + place * width, count + (place + 1) * width)]

    def values(self, place: int, points: FloatArray) -> FloatArray:
        """Outputs (N, H + 1 + instants, outputs) of a run at all points (N, d)."""
        found = self._rollout(place, points, None)
        if len(points) == 1:
            self._latest[place] = (points[0].tobytes(), found)
        return self._chosen(found)

    def _chosen(self, found: Any) -> FloatArray:
        low, high = self._edges
        within = np.clip(found.measured, low, high)
        parts = [
            ((found.observations, within) if seen else (found.states, found.instant_states), i)
            for seen, i in self._outputs
        ]
        return np.stack([np.concatenate([one[:, :, i] for one in both], axis=1) for both, i in parts], axis=-1)

    def _rollout(self, place: int, points: FloatArray, steps: int | None) -> Any:
        run = self.runs[place]
        states = np.tile(run.states, (len(points), 1))
        states[:, self._columns] = points[:, self._own(place)[len(self.parameters) :]]
        given: dict[str, Any] = {**run.parameters, **self._fixed}
        given |= {name: points[:, i] for i, name in enumerate(self.parameters)}
        actions = run.actions[:steps]
        return rollout(
            self.model,
            states,
            np.broadcast_to(actions, (len(points), *actions.shape)),
            parameters=given,
            discrete=run.discrete,
            disturbances={name: values[: len(actions)] for name, values in run.disturbances.items()},
            method=self._method,
            threads=1 if steps else None,  # of a few steps, threads cost more than they bring
            max_steps=len(run.actions),  # a record may be longer than an episode of the model
            instants=() if steps else run.instants,
        )

    def differences(self, place: int, points: FloatArray, steps: int | None = None) -> FloatArray:
        """Derivatives (H + 1 + instants, outputs, d) by differences of the points of `beside`."""
        size = (len(points) - 1) // 2
        path = self._rollout(place, points, steps)
        if steps is None:
            # After the end of a neighbour differences are not derivatives.
            self.steps[place] = int(path.steps.min())
        found = self._chosen(path)
        distance = (points[1 : size + 1] - points[size + 1 :]).diagonal()
        return np.moveaxis(found[1 : size + 1] - found[size + 1 :], 0, -1) / distance

    def exact(self, place: int, point: FloatArray, points: Callable[[], FloatArray]) -> FloatArray:
        """Derivatives (H + 1, outputs, d) of a run by forward sensitivities.

        Args:
            place: of the run.
            point: where, (d,).
            points: gives those of `beside`, for the readings at the start, which no step leads to.

        Raises:
            SimulationError: a step cannot be differentiated, or a step from the states of the run
                is not that of the run, which has a memory besides them.
        """
        run, own = self.runs[place], self._own(place)
        if run.instants:
            raise SimulationError(
                f"{run.name} has samples within steps, or of rare or late sensors, at their own times"
            )
        at, path = self._latest.get(place, (b"", None))
        if at != point.tobytes():
            path = self._rollout(place, point[None], None)
        states, steps = path.states[0], int(path.steps[0])
        if not steps:
            raise SimulationError(f"{run.name}: {path.failure[0]}")
        self.steps[place] = steps
        if self.model.delays:
            of_states, of_readings = self._whole(run, point, states[: steps + 1], len(states))
        else:
            of_states, of_readings = self._chain(self._taken(run, point, states[: steps + 1]), len(states))
        found = np.zeros((len(states), len(self._outputs), len(point)))
        for i, (seen, column) in enumerate(self._outputs):
            found[:, i, own] = self._read(column, of_readings, path.observations[0]) if seen else of_states[:, column]
        if any(seen for seen, _ in self._outputs):
            at_start = self.differences(place, points(), 1)[0]
            found[0] = [at_start[i] if seen else found[0, i] for i, (seen, _) in enumerate(self._outputs)]
        return found

    def _taken(self, run: Run, point: FloatArray, states: FloatArray) -> _Steps:
        """Every step of a run with its derivatives, checked to be those of the run."""
        size = np.abs(states).max(axis=0)
        for together in (True, False) if self.together else (False,):
            self.together = together
            found = self._steps(run, point, states, together)
            away = (np.abs(found.states - states[1:]) > _APART[together] * size).any(axis=1)
            if not away.any():
                return found
        step = int(np.argmax(away))
        raise SimulationError(f"{run.name}, step {step}: how {self.model.name} goes on depends on more than its states")

    def _steps(self, run: Run, point: FloatArray, states: FloatArray, together: bool) -> _Steps:
        """Every step of a run from the states before it, in one call or one after another."""
        cores = (os.cpu_count() or 1) if states.shape[1] * len(self._directions) >= _LARGE else 1
        steps = len(states) - 1
        if together:
            return self._taken_from(run, point, states[:steps], (0, 1), min(cores, steps))
        parts = [self._taken_from(run, point, states[k : k + 1], (k, 1), 1) for k in range(steps)]
        return _Steps(*(np.concatenate(part) for part in zip(*parts, strict=True)))

    def _taken_from(
        self, run: Run, point: FloatArray, states: FloatArray, size: tuple[int, int], threads: int
    ) -> _Steps:
        """Steps from each of the states of a run; `size` is (first step, number of steps)."""
        given = {**run.parameters, **self._fixed, **dict(zip(self.parameters, point.tolist(), strict=False))}
        (first, horizon), count = size, len(states)
        part = slice(first, first + count * horizon)
        # What `linearize_step` does without its checks: a step of a small model takes no longer
        # than these.
        try:
            found = self.model.native.sensitivity(
                states,
                run.actions[part],
                _singles(given),
                _singles(run.discrete),
                [(name, values[part]) for name, values in run.disturbances.items()],
                (count, first, horizon),
                (self._directions, threads, None, self._method),
            )
        except SimulationError as error:
            number, _, reason = str(error).removeprefix("point ").partition(": ")
            at = first + int(number) if number.isdigit() and horizon == 1 else first
            raise SimulationError(f"{run.name}, step {at}: {reason or error}") from error
        return _Steps(found[0], found[3], found[5])

    def _whole(self, run: Run, point: FloatArray, states: FloatArray, rows: int) -> tuple[FloatArray, FloatArray]:
        """Derivatives as those of `_chain`, by the steps of the run together."""
        steps, count = len(states) - 1, states.shape[1]
        found = self._taken_from(run, point, states[:1], (0, steps), 1)
        own = [*range(count, count + len(self.parameters)), *self._columns]
        of_states = np.zeros((rows, count, len(own)))
        of_states[0, self._columns, range(len(self.parameters), len(own))] = 1.0
        of_readings = np.zeros((rows, found.of_readings.shape[1], len(own)))
        of_states[1 : steps + 1], of_readings[1 : steps + 1] = found.of_states[..., own], found.of_readings[..., own]
        # A run that has ended stays where it is.
        of_states[steps + 1 :], of_readings[steps + 1 :] = of_states[steps], of_readings[steps]
        return of_states, of_readings

    def _chain(self, taken: _Steps, rows: int) -> tuple[FloatArray, FloatArray]:
        """Derivatives of states (H + 1, states, own) and readings (H + 1, observations, own)."""
        steps, count = taken.states.shape
        width = len(self.parameters) + len(self.initial)
        of_states = np.zeros((rows, count, width))
        of_states[0, self._columns, range(len(self.parameters), width)] = 1.0
        by_states = taken.of_states[:, :, :count]
        direct = np.zeros((steps, count, width))
        direct[:, :, : len(self.parameters)] = taken.of_states[:, :, count:]
        for k in range(steps):
            of_states[k + 1] = by_states[k] @ of_states[k] + direct[k]
        of_readings = np.zeros((rows, taken.of_readings.shape[1], width))
        of_readings[1 : steps + 1] = taken.of_readings[:, :, :count] @ of_states[:steps]
        of_readings[1 : steps + 1, :, : len(self.parameters)] += taken.of_readings[:, :, count:]
        # A run that has ended stays where it is.
        of_states[steps + 1 :], of_readings[steps + 1 :] = of_states[steps], of_readings[steps]
        return of_states, of_readings

    def _read(self, sensor: int, of_readings: FloatArray, read: FloatArray) -> FloatArray:
        """Derivatives (H + 1, d) of a sensor's delayed reading."""
        delay = int(self._sensors.delay[sensor])
        shown = of_readings[:, sensor]
        if delay:
            shown = np.concatenate([np.zeros_like(shown[:delay]), shown[: len(shown) - delay]])
        low, high = (edge[sensor] for edge in self._edges)
        inside = (read[:, sensor] > low) & (read[:, sensor] < high)
        return np.where(inside[:, None], shown, 0.0)


def _singles(values: Mapping[str, float]) -> list[tuple[str, FloatArray]]:
    return [(name, np.array([value])) for name, value in values.items()]


def beside(z: FloatArray, scale: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """A point and two neighbours in each direction, (1 + 2 d, d), within the bounds."""
    distance = np.diag(np.full(len(z), DISTANCE))
    return np.clip(np.vstack([z, z + distance, z - distance]) * scale, low, high)
