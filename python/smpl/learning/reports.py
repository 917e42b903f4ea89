"""Reports of evaluations: a table for the terminal, JSON, Markdown and one HTML file."""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from smpl.learning.plan import Plan
from smpl.learning.scores import Score, compare
from smpl.support import style as look
from smpl.support.optional import install

# Heading, key, and how a value is written.
_COLUMNS = (
    ("per step", "mean", "std"),
    ("per episode", "episode_mean", "episode_std"),
    ("return", "return_mean", "return_interval"),
    ("interquartile", "return_iqm", "return_iqm_interval"),
    ("failures", "failures", None),
    ("successes", "successes", None),
    ("cost", "cost_mean", None),
    ("settled", "settled", None),
    ("settling", "settling_time", None),
    ("filter acts", "safety_filter", None),
    ("decision", "latency_ms", None),
)
_LEGEND = (
    "per step: mean ± population standard deviation over all steps of all episodes; per episode: over the episodes' "
    "mean rewards; return: mean of the sums with its 95 % bootstrap interval; interquartile: mean of the middle half "
    "of the returns with its interval; cost: mean over episodes of the summed violations; settled: episodes that end "
    "within 2 % of each state's range of the steady state; settling: median time until then; filter acts: share "
    "of actions that a safety filter changes; decision: median, of a batch the share of one environment."
)


# What a limit counts that is broken without a measure, as an event is: the line on failures says
# it.
_MARK = 1e-6


def content(plan: Plan, scores: Sequence[Score]) -> dict[str, Any]:
    """Content of `report.json`."""
    task = plan.task
    return {
        "about": {
            "env": task.name,
            "checksum": task.checksum,
            "reward": task.model.reward,
            "scenario": task.model._arguments.get("scenario"),
            "episodes": plan.episodes,
            "seed": plan.seed,
            "starts": plan.starts.kind,
            "time_unit": task.model.time_unit,
        },
        "controllers": {one.name: one.report() for one in scores},
        "comparisons": {one.name: compare(one, scores[0]) for one in scores[1:]},
    }


def table(report: Mapping[str, Any]) -> list[list[str]]:
    """Rows of texts, the first of them the heading; columns that say nothing are left out."""
    rows = [["controller", *(heading for heading, _, _ in _COLUMNS)]]
    rows += [[name, *_cells(values)] for name, values in report["controllers"].items()]
    keep = [i for i in range(len(rows[0])) if i == 0 or any(row[i] not in ("", "0") for row in rows[1:])]
    return [[row[i] for i in keep] for row in rows]


def text_table(rows: Sequence[Sequence[str]]) -> str:
    """Rows for a terminal, with minus signs that other programs read."""
    rows = [[look.plain(cell) for cell in row] for row in rows]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join([lines[0], "  ".join("-" * width for width in widths), *lines[1:]])


def write(folder: Path, plan: Plan, scores: Sequence[Score]) -> dict[str, Any]:
    """Writes `report.json`, `report.md`, `report.html` and the pictures; returns the first."""
    folder.mkdir(parents=True, exist_ok=True)
    report = content(plan, scores)
    _write(folder / "report.json", json.dumps(report, indent=1, allow_nan=False).encode() + b"\n")
    pictures, note = _pictures(plan, scores)
    for name, (_, data) in pictures.items():
        _write(folder / f"{name}.png", data)
    _write(folder / "report.md", markdown(report, pictures, note).encode())
    _write(folder / "report.html", page(report, pictures, note).encode())
    return report


