"""Where the models are, in a source checkout and in an installed package."""

from __future__ import annotations

import os
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def models_directory() -> Path:
    """Folder of the shipped models: that of the checkout if the package runs from one, else the package's own copy."""
    checkout = _PACKAGE.parent.parent
    if (checkout / "Cargo.toml").is_file() and (checkout / "models").is_dir():
        return checkout / "models"
    return _PACKAGE / "models"


def announce_library() -> None:
    """Let models anywhere import the shipped components (`use "lib/..."`), unless a library is set already."""
    os.environ.setdefault("SMPL_LIBRARY", str(models_directory()))


def model_path(name: str) -> Path:
    """Path of a shipped model, `reactor` -> `.../reactor.eq`.

    Raises:
        FileNotFoundError: there is no such model; the message lists those that there are.
    """
    path = models_directory() / f"{name}.eq"
    if not path.is_file():
        known = ", ".join(sorted(file.stem for file in models_directory().glob("*.eq")))
        raise FileNotFoundError(f"no model named {name!r}; there are: {known}")
    return path
