"""The models among the test cases of the language."""

import re
from pathlib import Path

import smpl

CASES = Path(__file__).resolve().parents[2] / "language"
PAGES = sorted(CASES.rglob("*.md"))


def models(page):
    """Title and model of each case of a page that is accepted: warnings are no obstacle, a file of its own and a missing state are."""
    text = page.read_text(encoding="utf-8")
    for title, source in re.findall(r"^## (.*?)$(?:(?!^## ).)*?^```eq\n(.*?)^```$", text, re.S | re.M):
        try:
            yield title, smpl.compile(source=source)
        except (smpl.CompileError, smpl.ScenarioError):
            continue
