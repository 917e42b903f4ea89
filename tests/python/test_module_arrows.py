"""Modules of the Rust crates and of the Python package depend on one another in one direction.

Exceptions are modules of Rust that treat something recursive. A module of Rust may name what the modules around it
define, as its own methods of their types do. In Python imports within functions count, those for types alone do not.
"""

import ast
import re
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

# Files that call each other as what they treat does.
RECURSIVE = {
    # A unit may be one of an expression, and a number of an expression has a unit.
    "dsl": {frozenset({"parse::expression", "parse::unit"})},
    # An index may be computed from parameters, whose values occur in loops over ranges of such indices.
    "compiler": {frozenset(f"elaborate::lower::{name}" for name in ("binders", "defaults", "nests", "structural"))},
}

TOKEN = re.compile(
    r"""(?P<skip>//[^\n]*|/\*.*?\*/|b?r(?P<h>\#*)".*?"(?P=h)|b?"(?:\\.|[^"\\])*"|b?'(?:\\[^u]|\\u\{\w+\}|[^'\\])')"""
    r"|(?P<word>[A-Za-z_]\w*!?|::|[{}();,*#\[\]=<>&.]|\S)",
    re.VERBOSE | re.DOTALL,
)


@dataclass
class Module:
    """A file: what it imports, what it gives on under another path, and the paths that it names."""

    path: tuple[str, ...]
    imports: dict[str, tuple[str, ...]] = field(default_factory=dict)
    globs: list[tuple[str, ...]] = field(default_factory=list)
    named: set[tuple[str, ...]] = field(default_factory=set)
    defined: set[str] = field(default_factory=set)


def tokens(text):
    """Words and signs, without comments, texts and tests."""
    words = [match["word"] for match in TOKEN.finditer(text) if match["word"]]
    out, at = [], 0
    while at < len(words):
        if words[at : at + 7] == ["#", "[", "cfg", "(", "test", ")", "]"]:
            at = behind_item(words, at + 7)
        else:
            out.append(words[at])
            at += 1
    return out


def behind_item(words, at):
    depth = 0
    while at < len(words):
        depth += (words[at] in "{([") - (words[at] in "})]")
        if depth == 0 and words[at] in ";}":
            return at + 1
        at += 1
    return at


def tree(words, at, prefix=()):
    """The paths of a `use`, as (name, path), and the place behind it."""
    path, found = prefix, []
    while True:
        word = words[at]
        if word == "{":
            at += 1
            while words[at] != "}":
                inner, at = tree(words, at, path)
                found += inner
                at += words[at] == ","
            return found, at + 1
        if word in (",", ";", "}"):
            return [*found, (path[-1], path)], at
        if word == "as":
            return [(words[at + 1], path)], at + 2
        if word == "*":
            return [("*", path)], at + 1
        if word not in ("::", "self") or (word == "self" and not path):
            path = (*path, word)
        at += 1


def read(file, path):
    """A module from its text; modules written inside it count as the file itself."""
    module, words, at = Module(path), tokens(file.read_text()), 0
    while at < len(words):
        word = words[at]
        if word == "use" and words[at - 1] not in (".", "::", "+"):
            found, at = tree(words, at + 1)
            for name, target in found:
                if name == "*":
                    module.globs.append(target)
                else:
                    module.imports[name] = target
        elif at + 1 < len(words) and words[at + 1] == "::" and words[at - 1] != "::" and re.match(r"[A-Za-z_]", word):
            named = [word]
            while words[at + 1] == "::" and re.match(r"[A-Za-z_]", words[at + 2]):
                named.append(words[at + 2])
                at += 2
            module.named.add(tuple(named))
            at += 1
        else:
            if word in ("fn", "struct", "enum", "trait", "type", "const", "static", "macro_rules!", "union"):
                module.defined.add(words[at + 1])
            at += 1
    return module


