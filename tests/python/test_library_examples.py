"""The examples of the library pass their tests, and are in the book with their pictures."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "models/examples").glob("*.eq"))


def output(*arguments: str) -> str:
    """Output of the command, which succeeds without a word on the error stream."""
    library = {**os.environ, "SMPL_LIBRARY": str(ROOT / "models")}
    found = subprocess.run([sys.executable, "-m", "smpl", *arguments], capture_output=True, text=True, env=library)
    assert found.returncode == 0, found.stdout + found.stderr
    assert not found.stderr, found.stderr
    return found.stdout


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_has_no_warnings_and_passes_its_tests(example: Path) -> None:
    assert "warning" not in output("check", str(example))
    found = output("test", str(example))
    assert "\n1 test, 1 passed, 0 failed" in found, found


def test_every_example_is_on_the_page_of_the_library_and_has_a_picture() -> None:
    page = (ROOT / "docs/library.md").read_text(encoding="utf-8")
    pictures = json.loads((ROOT / "docs/pictures/index.json").read_text(encoding="utf-8"))
    for example in EXAMPLES:
        assert f"(library/{example.stem}.md)" in page
        assert pictures[f"examples/{example.stem}"]