def _write(path: Path, data: bytes) -> None:
    """Write a file, whole or not at all.

    Raises:
        OSError: the disk is full, or the like; the message names the file.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        temporary.write_bytes(data)
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path)) from error


def markdown(report: Mapping[str, Any], pictures: Mapping[str, tuple[str, bytes]], note: str) -> str:
    """The report as Markdown."""
    rows = [[_plain(cell).replace("|", "\\|") for cell in row] for row in table(report)]
    lines = [
        f"# {_plain(_title(report))}",
        "",
        _plain(_about(report)),
        "",
        _line(rows[0]),
        _line(["---"] * len(rows[0])),
    ]
    lines += [*map(_line, rows[1:]), "", _LEGEND, "", *map(_plain, _findings(report)), "", note]
    lines += [f"![{title}]({name}.png)\n" for name, (title, _) in pictures.items()]
    return "\n".join(lines).strip() + "\n"


def _plain(text: str) -> str:
    """Text as Markdown without links, images, HTML and code."""
    return re.sub(r"([\\`*_\[\]#$])", r"\\\1", text).replace("<", "&lt;")


def page(report: Mapping[str, Any], pictures: Mapping[str, tuple[str, bytes]], note: str) -> str:
    """The report as one HTML file that needs no other."""
    rows = table(report)
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in rows[0])
    body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows[1:])
    findings = "".join(f"<li>{html.escape(line[2:])}</li>" for line in _findings(report))
    figures = "".join(
        f"<figure><figcaption>{html.escape(title)}</figcaption>"
        f'<img alt="{html.escape(title)}" src="data:image/png;base64,{base64.b64encode(data).decode()}"></figure>'
        for title, data in pictures.values()
    )
    style = (
        f"body{{font:14px/1.5 {look.FONTS};color:{look.INK};max-width:72rem;margin:2rem auto;padding:0 1rem}}"
        "h1{font-size:1.3rem;margin:0 0 .3rem}.note{color:#696969;font-size:.9em}.wide{overflow-x:auto}"
        "table{border-collapse:collapse;font-variant-numeric:tabular-nums;font-size:.88em}"
        "th,td{padding:.3rem .55rem;border-bottom:1px solid #e4e4e4;text-align:right;white-space:nowrap}"
        "th{border-bottom:1px solid #8c8c8c}th:first-child,td:first-child{text-align:left;padding-left:0}"
        "figure{margin:1.8rem 0;max-width:60rem}figcaption{font-weight:bold;margin-bottom:.4rem}"
        "img{width:100%;height:auto}"
    )
    title = html.escape(_title(report))
    head_of_page = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{title}</title>'
    written = f"<table><tr>{head}</tr>{body}</table>"
    return (
        f'<!doctype html><html lang="en">{head_of_page}<style>{style}</style>'
        f'<h1>{title}</h1><p class="note">{html.escape(_about(report))}</p><div class="wide">{written}</div>'
        f'<p class="note">{html.escape(_LEGEND)}</p><ul>{findings}</ul><p>{html.escape(note, quote=False)}</p>'
        f"{figures}</html>\n"
    )


def _pictures(plan: Plan, scores: Sequence[Score]) -> tuple[dict[str, tuple[str, bytes]], str]:
    """Pictures by name with their titles; a note if pictures are missing."""
    try:
        from smpl.learning.pictures import pictures
    except ImportError:
        return {}, f"Pictures are left out: {install('matplotlib')}."
    return pictures(plan, scores), ""


def _title(report: Mapping[str, Any]) -> str:
    return f"Evaluation on {report['about']['env']}"


def _about(report: Mapping[str, Any]) -> str:
    about = report["about"]
    scenario = f", scenario {about['scenario']}" if about["scenario"] else ""
    last = about["seed"] + about["episodes"] - 1
    return (
        f"{about['episodes']} episodes each, the same for all, seeds {about['seed']} to {last}; starts: "
        f"{about['starts']}; reward {about['reward']}{scenario}; model {about['checksum'][:12]}."
    )


def _findings(report: Mapping[str, Any]) -> list[str]:
    """Failures by cause, violations, and how controllers do against the first."""
    lines = []
    for name, values in report["controllers"].items():
        for cause, count in values["failures_by_cause"].items():
            lines.append(f"- {name}: {count} of {len(values['returns'])} episodes fail by {cause}")
        for limit, excess in values["violations"].items():
            if excess > _MARK:
                lines.append(
                    f"- {name}: {limit} is exceeded by {look.number(excess)} of its range an episode, summed over steps"
                )
    for name, values in report["comparisons"].items():
        what, key = ("regret of", "regret") if "regret" in values else ("return differs by", "difference")
        ends = look.interval(*values["regret_interval" if key == "regret" else "interval"])
        lines.append(
            f"- {name} against {values['baseline']}, episode by episode: {what} {look.number(values[key])} "
            f"({ends}), better in {100 * values['better']:.0f} % of the episodes"
        )
    return lines


def _cells(values: Mapping[str, Any]) -> list[str]:
    cells = []
    for _, key, other in _COLUMNS:
        value, more = values.get(key), None if other is None else values[other]
        if value is None:
            cell = ""
        elif key == "safety_filter":
            cell = f"{100 * value['intervention_rate']:.0f} %"
        elif key == "latency_ms":
            cell = look.quantity(1e-3 * value, "s", 3)
        else:
            cell = look.number(value)
        if isinstance(more, list):
            cell += f" ({look.interval(*more)})"
        elif more is not None:
            cell += f" ± {look.number(more)}"
        cells.append(cell)
    return cells


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
