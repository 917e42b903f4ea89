"""Recorded runs: tables as `smpl simulate --out` writes them, episodes, and mappings of columns."""

from __future__ import annotations

import csv
import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from smpl._native import SimulationError, on_steps
from smpl.analysis.runs import Run
from smpl.analysis.sensors import sensors
from smpl.envs import Env
from smpl.episodes import Details
from smpl.model import Model
from smpl.support.arguments import FloatArray
from smpl.support.optional import load
from smpl.support.scaling import from_unit

# Times within this part of a step are one time.
_SAME = 1e-6


def read_runs(model: Model, runs: Any, resample: str = "hold") -> list[Run]:
    """All runs: one or several of any kind; a data set, or its folder, is one run an episode.

    `resample` is the course of inputs between the times of a table, `hold` or `linear`.

    Raises:
        ValueError: not a run, a run without actions, or another model's data set.
        FileNotFoundError: there is no such file.
        ImportError: pyarrow is missing.
    """
    if hasattr(runs, "manifest"):
        return [_from_data_set(model, runs.manifest, episode, f"episode {i}") for i, episode in enumerate(runs)]
    single = isinstance(runs, (str, os.PathLike, Mapping, Run)) or not isinstance(runs, Sequence)
    found: list[Run] = []
    for place, run in enumerate([runs] if single else runs):
        if isinstance(run, (str, os.PathLike)) and (Path(run) / "dataset.json").is_file():
            from smpl.datasets import load  # needs pyarrow

            found += read_runs(model, load(run))
        else:
            found += _read(model, run, place, resample)
    for one in found:
        _check_outputs(one)
    return found


def _check_outputs(run: Run) -> None:
    """Refuse outputs that are not numbers; only an empty cell, or NaN, is a missing value."""
    for name, values in run.outputs.items():
        wrong = np.flatnonzero(np.isinf(values))
        if len(wrong):
            raise ValueError(f"{run.name}: {name} has no finite number in row {wrong[0]}; leave a missing value empty")


def _read(model: Model, run: Any, place: int, resample: str) -> list[Run]:
    """A run of any kind, or the runs of a table.

    Raises:
        ValueError: it is not a run, or lacks the actions.
        FileNotFoundError: there is no such file.
    """
    if isinstance(run, Run):
        return [run]
    if isinstance(run, (str, os.PathLike)):
        return [_from_columns(model, one, name, resample) for name, one in _separated(read_table(run), str(run))]
    if isinstance(run, Mapping):
        columns = {str(name): np.asarray(values, dtype=np.float64) for name, values in run.items()}
        return [_from_columns(model, one, name, resample) for name, one in _separated(columns, f"run {place}")]
    if hasattr(run, "states") and hasattr(run, "actions") and hasattr(run, "observations"):
        return [_from_episode(model, run, f"run {place}")]
    raise ValueError(
        f"run {place} is {type(run).__name__}, expected a path, an episode or a mapping from columns to arrays"
    )


def read_table(path: str | os.PathLike[str]) -> dict[str, FloatArray]:
    """Columns of a CSV or Parquet file; empty cells are NaN, truth values 0 and 1, texts infinite.

    Raises:
        ValueError: no rows, a row of another length, or two columns of one name.
    """
    file = Path(path)
    if file.suffix == ".parquet":
        parquet = load("pyarrow.parquet", "reading Parquet")
        table = parquet.read_table(file)
        _check_once(file, table.column_names)
        return {name: _numbers(table[name].to_pylist()) for name in table.column_names}
    with file.open(newline="", encoding="utf-8-sig") as text:
        rows = [row for row in csv.reader(text) if row]
    if len(rows) < 2:
        raise ValueError(f"{file} has no rows")
    _check_once(file, rows[0])
    ragged = [i for i, row in enumerate(rows) if len(row) != len(rows[0])]
    if ragged:
        raise ValueError(f"{file}, line {ragged[0] + 1}: {len(rows[ragged[0]])} values for {len(rows[0])} columns")
    return {name: _numbers(values) for name, values in zip(rows[0], zip(*rows[1:], strict=True), strict=True)}


def _check_once(file: Path, names: Sequence[str]) -> None:
    """Refuse two columns of one name."""
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"{file} has two columns named {', '.join(map(repr, twice))}")


def _numbers(values: Any) -> FloatArray:
    return np.array([_number(value) for value in values], dtype=np.float64)


def _number(value: Any) -> float:
    if value in ("true", "false"):
        return float(value == "true")
    if value is None or value == "":
        return float("nan")
    try:
        return float(value)
    except (TypeError, ValueError):
        return float("inf")


