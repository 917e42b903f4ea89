"""What a controller is, as text: two that may choose different actions have different descriptions.

A description maps places in the object (`.gains['f']`) to what stands there. Numbers, texts and containers stand as
they are, arrays and long texts by their digests, code of one's own by its instructions, constants and the globals that
it reads, installed code by its name. Nothing depends on addresses, on the order of sets or on the process.
"""

from __future__ import annotations

import hashlib
import inspect
import re
import sys
import sysconfig
import types
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from smpl.envs import Interface
from smpl.model import Model

# Places that a description lists one by one; of more there is one digest.
_MOST = 200
# How deep objects may hold objects; what lies deeper is described by its type.
_DEEPEST = 60
# Texts that are longer stand as their digest.
_LONG = 80
# What a class has that its body does not say.
_UNSAID = (
    "__dict__", "__weakref__", "__module__", "__doc__", "__qualname__", "__firstlineno__", "__slotnames__", "_abc_impl",
    "__static_attributes__",
)  # fmt: skip
# Attribute with the description of its arguments, of a controller that follows from them whatever it has built since.
MADE_FROM = "_made_from"
Description = dict[str, str]


def describe(thing: Any) -> Description:
    """Where what stands in an object; see the module."""
    places = dict(_Walk().at(thing, "", 0))
    if len(places) <= _MOST:
        return places
    return {"": places.get("", ""), f"all {len(places)} places": _digest(repr(sorted(places.items())).encode())}


