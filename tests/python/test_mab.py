"""The right-hand side of MAb against its reference, section 10 of the specification."""

import os
from pathlib import Path

import numpy as np
import pytest

import smpl

ROOT = Path(__file__).resolve().parents[2]
REFERENCE = Path(os.environ.get("SMPL_REFERENCE", ROOT.parent / "shared" / "reference"))

# Scales of the tanks' states, section 2 of the specification; those of the column are 1.
TANKS = [3e10, 5e10, 5000, 50, 200, 50, 150, 3000, 2e10, 3e10, 5000, 100, 250, 100, 200, 3000, 37, 3, 200]


@pytest.mark.skipif(not (REFERENCE / "mab_rhs.npz").exists(), reason="reference files are not installed")
def test_rates_of_legacy_are_those_of_the_reference():
    table = np.load(REFERENCE / "mab_rhs.npz")
    model = smpl.compile(ROOT / "models" / "mab.eq", scenario="legacy")
    assert list(model.state_names) == [str(name) for name in table["state_names"]]
    scale = np.ones(len(model.state_names))
    scale[: len(TANKS)] = TANKS
    for state, action, expected in zip(table["states"], table["actions"], table["derivatives_legacy"], strict=True):
        rates = np.asarray(model.rhs(0.0, state, action))
        assert (np.abs(rates - expected) / scale).max() <= 1e-12 * (np.abs(expected) / scale).max()
