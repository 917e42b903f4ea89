"""Shared fixtures: the registered environments and the reference trajectories."""

import csv
import os
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import smpl

ROOT = Path(__file__).resolve().parents[2]
ENVIRONMENTS = sorted(name for name in gymnasium.registry if name.startswith("smpl/"))


@pytest.fixture(params=ENVIRONMENTS)
def identifier(request):
    """Id of each registered environment in turn."""
    return request.param


@pytest.fixture
def reactor():
    """The reactor in physical units."""
    return smpl.Env("reactor", normalize=False)


@pytest.fixture(scope="session")
def reactor_model():
    return smpl.compile("reactor")


@pytest.fixture(scope="session")
def reference():
    """Reads a reference file: name of a column -> array (empty cells are NaN)."""
    folder = Path(os.environ.get("SMPL_REFERENCE", ROOT.parent / "shared" / "reference"))
    if not folder.is_dir():
        pytest.skip(f"reference trajectories are not there: {folder} (set SMPL_REFERENCE)")

    def read(name):
        with (folder / name).open(newline="") as file:
            rows = list(csv.DictReader(file))
        return {key: np.array([_number(row[key]) for row in rows]) for key in rows[0]}

    return read


def _number(text):
    try:
        return float(text)
    except ValueError:
        return float(text == "true") if text in ("true", "false") else float("nan")