def differences(there: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    """What differs between two descriptions, place by place."""
    places = dict.fromkeys([*there, *here])
    return [
        f"{place.strip() or 'controller'}: {there.get(place, 'nothing')} there, {here.get(place, 'nothing')} here"
        for place in places
        if there.get(place) != here.get(place)
    ]


class _Walk:
    """One walk through an object; what it meets again is described by the place where it was first."""

    def __init__(self) -> None:
        self._seen: dict[int, tuple[str, Any]] = {}

    def at(self, thing: Any, place: str, depth: int) -> Iterator[tuple[str, str]]:
        """Places below `place` with what stands there."""
        plain = _plain(thing)
        if plain is not None:
            yield place, plain
            return
        if id(thing) in self._seen:
            yield place, f"as {self._seen[id(thing)][0] or 'the whole'}"
            return
        # The object is kept too, so that no other one has its address meanwhile.
        self._seen[id(thing)] = place, thing
        if depth > _DEEPEST:
            yield place, f"{type(thing).__qualname__}, deeper than {_DEEPEST} objects"
            return
        title, parts = _opened(thing)
        yield place, title
        for name, part in parts:
            yield from self.at(part, place + name, depth + 1)


Parts = list[tuple[str, Any]]


def _plain(thing: Any) -> str | None:
    """Text of what has no parts; none of what has some."""
    if isinstance(thing, _Said):
        return str(thing)
    if isinstance(thing, np.generic) and not isinstance(thing, np.void):
        thing = thing.item()
    if isinstance(thing, bool) or thing is None or thing is Ellipsis:
        return repr(thing)
    if isinstance(thing, (int, float, complex)) and type(thing) in (int, float, complex):
        # A whole number says the same as a float.
        return repr(float(thing)) if isinstance(thing, int) and abs(thing) < 2**53 else repr(thing)
    if isinstance(thing, (str, bytes, bytearray)):
        text = repr(thing)
        return text if len(text) <= _LONG else f"{text[:20]}... {_digest(text.encode())}"
    if isinstance(thing, np.dtype):
        return repr(thing)
    if isinstance(thing, types.ModuleType):
        return f"module {thing.__name__}"
    return None


def _opened(thing: Any) -> tuple[str, Parts]:
    """What an object with parts is called, and its parts by their names."""
    if type(thing) in (dict, types.MappingProxyType):
        items = sorted(((_plain(key) or _all(key), value) for key, value in thing.items()), key=lambda item: item[0])
        return type(thing).__qualname__, [(f"[{key}]", value) for key, value in items]
    if isinstance(thing, (list, tuple)) and type(thing) in (list, tuple):
        return f"{type(thing).__qualname__} of {len(thing)}", [(f"[{i}]", one) for i, one in enumerate(thing)]
    if isinstance(thing, (set, frozenset)):
        return type(thing).__qualname__, [(f"[{i}]", one) for i, one in enumerate(sorted(map(_all, thing)))]
    if isinstance(thing, np.ndarray) and thing.dtype != object:
        return _array(thing), []
    if isinstance(thing, type):
        return _class(thing)
    if isinstance(thing, (types.FunctionType, types.MethodType, types.BuiltinFunctionType, np.ufunc, property)):
        return _function(thing)
    if isinstance(thing, np.random.Generator):
        return f"random numbers {_digest(repr(thing.bit_generator.state).encode())}", []
    if isinstance(thing, types.CodeType):
        return f"code {_code(thing)}", []
    if isinstance(thing, Model):
        kept = {key: value for key, value in thing._arguments.items() if key not in ("path", "scenario")}
        texts = [Path(file).read_bytes() for file in thing.native.sources if Path(file).is_file()]
        return f"model {thing.name}", [*_named(kept), (" text", _digest(b"".join(texts)))]
    if isinstance(thing, Interface):
        return type(thing).__qualname__, [(".model", thing.model), (".options", getattr(thing, "_options", None))]
    return _object(thing)


def _all(thing: Any) -> str:
    """One text of all that stands in an object."""
    return "; ".join(f"{place}: {text}" for place, text in _Walk().at(thing, "", 0))


def _array(thing: np.ndarray[Any, Any]) -> str:
    if thing.size <= 4:
        return f"{thing.dtype} {thing.tolist()}"
    content = np.ascontiguousarray(thing)
    return f"{thing.dtype} {thing.shape} {_digest(content.tobytes())}"


def _class(thing: type) -> tuple[str, Parts]:
    """A class: an installed one is its name, one's own is what its body says."""
    if _installed(thing):
        return f"class {thing.__module__}.{thing.__qualname__}", []
    said = {
        name: getattr(one, "__func__", one)
        for name, one in vars(thing).items()
        if name not in _UNSAID and not isinstance(one, (types.GetSetDescriptorType, types.MemberDescriptorType))
    }
    bases = [(f"({base.__name__})", base) for base in thing.__bases__ if base is not object]
    return f"class {thing.__qualname__}", [*bases, *((f".{name}", said[name]) for name in sorted(said))]


def _function(thing: Any) -> tuple[str, Parts]:
    """A function: an installed one is its name, one's own its code and what that reads."""
    if isinstance(thing, property):
        return "property", [(".fget", thing.fget), (".fset", thing.fset)]
    if isinstance(thing, np.ufunc):
        return f"numpy.{thing.__name__}", []
    if isinstance(thing, (types.MethodType, types.BuiltinFunctionType)):
        owner = getattr(thing, "__self__", None)
        inner = [] if owner is None or isinstance(owner, types.ModuleType) else [(".__self__", owner)]
        if isinstance(thing, types.MethodType):
            return f"method {thing.__name__}", [*inner, (".__func__", thing.__func__)]
        return f"function {thing.__module__}.{thing.__qualname__}", inner
    if _installed(thing):
        return f"function {thing.__module__}.{thing.__qualname__}", [*_enclosed(thing)]
    parts: Parts = [*_enclosed(thing)]
    own = ("__defaults__", "__kwdefaults__", "__dict__")
    parts += [(f".{name}", getattr(thing, name)) for name in own if getattr(thing, name)]
    parts += _globals(thing)
    return f"function {_code(thing.__code__, thing.__doc__)}", parts


def _enclosed(thing: types.FunctionType) -> Iterator[tuple[str, Any]]:
    """Variables of a function that it has from the one around it."""
    for name, cell in zip(thing.__code__.co_freevars, thing.__closure__ or (), strict=True):
        try:
            yield f" {name}", cell.cell_contents
        except ValueError:  # not assigned yet
            yield f" {name}", None


def _globals(thing: types.FunctionType) -> Iterator[tuple[str, Any]]:
    """What a function may read of its module, and of modules of one's own that are imported there."""
    names = sorted(_names(thing.__code__))
    for name in names:
        if name not in thing.__globals__:
            continue
        found = thing.__globals__[name]
        yield f" {name}", found
        if isinstance(found, types.ModuleType) and not _installed_module(found.__name__):
            yield from ((f" {name}.{one}", vars(found)[one]) for one in names if one in vars(found))


def _names(code: types.CodeType) -> set[str]:
    """Names that code and the functions in it may take from the module."""
    inner = [_names(one) for one in code.co_consts if isinstance(one, types.CodeType)]
    return set(code.co_names).union(*inner)


def _code(code: types.CodeType, said: str | None = None) -> str:
    """Digest of instructions, constants and names; not of places in a file, nor of what it says of itself."""
    parts = [code.co_code.hex(), repr((code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars))]
    for one in code.co_consts:
        if isinstance(one, str) and one == said:
            one = None  # as without
        parts.append(_code(one) if isinstance(one, types.CodeType) else _all(one))
    return _digest("\n".join(parts).encode())


def _object(thing: Any) -> tuple[str, Parts]:
    """Any other object: its class and what it holds."""
    kind = type(thing)
    head: Parts = [] if _installed(kind) else [(".__class__", kind)]
    title = kind.__qualname__
    if _installed(kind) and not kind.__module__.startswith("smpl."):
        learned = _learned(thing)
        if learned is not None:
            return f"{kind.__module__}.{title}", [(" learned", learned)]
    made = getattr(thing, MADE_FROM, None)
    if made is not None:
        return title, [*head, *((place, _Said(text)) for place, text in made.items() if place)]
    return title, [*head, *_held(thing)]


class _Said(str):
    """What was said before of a place."""

    __slots__ = ()


def _learned(thing: Any) -> Any:
    """What a policy or network of an installed package has learned; none of anything else."""
    if callable(getattr(thing, "detach", None)) and callable(getattr(thing, "numpy", None)):
        return _tried(lambda: thing.detach().cpu().numpy())
    if callable(getattr(thing, "state_dict", None)):
        return _tried(lambda: (_built(getattr(thing, "code", thing)), dict(thing.state_dict())))
    for give in (getattr(thing, name, None) for name in ("get_parameters", "get_weights")):
        if callable(give):
            return _tried(partial(_policy, thing, give))
    modules = getattr(getattr(thing, "impl", None), "modules", None)
    return None if modules is None else _tried(lambda: (vars(modules), getattr(thing, "config", None)))


def _policy(thing: Any, give: Callable[[], Any]) -> Any:
    return _built(getattr(thing, "policy", "")), give()


def _built(network: Any) -> str:
    """What a network says of its layers, without addresses."""
    return re.sub(r" at 0x[0-9a-f]+", "", str(network))


def _tried(give: Callable[[], Any]) -> Any:
    try:
        return give()
    except Exception:
        return None


def _held(thing: Any) -> Parts:
    """What an object would be pickled from; of one that cannot be its attributes."""
    try:
        reduced = thing.__reduce_ex__(4)
    except Exception:
        reduced = None
    if isinstance(reduced, tuple):
        made, given, state, items, pairs = (*reduced, None, None, None)[:5]
        parts: Parts = [(f"({i})", one) for i, one in enumerate(given) if one is not type(thing)]
        if getattr(made, "__name__", "") not in ("__newobj__", "__newobj_ex__", "_reconstructor"):
            parts.append(("()", made))
        parts += _state(state)
        parts += [("[...]", list(items))] if items is not None else []
        parts += [("[...]", dict(pairs))] if pairs is not None else []
        return parts
    return _state(getattr(thing, "__dict__", None))


def _state(state: Any) -> Parts:
    """Attributes one by one, those of slots too."""
    if isinstance(state, tuple) and len(state) == 2 and all(one is None or isinstance(one, dict) for one in state):
        return [*_state(state[0]), *_state(state[1])]
    if isinstance(state, dict) and all(isinstance(name, str) for name in state):
        return _named(state)
    return [] if state is None else [(".", state)]


def _named(parts: Mapping[str, Any]) -> Parts:
    return [(f".{name}", parts[name]) for name in sorted(parts)]


def _installed(thing: Any) -> bool:
    """Whether a class or function is of an installed module; what was made by `exec` may say it is of `builtins`."""
    if thing.__module__ == "builtins":
        return not isinstance(thing, types.FunctionType) and "__module__" not in vars(thing)
    return _installed_module(thing.__module__)


@lru_cache(maxsize=512)
def _installed_module(module: str | None) -> bool:
    """Whether a module belongs to Python, to smpl or to an installed package: its version tells what it does."""
    top = (module or "").partition(".")[0]
    if top == "smpl" or top in sys.stdlib_module_names - {"__main__"}:
        return True
    try:
        file = inspect.getfile(sys.modules[top])
    except (KeyError, TypeError):
        return top in sys.builtin_module_names
    places = {sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")}
    return any(Path(file).is_relative_to(place) for place in places) or "site-packages" in file


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]