def _separated(columns: Mapping[str, FloatArray], name: str) -> list[tuple[str, Mapping[str, FloatArray]]]:
    """The runs of a table with their names; a run begins where a column `step` is 0.

    Raises:
        ValueError: the columns are not of one length, a run has no steps, or `step` does not count
            its rows.
    """
    lengths = {len(values) for values in columns.values()}
    if len(lengths) != 1 or min(lengths) < 2:
        raise ValueError(f"{name}: expected columns of one length, at least two rows")
    count = columns.get("step")
    if count is None:
        return [(name, columns)]
    starts = np.flatnonzero(count == 0)
    ends = [*starts[1:], len(count)]
    if not len(starts) or starts[0] != 0:
        raise ValueError(f"{name}: the column step begins with {count[0]:g}, expected 0: row 0 is the start of a run")
    found: list[tuple[str, Mapping[str, FloatArray]]] = []
    for i, (first, end) in enumerate(zip(starts, ends, strict=True)):
        one = name if len(starts) == 1 else f"{name}, run {i}"
        wrong = np.flatnonzero(count[first:end] != np.arange(end - first))
        if len(wrong):
            row = first + wrong[0]
            raise ValueError(f"{one}: the column step says {count[row]:g} in row {row}, expected {wrong[0]}")
        if end - first < 2:
            raise ValueError(f"{one} has no steps behind its start")
        found.append((one, {column: values[first:end] for column, values in columns.items()}))
    return found


def _from_columns(model: Model, columns: Mapping[str, FloatArray], name: str, resample: str) -> Run:
    missing = [action for action in model.action_names if action not in columns]
    if missing:
        raise ValueError(f"{name} has no column for the actions {', '.join(missing)}")
    outputs = {state: columns[state] for state in model.state_names if state in columns}
    outputs |= {seen: columns[f"obs.{seen}"] for seen in model.observation_names if f"obs.{seen}" in columns}
    if "time" in columns and "step" not in columns:
        _check_times(columns["time"], name)
        return _by_time(model, columns, outputs, name, resample)
    if resample == "linear":
        raise ValueError(f"{name}: linear resampling needs a column time, and no column step")
    if "time" in columns:
        _check_against_steps(columns["time"], model.step, name)
    # Row 0 is the start; the action of a row is that of the step that led to it.
    rows = len(next(iter(columns.values())))
    actions = np.array([columns[action][1:] for action in model.action_names]).reshape(-1, rows - 1).T
    if not np.isfinite(actions).all():
        raise ValueError(f"{name}: an action is missing in row {int(np.argwhere(~np.isfinite(actions))[0, 0]) + 1}")
    start = {state: float(columns[state][0]) for state in model.state_names if state in columns}
    disturbances = {one: _sequence(columns[one][1:], one, name) for one in model.disturbance_names if one in columns}
    return _of_start(model, columns, name, start, Run(name, np.zeros(0), actions, outputs, {}, disturbances, {}))


def _of_start(model: Model, columns: Mapping[str, FloatArray], name: str, start: Mapping[str, float], run: Run) -> Run:
    """A run with what its record says of the start: states, discrete variables and parameters."""

    def first(names: Iterable[str], prefix: str) -> dict[str, float]:
        known = {one: columns[prefix + one][0] for one in names if prefix + one in columns}
        wrong = [one for one, value in known.items() if np.isinf(value)]
        if wrong:
            raise ValueError(f"{name}: {prefix}{wrong[0]} has no finite number in row 0")
        return {one: float(value) for one, value in known.items() if np.isfinite(value)}

    return replace(
        run,
        states=starting_states(model, start),
        discrete=first(model.discrete_names, ""),
        parameters=first(model.parameter_names, "param."),
        assumed=tuple(one for one in model.state_names if not np.isfinite(start.get(one, np.nan))),
    )


def _sequence(values: FloatArray, disturbance: str, name: str) -> FloatArray:
    missing = np.flatnonzero(~np.isfinite(values))
    if len(missing):
        raise ValueError(f"{name}: the disturbance {disturbance} is missing in row {missing[0] + 1}")
    return values


def _check_times(times: FloatArray, name: str) -> None:
    """Refuse times of rows that do not increase from 0, the start of a run, or later.

    Raises:
        ValueError: names the row.
    """
    wrong = np.flatnonzero(~np.isfinite(times))
    if len(wrong):
        raise ValueError(f"{name}: the column time has no finite number in row {wrong[0]}")
    if times[0] < 0:
        raise ValueError(f"{name}: the column time has {times[0]:g} in row 0; a run begins at 0")
    falls = np.flatnonzero(np.diff(times) <= 0)
    if len(falls):
        row = falls[0] + 1
        raise ValueError(
            f"{name}: the column time has {times[row]:g} in row {row}, after {times[row - 1]:g}; times must increase"
        )


