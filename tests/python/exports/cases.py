"""The models among the test cases of the language."""

import re
from pathlib import Path

import smpl

PAGES = sorted((Path(__file__).resolve().parents[2] / "language").rglob("*.md"))


def accepted(page):
    """Title and model of every case of a page that is a whole model without a fault."""
    text = page.read_text(encoding="utf-8")
    for title, source in re.findall(r"^## ([^\n]*)\n(?:(?!^## ).)*?^```eq\n(.*?)^```$", text, re.S | re.M):
        try:
            yield title, smpl.compile(source=source)
        except (smpl.CompileError, smpl.ScenarioError):
            continue


CASES = [(f"{page.stem}: {title}", model) for page in PAGES for title, model in accepted(page)]
