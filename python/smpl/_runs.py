"""Recorded runs: tables as `smpl simulate --out` writes them, episodes, and mappings of columns."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from smpl._arguments import FloatArray
from smpl._native import SimulationError
from smpl._optional import load
from smpl.envs import Env, from_unit
from smpl.model import Model


@dataclass(frozen=True)
class Run:
    """One recorded run of H steps.

    Attributes:
        name: where it is from, for messages.
        states: at the start, (states,); what the record has not is at the model's nominal start.
        actions: (H, actions).
        outputs: observations and states by name, (H + 1,), NaN where nothing was read.
        discrete: discrete variables at the start.
        disturbances: sequences by name, (H,).
        parameters: known values.
        assumed: states of which the record has no start.
    """

    name: str
    states: FloatArray
    actions: FloatArray
    outputs: dict[str, FloatArray]
    discrete: dict[str, float]
    disturbances: dict[str, FloatArray]
    parameters: dict[str, float]
    assumed: tuple[str, ...] = ()


def read_runs(model: Model, runs: Any) -> list[Run]:
    """All runs: one or several of any kind; a data set, or its folder, is one run an episode.

    Raises:
        ValueError: what is none, or lacks the actions; another model's data set.
        FileNotFoundError: there is no such file.
        ImportError: pyarrow is missing.
    """
    if hasattr(runs, "manifest"):
        return [_from_data_set(model, runs.manifest, episode, f"episode {i}") for i, episode in enumerate(runs)]
    single = isinstance(runs, (str, os.PathLike, Mapping)) or not isinstance(runs, Sequence)
    found: list[Run] = []
    for place, run in enumerate([runs] if single else runs):
        if isinstance(run, (str, os.PathLike)) and (Path(run) / "dataset.json").is_file():
            from smpl.datasets import load

            found += read_runs(model, load(run))
        else:
            found += _read(model, run, place)
    return found


def _read(model: Model, run: Any, place: int) -> list[Run]:
    """A run of any kind, or the runs of a table.

    Raises:
        ValueError: it is none, or lacks the actions.
        FileNotFoundError: there is no such file.
    """
    if isinstance(run, (str, os.PathLike)):
        return [_from_columns(model, one, name) for name, one in _separated(read_table(run), str(run))]
    if isinstance(run, Mapping):
        columns = {str(name): np.asarray(values, dtype=np.float64) for name, values in run.items()}
        return [_from_columns(model, one, name) for name, one in _separated(columns, f"run {place}")]
    if hasattr(run, "states") and hasattr(run, "actions") and hasattr(run, "observations"):
        return [_from_episode(model, run, f"run {place}")]
    raise ValueError(
        f"run {place} is {type(run).__name__}, expected a path, an episode or a mapping from columns to arrays"
    )


def read_table(path: str | os.PathLike[str]) -> dict[str, FloatArray]:
    """Columns of a CSV or Parquet file; what is no number is NaN, truth values are 0 and 1.

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
    try:
        return float(value)
    except (TypeError, ValueError):
        return float("nan")


def _separated(columns: Mapping[str, FloatArray], name: str) -> list[tuple[str, Mapping[str, FloatArray]]]:
    """The runs of a table with their names: where a column `step` counts from 0 again, another one begins.

    Raises:
        ValueError: the columns are not of one length, a run has no steps, or `step` does not count its rows.
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


def _from_columns(model: Model, columns: Mapping[str, FloatArray], name: str) -> Run:
    missing = [action for action in model.action_names if action not in columns]
    if missing:
        raise ValueError(f"{name} has no column for the actions {', '.join(missing)}")
    # Row 0 is the start; the action of a row is that of the step that led to it.
    rows = len(next(iter(columns.values())))
    actions = np.array([columns[action][1:] for action in model.action_names]).reshape(-1, rows - 1).T
    if not np.isfinite(actions).all():
        raise ValueError(f"{name}: an action is missing in row {int(np.argwhere(~np.isfinite(actions))[0, 0]) + 1}")
    outputs = {state: columns[state] for state in model.state_names if state in columns}
    outputs |= {seen: columns[f"obs.{seen}"] for seen in model.observation_names if f"obs.{seen}" in columns}
    start = {state: float(columns[state][0]) for state in model.state_names if state in columns}
    return Run(
        name,
        _states(model, start),
        actions,
        outputs,
        {
            one: float(columns[one][0])
            for one in model.discrete_names
            if one in columns and np.isfinite(columns[one][0])
        },
        {one: _sequence(columns[one][1:], one, name) for one in model.disturbance_names if one in columns},
        {
            one: float(columns[f"param.{one}"][0])
            for one in model.parameter_names
            if f"param.{one}" in columns and np.isfinite(columns[f"param.{one}"][0])
        },
        tuple(name for name in model.state_names if not np.isfinite(start.get(name, np.nan))),
    )


def _sequence(values: FloatArray, disturbance: str, name: str) -> FloatArray:
    missing = np.flatnonzero(~np.isfinite(values))
    if len(missing):
        raise ValueError(f"{name}: the disturbance {disturbance} is missing in row {missing[0] + 1}")
    return values


def _from_episode(model: Model, episode: Any, name: str) -> Run:
    applied, readings = getattr(episode, "applied", None), getattr(episode, "readings", None)
    given = getattr(episode, "given", None)
    if applied is None or readings is None or given is None:
        raise ValueError(
            f"{name} does not say its physical units and what was drawn for it (applied, readings, given): make it by "
            "smpl.evaluation.run_episode"
        )
    widths = np.shape(applied)[1], np.shape(readings)[1], np.shape(episode.states)[1]
    expected = len(model.action_names), len(model.observation_names), len(model.state_names)
    if widths != expected:
        counts = "{} actions, {} observations and {} states"
        raise ValueError(f"{name} has {counts.format(*widths)}, {model.name} has {counts.format(*expected)}")
    _check_given(model, given, name)
    outputs = dict(zip(model.state_names, np.asarray(episode.states).T, strict=True))
    outputs |= dict(zip(model.observation_names, readings.T, strict=True))
    return Run(
        name,
        np.asarray(episode.states)[0],
        np.asarray(applied, dtype=np.float64),
        outputs,
        dict(given.discrete),
        dict(given.disturbances),
        dict(given.parameters),
    )


def _check_given(model: Model, given: Any, name: str) -> None:
    """Whether the model has what was drawn for an episode."""
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
    """Runs that do not hold at its recorded value what the model computes from parameters that are moved."""
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
    """An episode of a data set: its observations back in physical units, what is drawn or set as it was."""
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
        _states(model, start),
        details.physical,
        outputs,
        {one: float(values[0]) for one, values in details.discrete.items()},
        {one: np.asarray(values, dtype=np.float64) for one, values in details.disturbances.items()},
        dict(details.parameters),
        tuple(state for state in model.state_names if state not in start),
    )


def _states(model: Model, given: Mapping[str, float]) -> FloatArray:
    """The start, from the model's nominal one where nothing is recorded."""
    known = {name: value for name, value in given.items() if np.isfinite(value)}
    if len(known) == len(model.state_names):
        return np.array([known[name] for name in model.state_names])
    env = Env(model, normalize=False)
    env.reset(seed=0, options={"start": "nominal", "state": known})
    return env.state
