"""Hooks of MkDocs.

The navigation is docs/SUMMARY.md, files of the repository that pages link to come along, and models are coloured.
"""

from __future__ import annotations

import json
import posixpath
import re
import shutil
from pathlib import Path
from typing import Any

from pygments import lexers, token
from pygments.lexer import RegexLexer

ROOT = Path(__file__).resolve().parent.parent
LINK = re.compile(r"\]\(((?:\.\./)+[^)\s#]+)\)")
ENTRY = re.compile(r"^(\s*)(?:- )?\[(.+)\]\((.+)\)\s*$")
GRAMMAR = ROOT / "docs/editors/vscode/syntaxes/smpl.tmLanguage.json"
# Scopes of the grammar by how they begin, and the token types of Pygments.
SCOPES = {
    "comment": token.Comment,
    "string": token.String,
    "keyword.operator": token.Operator,
    "keyword.control.statement": token.Keyword.Declaration,
    "keyword": token.Keyword,
    "constant.numeric": token.Number,
    "constant.language": token.Keyword.Constant,
    "support.function": token.Name.Builtin,
    "support.type": token.Keyword.Type,
    "entity.name.function": token.Name.Function,
}
wanted: set[str] = set()


def rules() -> list[tuple[str, Any]]:
    """Rules of Pygments from the TextMate grammar, which is a flat list of patterns."""
    out: list[tuple[str, Any]] = []
    for pattern in json.loads(GRAMMAR.read_text(encoding="utf-8"))["patterns"]:
        kinds = [kind for scope, kind in SCOPES.items() if pattern["name"].startswith(scope)]
        out.append((pattern["match"], kinds[0]))
    return [*out, (r"[A-Za-z_][A-Za-z0-9_]*", token.Name), (r"\s+", token.Whitespace), (r".", token.Text)]


class ModelLexer(RegexLexer):
    """Models, by the grammar that editors use."""

    name = "smpl"
    aliases = ["eq", "smpl"]  # noqa: RUF012
    flags = re.MULTILINE
    tokens = {"root": rules()}  # noqa: RUF012


FENCE = re.compile(r"^```(.*)\n((?:.*\n)*?)```$", re.MULTILINE)
STATEMENT = re.compile(next(pattern for pattern, kind in rules() if kind is token.Keyword.Declaration))


def labelled(fence: re.Match[str]) -> str:
    """A block without a language that begins with a statement is a model."""
    lines = [line for line in fence[2].splitlines() if line.strip() and not line.startswith("#")]
    is_model = not fence[1] and lines and STATEMENT.match(lines[0])
    return f"```eq\n{fence[2]}```" if is_model else fence[0]


def register_lexer() -> None:
    """Make the lexer known to Pygments under its names."""
    lexers.LEXERS["ModelLexer"] = (__name__, "smpl", ("eq", "smpl"), ("*.eq",), ())
    lexers._lexer_cache["smpl"] = ModelLexer


def navigation(summary: str) -> list[Any]:
    """Parts, chapters and their pages, as MkDocs expects them: `[{"Guide": [{"Tutorial": "tutorial.md"}]}]`."""
    out: list[Any] = []
    part: list[Any] = out
    for line in summary.splitlines():
        if line.startswith("# ") and line != "# Contents":
            part = []
            out.append({line[2:].strip(): part})
        elif entry := ENTRY.match(line):
            indent, title, path = entry.groups()
            if indent:
                last = part[-1]
                ((name, inside),) = last.items()
                pages = inside if isinstance(inside, list) else [inside]
                part[-1] = {name: [*pages, {title: path}]}
            else:
                part.append({title: path})
    return out


def on_config(config: Any) -> Any:
    """Read the navigation."""
    wanted.clear()
    register_lexer()
    config["nav"] = navigation((ROOT / "docs/SUMMARY.md").read_text(encoding="utf-8"))
    return config


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Point links out of docs/ to copies under `files/`, and name the language of models."""
    folder = posixpath.dirname(page.file.src_uri)

    def moved(match: re.Match[str]) -> str:
        path = posixpath.normpath(posixpath.join("docs", folder, match[1]))
        if path.startswith(("docs/", "..")) or not (ROOT / path).exists():
            return match[0]
        wanted.add(path)
        return f"]({posixpath.relpath(f'files/{path}', folder or '.')})"

    return FENCE.sub(labelled, LINK.sub(moved, markdown))


def on_post_build(config: Any, **_: Any) -> None:
    """Copy what pages link to."""
    for path in sorted(wanted):
        target = Path(config["site_dir"]) / "files" / path
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / path).is_dir():
            shutil.copytree(ROOT / path, target, dirs_exist_ok=True)
        else:
            shutil.copy(ROOT / path, target)