def modules_of(source):
    """All modules of a crate by their path from its root."""
    modules = {}
    for file in sorted(source.rglob("*.rs")):
        parts = file.relative_to(source).with_suffix("").parts
        if parts[-1] == "tests" or "bin" in parts[:1]:
            continue
        if parts[-1] in ("lib", "main", "mod"):
            parts = parts[:-1]
        modules[parts] = read(file, parts)
    return modules


def resolved(modules, home, path, seen=frozenset()):
    """The module that holds what a path in `home` names; None outside of the crate, and for modules themselves."""
    if (home, path) in seen:
        return None
    seen = seen | {(home, path)}
    head, at, rest = path[0], home, path
    if head == "crate":
        at, rest = (), path[1:]
    elif head == "self":
        rest = path[1:]
    elif head == "super":
        while rest and rest[0] == "super":
            at, rest = at[:-1], rest[1:]
    elif (*home, head) not in modules and head in modules[home].imports:
        return resolved(modules, home, (*modules[home].imports[head], *path[1:]), seen)
    elif (*home, head) not in modules and head not in modules[home].defined:
        return None
    while rest and (*at, rest[0]) in modules:
        at, rest = (*at, rest[0]), rest[1:]
    if not rest or at not in modules:
        return None
    target = modules[at]
    if rest[0] in target.defined:
        return at
    if rest[0] in target.imports:
        return resolved(modules, at, (*target.imports[rest[0]], *rest[1:]), seen)
    for glob in target.globs:
        found = resolved(modules, at, (*glob, rest[0]), seen)
        if found is not None and rest[0] in modules[found].defined:
            return found
    return at


def arrows(modules):
    """For each module those whose items it names."""
    out = {}
    for home, module in modules.items():
        paths = [*module.imports.values(), *module.named]
        found = {resolved(modules, home, path) for path in paths}
        out[home] = {target for target in found if target is not None and home[: len(target)] != target}
    return out


def cycles(graph):
    """Strongly connected parts of more than one module (Tarjan, SIAM J. Comput. 1 (1972) 146)."""
    number, low, stack, found = {}, {}, [], []

    def visit(node):
        number[node] = low[node] = len(number)
        stack.append(node)
        for target in graph[node]:
            if target not in number:
                visit(target)
                low[node] = min(low[node], low[target])
            elif target in stack:
                low[node] = min(low[node], number[target])
        if low[node] == number[node]:
            part = {stack.pop()}
            while node not in part:
                part.add(stack.pop())
            if len(part) > 1:
                found.append(part)

    for node in graph:
        if node not in number:
            visit(node)
    return found


@pytest.mark.parametrize("crate", ["dsl", "compiler", "compiler/analysis", "runtime", "runtime/tools", "python"])
def test_modules_depend_on_one_another_in_one_direction(crate):
    modules = modules_of(ROOT / crate / "src")
    graph = arrows(modules)
    assert sum(map(len, graph.values())) > len(modules), "the arrows are not seen"
    found = {frozenset("::".join(module) for module in part) for part in cycles(graph)}
    assert found == RECURSIVE.get(crate, set())


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        (
            {"lib.rs": "mod a; mod b;", "a.rs": "use crate::b::g; fn f() { g() }", "b.rs": "fn g() { super::a::f() }"},
            [{"a", "b"}],
        ),
        (
            {
                "lib.rs": "mod a; mod b;",
                "a.rs": "use super::b; fn f() { b::g() }",
                "b.rs": "use std::a::f; fn g() {}",
            },
            [],
        ),
        (
            {
                "lib.rs": "mod a; mod b;",
                "a.rs": "fn f() { crate::b::g() } struct T;",
                "b.rs": "use crate::a::{T as U}; fn g() {}",
            },
            [{"a", "b"}],
        ),
        (
            {
                "lib.rs": "mod a; mod b; pub use b::g;",
                "a.rs": "use crate::g; fn f() {}",
                "b.rs": "use crate::a::f; pub fn g() {}",
            },
            [{"a", "b"}],
        ),
        (
            {
                "lib.rs": "mod a; mod b;",
                "a.rs": "fn f() { /* crate::b::g() */ }",
                "b.rs": 'use crate::a::f; fn g() { h("crate::b::g") }',
            },
            [],
        ),
        ({"lib.rs": "mod a; use a::f; struct T;", "a.rs": "use super::T; fn f() {}"}, []),
    ],
)
def test_cycles_are_seen_through_imports_paths_and_names_that_are_given_on(tmp_path, files, expected):
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    found = [{"::".join(module) for module in part} for part in cycles(arrows(modules_of(tmp_path)))]
    assert found == expected


