"""What a controller is, as text: two that may choose different actions have different descriptions.

A description maps places in the object (`.gains['f']`) to what stands there. Numbers, texts and containers stand as
they are, arrays and long texts by their digests, code of one's own by its instructions, constants, globals and modules
that it reads, installed code by its name and version. Nothing depends on addresses, on the order of sets or on the
process.
"""

from __future__ import annotations

import gc
import hashlib
import inspect
import re
import types
from collections.abc import Callable, Iterator, Mapping
from copyreg import dispatch_table
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from smpl._code import installed, members_stored, reads, signed, version
from smpl.envs import Env, Interface
from smpl.model import Model

# Places that a description lists one by one; of more there is one digest.
_MOST = 200
# Texts that are longer stand as their digest.
_LONG = 80
# What a class has that its body does not say.
_UNSAID = (
    "__dict__", "__weakref__", "__module__", "__doc__", "__qualname__", "__firstlineno__", "__slotnames__", "_abc_impl",
    "__static_attributes__",
)  # fmt: skip
# Attribute with the arguments of a controller that follows from them, whatever it has built since.
MADE_FROM = "_made_from"
# Attribute of a controller that was reset; it changes nothing that the controller does.
BEGUN = "_begun"
Description = dict[str, str]
Parts = list[tuple[str, Any]]


def describe(thing: Any) -> Description:
    """Where what stands in an object; see the module."""
    places: Description = {}
    for place, text in _Walk().through(thing):
        while place in places:
            place += "'"
        places[place] = text
    if len(places) <= _MOST:
        return places
    return {"": places[""], f"all {len(places)} places": _digest(repr(list(places.items())).encode())}


