"""Compilation by the native compiler, and its arguments."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from smpl import _native
from smpl.support.arguments import FloatArray, as_mapping, as_numbers, shorten
from smpl.support.files import is_shipped, model_folders, model_path

Setting = bool | int | float | str | Sequence[float] | FloatArray


class Compilation(NamedTuple):
    """Checked arguments of `smpl.compile`, which can be compared and hashed."""

    path: str | None
    source: str | None
    scenario: str | None
    variants: tuple[str, ...]
    settings: tuple[tuple[str, str], ...]
    observation: str
    reward: str | None
    extra: str | None

    @classmethod
    def of(
        cls,
        path: str | os.PathLike[str] | None,
        source: str | None,
        scenario: str | os.PathLike[str] | None,
        variants: Iterable[str],
        settings: Mapping[str, Setting] | None,
        choices: tuple[str, str | None, str | None],
    ) -> Compilation:
        """Check arguments; `choices` are `observation`, `reward` and `extra`.

        Raises:
            ValueError: an argument of another type, or path and source together.
            FileNotFoundError: there is no such file.
            ScenarioError: an invalid setting.
        """
        if (path is None) == (source is None):
            raise ValueError("give either the path of a model or its source")
        extra = choices[2]
        if extra is not None and not isinstance(extra, str):
            raise ValueError(f"extra is {shorten(extra)}, expected statements of the language as a text")
        return cls(
            None if path is None else _resolve(_path("path", path)),
            source,
            None if scenario is None else _path("scenario", scenario),
            as_variants(variants),
            tuple(sorted((name, _text(name, value)) for name, value in as_mapping("settings", settings).items())),
            *choices,
        )

    def native(self) -> _native.Model:
        """Compile.

        Raises:
            CompileError: the model is invalid.
            ScenarioError: the scenario, a variant, a setting or the reward is invalid.
        """
        try:
            return _native.Model(*self[:4], dict(self.settings), *self[5:])
        except _native.ScenarioError as error:
            _, found, rest = str(error).partition(f"unknown reward `{self.reward}`")
            if found:
                raise _native.ScenarioError(f"argument `reward`: {found}{rest}") from None
            raise

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of `smpl.compile`, without `extra` if it has no value.

        The checksum of a task contains them.
        """
        named = {**self._asdict(), "settings": dict(self.settings)}
        if self.extra is None:
            del named["extra"]
        return named

    def stamp(self) -> tuple[int, ...]:
        """Times of change of the files next to the model, which distinguish versions of a file."""
        if self.path is None:
            return ()
        path, folder = Path(self.path), Path(self.path).parent
        files = [*folder.glob("*.eq"), *folder.glob("*.yaml"), *(folder / "lib").glob("*.eq")]
        if path.suffix != ".eq" and path.is_file():
            files.append(path)
        if self.scenario is not None and Path(self.scenario).is_file():
            files.append(Path(self.scenario))
        return tuple(file.stat().st_mtime_ns for file in sorted(files))


def as_variants(given: Any) -> tuple[str, ...]:
    """Variants one by one.

    Raises:
        ValueError: they are not texts.
    """
    if isinstance(given, str):
        return (given,)
    variants = tuple(given) if isinstance(given, Iterable) else (given,)
    if not all(isinstance(variant, str) for variant in variants):
        raise ValueError(f"variants is {shorten(given)}, expected names such as 'reward_floor' or 'scheme=legacy'")
    return variants


def portable(arguments: dict[str, Any]) -> dict[str, Any]:
    """Arguments for other processes: names of shipped models, absolute paths of other files."""
    path, scenario = arguments["path"], arguments["scenario"]
    if path is not None:
        shipped = Path(path).parent in model_folders() and Path(path).suffix == ".eq"
        path = Path(path).stem if shipped else str(Path(path).absolute())
    if scenario is not None and Path(scenario).suffix in (".yaml", ".yml"):
        scenario = str(Path(scenario).absolute())
    return {**arguments, "path": path, "scenario": scenario}


def _path(name: str, value: Any) -> str:
    """The text of a path, or of a name.

    Raises:
        ValueError: it is neither.
    """
    if not isinstance(value, (str, os.PathLike)) or not isinstance(os.fspath(value), str):
        raise ValueError(f"{name} is {shorten(value)}, expected a name or a path")
    return str(os.fspath(value))


def _resolve(path: str | os.PathLike[str]) -> str:
    text = os.fspath(path)
    if isinstance(path, str) and (is_shipped(text) or (text.isidentifier() and not Path(text).exists())):
        return str(model_path(text))
    if not Path(text).exists() and text.startswith("smpl/"):
        raise FileNotFoundError(f"{text!r} is the id of an environment: gymnasium.make({text!r}) makes it")
    return text


def times_of(files: Iterable[str]) -> dict[str, int]:
    """Times of change of those that are files."""
    return {file: Path(file).stat().st_mtime_ns for file in files if Path(file).is_file()}


def _text(name: str, value: Setting) -> str:
    """A setting as the command line would write it.

    Raises:
        ScenarioError: it is not a setting.
    """
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (int, np.integer, str)):
        return str(value)
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    what = f"settings[{name!r}]"
    if isinstance(value, (Sequence, np.ndarray)):
        try:
            numbers = as_numbers(what, value, "(elements,)")
        except ValueError as error:
            raise _native.ScenarioError(str(error)) from error
        if numbers.ndim == 1:
            return f"[{', '.join(map(repr, numbers.tolist()))}]"
    raise _native.ScenarioError(f"{what} is {shorten(value)}, expected a number, numbers, True, False or a text")
