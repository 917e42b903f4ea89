"""The texts that `smpl export` writes."""

from __future__ import annotations

import json as _json
import os
import warnings
from pathlib import Path
from typing import Any

from smpl.model import Model


def text(model: Model, target: str, *, history: int | None = None) -> dict[str, str]:
    """The files of an export: ending -> text, the main file first.

    Args:
        model: a compiled model; scenario, variants and settings are those that it was compiled
            with.
        target: a form that is text, such as `json`; an unknown name raises an error with all forms.
        history: as for `fmu`, of an instance of a kernel; 500 if left out.

    Raises:
        ValueError: an unknown target, a model that the target cannot carry, or a history below 1.
    """
    return dict(model.native.export(target, None, _history(history)))


def json(model: Model) -> dict[str, Any]:
    """The checked model as a tree, in the form of `docs/schema/model-3.schema.json`."""
    return _json.loads(text(model, "json")["json"])


def write(model: Model, target: str, path: str | os.PathLike[str], *, history: int | None = None) -> list[Path]:
    """Writes an export as `smpl export --to TARGET -o PATH` does; further files are next to it.

    Arguments are those of `text`.

    Returns:
        The files, the main one first.

    Raises:
        ValueError: as for `text`.
    """
    main = Path(path)
    files = dict(model.native.export(target, main.stem, _history(history)))
    paths = [main, *(main.with_suffix(f".{ending}") for ending in list(files)[1:])]
    for file, content in reversed(list(zip(paths, files.values(), strict=True))):
        _write_whole(file, content.encode())
    return paths


def fmu(model: Model, path: str | os.PathLike[str], *, binary: bool = True, history: int | None = None) -> Path:
    """Write a Functional Mock-up Unit of FMI 3.0, as `smpl export --to fmu -o PATH` does.

    Args:
        model: a compiled model; scenario, variants and settings are those that it was compiled
            with.
        path: where it goes, `NAME.fmu`.
        binary: make a binary for this machine by the C compiler `cc` (another one: the environment
            variable `CC`). Without one the FMU holds sources that an importer compiles; a warning
            says so where that was not asked for.
        history: most internal steps that the unit keeps for dead times, `delay(...)`; 10,000 if
            left out. A simulation that needs more of them fails with a message.

    Returns:
        The file.

    Raises:
        ValueError: a model that an FMU cannot carry, or a history below 1.
    """
    content, why = model.native.fmu(binary, _history(history))
    if binary and why:
        warnings.warn(f"{path} holds sources only and no binary: {why}", stacklevel=2)
    _write_whole(Path(path), content)
    return Path(path)


def _history(history: int | None) -> int | None:
    if history is not None and history < 1:
        raise ValueError(f"history must be positive, not {history}")
    return history


def _write_whole(file: Path, content: bytes) -> None:
    """A file that is there whole or not at all."""
    part = file.with_name(f".{file.name}.part")
    part.write_bytes(content)
    part.replace(file)
