"""Reading data sets."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np

from smpl.datasets.store import MANIFEST, DatasetError, Manifest, part_mark, part_path, read_part
from smpl.episodes import Episode
from smpl.learning.plan import Task


class Dataset(Sequence[Episode]):
    """Episodes of a folder, read part by part at their use; one part is in memory at a time.

    Attributes:
        folder: where it is.
        manifest: names, units, bounds, versions, and what the episodes are a function of.
        damaged: parts that were left out, damaged or missing, with what is wrong with them.
    """

    def __init__(self, folder: Path, manifest: Manifest, skip_damaged: bool) -> None:
        self.folder, self.manifest = folder, manifest
        self.damaged: dict[str, str] = {}
        self._parts: list[tuple[int, int]] = []  # number of the part, episodes in it
        self._held: tuple[int, list[Episode]] = (-1, [])
        for number in range(manifest.parts):
            self._find(number, skip_damaged)
        for number, fault in self._faults().items():
            name = part_path(folder, number)
            self.damaged[name.name] = f"{name} {fault}"
            warnings.warn(
                f"{name} {fault}; its episodes are left out, and those behind it count from there", stacklevel=3
            )
        self._parts = [
            (number, count) for number, count in self._parts if part_path(folder, number).name not in self.damaged
        ]
        self._starts = np.cumsum([0, *(count for _, count in self._parts)])

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_held": (-1, [])}  # a copy reads for itself

    def __len__(self) -> int:
        return int(self._starts[-1])

    def __iter__(self) -> Iterator[Episode]:
        for place in range(len(self._parts)):
            yield from self._part(place)

    @overload
    def __getitem__(self, index: int) -> Episode: ...

    @overload
    def __getitem__(self, index: slice) -> list[Episode]: ...

    def __getitem__(self, index: int | slice) -> Episode | list[Episode]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"episode {index} of {len(self)}")
        number = index % len(self)
        place = int(np.searchsorted(self._starts, number, side="right")) - 1
        return self._part(place)[number - int(self._starts[place])]

    def __repr__(self) -> str:
        return f"<smpl data set {self.folder}: {len(self)} episodes of {self.manifest.about['env']}>"

    @property
    def complete(self) -> bool:
        """True if all requested episodes are there; False during and after a partial collection."""
        return len(self) == self.manifest.episodes

    def check(self, env: Any, **arguments: Any) -> None:
        """Refuse a data set that is not of this environment as it is today.

        Raises:
            DatasetError: names, units, shapes or equations differ; the message says which.
        """
        task = Task.of(env, **arguments)
        model, names, about = task.model, self.manifest.names, self.manifest.about
        pairs: dict[str, tuple[Any, Any]] = {
            "observations": (names["observations"], model.observation_names),
            "actions": (names["actions"], model.action_names),
            "units of observations": (about["observation_units"], model.observation_units),
            "units of actions": (about["action_units"], model.action_units),
        }
        for what, (there, here) in pairs.items():
            if list(there) != list(here):
                raise DatasetError(f"{self.folder} has other {what}: {', '.join(there)}; now {', '.join(here)}")
        there = _told({**about["compiled"], **self.manifest.identity["arguments"]})
        here = _told(
            {key: value for key, value in model._arguments.items() if key in about["compiled"]} | task.arguments
        )
        other = [key for key in dict.fromkeys([*there, *here]) if there.get(key) != here.get(key)]
        if other:
            told = "; ".join(f"{key}: {there.get(key)} there, {here.get(key)} here" for key in other)
            raise DatasetError(f"{self.folder} was collected with other arguments ({told})")
        if self.manifest.identity["checksum"] != task.checksum:
            raise DatasetError(f"{self.folder} is of another version of {model.name}")

    def _find(self, number: int, skip: bool) -> None:
        try:
            mark = part_mark(self.folder, number)
            if skip and mark is not None:
                read_part(self.folder, number, self.manifest)
        except DatasetError as error:
            if not skip:
                raise
            self.damaged[part_path(self.folder, number).name] = str(error)
            return
        if mark is not None:
            self._parts.append((number, int(mark["episodes"])))

    def _faults(self) -> dict[int, str]:
        """Missing parts before others; parts missing at the end are not an error."""
        manifest, counts, faults = self.manifest, dict(self._parts), {}
        sizes = {number: last - first for number in range(manifest.parts) for first, last in [manifest.range(number)]}
        again = f"though {part_path(self.folder, max(counts, default=0)).name} is there: collect again"
        for number in range(max(counts, default=0)):
            if part_path(self.folder, number).name in self.damaged:
                continue
            if number not in counts:
                faults[number] = f"is missing, {again}"
            elif counts[number] < sizes[number]:
                faults[number] = f"has {counts[number]} of {sizes[number]} episodes, {again}"
        beyond = f"has more than the {manifest.episodes} episodes of {MANIFEST}: collect as many again"
        found = [int(path.stem[5:]) for path in self.folder.glob("part-*.parquet") if path.stem[5:].isdigit()]
        faults |= {number: beyond for number in sorted(found) if number >= manifest.parts}
        return {**faults, **{number: beyond for number, count in counts.items() if count > sizes[number]}}

    def _part(self, place: int) -> list[Episode]:
        if self._held[0] != place:
            self._held = place, read_part(self.folder, self._parts[place][0], self.manifest)
        return self._held[1]


def _told(arguments: Mapping[str, Any]) -> dict[str, str]:
    """Arguments of an environment as texts; a scenario by its name, wherever its file lies."""
    found = {key: str(value) for key, value in arguments.items()}
    return {**found, "scenario": Path(found.get("scenario", "None")).name}


def load(folder: str | os.PathLike[str], env: Any = None, *, skip_damaged: bool = False, **arguments: Any) -> Dataset:
    """The data set of a folder.

    Args:
        folder: where `collect` wrote it.
        env: the environment that it shall be of; not looked at if none.
        skip_damaged: leave damaged parts out (every part is read once for it).
        arguments: of the environment.

    Raises:
        DatasetError: no data set, a damaged part, or one of another model.
        ValueError: arguments without an environment.
        ImportError: pyarrow is missing.

    Warns:
        UserWarning: a part is missing before others, as where several workers were cut off;
        collecting again makes it.
    """
    if env is None and arguments:
        raise ValueError(f"{', '.join(arguments)}: arguments of an environment, and none is given")
    dataset = Dataset(Path(folder), Manifest.read(Path(folder)), skip_damaged)
    if env is not None:
        dataset.check(env, **arguments)
    return dataset
