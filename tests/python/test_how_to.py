"""The how-to guides, the short tutorials, the pages for users of other tools,
of the library and on limits run as printed.

A section of a page, or a tutorial, is one task in a folder that holds `tank.eq` of the first page:

- A block with `title="NAME"` is the file NAME; a model must compile, unless its name begins with `faulty`.
- A block `eq` without a title is appended to `tank.eq`.
- Blocks `python` run one after another in one scope, blocks `sh` in a shell.
- A block `text` that follows one of them is its output: numbers agree to the digits printed, `...` matches anything.

A section that names an extra (``extra `sb3` ``) or a package (`pip install NAME`) is skipped where it is not installed.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import smpl

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    *sorted((ROOT / "docs/how-to").glob("*.md")),
    *sorted((ROOT / "docs/coming-from").glob("*.md")),
    *sorted((ROOT / "docs/tutorials").glob("*.md")),
    ROOT / "docs/library.md",
    ROOT / "docs/limits.md",
]
BLOCK = re.compile(r"^```(\w+)(?: title=\"([^\"]+)\")?\n(.*?)^```$", re.S | re.M)
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
MODULES = {
    "scipy": ["scipy"],
    "data": ["pyarrow"],
    "report": ["matplotlib"],
    "minari": ["minari", "h5py"],
    "d3rlpy": ["d3rlpy", "pyarrow"],
    "sb3": ["stable_baselines3"],
    "mpc": ["casadi"],
    "casadi": ["casadi"],
    "do-mpc": ["do_mpc", "casadi"],
    "fmu": ["fmpy"],
    "jax": ["jax"],
    "pandas": ["pandas"],
    "pcgym": ["pcgym"],
    "optimize": ["cma", "scipy"],
}


def sections(page: Path) -> list[tuple[str, str]]:
    """Titles and texts of the sections of a page that have code."""
    text = page.read_text(encoding="utf-8")
    if page.parent.name == "tutorials":
        return [("all", text)]
    parts = re.split(r"^## (.+)$", text, flags=re.M)
    named = [("introduction", parts[0]), *zip(parts[1::2], parts[2::2], strict=True)]
    return [(title, body) for title, body in named if BLOCK.search(body)]


TASKS = [
    pytest.param(body, id=f"{page.relative_to(ROOT / 'docs').with_suffix('')}: {title}")
    for page in PAGES
    for title, body in sections(page)
]


def anchor(heading: str) -> str:
    """The link to a heading, as GitHub and MkDocs make it."""
    return re.sub(r"\s+", "-", re.sub(r"[^\w\s-]", "", heading.lower()).strip())


def missing(body: str) -> str:
    """The first package that a section names and that is not installed, or an empty text."""
    names = re.findall(r"extra `([\w-]+)`", body) + re.findall(r"`pip install ([\w-]+)`", body)
    modules = [module for name in names for module in MODULES[name]]
    return next((module for module in modules if importlib.util.find_spec(module) is None), "")


def agrees(shown: str, found: str) -> bool:
    """Compares texts; numbers agree within two units of the last digit that the page shows, blanks do not count."""
    pattern, numbers, at = "", [], 0
    for number in NUMBER.finditer(shown):
        pattern += _blank(shown[at : number.start()]) + f"({NUMBER.pattern})"
        numbers.append(number[0])
        at = number.end()
    match = re.fullmatch(pattern + _blank(shown[at:]), found.strip(), re.S)
    return match is not None and all(map(_close, numbers, match.groups()))


def _blank(text: str) -> str:
    pieces = [r"\s*".join(map(re.escape, piece.split())) for piece in text.split("...")]
    joined = ".*?".join(pieces)
    return (r"\s*" if text[:1].isspace() else "") + joined + (r"\s*" if text[-1:].isspace() else "")


def _close(shown: str, found: str) -> bool:
    mantissa, _, power = shown.lower().partition("e")
    digits = len(mantissa.partition(".")[2])
    return (
        abs(float(shown) - float(found)) <= 2 * 10.0 ** (int(power or 0) - digits) if "." in shown else shown == found
    )


def python(code: str, scope: dict[str, object]) -> str:
    """Standard output of a block of Python."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        exec(compile(code, "<block>", "exec"), scope)
    return out.getvalue()


def shell(code: str, may_fail: bool) -> str:
    """Standard output and errors of a block of shell commands, `smpl` and `python` those of this interpreter."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "PATH": path, "NO_COLOR": "1"},
    )
    assert may_fail or done.returncode == 0, done.stdout
    return done.stdout


@pytest.mark.parametrize("body", TASKS)
def test_task_runs_as_printed(body: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if module := missing(body):
        pytest.skip(f"{module} is not installed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    index = (ROOT / "docs/how-to/README.md").read_text(encoding="utf-8")
    Path("tank.eq").write_text(next(text for _, title, text in BLOCK.findall(index) if title == "tank.eq"))
    scope: dict[str, object] = {"__name__": "how_to"}
    output = ""
    for kind, title, text in BLOCK.findall(body):
        if title:
            Path(title).write_text(text)
        if kind == "eq":
            if not title:
                with Path("tank.eq").open("a") as file:
                    file.write(text)
            if not title.startswith("faulty"):
                with warnings.catch_warnings():
                    warnings.simplefilter("error", smpl.CompileWarning)
                    smpl.compile(title or "tank.eq")
        elif kind == "python" and not title:
            output = python(text, scope)
        elif kind == "sh":
            output = shell(text, may_fail='title="faulty' in body)
        elif kind == "text":
            assert agrees(text, output), f"the page shows\n{text}\nand this is\n{output}"


def test_the_index_lists_every_task() -> None:
    index = (ROOT / "docs/how-to/README.md").read_text(encoding="utf-8")
    listed = re.findall(r"^- \[(.+)\]\((.+)\)$", index, re.M)
    pages = [page for page in PAGES if page.parent.name == "how-to" and page.name != "README.md"]
    headings = {
        (heading, f"{page.name}#{anchor(heading)}")
        for page in pages
        for heading in re.findall(r"^## (.+)$", page.read_text(encoding="utf-8"), re.M)
    }
    assert set(listed) == headings