def _check_against_steps(times: FloatArray, step: float, name: str) -> None:
    """Refuse times that are not within the steps that their rows count."""
    ends = step * np.arange(len(times))
    wrong = np.flatnonzero(~((times <= ends + _SAME * step) & (times >= ends - (1 + _SAME) * step)))
    if len(wrong):
        row = wrong[0]
        raise ValueError(
            f"{name}: the column time has {times[row]:g} in row {row}, whose step ends at {ends[row]:g}; leave the "
            "column step out to take the rows by their times, or the column time to take them one after another"
        )


def _by_time(
    model: Model, columns: Mapping[str, FloatArray], outputs: Mapping[str, FloatArray], name: str, resample: str
) -> Run:
    """A run of a table with a column of times; each value of an output is a sample at its time."""
    times, h = columns["time"], model.step
    sampled = np.any([np.isfinite(values) for values in outputs.values()], axis=0) if outputs else np.zeros(len(times))
    last = float(times[np.flatnonzero(sampled)[-1]]) if np.any(sampled) else 0.0
    steps = int(np.ceil(last / h - _SAME))
    if steps < 1:
        raise ValueError(f"{name} has no value of a state or observation (obs.NAME) after the start")
    disturbed = [one for one in model.disturbance_names if one in columns]
    # As in the tables of `smpl simulate`, a value holds up to its time, unless row 0 has one at the
    # start.
    first = [columns[one][0] for one in (model.action_names or disturbed)]
    after = times[0] <= _SAME * h and bool(np.isfinite(first).any())
    course = _Course(times, h, resample == "linear", after, steps, last)
    actions = np.array([course.on_steps(columns[one], one, name) for one in model.action_names])
    disturbances = {one: course.on_steps(columns[one], one, name) for one in disturbed}
    at_start = times[0] <= _SAME * h
    start = {one: float(columns[one][0]) for one in model.state_names if at_start and one in columns}
    grid, instants, samples = _placed(model, times, outputs, steps)
    run = Run(name, np.zeros(0), actions.reshape(-1, steps).T, grid, {}, disturbances, {}, (), instants, samples)
    return _of_start(model, columns, name, start, run)


@dataclass(frozen=True)
class _Course:
    """Interpolation of inputs between the times of a table."""

    times: FloatArray
    step: float
    linear: bool
    after: bool
    steps: int
    last: float

    def on_steps(self, values: FloatArray, column: str, name: str) -> FloatArray:
        """A value for each step; an input that changes within one is averaged, with a warning."""
        wrong = np.flatnonzero(np.isinf(values))
        if len(wrong):
            raise ValueError(f"{name}: {column} has no finite number in row {wrong[0]}")
        read = np.isfinite(values)
        # The last value holds as long as a row before it did.
        end = float(2 * self.times[-1] - self.times[-2]) if self.after else None
        try:
            found, split = on_steps(self.times[read], values[read], self.step, self.linear, end, self.steps)
        except ValueError as error:
            raise ValueError(f"{name}: {column}: {error}") from error
        until = self.times[read][-1] if end is None or self.linear else end
        if len(found) < self.steps or until < self.last - _SAME * self.step:
            raise ValueError(f"{name}: {column} ends at {until:g}, before the last sample at {self.last:g}")
        if split is not None:
            text = (
                f"{name}: {column} changes within step {split + 1}; a step has one value of it, the mean over the step"
            )
            warnings.warn(text, stacklevel=9)
        return np.array(found)


def _placed(
    model: Model, times: FloatArray, outputs: Mapping[str, FloatArray], steps: int
) -> tuple[dict[str, FloatArray], tuple[tuple[int, float], ...], dict[str, FloatArray]]:
    """Samples at the ends of steps, and samples at other instants."""
    declared = sensors(model)
    seen = model.observation_names
    plain = {name: name not in seen or (declared.every[i] == 1 and declared.delay[i] == 0)
             for name in outputs for i in [seen.index(name) if name in seen else 0]}  # fmt: skip
    grid = {name: np.full(steps + 1, np.nan) for name in outputs}
    instants: dict[tuple[int, float], int] = {}
    apart: dict[str, dict[int, float]] = {name: {} for name in outputs}
    for row, time in enumerate(times / model.step):
        k = round(time)
        on_grid = abs(time - k) <= _SAME
        for name, values in outputs.items():
            if np.isnan(values[row]):
                continue
            if on_grid and (plain[name] or k == 0):
                grid[name][k] = values[row]
                continue
            place = (k - 1, 1.0) if on_grid else (int(time), float(time - int(time)))
            apart[name][instants.setdefault(place, len(instants))] = values[row]
    samples = {}
    for name, found in apart.items():
        samples[name] = np.full(len(instants), np.nan)
        samples[name][list(found)] = list(found.values())
    return grid, tuple(instants), samples


