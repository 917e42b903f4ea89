"""The plants of the page on the library equal the same plants with every equation written out."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import smpl

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/how-to/library.md").read_text(encoding="utf-8")
REFERENCE = (ROOT / "docs/library.md").read_text(encoding="utf-8")
PLANTS = ("flash", "network", "reactor")


def text_of(plant: str, page: str = PAGE) -> str:
    """The text on the page."""
    block = re.search(rf'^```eq title="{plant}\.eq"\n(.*?)^```$', page, re.S | re.M)
    assert block, plant
    return block[1]


def written_out(plant: str) -> Path:
    return ROOT / f"tests/python/plants/{plant}.eq"


def lines_of(text: str) -> int:
    """Lines with statements."""
    return sum(1 for line in text.splitlines() if line.strip() and not line.strip().startswith("#"))


def observed(model: smpl.Model, steps: int, actions: np.ndarray) -> np.ndarray:
    env = smpl.Env(model)
    rows = [env.reset(seed=0, options={"start": "nominal"})[0]]
    rows += [env.step(actions)[0] for _ in range(steps)]
    return np.stack(rows)


@pytest.mark.parametrize("plant", PLANTS)
def test_a_plant_of_library_units_moves_as_its_equations_written_out(plant: str) -> None:
    models = (smpl.compile(source=text_of(plant)), smpl.compile(written_out(plant)))
    assert "use" not in written_out(plant).read_text(encoding="utf-8").split()
    for share in (0.5, 0.3, 0.8):
        found = []
        for model in models:
            space = smpl.Env(model).action_space
            found.append(observed(model, 20, space.low + share * (space.high - space.low)))
        span = np.abs(found[0]).max(axis=0)
        assert found[0].shape == found[1].shape
        assert np.all(np.abs(found[0] - found[1]) <= 1e-6 * np.maximum(span, 1.0)), share


def test_the_page_counts_the_lines_of_both_texts() -> None:
    rows = re.findall(r"^\| \[[^|]*\| (\d+) \| (\d+) \| (\d+) %", PAGE, re.M)
    pairs = [(text_of(p), written_out(p).read_text(encoding="utf-8")) for p in PLANTS]
    pairs.append((text_of("plant", REFERENCE), text_of("plain", REFERENCE)))
    counts = [(lines_of(short), lines_of(long)) for short, long in pairs]
    assert rows == [(str(short), str(long), str(round(100 * short / long))) for short, long in counts]