# Imports within functions, other than of packages that need not be installed: module -> what needs the package.
LATE = {
    "smpl": {"smpl.notebooks.magic"},  # IPython
    "smpl.analysis.fitting": {"smpl.analysis.fit_pictures"},  # Matplotlib
    "smpl.analysis.records": {"smpl.datasets"},  # pyarrow
    "smpl.learning.policy_files": {"smpl.deploy", "smpl.deploy.artefact"},  # onnxruntime, fmpy, a C compiler
    "smpl.learning.reports": {"smpl.learning.pictures"},  # Matplotlib
    "smpl.optimize.episodes": {"smpl.optimize.pictures"},  # Matplotlib
    "smpl.optimize.steady": {"smpl.optimize.pictures"},  # Matplotlib
}


def python_modules(folder, package):
    """Files of a package by the names of its modules; the compiled one has no file."""
    found = {f"{package}._native": None} if package == "smpl" else {}
    for file in sorted((folder / package).rglob("*.py")):
        parts = file.relative_to(folder).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return found


def imports(tree, within=False):
    """Paths that a module imports, each with whether it does so within a function."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        if isinstance(node, ast.ImportFrom) and node.level == 0:
            yield from ((f"{node.module}.{alias.name}", within) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from ((alias.name, within) for alias in node.names)
        else:
            function = isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda))
            yield from imports(node, within or function)


def python_arrows(modules):
    """For each module those that it imports, and those that it imports within functions only."""
    graph, late = {name: set() for name in modules}, {}
    for name, file in modules.items():
        places = {}
        for path, within in imports(ast.parse(file.read_text(encoding="utf-8"))) if file is not None else ():
            while path and path not in modules:
                path = path.rpartition(".")[0]
            # An import runs the modules of the packages around it too, but for those around the importer.
            while path and not f"{name}.".startswith(f"{path}."):
                places[path] = places.get(path, True) and within
                path = path.rpartition(".")[0]
        graph[name] = set(places)
        if any(places.values()):
            late[name] = {path for path, within in places.items() if within}
    return graph, late


def test_modules_of_the_package_depend_on_one_another_in_one_direction():
    graph, late = python_arrows(python_modules(ROOT / "python", "smpl"))
    assert sum(map(len, graph.values())) > len(graph), "the arrows are not seen"
    assert cycles(graph) == []
    assert late == LATE


PACKAGE = python_modules(ROOT / "python", "smpl")


@pytest.mark.parametrize("module", [name for name in PACKAGE if name.count(".") == 1 and "__" not in name])
def test_every_module_and_room_can_be_imported_first(module):
    for optional in ("jax", "torch", "stable_baselines3"):
        if module == f"smpl.{optional}" or (module, optional) == ("smpl.sb3", "stable_baselines3"):
            pytest.importorskip(optional)
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", f"import {module}"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_cycles_of_python_are_seen_through_functions_and_not_through_types(tmp_path):
    texts = {
        "__init__": "from own.a import f",
        "a": "def f():\n    from own.b import g\n    return g",
        "b": "from typing import TYPE_CHECKING\nimport own.c\nif TYPE_CHECKING:\n    from own.d import T",
        "c": "from own import a",
        "d": "import own.b",
    }
    (tmp_path / "own").mkdir()
    for name, text in texts.items():
        (tmp_path / "own" / f"{name}.py").write_text(text)
    graph, late = python_arrows(python_modules(tmp_path, "own"))
    assert cycles(graph) == [{"own.a", "own.b", "own.c"}]
    assert late == {"own.a": {"own.b"}}
