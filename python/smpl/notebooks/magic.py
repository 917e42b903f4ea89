"""Notebook cells that hold a model: `%load_ext smpl`, then `%%smpl NAME`."""

from __future__ import annotations

import html
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from smpl import _native
from smpl._native import CompileError, Diagnostic
from smpl.model import compile
from smpl.support.drawing import model_as_html

# The file of findings in a text without one.
_CELL = "<source>"
_COLOURS = {"error": "#c0392b", "warning": "#b7791f"}


def cell(line: str, text: str, shell: Any) -> None:
    """Checks the model of a cell, binds it to a name, and shows it or its diagnostics.

    Raises:
        ValueError: the line is not a name.
    """
    from IPython.display import HTML, Math, display

    name = line.strip()
    if not name.isidentifier():
        raise ValueError(f"%%smpl is followed by {name!r}, expected the name of a variable: `%%smpl tank`")
    try:
        model = compile(source=text)
    except CompileError as error:
        display(HTML(diagnostics_as_html(error.diagnostics, text)))
        return
    shell.user_ns[name] = model
    if model.warnings:
        display(HTML(diagnostics_as_html(model.warnings, text)))
    for equation in equations(text):
        display(Math(equation))
    display(HTML(model_as_html(model)))


def equations(text: str) -> list[str]:
    """The equations of a text in LaTeX, one display each; none where the text alone has faults."""
    with tempfile.TemporaryDirectory() as folder:
        model, out = Path(folder) / "cell.eq", Path(folder) / "cell.tex"
        model.write_text(text, encoding="utf-8")
        if _native.main(["smpl", "compile", str(model), "--emit", "latex", "-o", str(out)]) != 0:
            return []
        return out.read_text(encoding="utf-8").splitlines()


def diagnostics_as_html(diagnostics: Sequence[Diagnostic], text: str) -> str:
    """Findings with the lines of the text that they are about, the place underlined."""
    parts = "".join(_one(finding, text.splitlines()) for finding in diagnostics)
    return f"<div style='font-family:monospace'>{parts}</div>"


def _one(finding: Diagnostic, lines: Sequence[str]) -> str:
    colour = _COLOURS.get(finding.severity, "#2c6fbb")
    heading = f"<b style='color:{colour}'>{html.escape(finding.severity)}</b> {html.escape(finding.message)}"
    heading += f" <span style='opacity:.7'>[{html.escape(finding.code)}]</span>"
    source = _excerpt(finding, lines, colour)
    told = [f"help: {finding.help}"] if finding.help else []
    notes = "".join(f"<div>{html.escape(note)}</div>" for note in (*finding.notes, *told))
    return f"<div style='margin:.5em 0'><div>{heading}</div>{source}{notes}</div>"


def _excerpt(finding: Diagnostic, lines: Sequence[str], colour: str) -> str:
    if finding.file != _CELL:
        return f"<div>{html.escape(finding.file)}, line {finding.line}</div>"
    if not 1 <= finding.line <= len(lines):
        return ""
    line, start = lines[finding.line - 1], finding.column - 1
    end = finding.end_column - 1 if finding.end_line == finding.line else len(line)
    end = max(end, start + 1)
    before, marked, after = line[:start], line[start:end] or " ", line[end:]
    shown = html.escape(before)
    shown += f"<span style='text-decoration:underline wavy {colour}'>{html.escape(marked)}</span>{html.escape(after)}"
    return f"<pre style='margin:.2em 0'>{finding.line:>4} │ {shown}</pre>"


def load(shell: Any) -> None:
    """Give a shell the cell magic `%%smpl`."""
    shell.register_magic_function(lambda line, text: cell(line, text, shell), "cell", "smpl")
