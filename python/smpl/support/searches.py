"""Files in which searches keep their points, so that they can be gone on with."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt


def read_search(file: Path, names: Sequence[str]) -> npt.NDArray[np.float64]:
    """Points and values (points, names + 1) that a search wrote.

    A line that was not whole when the search was stopped is taken off the file.
    Raises ValueError for the file of another search.
    """
    text = file.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    rows = list(csv.reader(whole.splitlines()))
    if not rows or tuple(rows[0]) != (*names, "value"):
        raise ValueError(f"{file} is of another search: its columns are {', '.join(rows[0] if rows else [])}")
    if whole != text:
        file.write_text(whole, encoding="utf-8")
    return np.array(rows[1:], dtype=np.float64).reshape(len(rows) - 1, len(rows[0]))