def differences(there: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    """What differs between two descriptions, place by place."""
    places = dict.fromkeys([*there, *here])
    return [
        f"{place.strip() or 'controller'}: {there.get(place, 'nothing')} there, {here.get(place, 'nothing')} here"
        for place in places
        if there.get(place) != here.get(place)
    ]


class MadeFrom:
    """Arguments of a controller, which are described when that is asked for; of a pickled one the description."""

    def __init__(self, given: Mapping[str, Any], said: Description | None = None) -> None:
        # What an environment does meanwhile does not matter: a controller meets it when it acts.
        self._given = {name: one.model if isinstance(one, Interface) else one for name, one in given.items()}
        self._said = said

    def description(self) -> Description:
        """Where what stands in the arguments."""
        return self._said if self._said is not None else describe(types.SimpleNamespace(**self._given))

    def __reduce__(self) -> tuple[Any, ...]:
        return MadeFrom, ({}, self.description())


class _Said(str):
    """What was said before of a place."""

    __slots__ = ()


class _Walk:
    """One walk through an object; what it meets again is described by the place where it was first."""

    def __init__(self, around: Mapping[int, tuple[str, Any]] | None = None) -> None:
        self._seen: dict[int, tuple[str, Any]] = {key: ("around", one) for key, (_, one) in (around or {}).items()}

    def through(self, whole: Any) -> Iterator[tuple[str, str]]:
        """Places with what stands there."""
        waiting: Parts = [("", whole)]
        while waiting:
            place, thing = waiting.pop()
            plain = _plain(thing)
            if plain is not None:
                yield place, plain
            elif id(thing) in self._seen:
                yield place, f"as {self._seen[id(thing)][0] or 'the whole'}"
            else:
                if not _flat(thing):
                    # The object is kept too, so that no other one has its address meanwhile.
                    self._seen[id(thing)] = place, thing
                title, parts = self._opened(thing)
                yield place, title
                waiting.extend((place + name, part) for name, part in reversed(parts))

    def _text(self, thing: Any) -> str:
        """One text of all that stands in a key, or an element of a set."""
        plain = _plain(thing)
        if plain is not None:
            return plain
        return "; ".join(f"{place}: {text}" for place, text in _Walk(self._seen).through(thing))

    def _opened(self, thing: Any) -> tuple[str, Parts]:
        """What an object with parts is called, and its parts by their names."""
        kind = type(thing)
        if kind in (dict, types.MappingProxyType):
            items = [(self._text(key), value) for key, value in thing.items()]
            ordered = sorted(items, key=lambda item: item[0])
            keys = [key for key, _ in items]
            order = "" if keys == sorted(keys) else f" in the order {_digest(repr(keys).encode())}"
            return f"{kind.__qualname__}{order}", [(f"[{key}]", value) for key, value in ordered]
        if kind in (list, tuple):
            return f"{kind.__qualname__} of {len(thing)}", [(f"[{i}]", one) for i, one in enumerate(thing)]
        if isinstance(thing, (set, frozenset)):
            elements = [(f"[{i}]", _Said(one)) for i, one in enumerate(sorted(map(self._text, thing)))]
            return kind.__qualname__, [*_own(kind), *elements]
        if kind is np.ndarray and thing.dtype != object:
            return _array(thing), []
        if isinstance(thing, type):
            return _class(thing)
        for what, opened in _KINDS.items():
            if isinstance(thing, what):
                return opened(thing)
        return _object(thing)


def _plain(thing: Any) -> str | None:
    """Text of what has no parts; none of what has some."""
    if type(thing) is _Said:
        return str(thing)
    if isinstance(thing, np.inexact) and type(thing) not in (np.float64, np.complex128):
        return f"{thing.dtype} {thing.item()!r}"
    if isinstance(thing, np.generic) and not isinstance(thing, np.void):
        thing = thing.item()
    kind = type(thing)
    if thing is None or thing is Ellipsis or kind in (bool, int, float, complex):
        return repr(thing)
    if kind in (str, bytes, bytearray):
        text = repr(thing)
        return text if len(text) <= _LONG else f"{text[:20]}... {_digest(text.encode())}"
    if isinstance(thing, np.dtype):
        return repr(thing)
    if isinstance(thing, types.ModuleType):
        return f"module {thing.__name__}{version(thing.__name__)}"
    return None


def _flat(thing: Any) -> bool:
    """Whether it is an array or a small container of plain things, of which two equal ones say the same as one."""
    if type(thing) in (list, tuple):
        return len(thing) <= 16 and all(_plain(one) is not None for one in thing)
    return type(thing) is np.ndarray and thing.dtype != object


def _array(thing: np.ndarray[Any, Any]) -> str:
    if thing.size <= 4:
        return f"{thing.dtype} {thing.tolist()}"
    return f"{thing.dtype} {thing.shape} {_digest(np.ascontiguousarray(thing).tobytes())}"


def _own(kind: type) -> Parts:
    """The class of an object, where it is one's own."""
    return [] if installed(kind) else [(".__class__", kind)]


def _class(thing: type) -> tuple[str, Parts]:
    """A class: an installed one is its name, one's own is what its body says."""
    if installed(thing):
        return f"class {thing.__module__}.{thing.__qualname__}{version(thing.__module__)}", []
    said = {
        name: one
        for name, one in vars(thing).items()
        if name not in _UNSAID and not isinstance(one, (types.GetSetDescriptorType, types.MemberDescriptorType))
    }
    bases = [(f"({base.__name__})", base) for base in thing.__bases__ if base is not object]
    meta = [] if installed(type(thing)) else [(" metaclass", type(thing))]
    return f"class {thing.__qualname__}", [*meta, *bases, *_named(said)]


def _function(thing: types.FunctionType) -> tuple[str, Parts]:
    """A function: an installed one is its name, one's own its code and what that reads."""
    parts: Parts = [(f" {name}", one) for name, one in _enclosed(thing)]
    if installed(thing):
        module = str(thing.__globals__.get("__name__"))
        wrapped = [(" wrapped", thing.__wrapped__)] if hasattr(thing, "__wrapped__") else []
        return f"function {module}.{thing.__qualname__}{version(module)}", [*parts, *wrapped]
    own = ("__defaults__", "__kwdefaults__", "__dict__")
    parts += [(f".{name}", getattr(thing, name)) for name in own if getattr(thing, name)]
    parts += [(f" {name}", one) for name, one in reads(thing)]
    return f"function {signed(thing.__code__)}", parts


def _enclosed(thing: types.FunctionType) -> Iterator[tuple[str, Any]]:
    """Variables of a function that it has from the one around it."""
    for name, cell in zip(thing.__code__.co_freevars, thing.__closure__ or (), strict=True):
        try:
            yield name, cell.cell_contents
        except ValueError:  # not assigned yet
            yield name, None


def _method(thing: Any) -> tuple[str, Parts]:
    owner = thing.__self__
    if isinstance(thing, types.MethodType):
        return f"method {thing.__name__}", [(".__self__", owner), (".__func__", thing.__func__)]
    inner: Parts = [] if owner is None or isinstance(owner, types.ModuleType) else [(".__self__", owner)]
    return f"function {thing.__module__}.{thing.__qualname__}{version(thing.__module__ or '')}", inner


def _property(thing: property) -> tuple[str, Parts]:
    return "property", [(".fget", thing.fget), (".fset", thing.fset), (".fdel", thing.fdel)]


def _wrapped(thing: Any) -> tuple[str, Parts]:
    return type(thing).__name__, [(".__func__", thing.__func__)]


def _generator(thing: types.GeneratorType[Any, Any, Any]) -> tuple[str, Parts]:
    inside = {} if thing.gi_frame is None else dict(thing.gi_frame.f_locals)
    return f"generator {signed(thing.gi_code)}", _named(inside)


def _model(thing: Model) -> tuple[str, Parts]:
    kept = {key: value for key, value in thing._arguments.items() if key not in ("path", "scenario")}
    texts = [Path(file).read_bytes() for file in thing.native.sources if Path(file).is_file()]
    return f"model {thing.name}", [*_named(kept), (" text", _digest(b"".join(texts)))]


def _interface(thing: Interface) -> tuple[str, Parts]:
    """An environment: its model, its arguments and the parameters of its episode."""
    parameters = [(".parameters", thing._native.values("parameter"))] if isinstance(thing, Env) else []
    return type(thing).__qualname__, [
        (".model", thing.model), (".options", getattr(thing, "_options", None)), *parameters,
    ]  # fmt: skip


def _ufunc(thing: np.ufunc) -> tuple[str, Parts]:
    """A function of NumPy, or one of one's own by `np.frompyfunc`, which is found among what it refers to."""
    own = [one for one in gc.get_referents(thing) if isinstance(one, types.FunctionType)]
    return f"ufunc {thing.__name__}", [(f"[{i}]", one) for i, one in enumerate(own)]


def _space(thing: gymnasium.Space[Any]) -> tuple[str, Parts]:
    """A space without its random numbers, which nobody seeds."""
    return type(thing).__qualname__, _named({name: one for name, one in vars(thing).items() if name != "_np_random"})


_KINDS: dict[Any, Callable[[Any], tuple[str, Parts]]] = {
    types.FunctionType: _function,
    (types.MethodType, types.BuiltinFunctionType): _method,
    property: _property,
    (staticmethod, classmethod): _wrapped,
    types.GeneratorType: _generator,
    types.CodeType: lambda thing: (f"code {signed(thing)}", []),
    np.random.Generator: lambda thing: (f"random numbers {_digest(repr(thing.bit_generator.state).encode())}", []),
    np.ufunc: _ufunc,
    memoryview: lambda thing: (f"memoryview {_digest(thing.tobytes())}", []),
    Model: _model,
    Interface: _interface,
    gymnasium.Space: _space,
}


def _object(thing: Any) -> tuple[str, Parts]:
    """Any other object: its class and what it holds."""
    kind = type(thing)
    head, title = _own(kind), kind.__qualname__
    if not head and not kind.__module__.startswith("smpl."):
        title = f"{kind.__module__}.{title}{version(kind.__module__)}"
        learned = _learned(thing)
        if learned is not None:
            return title, [(" learned", learned)]
    made = getattr(thing, "__dict__", {}).get(MADE_FROM)
    if made is not None:
        arguments = [(place, _Said(text)) for place, text in made.description().items() if place]
        return title, [*head, *arguments, *_named(_set_since(thing))]
    return title, [*head, *_held(thing)]


def _set_since(thing: Any) -> dict[str, Any]:
    """Attributes of a controller of ours that tell more than its arguments: those that its own code does not set.

    And plain ones that only its making sets, so that somebody may have set them since.
    """
    at_making, later = members_stored(type(thing))
    return {
        name: one
        for name, one in vars(thing).items()
        if name not in (MADE_FROM, BEGUN) and name not in later and (name not in at_making or _plain(one) is not None)
    }


def _learned(thing: Any) -> Any:
    """What a tensor, or a policy of an installed package, has learned; none of anything else."""
    if callable(getattr(thing, "detach", None)) and callable(getattr(thing, "numpy", None)):
        return _tried(lambda: thing.detach().cpu().numpy())
    if callable(getattr(thing, "save_to_buffer", None)):  # TorchScript
        return _tried(thing.save_to_buffer)
    for name in ("get_parameters", "get_weights"):
        if callable(getattr(thing, name, None)):
            return _tried(partial(_of_policy, thing, name))
    modules = getattr(getattr(thing, "impl", None), "modules", None)
    if modules is None:
        return None
    return _tried(lambda: ([_network(one) for one in vars(modules).values()], getattr(thing, "config", None)))


def _of_policy(thing: Any, name: str) -> Any:
    """What a policy of an installed package acts by; of how it learns nothing."""
    given = getattr(thing, name)()
    kept = {key: one for key, one in given.items() if "optimizer" not in key} if isinstance(given, dict) else given
    return _network(getattr(thing, "policy", None)), kept


def _network(thing: Any) -> Any:
    """What a network of an installed package computes by: its layers, classes of one's own among them, and weights."""
    if not callable(getattr(thing, "modules", None)):
        return None
    classes = sorted(
        {type(one) for one in thing.modules() if not installed(type(one))}, key=lambda one: one.__qualname__
    )
    return _printed(thing), classes, thing.state_dict()


def _tried(give: Callable[[], Any]) -> Any:
    try:
        return give()
    except Exception:
        return None


def _held(thing: Any) -> Parts:
    """What an object would be pickled from; of one that cannot be its attributes, or what it prints."""
    kind = type(thing)
    reduced = _tried(lambda: dispatch_table[kind](thing) if kind in dispatch_table else thing.__reduce_ex__(4))
    if isinstance(reduced, tuple):
        made, given, state, items, pairs = (*reduced, None, None, None)[:5]
        parts: Parts = [(f"({i})", one) for i, one in enumerate(given) if one is not kind]
        if getattr(made, "__name__", "") not in ("__newobj__", "__newobj_ex__", "_reconstructor"):
            parts.append(("()", made))
        parts += _state(kind, state)
        parts += [("[...]", list(items))] if items is not None else []
        parts += [("{...}", dict(pairs))] if pairs is not None else []
        return parts
    # An expression of CasADi has its text only.
    inside = [] if kind.__module__.startswith("casadi") else _state(kind, getattr(thing, "__dict__", None))
    name = [(" name", reduced)] if isinstance(reduced, str) else []
    return [*name, *inside] if name or inside else [(" text", _printed(thing))]


def _printed(thing: Any) -> str:
    """What an object prints, without addresses."""
    return re.sub(r" at 0x[0-9a-fA-F]+", "", str(_tried(lambda: repr(thing))))


def _state(kind: type, state: Any) -> Parts:
    """Attributes one by one, those of slots too; what is computed from them once and kept is none."""
    if isinstance(state, tuple) and len(state) == 2 and all(one is None or isinstance(one, dict) for one in state):
        return [*_state(kind, state[0]), *_state(kind, state[1])]
    if isinstance(state, dict) and all(isinstance(name, str) for name in state):
        kept = {name for name in state if isinstance(inspect.getattr_static(kind, name, None), cached_property)}
        return _named({name: one for name, one in state.items() if name not in kept and name != BEGUN})
    return [] if state is None else [(".", state)]


def _named(parts: Mapping[str, Any]) -> Parts:
    return [(f".{name}", parts[name]) for name in sorted(parts)]


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]
