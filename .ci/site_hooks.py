"""Hooks of MkDocs: the navigation is docs/SUMMARY.md, and files of the repository that pages link to come along."""

from __future__ import annotations

import posixpath
import re
import shutil
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
LINK = re.compile(r"\]\(((?:\.\./)+[^)\s#]+)\)")
ENTRY = re.compile(r"^(\s*)(?:- )?\[(.+)\]\((.+)\)\s*$")
wanted: set[str] = set()


def navigation(summary: str) -> list[Any]:
    """Parts, chapters and their pages, as MkDocs wants them: `[{"Guide": [{"Tutorial": "tutorial.md"}]}]`."""
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
    config["nav"] = navigation((ROOT / "docs/SUMMARY.md").read_text(encoding="utf-8"))
    return config


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Point links out of docs/ to copies under `files/`."""
    folder = posixpath.dirname(page.file.src_uri)

    def moved(match: re.Match[str]) -> str:
        path = posixpath.normpath(posixpath.join("docs", folder, match[1]))
        if path.startswith(("docs/", "..")) or not (ROOT / path).exists():
            return match[0]
        wanted.add(path)
        return f"]({posixpath.relpath(f'files/{path}', folder or '.')})"

    return LINK.sub(moved, markdown)


def on_post_build(config: Any, **_: Any) -> None:
    """Copy what pages link to."""
    for path in sorted(wanted):
        target = Path(config["site_dir"]) / "files" / path
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / path).is_dir():
            shutil.copytree(ROOT / path, target, dirs_exist_ok=True)
        else:
            shutil.copy(ROOT / path, target)
