"""What code reads, and whose it is."""

from __future__ import annotations

import dis
import hashlib
import importlib
import importlib.util
import inspect
import sys
import sysconfig
import types
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

_HERE = Path(__file__).parent
# Of classes that are made while Python runs (`Py_TPFLAGS_HEAPTYPE`).
_HEAP_TYPE = 1 << 9


@dataclass(frozen=True)
class _Said:
    """What the instructions of code, and of functions in it, name.

    Attributes:
        globals, attributes: names that are read.
        imports: what is imported inside of functions: name, level of a relative import, names out of it.
        constants: positions of the code's own constants that are read.
    """

    globals: frozenset[str]
    attributes: frozenset[str]
    imports: frozenset[tuple[str, int, tuple[str, ...]]]
    constants: frozenset[int]


@lru_cache(maxsize=4096)
def _said(code: types.CodeType) -> _Said:
    names: set[str] = set()
    attributes: set[str] = set()
    imports: set[tuple[str, int, tuple[str, ...]]] = set()
    constants: set[int] = set()
    before: list[Any] = [None, None]
    for one in dis.get_instructions(code):
        if one.opcode in dis.hasconst:
            constants.add(one.arg or 0)
        if one.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
            names.add(one.argval)
        elif one.opname in ("LOAD_ATTR", "LOAD_METHOD"):
            attributes.add(one.argval)
        elif one.opname == "IMPORT_NAME":
            level, listed = before
            imports.add((one.argval, level if isinstance(level, int) else 0, tuple(listed or ())))
        before = [before[1], one.argval]
    for part in (one for one in code.co_consts if isinstance(one, types.CodeType)):
        inner = _said(part)
        names |= inner.globals
        attributes |= inner.attributes
        imports |= inner.imports
    return _Said(frozenset(names), frozenset(attributes), frozenset(imports), frozenset(constants))


def signed(code: types.CodeType) -> str:
    """Digest of instructions, constants and names; not of places in a file, nor of what it says of itself."""
    return hashlib.sha256(_content(code).encode()).hexdigest()[:16]


def _content(code: types.CodeType) -> str:
    names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
    parts = [code.co_code.hex(), getattr(code, "co_exceptiontable", b"").hex(), repr(names)]
    used = _said(code).constants
    for i, one in enumerate(code.co_consts):
        if isinstance(one, types.CodeType):
            parts.append(_content(one))
        else:
            # The first constant that no instruction reads is the text of what a function says of itself.
            parts.append(_constant(one) if i or i in used else "")
    return "\n".join(parts)


def _constant(one: Any) -> str:
    if isinstance(one, frozenset):
        return f"{{{', '.join(sorted(map(_constant, one)))}}}"
    if isinstance(one, tuple):
        return f"({', '.join(map(_constant, one))})"
    return repr(one)


def reads(function: types.FunctionType) -> Iterator[tuple[str, Any]]:
    """What a function may read of its module, and of modules of one's own that are imported there or in itself."""
    said = _said(function.__code__)
    for name in sorted(said.globals & function.__globals__.keys()):
        found = function.__globals__[name]
        yield name, found
        if isinstance(found, types.ModuleType):
            yield from _of_module(name, found, said.attributes, set())
    package = function.__globals__.get("__package__") or None
    for name, level, listed in sorted(said.imports):
        module = _imported("." * level + name, package)
        if module is not None:
            yield from _of_module(f"import {'.' * level}{name}", module, said.attributes | set(listed), set())


def _of_module(name: str, module: types.ModuleType, read: frozenset[str], met: set[str]) -> Iterator[tuple[str, Any]]:
    """What is read of a module of one's own, and of those in it."""
    if module.__name__ in met or _is_installed(module.__name__):
        return
    met.add(module.__name__)
    for one in sorted(read & vars(module).keys()):
        found = vars(module)[one]
        yield f"{name}.{one}", found
        if isinstance(found, types.ModuleType):
            yield from _of_module(f"{name}.{one}", found, read, met)


def _imported(name: str, package: str | None) -> types.ModuleType | None:
    """A module of one's own that a function imports when it runs; none where it is installed, or not there."""
    try:
        whole = importlib.util.resolve_name(name, package)
        if _is_installed(whole.partition(".")[0]):
            return None
        return importlib.import_module(whole)
    except (ImportError, ValueError):
        return None


def members_stored(kind: type) -> tuple[frozenset[str], frozenset[str]]:
    """Attributes that code of smpl sets in objects of a class: those of `__init__` alone, those of other methods."""
    at_making: set[str] = set()
    later: set[str] = set()
    for base in kind.__mro__:
        if base.__module__.partition(".")[0] != "smpl":
            continue
        for name, one in vars(base).items():
            own: Any = one.fget if isinstance(one, property) else getattr(one, "__func__", one)
            inner = inspect.unwrap(own)
            if isinstance(inner, types.FunctionType):
                (at_making if name == "__init__" else later).update(_stored(inner.__code__))
    return frozenset(at_making - later), frozenset(later)


def _stored(code: types.CodeType) -> Iterator[str]:
    yield from (one.argval for one in dis.get_instructions(code) if one.opname == "STORE_ATTR")
    for part in code.co_consts:
        if isinstance(part, types.CodeType):
            yield from _stored(part)


def installed(thing: type | types.FunctionType) -> bool:
    """Whether a class or function belongs to Python, to smpl or to an installed package."""
    if isinstance(thing, types.FunctionType):
        return _is_place(thing.__code__.co_filename)
    if thing.__module__ == "builtins":
        # Or made by `exec` in a namespace without a name.
        return not (thing.__flags__ & _HEAP_TYPE and isinstance(vars(thing).get("__module__"), str))
    return _is_installed(thing.__module__)


def version(module: str) -> str:
    """Version of the installed package that a module belongs to, as a suffix; nothing where it says none."""
    top = module.partition(".")[0]
    said = getattr(sys.modules.get(top), "__version__", None)
    return f" {said}" if isinstance(said, str) and top != "smpl" and _is_installed(top) else ""


@lru_cache(maxsize=1024)
def _is_installed(module: str) -> bool:
    if module == "__main__" or module == "__mp_main__":
        return False
    found = sys.modules.get(module)
    if found is None:
        try:
            spec = importlib.util.find_spec(module)
        except (ImportError, ValueError, AttributeError):
            return False
        file, built_in = getattr(spec, "origin", None), spec is not None and spec.origin in ("built-in", "frozen")
    else:
        file = getattr(found, "__file__", None)
        built_in = file is None and not hasattr(found, "__path__")
    if built_in:
        return module in sys.builtin_module_names or module.partition(".")[0] in sys.stdlib_module_names
    return file is not None and _is_place(file)


@lru_cache(maxsize=1024)
def _is_place(file: str) -> bool:
    """Whether a file lies among those of Python, of smpl or of installed packages."""
    if file.startswith("<frozen"):
        return True
    found = (sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib"))
    path, places = Path(file), [_HERE, *(Path(place) for place in found if place)]
    return any(path.is_relative_to(place) for place in places) or "site-packages" in path.parts
