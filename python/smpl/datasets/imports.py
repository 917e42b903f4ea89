"""Data sets that others wrote: those of 2022, with their shifts undone."""

from __future__ import annotations

import csv
import os
import pickle
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.datasets.store import DatasetError
from smpl.episodes import Episode

Array = npt.NDArray[Any]
_LEGACY = ("observations", "actions", "rewards", "terminals", "timeouts")
# Columns of the penicillin files in the order of the environment's names, spellings without units
# and case.
_PENSIM_OBSERVATIONS = (
    "time step",
    "ph",
    "temperature",
    "acid flow rate",
    "base flow rate",
    "cooling water",
    "heating water",
    "vessel weight",
    "dissolved oxygen concentration",
)
_PENSIM_ACTIONS = (
    "discharge rate",
    "sugar feed rate",
    "soil bean feed rate",
    "aeration rate",
    "back pressure",
    "water injection/dilution",
)
_PENSIM_REWARD = "yield per step"
_PENSIM_STEPS = 1150


class _Arrays(pickle.Unpickler):
    """Reads arrays, numbers, lists and dictionaries, and runs nothing else."""

    _ALLOWED = ("ndarray", "dtype", "_reconstruct", "scalar", "_frombuffer")

    def find_class(self, module: str, name: str) -> Any:
        if module.split(".")[0] == "numpy" and name in self._ALLOWED:
            return super().find_class(module, name)
        if (module, name) == ("_codecs", "encode"):
            return super().find_class(module, name)
        raise DatasetError(f"the file asks for {module}.{name}, which is not part of a data set: it was not read")


def from_legacy(path: str | os.PathLike[str] | Mapping[str, npt.ArrayLike]) -> list[Episode]:
    """Episodes of a data set of 2022: a pickle, or the dictionary that is in it.

    There row t holds observation t, the action chosen from it, and the reward and flags received
    *before* it. The last row of an episode holds its final observation and an unused action, and
    the flag `terminals` is also set at time-outs. Here the reward of a step is in the row of its
    action, and an end is either of the two.

    Only arrays are read from a pickle; one that asks for anything else is refused.

    Raises:
        DatasetError: no such file or dictionary, a value that is not finite, rows without an end.
    """
    columns = _legacy_columns(path if isinstance(path, Mapping) else _unpickle(Path(path)))
    ends = np.flatnonzero(columns["terminals"] | columns["timeouts"])
    rows = len(columns["rewards"])
    if not len(ends) or ends[-1] != rows - 1:
        first = int(ends[-1]) + 1 if len(ends) else 0
        raise DatasetError(f"rows {first} to {rows - 1} belong to an episode without an end")
    starts = [0, *(ends[:-1] + 1)]
    return [_legacy_episode(columns, int(a), int(b)) for a, b in zip(starts, ends, strict=True)]


def _unpickle(path: Path) -> Any:
    try:
        with path.open("rb") as file:
            return _Arrays(file).load()
    except DatasetError:
        raise
    except Exception as error:  # what a damaged pickle raises is anything
        raise DatasetError(f"{path} is not a data set of 2022: {error}") from error


def _legacy_columns(content: Any) -> dict[str, Array]:
    if not isinstance(content, Mapping) or not all(key in content for key in _LEGACY):
        found = ", ".join(map(str, content)) if isinstance(content, Mapping) else type(content).__name__
        raise DatasetError(f"expected a dictionary with {', '.join(_LEGACY)}, got {found}")
    columns = {key: np.asarray(content[key]) for key in _LEGACY}
    for key in ("rewards", "terminals", "timeouts"):
        columns[key] = columns[key].reshape(-1)
    lengths = {key: len(values) for key, values in columns.items()}
    if len(set(lengths.values())) != 1:
        raise DatasetError(f"columns differ in length: {lengths}")
    for key in ("observations", "actions", "rewards"):
        columns[key] = columns[key].astype(np.float64)
        if not np.all(np.isfinite(columns[key])):
            row = int(np.argwhere(~np.isfinite(columns[key]))[0][0])
            raise DatasetError(f"{key}, row {row}, is not finite")
    for key in ("terminals", "timeouts"):
        columns[key] = columns[key].astype(np.bool_)
    return columns


