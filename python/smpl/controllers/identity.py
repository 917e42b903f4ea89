"""Identity of a controller, so that a collection is continued with the same one only.

Compared are the class and the constructor arguments of an object, the qualified name and `version`
of a function, and the digest of a policy file (`smpl.learning.agents.described`). Code is not
compared: raise `version` when it changes.
"""

from __future__ import annotations

import contextlib
import dataclasses
import enum
import functools
import hashlib
import inspect
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from smpl.envs import Interface
from smpl.model import Model
from smpl.support.options import expanded

Description = dict[str, str]
# Attribute with the constructor arguments of an object.
MADE_FROM = "_made_from"
# Entries that are listed one by one; more of them, and longer texts, are replaced by a digest.
_MOST, _LONG = 200, 80
_WAYS = (
    "derive the class from smpl.controllers.Recorded, make it a dataclass, or give "
    "smpl.learning.Agent(name, controller, version=...)"
)


class AnonymousError(ValueError):
    """An object that two processes cannot compare."""


class Recorded:
    """Base of classes whose objects are compared by their class and constructor arguments.

    Example:
        >>> class Law(Recorded):
        ...     def __init__(self, gain):
        ...         self._gain = gain
        >>> list(identity(Law(2.0)).values())[1:]
        ['2.0']
    """

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "__init__" in vars(cls):
            setattr(cls, "__init__", _recording(vars(cls)["__init__"]))  # noqa: B010 - mypy forbids the assignment


class Arguments:
    """Constructor arguments, described on demand; of a pickled object the description."""

    def __init__(self, given: Mapping[str, Any], known: Description | None = None) -> None:
        # The episode of an environment does not matter: a controller meets it when it acts.
        self._given = {name: one.model if isinstance(one, Interface) else one for name, one in given.items()}
        self._known = known

    def entries(self) -> Description:
        """Arguments by name.

        Raises:
            AnonymousError: an argument has no identity.
        """
        if self._known is not None:
            return self._known
        return dict(entry for name, one in self._given.items() for entry in _entries(f".{name}", one))

    def __reduce__(self) -> tuple[Any, ...]:
        try:
            return Arguments, ({}, self.entries())
        except AnonymousError as error:
            return _Lost, (str(error),)


class _Lost(Arguments):
    """Arguments without an identity, of an object that came from another process."""

    def __init__(self, reason: str) -> None:
        super().__init__({})
        self._reason = reason

    def entries(self) -> Description:
        raise AnonymousError(self._reason)

    def __reduce__(self) -> tuple[Any, ...]:
        return _Lost, (self._reason,)


def identity(thing: Any) -> Description:
    """Entries from places (`.gain`, `.weights['T']`) to text: class and arguments of an object.

    Raises:
        AnonymousError: a lambda, a closure, or an object whose constructor arguments are unknown;
            the message names the alternatives.
    """
    try:
        found = dict(_entries("", thing))
    except RecursionError as error:
        raise AnonymousError(f"{name_of(thing)} has arguments that are nested too deeply: {_WAYS}") from error
    if len(found) <= _MOST:
        return found
    return {"": found[""], f"all {len(found)} entries": _digest(repr(list(found.items())).encode())}


