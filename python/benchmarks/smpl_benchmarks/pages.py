"""The table of the benchmark as Markdown, and in the places that a page keeps for it.

A place is what stands between the lines `<!-- table -->` and `<!-- end of table -->`: all processes, one under the
other. `<!-- table: Beer -->` is the place of one process, `<!-- table: best -->` that of the summary.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from smpl_benchmarks.subjects import SUITES
from smpl_benchmarks.tables import lines, remarks

_PLACE = re.compile(r"(<!-- table(?:: ([A-Za-z_]\w*))? -->\n)(.*?)(<!-- end of table -->\n)", re.DOTALL)
_SUMMARY = "best"
# What the others are compared with.
_BOUNDS = ("nominal", "full_information", "random")


def markdown(table: Mapping[str, Any]) -> str:
    """All processes, each under its heading."""
    parts = [f"\n#### {env}\n\n{rows}" for env, rows in _processes(table).items()]
    return "".join(parts) + remarks(table)


def place_in(page: Path, table: Mapping[str, Any]) -> None:
    """Put the table into the places of a page; those of processes that the table does not have stay as they are.

    Raises:
        ValueError: the page has no place.
    """
    processes = _processes(table)

    def filled(found: re.Match[str]) -> str:
        begin, which, before, end = found.groups()
        if which is None:
            return f"{begin}{markdown(table)}{end}"
        if which == _SUMMARY:
            return f"{begin}\n{summary(table)}\n{end}"
        if which not in processes:
            return f"{begin}{before}{end}"
        mine = {**table, "rows": [row for row in table["rows"] if row["env"] == which]}
        return f"{begin}\n{processes[which]}{remarks(mine)}\n{end}"

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


def summary(table: Mapping[str, Any]) -> str:
    """For each process the controller and the policies of most gain over the nominal policy.

    All cells of a row are means over the same episodes: those that every controller and algorithm of most seeds has
    run. Rows of fewer seeds are left out.
    """
    head = ["process", "episodes", "nominal", *(f"best of {suite}" for suite in SUITES), "full information"]
    written = [f"| {' | '.join(head)} |", "| --- |" + " ---: |" * (len(head) - 1)]
    for env in dict.fromkeys(row["env"] for row in table["rows"]):
        rows = [row for row in table["rows"] if row["env"] == env and "common" in row]
        named = {row["controller"]: row["common"] for row in rows}
        if "nominal" not in named:
            continue
        best = [_best(rows, suite) for suite in SUITES]
        informed = _gain(named["full_information"]) if "full_information" in named else ""
        nominal = named["nominal"]
        written.append(f"| {env} | {nominal['episodes']} | {nominal['mean']:.5g} | {' | '.join(best)} | {informed} |")
    return "\n".join(written) + "\n"


def _best(rows: Sequence[Mapping[str, Any]], suite: str) -> str:
    mine = [row for row in rows if row["suite"] == suite and row["controller"] not in _BOUNDS]
    if not mine:
        return ""
    best = max(mine, key=lambda row: float(row["common"]["gain"]))
    return f"{best['controller']} {_gain(best['common'])}" if best["common"]["gain"] > 0 else "none above"


def _gain(common: Mapping[str, Any]) -> str:
    """The gain in the return of an episode over the nominal policy, and its interval."""
    low, high = common["interval"]
    return f"{common['gain']:+.4g} ({low:+.4g} to {high:+.4g})"


def _processes(table: Mapping[str, Any]) -> dict[str, str]:
    """Name of each process to its rows as Markdown."""
    head, *body = lines(table)
    rule = "| --- | --- |" + " ---: |" * (len(head) - 3)
    found = {}
    for env, rows in groupby(body, key=lambda row: row[0]):
        written = [f"| {' | '.join(row[1:])} |" for row in (head, *rows)]
        found[env] = "\n".join([written[0], rule, *written[1:]]) + "\n"
    return found
