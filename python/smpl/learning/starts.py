"""Starts of episodes: sampled by the model, on a grid, spread over the box, or from a table."""

from __future__ import annotations

import csv
import hashlib
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from smpl.envs import Env
from smpl.learning.grids import initial_grid
from smpl.support.arguments import FloatArray, check_names
from smpl.support.optional import load

# Kinds that are asked for by name, and how many numbers each takes.
_KINDS = {"grid": 2, "unclipped_grid": 2, "spread": 1}


@dataclass(frozen=True)
class Starts:
    """States that episodes start from; episode i takes number i modulo their count.

    Attributes:
        kind: how they were made; `sampled` leaves each start to the model and has no states.
        names: of the states that are given; the others are sampled.
        states: shape (starts, names), physical units; none if sampled.
    """

    kind: str
    names: tuple[str, ...] = ()
    states: FloatArray | None = None

    def option(self, index: int) -> dict[str, float] | None:
        """`options["state"]` of episode `index`, none if it is sampled."""
        if self.states is None:
            return None
        return dict(zip(self.names, self.states[index % len(self.states)].tolist(), strict=True))

    @property
    def identity(self) -> str:
        """Text that is equal for equal starts."""
        if self.states is None:
            return self.kind
        text = repr((self.names, self.states.shape)).encode() + np.ascontiguousarray(self.states).tobytes()
        return f"{self.kind} {hashlib.sha256(text).hexdigest()[:16]}"

    @classmethod
    def of(cls, given: Any, env: Env, episodes: int, seed: int = 0) -> Starts:
        """Starts as a user names them.

        Args:
            given: None or `sampled`, `grid:D:N` or `unclipped_grid:D:N`, `spread:D`, a path of a
                CSV file with states as columns, an array (starts, states), or one mapping per
                start. A grid has N values per state from 1 - D to 1 + D times the steady state (0.3
                and 10 by default), clipped to the box. A spread has scrambled Sobol points in the
                box, its ends clipped to the bounds.
            env: the environment.
            episodes: how many spread starts.
            seed: of the scrambling.

        Raises:
            ValueError: none of these, an unknown state.
        """
        if isinstance(given, Starts):
            return given
        if given is None or (isinstance(given, str) and given == "sampled"):
            return cls("sampled")
        if isinstance(given, Path) or (isinstance(given, str) and given.endswith(".csv")):
            return _table(Path(given), env)
        if isinstance(given, str):
            return _named(given, env, episodes, seed)
        return _given(given, env)


def _named(text: str, env: Env, episodes: int, seed: int) -> Starts:
    kind, *numbers = text.split(":")
    try:
        spread = float(numbers[0]) if numbers else 0.3
        points = int(numbers[1]) if len(numbers) > 1 else 10
        good = kind in _KINDS and len(numbers) <= _KINDS[kind] and spread > 0 and points > 0
    except ValueError:
        good = False
    if not good:
        raise ValueError(f"starts is {text!r}; there are: sampled, grid:D:N, unclipped_grid:D:N, spread:D, FILE.csv")
    centre = _centre(env)
    low, high = env.model.native.bounds("state")
    if kind != "spread":
        if points ** len(centre) > 10_000_000:
            raise ValueError(f"a grid of {points} values for {len(centre)} states has more than 10 million starts")
        box = (low, high) if kind == "grid" else (None, None)
        return Starts(text, env.state_names, initial_grid(centre, spread, points, *box))
    unit = _sobol(len(centre), episodes, seed)
    ends = np.clip(np.sort(np.stack([(1 - spread) * centre, (1 + spread) * centre]), axis=0), low, high)
    return Starts(text, env.state_names, ends[0] + unit * (ends[1] - ends[0]))


def _centre(env: Env) -> FloatArray:
    """The state that grids lie around: the steady one, else the nominal start."""
    env.reset(seed=0, options={"start": "nominal"})
    steady = env.steady_state
    return env.state if steady is None else np.asarray(steady)


def _sobol(dimensions: int, count: int, seed: int) -> FloatArray:
    qmc = load("scipy.stats.qmc", "a set of spread starts")
    power = max(0, int(np.ceil(np.log2(count))))
    return np.asarray(qmc.Sobol(dimensions, seed=seed).random_base2(power)[:count], dtype=np.float64)


def _table(path: Path, env: Env) -> Starts:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            header, *lines = list(csv.reader(file)) or [[]]
        names = tuple(name.strip() for name in header)
        states = np.array([_numbers(names, line, i) for i, line in enumerate(lines, 2) if line])
        if not len(states):
            raise ValueError("it has no rows: expected names of states in the first line, and a start in each other")
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise ValueError(f"two columns are called {twice[0]!r}")
    except (OSError, ValueError) as error:
        raise ValueError(f"table of starts {str(path)!r}: {error}") from error
    starts = _checked(Starts(f"table {path.name}", names, states), env)
    _warn(starts, env)
    return starts


def _warn(starts: Starts, env: Env) -> None:
    """Warns of states of a table out of bounds, with which most episodes end in a step."""
    low, high = env.model.native.bounds("state")
    columns = np.transpose(np.asarray(starts.states))
    for name, values in zip(starts.names, columns, strict=True):
        place = env.state_names.index(name)
        outside = np.flatnonzero((values < low[place]) | (values > high[place]))
        if len(outside):
            text = f"{starts.kind}: {name} is outside its bounds, {low[place]:g} to {high[place]:g}, in"
            warnings.warn(f"{text} {len(outside)} of {len(values)} starts, first {values[outside[0]]:g}", stacklevel=2)


def _numbers(names: tuple[str, ...], line: list[str], number: int) -> list[float]:
    if len(line) != len(names):
        raise ValueError(f"line {number} has {len(line)} cells, expected {len(names)}: {', '.join(names)}")
    found = []
    for place, cell in enumerate(line):
        try:
            found.append(float(cell))
        except ValueError:
            raise ValueError(f"line {number}: {names[place]} is {cell!r}, expected a number") from None
    return found


def _given(given: Any, env: Env) -> Starts:
    rows = list(given) if isinstance(given, Iterable) else []
    if not rows:
        raise ValueError(f"starts is {given!r}, expected states to start from")
    if all(isinstance(row, Mapping) for row in rows):
        names = tuple(rows[0])
        if any(tuple(row) != names for row in rows):
            raise ValueError("starts name different states, expected the same in each")
        return _checked(Starts("given", names, np.array([[row[n] for n in names] for row in rows], dtype=float)), env)
    return _checked(Starts("given", env.state_names, np.asarray(rows, dtype=np.float64)), env)


def _checked(starts: Starts, env: Env) -> Starts:
    check_names("starts", starts.names, env.state_names)
    states = starts.states
    if states is None or states.ndim != 2 or not len(states) or states.shape[1] != len(starts.names):
        shape = None if states is None else states.shape
        raise ValueError(f"starts has shape {shape}, expected (starts, {len(starts.names)})")
    if not np.all(np.isfinite(states)):
        raise ValueError("starts has a value that is not finite")
    return starts
