"""The table of the benchmark as Markdown, and in the places that a page keeps for it.

A place is the text between the lines `<!-- table -->` and `<!-- end of table -->`: all processes,
one under the other. `<!-- table: Beer -->` is the place of one process; `<!-- table: best -->` and
others are those of `smpl_benchmarks.places`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from smpl_benchmarks.tables import lines, remarks

_PLACE = re.compile(r"(<!-- table(?:: ([A-Za-z_][\w ]*))? -->\n)(.*?)(<!-- end of table -->\n)", re.DOTALL)


def markdown(table: Mapping[str, Any]) -> str:
    """All processes, each under its heading."""
    parts = [f"\n#### {env}\n\n{rows}" for env, rows in _processes(table).items()]
    return "".join(parts) + remarks(table)


def place_in(page: Path, table: Mapping[str, Any], more: Mapping[str, str] | None = None) -> None:
    """Put the table into the places of a page; places of processes without rows are unchanged.

    Args:
        page: a Markdown file.
        table: content of `table.json`.
        more: text of further places by name.

    Raises:
        ValueError: the page has no place.
    """
    texts = {}
    for name, rows in _processes(table).items():
        mine = {**table, "rows": [row for row in table["rows"] if row["env"] == name]}
        texts[name] = f"{rows}{remarks(mine)}"
    fill(page, {**texts, **(more or {})}, markdown(table))


def fill(page: Path, texts: Mapping[str, str], whole: str | None = None) -> None:
    """Put texts into the places of a page; other places are unchanged.

    Args:
        page: a Markdown file.
        texts: text of each place by name.
        whole: text of the place without a name.

    Raises:
        ValueError: the page has no place.
    """

    def filled(found: re.Match[str]) -> str:
        begin, which, _, end = found.groups()
        text = whole if which is None else texts.get(which)
        return found.group() if text is None else f"{begin}\n{text.strip()}\n\n{end}"

    page.write_text(_PLACE.sub(filled, places_of(page)), encoding="utf-8")


def places_of(page: Path) -> str:
    """The text of a page that has a place for the table.

    Raises:
        ValueError: it has none.
    """
    text = page.read_text(encoding="utf-8")
    if not _PLACE.search(text):
        raise ValueError(f"{page} has no lines <!-- table --> and <!-- end of table -->")
    return text


def grid(head: Sequence[str], lines: Sequence[Sequence[str]], left: int) -> str:
    """A table in Markdown; the first `left` columns hold text, the others numbers."""
    rule = "|" + " --- |" * left + " ---: |" * (len(head) - left)
    return "\n".join([_line(head), rule, *map(_line, lines)]) + "\n"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _processes(table: Mapping[str, Any]) -> dict[str, str]:
    """Name of each process to its rows as Markdown."""
    head, *body = lines(table)
    found = {}
    for env, rows in groupby(body, key=lambda row: row[0]):
        found[env] = grid(head[1:], [row[1:] for row in rows], left=2)
    return found