def _from_episode(model: Model, episode: Any, name: str) -> Run:
    details = getattr(episode, "details", None)
    if details is None or details.readings is None:
        raise ValueError(
            f"{name} has no readings in physical units (`details.readings`): make it by smpl.evaluation.run_episode, "
            "or give the data set"
        )
    widths = np.shape(details.physical)[1], np.shape(details.readings)[1], np.shape(episode.states)[1]
    expected = len(model.action_names), len(model.observation_names), len(model.state_names)
    if widths != expected:
        counts = "{} actions, {} observations and {} states"
        raise ValueError(f"{name} has {counts.format(*widths)}, {model.name} has {counts.format(*expected)}")
    _check_given(model, details, name)
    outputs = dict(zip(model.state_names, np.asarray(episode.states).T, strict=True))
    outputs |= dict(zip(model.observation_names, details.readings.T, strict=True))
    return Run(name, np.asarray(episode.states)[0], details.physical, outputs, **_drawn(details))


def _drawn(details: Details) -> dict[str, Any]:
    """Arguments of a run: initial discrete variables, disturbances and parameters."""
    return {
        "discrete": {one: float(values[0]) for one, values in details.discrete.items()},
        "disturbances": {one: np.asarray(values, dtype=np.float64) for one, values in details.disturbances.items()},
        "parameters": dict(details.parameters),
    }


def _check_given(model: Model, given: Details, name: str) -> None:
    """True if the model has the names drawn for an episode."""
    known = (
        ("parameters", given.parameters, model.parameter_names),
        ("discrete variables", given.discrete, model.discrete_names),
        ("disturbances", given.disturbances, model.disturbance_names),
    )
    for what, values, names in known:
        strange = [one for one in values if one not in names]
        if strange:
            raise ValueError(f"{name} has the {what} {', '.join(strange)}, which {model.name} has not")


def without_computed(model: Model, runs: list[Run], moved: Iterable[str]) -> list[Run]:
    """Runs without recorded values that the model computes from fitted parameters."""
    follow = set.union(set(), *(_following(model, name) for name in moved)) - set(moved)
    return [_without_computed(model, run, sorted(follow & set(run.parameters))) for run in runs]


def _following(model: Model, name: str) -> set[str]:
    """Names of the parameters that are computed from one."""
    place = model.parameter_names.index(name)
    low, high = (float(bound[place]) for bound in model.native.bounds("parameter"))
    value = float(model.native.defaults("parameter")[place])
    step = 1e-3 * (abs(value) or 1.0)
    try:
        usual = _parameters(model, {name: value})
        other = _parameters(model, {name: value + step if value + step <= high else max(value - step, low)})
    except (ValueError, SimulationError):  # no episode begins there: nothing is known of it
        return set()
    return {one for one in usual if usual[one] != other[one] and one != name}


def _without_computed(model: Model, run: Run, names: list[str]) -> Run:
    if not names:
        return run
    rest = {one: value for one, value in run.parameters.items() if one not in names}
    computed = _parameters(model, rest)
    ours = {one for one in names if np.isclose(computed[one], run.parameters[one], rtol=1e-9, atol=0)}
    return replace(run, parameters={one: value for one, value in run.parameters.items() if one not in ours})


def _parameters(model: Model, given: Mapping[str, float]) -> dict[str, float]:
    """All parameters of an episode for which some are given, what is drawn at its mean."""
    env = Env(model, normalize=False)
    env.reset(seed=0, options={"start": "nominal", "parameters": dict(given)})
    return env.parameters


def _from_data_set(model: Model, manifest: Any, episode: Any, name: str) -> Run:
    """An episode of a data set with physical observations and its drawn or set values."""
    pairs = (("observations", model.observation_names), ("actions", model.action_names))
    for what, names in pairs:
        if tuple(manifest.names[what]) != names:
            there = ", ".join(manifest.names[what])
            raise ValueError(f"the data set has the {what} {there}, {model.name} has {', '.join(names)}")
    readings = episode.observations.astype(np.float64)
    if manifest.about["normalize"]:
        low, high = (np.array(manifest.about[f"observation_{end}"]) for end in ("low", "high"))
        readings = from_unit(readings, low, high)
    outputs = dict(zip(manifest.names["states"], episode.states.T, strict=False))
    start = {state: float(outputs[state][0]) for state in model.state_names if state in outputs}
    outputs |= dict(zip(model.observation_names, readings.T, strict=True))
    details = episode.details
    return Run(
        name,
        starting_states(model, start),
        details.physical,
        outputs,
        assumed=tuple(state for state in model.state_names if state not in start),
        **_drawn(details),
    )


def starting_states(model: Model, given: Mapping[str, float]) -> FloatArray:
    """The start, from the model's nominal one where nothing is recorded."""
    known = {name: value for name, value in given.items() if np.isfinite(value)}
    if len(known) == len(model.state_names):
        return np.array([known[name] for name in model.state_names])
    env = Env(model, normalize=False)
    env.reset(seed=0, options={"start": "nominal", "state": known})
    return env.state