def differences(there: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    """Entries that differ between two identities."""
    return [
        f"{place.lstrip('.') or 'controller'}: {there.get(place, 'nothing')} there, {here.get(place, 'nothing')} here"
        for place in dict.fromkeys([*there, *here])
        if there.get(place) != here.get(place)
    ]


def name_of(thing: Any) -> str:
    """Qualified name of a class or function, or of the class of an object."""
    named = thing if isinstance(thing, type) or hasattr(thing, "__qualname__") else type(thing)
    return f"{named.__module__}.{named.__qualname__}"


def _recording(method: Callable[..., Any]) -> Callable[..., Any]:
    """An `__init__` that keeps its arguments."""
    signature = inspect.signature(method)

    @functools.wraps(method)
    def recording(self: Any, *given: Any, **named: Any) -> Any:
        if not hasattr(self, MADE_FROM):  # the outermost class has the arguments of the caller
            with contextlib.suppress(TypeError):  # the call itself reports wrong arguments
                positional, keywords = expanded(method, given, named)
                bound = signature.bind(self, *positional, **keywords)
                bound.apply_defaults()
                object.__setattr__(self, MADE_FROM, Arguments(dict(list(bound.arguments.items())[1:])))
        return method(self, *given, **named)

    return recording


def _entries(place: str, thing: Any) -> Iterator[tuple[str, str]]:
    """Entries of a value and of its parts."""
    plain = _plain(thing)
    if plain is not None:
        yield place, plain
    elif isinstance(thing, Mapping):
        yield place, f"{type(thing).__name__} of {len(thing)}"
        for key, one in sorted(thing.items(), key=lambda item: repr(item[0])):
            yield from _entries(f"{place}[{key!r}]", one)
    elif isinstance(thing, (list, tuple, set, frozenset)):
        parts = thing if isinstance(thing, (list, tuple)) else sorted(thing, key=repr)
        yield place, f"{type(thing).__name__} of {len(thing)}"
        for i, one in enumerate(parts):
            yield from _entries(f"{place}[{i}]", one)
    elif isinstance(thing, functools.partial):
        yield from _entries(place, thing.func)
        yield from _entries(f"{place}.args", thing.args)
        yield from _entries(f"{place}.keywords", thing.keywords)
    elif isinstance(thing, types.MethodType):
        yield from _entries(place, thing.__self__)
        yield f"{place}.method", thing.__name__
    elif isinstance(thing, (types.FunctionType, types.BuiltinFunctionType, np.ufunc, type)):
        yield place, _named(place, thing)
    else:
        yield from _object(place, thing)


def _plain(thing: Any) -> str | None:
    """Text of a value without parts; None for another."""
    if isinstance(thing, enum.Enum):
        return str(thing)
    if isinstance(thing, np.inexact) and type(thing) not in (np.float64, np.complex128):
        return f"{thing.dtype} {thing.item()!r}"
    if isinstance(thing, np.generic) and not isinstance(thing, np.void):
        thing = thing.item()
    if thing is None or thing is Ellipsis or isinstance(thing, (bool, int, float, complex, range, slice, np.dtype)):
        return repr(thing)
    if isinstance(thing, (str, bytes, PurePath)):
        text = repr(thing)
        return text if len(text) <= _LONG else f"{text[:20]}... {_digest(text.encode())}"
    if type(thing) is np.ndarray and thing.dtype != object:
        short = thing.size <= 4
        text = str(thing.tolist()) if short else f"{thing.shape} {_digest(np.ascontiguousarray(thing).tobytes())}"
        return f"{thing.dtype} {text}"
    return None


def _named(place: str, thing: Any, version: str | None = None) -> str:
    """Name of a function or class.

    Raises:
        AnonymousError: another process cannot find it by its name.
    """
    kind = "class" if isinstance(thing, type) else "function"
    if isinstance(thing, np.ufunc):
        return f"function numpy.{thing.__name__}"
    version = _version(thing) if version is None else version
    if "<" in thing.__qualname__ and version is None:
        raise AnonymousError(
            f"{place.lstrip('.') or 'the controller'} is the anonymous {kind} {thing.__qualname__}: define it at the "
            f"top of a module, or {_WAYS}"
        )
    return f"{kind} {name_of(thing)}" + ("" if version is None else f" version {version}")


def _object(place: str, thing: Any) -> Iterator[tuple[str, str]]:
    """Entries of an object: its class, and the arguments that it was made with."""
    made: Iterable[tuple[str, str]]
    if isinstance(thing, Interface):
        thing = thing.model
    if isinstance(thing, Model):
        kept = {key: one for key, one in thing._arguments.items() if key not in ("path", "scenario")}
        texts = [Path(file).read_bytes() for file in thing.native.sources if Path(file).is_file()]
        yield place, f"model {thing.name} {_digest(b''.join([thing.text.encode(), *texts]))}"
        yield from _entries(f"{place}.arguments", kept)
        return
    version, arguments = _version(thing), vars(thing).get(MADE_FROM) if hasattr(thing, "__dict__") else None
    if isinstance(arguments, Arguments):
        made = ((f"{place}{name}", text) for name, text in arguments.entries().items())
    elif dataclasses.is_dataclass(thing):
        names = [one.name for one in dataclasses.fields(thing) if one.init]
        made = (entry for name in names for entry in _entries(f"{place}.{name}", getattr(thing, name)))
    elif hasattr(thing, "_saved_kwargs"):  # of gymnasium.utils.RecordConstructorArgs
        saved = thing._saved_kwargs
        made = (entry for name in sorted(saved) for entry in _entries(f"{place}.{name}", saved[name]))
    elif version is not None or type(thing).__init__ is object.__init__:
        made = ()
    else:
        raise AnonymousError(
            f"the constructor arguments of {place.lstrip('.') or type(thing).__name__} ({name_of(thing)}) are unknown: "
            f"{_WAYS}"
        )
    yield place, _named(place, type(thing), version)
    yield from made


def _version(thing: Any) -> str | None:
    """Attribute `version` of a user's function, class or object."""
    version = getattr(thing, "version", None)
    return str(version) if isinstance(version, (str, int)) else None


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]
