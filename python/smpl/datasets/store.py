"""Data sets on disk: a folder with `dataset.json` and parts in Parquet, each whole or absent.

One row per instant: row k of an episode holds observation k, the action chosen from it and the
results of the step (reward, flags, disturbance). The last row holds the final observation, and null
for the missing step. Parts are written under a temporary name, flushed to the disk and renamed.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.episodes import Details, Episode
from smpl.support.arguments import FloatArray
from smpl.support.optional import load

FORMAT = 1
MANIFEST = "dataset.json"
# Columns of names, in this order: (prefix, key of the manifest, whether the last row of an episode
# has a value).
GROUPS = (
    ("observation", "observations", True),
    ("action", "actions", False),
    ("physical", "actions", False),
    ("rewards", "rewards", False),
    ("violation", "constraints", True),
    ("state", "states", True),
    ("discrete", "discrete", True),
    ("disturbance", "disturbances", False),
    ("parameter", "parameters", True),
)


class DatasetError(ValueError):
    """A data set is damaged, or not what was asked for."""


def pyarrow() -> Any:
    """The package that reads and writes the parts.

    Raises:
        ImportError: it is missing.
    """
    load("pyarrow.parquet", "a data set in Parquet")
    return load("pyarrow", "a data set in Parquet")


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Locks a folder against other processes that write parts; a failed process releases it.

    Raises:
        DatasetError: another process, or thread, holds it.
    """
    place = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise DatasetError(f"another process is collecting into {folder}: wait for it, or stop it first") from None
        yield
    finally:
        os.close(place)