def _legacy_episode(columns: Mapping[str, Array], first: int, last: int) -> Episode:
    """The episode of rows first, ..., last."""
    if last == first:
        raise DatasetError(f"row {first} is an episode without a step")
    late = bool(columns["timeouts"][last])
    return _bare(
        columns["observations"][first : last + 1],
        columns["actions"][first:last],
        columns["rewards"][first + 1 : last + 1],
        terminated=not late,
        # Ends other than time-outs were failures of the original environments.
        failure="" if late else "unknown: the data set of 2022 does not say which",
    )


def from_pensim_csv(paths: str | os.PathLike[str] | Iterable[str | os.PathLike[str]]) -> list[Episode]:
    """Episodes of the penicillin files of 2022, one a batch, in physical units.

    Row k of a file holds the state *after* step k, the action and the reward of step k. A step of
    the episode is the observation of row k - 1 with action and reward of row k. The file lacks the
    observation before the first row, so that an episode has one step less than its file has rows. A
    file of 1150 rows ends with the batch, a shorter one is cut.

    Args:
        paths: a file, a folder of files, or several files.

    Raises:
        DatasetError: a missing file or column, or a cell that is not a number.
    """
    return [_pensim_episode(path) for path in _files(paths)]


def _files(paths: str | os.PathLike[str] | Iterable[str | os.PathLike[str]]) -> list[Path]:
    if isinstance(paths, (str, os.PathLike)):
        one = Path(paths)
        files = sorted(one.glob("*.csv")) if one.is_dir() else [one]
    else:
        files = [Path(path) for path in paths]
    if not files:
        raise DatasetError(f"{paths} has no CSV file")
    return files


def _pensim_episode(path: Path) -> Episode:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            header, *lines = [row for row in csv.reader(file) if row]
    except (OSError, ValueError) as error:
        raise DatasetError(f"{path} cannot be read: {error}") from error
    places = {_plain(name): place for place, name in enumerate(header)}
    missing = [name for name in (*_PENSIM_OBSERVATIONS, *_PENSIM_ACTIONS, _PENSIM_REWARD) if name not in places]
    if missing:
        raise DatasetError(f"{path} has no column {', '.join(missing)}; it has {', '.join(header)}")
    if len(lines) < 2:
        raise DatasetError(f"{path} has {len(lines)} rows, expected two at least")
    table = _numbers(path, lines, len(header))

    def columns(names: Iterable[str]) -> Array:
        return table[:, [places[name] for name in names]]

    return _bare(
        columns(_PENSIM_OBSERVATIONS),
        columns(_PENSIM_ACTIONS)[1:],
        table[1:, places[_PENSIM_REWARD]],
        terminated=len(lines) >= _PENSIM_STEPS,
        times=table[:, places["time step"]],
    )


def _numbers(path: Path, lines: list[list[str]], width: int) -> Array:
    table = np.full((len(lines), width), np.nan)
    for row, line in enumerate(lines):
        for place, cell in enumerate(line[:width]):
            try:
                table[row, place] = float(cell)
            except ValueError:
                raise DatasetError(f"{path}, line {row + 2}: {cell!r} is not a number") from None
        if not np.all(np.isfinite(table[row])):
            raise DatasetError(f"{path}, line {row + 2}: a cell is missing or not finite")
    return table


def _plain(name: str) -> str:
    """A heading without its unit in parentheses, and in small letters."""
    return name.partition("(")[0].strip().lower()


def _bare(
    observations: Array,
    actions: Array,
    rewards: Array,
    *,
    terminated: bool,
    failure: str = "",
    times: Array | None = None,
) -> Episode:
    """An episode of which no more is known."""
    steps = len(rewards)
    flags = np.zeros(steps, dtype=np.bool_)
    last = np.arange(steps) == steps - 1
    return Episode(
        None,
        observations.astype(np.float32),
        np.empty((steps + 1, 0)),
        actions.astype(np.float32),
        rewards.astype(np.float64),
        flags | (last & terminated),
        flags | (last & (not terminated)),
        np.zeros(steps + 1),
        np.arange(steps + 1, dtype=np.float64) if times is None else times,
        failure,
        terminated and not failure,
    )
