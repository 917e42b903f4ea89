"""Pictures of models, episodes and saved runs.

    smpl.plot("run.csv", model="models/reactor.eq").save("run.pdf")

A `Picture` shows itself in a notebook; `save` writes SVG, PNG, PDF or a page of HTML by the ending
of the file.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from smpl import _native
from smpl._native import Picture
from smpl.model import Model, compile
from smpl.support.drawing import names

__all__ = ["Picture", "plot"]


def plot(
    runs: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    show: str | Sequence[str] = (),
    model: Model | str | os.PathLike[str] | None = None,
) -> Picture:
    """Draw tables that `smpl simulate --out` wrote, over one another.

    Args:
        runs: path of a table, or several.
        show: names of quantities or columns, `states`, `actions` and so on; a sensible choice where
            it is empty.
        model: the model that made them, for units, bounds, set-points and names of phases.

    Raises:
        ValueError: a table is invalid, or has no column of a name.
        OSError: a table cannot be read.
    """
    paths = [runs] if isinstance(runs, (str, os.PathLike)) else list(runs)
    if not paths:
        raise ValueError("runs is empty: give the path of a table")
    compiled = model if model is None or isinstance(model, Model) else compile(model)
    native = None if compiled is None else compiled.native
    return _native.picture_of_tables([Path(path) for path in paths], names(show), native)