@dataclass(frozen=True)
class Manifest:
    """Common properties of all parts of a data set.

    Attributes:
        identity: what the episodes are a function of; the same for all runs that may add to the
            data set.
        names: of the columns by key of `GROUPS`.
        about: versions, units, bounds, for readers.
        part: episodes a part.
        episodes: how many were asked for.

    Raises:
        DatasetError: two columns have one name.
    """

    identity: Mapping[str, Any]
    names: Mapping[str, Sequence[str]]
    about: Mapping[str, Any]
    part: int
    episodes: int

    def __post_init__(self) -> None:
        for prefix, key, _ in GROUPS:
            twice = [name for name, count in Counter(self.names.get(key, ())).items() if count > 1]
            if twice:
                raise DatasetError(
                    f"{key} has {twice[0]!r} twice: a column {prefix}.{twice[0]} can hold one of them only; "
                    "give them different names"
                )

    def write(self, folder: Path) -> None:
        """Write `dataset.json`, whole or not at all."""
        content = {"format": FORMAT, **{key: getattr(self, key) for key in self.__dataclass_fields__}}
        text = json.dumps(content, indent=1, sort_keys=True, default=str) + "\n"
        _replace(folder / MANIFEST, lambda path: path.write_text(text, encoding="utf-8"))

    @classmethod
    def read(cls, folder: Path) -> Manifest:
        """The manifest of a folder.

        Raises:
            DatasetError: the manifest is missing, or has another format.
        """
        try:
            content = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
            found = content.pop("format")
            if found != FORMAT:
                raise DatasetError(f"{folder} has format {found}, this version of smpl reads format {FORMAT}")
            made = cls(**content)
            if not all(isinstance(one, int) and one > 0 for one in (made.part, made.episodes)):
                raise TypeError(f"part is {made.part!r}, episodes is {made.episodes!r}, expected positive integers")
            for key in dict.fromkeys(key for _, key, _ in GROUPS):
                made.names[key]
            return made
        except FileNotFoundError as error:
            raise DatasetError(f"{folder} is not a data set: it has no {MANIFEST}") from error
        except (OSError, TypeError, KeyError, AttributeError, json.JSONDecodeError) as error:
            raise DatasetError(f"{folder / MANIFEST} is damaged: {error}") from error

    @property
    def mark(self) -> str:
        """Digest of the inputs that determine the episodes, which differs between collections."""
        text = json.dumps(json.loads(json.dumps(self.identity, default=str)), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def parts(self) -> int:
        """Number of parts when it is whole."""
        return -(-self.episodes // self.part)

    def range(self, number: int) -> tuple[int, int]:
        """First episode of a part, and the one after its last."""
        return number * self.part, min((number + 1) * self.part, self.episodes)


def part_path(folder: Path, number: int) -> Path:
    """File of a part."""
    return folder / f"part-{number:06d}.parquet"


def write_part(folder: Path, number: int, manifest: Manifest, episodes: Sequence[tuple[int, Episode]]) -> None:
    """Write a part, whole or not at all.

    Args:
        folder, number: where.
        manifest: of the data set.
        episodes: with their numbers.

    Raises:
        DatasetError: a value is not finite.
        OSError: the disk is full, or the like.
    """
    arrow = pyarrow()
    for index, one in episodes:
        try:
            check_finite(index, one)
        except DatasetError as error:
            raise DatasetError(f"{error}; nothing was kept") from None
    columns = _columns(manifest, episodes)
    table = arrow.table({name: arrow.array(values, mask=mask) for name, (values, mask) in columns.items()})
    mark = {"checksum": manifest.identity["checksum"], "of": manifest.mark, "episodes": len(episodes)}
    table = table.replace_schema_metadata({b"smpl": json.dumps(mark).encode()})
    _replace(
        part_path(folder, number),
        lambda path: arrow.parquet.write_table(table, path, compression="zstd", write_page_checksum=True),
    )


def place_part(folder: Path, number: int, content: bytes) -> None:
    """Write a part that was made elsewhere, whole or not at all.

    Raises:
        OSError: the disk is full, or the like.
    """
    _replace(part_path(folder, number), lambda path: path.write_bytes(content))


def part_mark(folder: Path, number: int) -> dict[str, Any] | None:
    """Checksum of the model and number of episodes that a part names; none if it is not there.

    Raises:
        DatasetError: it is damaged.
    """
    path = part_path(folder, number)
    if not path.is_file():
        return None
    try:
        schema = pyarrow().parquet.read_schema(path)
        mark: dict[str, Any] = json.loads(schema.metadata[b"smpl"])
    except (OSError, TypeError, KeyError, ValueError) as error:
        raise DatasetError(_damaged(path, error)) from error
    return mark


def _damaged(path: Path, error: Exception) -> str:
    return f"{path} is damaged ({error}): remove it and collect again, or leave it out by load(..., skip_damaged=True)"


def read_part(folder: Path, number: int, manifest: Manifest) -> list[Episode]:
    """Episodes of a part.

    Raises:
        DatasetError: it is damaged, or of another model.
    """
    path, arrow = part_path(folder, number), pyarrow()
    mark = part_mark(folder, number)
    if mark is not None and mark["checksum"] != manifest.identity["checksum"]:
        raise DatasetError(f"{path} is of another version of the model than {folder / MANIFEST}")
    if mark is not None and mark.get("of", manifest.mark) != manifest.mark:
        raise DatasetError(f"{path} is of another collection than {folder / MANIFEST}: remove it and collect again")
    try:
        table = arrow.parquet.read_table(path, page_checksum_verification=True)
        columns = {name: table.column(name).to_numpy() for name in table.column_names}
        _check_order(columns, manifest.range(number)[0], mark["episodes"] if mark is not None else None)
        found = _episodes(manifest, columns)
        for index, one in enumerate(found, manifest.range(number)[0]):
            check_finite(index, one)
        return found
    except (OSError, KeyError, ValueError, arrow.ArrowException) as error:
        raise DatasetError(_damaged(path, error)) from error


def _check_order(columns: Mapping[str, npt.NDArray[Any]], first: int, count: int | None) -> None:
    """Refuses rows that are not those of so many complete episodes from `first` on.

    Raises:
        ValueError: they are not.
    """
    episodes, steps = columns["episode"], columns["step"]
    begins = np.flatnonzero(np.diff(episodes, prepend=episodes[:1] - 1))
    if not np.array_equal(episodes[begins], first + np.arange(len(begins) if count is None else count)):
        raise ValueError(f"its episodes are not those from {first} on")
    lengths = np.diff([*begins, len(steps)])
    # The last row of an episode, and no other one, has no step.
    if not np.array_equal(np.flatnonzero(np.isnan(columns["reward"])), np.cumsum(lengths) - 1):
        raise ValueError("an episode has no end")
    if not np.array_equal(steps, np.concatenate([np.arange(length) for length in lengths])):
        raise ValueError("the steps of an episode do not follow one another")


def check_finite(index: int, one: Episode) -> None:
    """Refuse what is not finite.

    Raises:
        DatasetError: a value is not; the message names the episode and where.
    """
    kinds: dict[str, Any] = {"observations": one.observations, "actions": one.actions, "rewards": one.rewards}
    kinds |= {"states": one.states, "costs": one.costs, "times": one.times}
    if one.details is not None:
        for kind in ("rewards", "violations", "discrete", "disturbances"):
            kinds |= {f"{kind} of {name}": values for name, values in getattr(one.details, kind).items()}
        kinds |= {"physical": one.details.physical}
    for kind, values in kinds.items():
        if not np.all(np.isfinite(values)):
            row = int(np.argwhere(~np.isfinite(values))[0][0])
            raise DatasetError(f"episode {index} (seed {one.seed}): {kind}, row {row}, is not finite")


Column = tuple[npt.NDArray[Any], npt.NDArray[np.bool_] | None]


def _columns(manifest: Manifest, episodes: Sequence[tuple[int, Episode]]) -> dict[str, Column]:
    """Columns with their masks (true is null)."""
    every = [one for _, one in episodes]
    lengths = [one.steps + 1 for one in every]
    last = np.zeros(sum(lengths), dtype=np.bool_)
    last[np.cumsum(lengths) - 1] = True

    def repeated(values: Sequence[Any], kind: Any) -> npt.NDArray[Any]:
        return np.repeat(np.array(values, dtype=kind), lengths)

    columns: dict[str, Column] = {
        "episode": (repeated([index for index, _ in episodes], np.int64), None),
        "step": (np.concatenate([np.arange(length) for length in lengths]), None),
        "time": (np.concatenate([one.times for one in every]), None),
        "reward": (_padded([one.rewards for one in every]), last),
        "cost": (np.concatenate([one.costs for one in every]), None),
        "terminated": (_padded([one.terminations for one in every]), last),
        "truncated": (_padded([one.truncations for one in every]), last),
    }
    for prefix, key, full in GROUPS:
        for i, name in enumerate(manifest.names[key]):
            values = [_value(one, prefix, i, name) for one in every]
            columns[f"{prefix}.{name}"] = (np.concatenate(values), None) if full else (_padded(values), last)
    if manifest.names["phases"]:
        columns["phase"] = (np.concatenate([np.array(_details(one).phases, dtype=object) for one in every]), None)
    seeds = [one.seed for one in every]
    columns["seed"] = (repeated(seeds, np.uint64 if max(map(_whole, seeds), default=0) >= 2**63 else np.int64), None)
    columns["controller"] = (repeated([_details(one).controller for one in every], object), None)
    columns["failure"] = (repeated([one.failure for one in every], object), None)
    columns["success"] = (repeated([one.success for one in every], np.bool_), None)
    columns["options"] = (repeated([json.dumps(one.options) for one in every], object), None)
    return columns


def _whole(seed: int | None) -> int:
    return 0 if seed is None else seed


def _padded(parts: Sequence[npt.NDArray[Any]]) -> npt.NDArray[Any]:
    """Values of the steps with one more row an episode."""
    return np.concatenate([np.concatenate([part, part[-1:]]) for part in parts])


def _details(one: Episode) -> Details:
    if one.details is None:
        raise DatasetError("an episode without details cannot be stored: make it by smpl.datasets.collect")
    return one.details


def _value(one: Episode, prefix: str, i: int, name: str) -> npt.NDArray[Any]:
    """Column of an episode."""
    details = _details(one)
    if prefix in ("observation", "action", "state"):
        return np.ascontiguousarray(getattr(one, f"{prefix}s")[:, i])
    if prefix == "physical":
        return np.ascontiguousarray(details.physical[:, i])
    if prefix == "parameter":
        return np.full(one.steps + 1, details.parameters[name])
    kinds = {"rewards": "rewards", "violation": "violations", "discrete": "discrete", "disturbance": "disturbances"}
    values: dict[str, npt.NDArray[Any]] = getattr(details, kinds[prefix])
    return np.ascontiguousarray(values[name])


def _episodes(manifest: Manifest, columns: Mapping[str, npt.NDArray[Any]]) -> list[Episode]:
    ends = np.flatnonzero(np.diff(columns["episode"], append=-1))
    return [
        _episode(manifest, {name: values[first : end + 1] for name, values in columns.items()})
        for first, end in zip([0, *(ends[:-1] + 1)], ends, strict=True)
    ]


def _episode(manifest: Manifest, c: Mapping[str, npt.NDArray[Any]]) -> Episode:
    def group(prefix: str, kind: Any) -> npt.NDArray[Any]:
        ((key, full),) = [(key, full) for p, key, full in GROUPS if p == prefix]
        rows = slice(None) if full else slice(-1)
        parts = [c[f"{prefix}.{name}"][rows] for name in manifest.names[key]]
        shape = (len(c["step"]) - (0 if full else 1), len(parts))
        return np.stack(parts, axis=1).astype(kind) if parts else np.empty(shape, dtype=kind)

    def named(prefix: str) -> dict[str, FloatArray]:
        ((key, full),) = [(key, full) for p, key, full in GROUPS if p == prefix]
        rows = slice(None) if full else slice(-1)
        return {name: c[f"{prefix}.{name}"][rows].astype(np.float64) for name in manifest.names[key]}

    details = Details(
        group("physical", np.float64),
        named("rewards"),
        named("violation"),
        named("discrete"),
        named("disturbance"),
        tuple(c["phase"]) if "phase" in c else (),
        {name: float(c[f"parameter.{name}"][0]) for name in manifest.names["parameters"]},
        str(c["controller"][0]),
    )
    return Episode(
        int(c["seed"][0]),
        group("observation", np.float32),
        group("state", np.float64),
        group("action", np.float32),
        c["reward"][:-1].astype(np.float64),
        c["terminated"][:-1].astype(np.bool_),
        c["truncated"][:-1].astype(np.bool_),
        c["cost"],
        c["time"],
        str(c["failure"][0]),
        bool(c["success"][0]),
        json.loads(c["options"][0]),
        details=details,
    )


def _replace(path: Path, write: Any) -> None:
    """Write under a temporary name, flush to the disk, rename; what fails leaves nothing behind."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        write(temporary)
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    if os.name == "posix":
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
