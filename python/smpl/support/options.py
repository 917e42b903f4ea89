"""Option objects: the optional arguments of a constructor or function as one frozen dataclass.

`takes` lets a function that reads an option object be called with such objects, with each option as
a keyword argument, or with both. The fields of the dataclass are the only list of the options,
their types and their defaults.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any, ParamSpec, TypeVar

from smpl.support.arguments import shorten
from smpl.support.hints import of_argument

P = ParamSpec("P")
T = TypeVar("T")
# Attribute of a function with the class of its options.
KIND = "_options"


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class Options:
    """Base of option objects: frozen keyword dataclasses in which each field has a default.

    `dataclasses.replace(options, NAME=VALUE)` returns a changed copy.
    """

    def changed(self) -> dict[str, Any]:
        """Options that differ from their defaults, by name."""
        values = ((one, getattr(self, one.name)) for one in dataclasses.fields(self))
        return {one.name: value for one, value in values if not _same(value, one.default)}

    def __repr__(self) -> str:
        texts = (f"{name}={shorten(value)}" for name, value in self.changed().items())
        return f"{type(self).__name__}({', '.join(texts)})"


def takes(kind: type[Options], *positional: str) -> Callable[[Callable[..., T]], Callable[..., T]]:
    """Decorates a function whose last parameter `options` is an option object.

    Callers pass option objects, options as keyword arguments, or both. Option objects are of `kind`
    or of a base of it, which holds some of its fields. An option that is given twice is refused.

    Args:
        kind: class of the options.
        positional: options that may also follow the other arguments by position.

    Example:
        >>> @dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
        ... class GreetOptions(Options):
        ...     greeting: str = "hello"
        ...     mark: str = "."
        >>> @takes(GreetOptions, "greeting")
        ... def greet(name, options):
        ...     return f"{options.greeting} {name}{options.mark}"
        >>> greet("Ann", "bye"), greet("Ann", GreetOptions(mark="!")), greet("Ann", mark="?")
        ('bye Ann.', 'hello Ann!', 'hello Ann?')
    """

    def decorate(method: Callable[..., T]) -> Callable[..., T]:
        flat, who = _flat(method, kind, positional), method.__qualname__.removesuffix(".__init__")
        names = [one.name for one in dataclasses.fields(kind)]

        @functools.wraps(method)
        def calling(*given: Any, **named: Any) -> T:
            given, named = expanded(calling, given, named)
            check_keywords(who, flat, named)
            try:
                bound = flat.bind(*given, **named)
            except TypeError as error:
                raise TypeError(f"{who}: {error}") from None
            chosen = {name: bound.arguments.pop(name) for name in names if name in bound.arguments}
            return method(*bound.args, **bound.kwargs, options=kind(**chosen))

        vars(calling).update({"__signature__": flat, KIND: kind})
        return calling

    return decorate


def expanded(
    method: Callable[..., Any], given: tuple[Any, ...], named: Mapping[str, Any]
) -> tuple[tuple[Any, ...], dict[str, Any]]:
    """Arguments of a call with the changed fields of its option objects as keyword arguments.

    Raises:
        TypeError: an option object of another function, or an option that is given twice.
    """
    kind, keywords = getattr(method, KIND, None), dict(named)
    if kind is None:
        return given, keywords
    objects = [one for one in given if isinstance(one, Options)]
    if isinstance(keywords.get("options"), Options):
        objects.append(keywords.pop("options"))
    for one in objects:
        if not issubclass(kind, type(one)):
            raise TypeError(f"options are {type(one).__name__}, expected {kind.__name__}")
        for name, value in one.changed().items():
            if name in keywords:
                raise TypeError(f"the option {name!r} is given twice; change a copy by dataclasses.replace")
            keywords[name] = value
    return tuple(one for one in given if not isinstance(one, Options)), keywords


def listed(method: Callable[P, T]) -> Callable[P, T]:
    """Decorates a function so that an unknown keyword argument is answered by the valid ones."""
    signature = inspect.signature(method)
    who = method.__qualname__.removesuffix(".__init__").rpartition(".")[2]

    @functools.wraps(method)
    def calling(*given: P.args, **named: P.kwargs) -> T:
        if named:
            check_keywords(who, signature, named)
        return method(*given, **named)

    return calling


def check_keywords(who: str, signature: inspect.Signature, named: Mapping[str, Any]) -> None:
    """Refuse keyword arguments that a function does not have.

    Args:
        who: name of the function in the message.
        signature: its signature.
        named: keyword arguments of the call.

    Raises:
        TypeError: lists the valid names, with the most similar one.
    """
    known = signature.parameters.values()
    if any(one.kind is one.VAR_KEYWORD for one in known):
        return
    names = [one.name for one in known if one.kind is not one.VAR_POSITIONAL and one.name != "self"]
    for name in named:
        if name not in names:
            hint = of_argument(who, name, names)
            raise TypeError(f"{who} has no argument {name!r}{hint and f'; {hint}'}; there are: {', '.join(names)}")


def _flat(method: Callable[..., Any], kind: type[Options], positional: tuple[str, ...]) -> inspect.Signature:
    """Signature of a function with its options instead of the parameter `options`."""
    own = inspect.signature(method)
    others = [one for one in own.parameters.values() if one.name != "options"]
    ends = [one for one in others if one.kind is one.VAR_KEYWORD]
    fields = {one.name: one for one in dataclasses.fields(kind)}
    made = [
        inspect.Parameter(
            name,
            inspect.Parameter.POSITIONAL_OR_KEYWORD if name in positional else inspect.Parameter.KEYWORD_ONLY,
            default=fields[name].default,
            annotation=fields[name].type,
        )
        for name in (*positional, *(name for name in fields if name not in positional))
    ]
    return own.replace(parameters=[*(one for one in others if one not in ends), *made, *ends])


def _same(value: Any, default: Any) -> bool:
    """True if a value is its default; arrays and values of another type are not."""
    if value is default:
        return True
    return type(value) is type(default) and isinstance(value, (bool, int, float, str, tuple)) and value == default
