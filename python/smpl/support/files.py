"""Folders of the models, in a source checkout and in an installed package."""

from __future__ import annotations

import os
from difflib import get_close_matches
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]


def models_directory() -> Path:
    """Folder of the shipped models: that of a checkout, else the copy in the package."""
    checkout = _PACKAGE.parent.parent
    if (checkout / "Cargo.toml").is_file() and (checkout / "models").is_dir():
        return checkout / "models"
    return _PACKAGE / "models"


def announce_library() -> None:
    """Let models anywhere import the shipped components, unless a library is set already."""
    os.environ.setdefault("SMPL_LIBRARY", str(models_directory()))


def model_folders() -> tuple[Path, Path]:
    """Folders in which shipped models are found by name: `models` and its `gallery`."""
    return models_directory(), models_directory() / "gallery"


def model_path(name: str) -> Path:
    """Path of a shipped model: `column_a` -> `.../gallery/column_a.eq`.

    Raises:
        FileNotFoundError: there is no such model; the message lists those that there are.
    """
    path = _shipped(name)
    if path is not None:
        return path
    known = sorted(file.stem for folder in model_folders() for file in folder.glob("*.eq"))
    plain = {stem.replace("_", ""): stem for stem in known}
    near = get_close_matches(name.lower().replace("_", ""), plain, 1)
    hint = f" did you mean {plain[near[0]]!r}?" if near else ""
    raise FileNotFoundError(f"no model and no file named {name!r};{hint} there are: {', '.join(known)}")


def is_shipped(name: str) -> bool:
    """Test for the name of a shipped model; the working folder does not matter."""
    return _shipped(name) is not None


def _shipped(name: str) -> Path | None:
    if not name.isidentifier():
        return None
    paths = (folder / f"{name}.eq" for folder in model_folders())
    return next((path for path in paths if path.is_file()), None)
