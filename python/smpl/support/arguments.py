"""Checks of arguments; messages name the argument, its value and the expected one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from smpl.model import Model

FloatArray = npt.NDArray[np.float64]

# The compiled module counts steps, threads and environments in 32 bits.
COUNTS = 2**32
METHODS = ("ida", "rosenbrock", "explicit", "auto")

# Kinds of NumPy arrays that hold real numbers; arrays of texts are refused.
_NUMBERS = "fiub"


def as_vector(name: str, values: npt.ArrayLike, length: int) -> FloatArray:
    """`values` as a contiguous vector of doubles.

    Raises:
        ValueError: the shape is not `(length,)`; the message names the argument, its shape and the
            expected one.
    """
    array = as_numbers(name, values, f"({length},)")
    if array.shape != (length,):
        raise ValueError(f"{name} has shape {np.shape(values)}, expected ({length},)")
    return array


def as_numbers(name: str, values: npt.ArrayLike, expected: str) -> FloatArray:
    """`values` as a contiguous array of doubles.

    Raises:
        ValueError: they are not numbers, or masked; the message names the argument and the expected
            shape.
    """
    if type(values) is np.ndarray and values.dtype.kind in _NUMBERS:
        return np.ascontiguousarray(values, dtype=np.float64)
    try:
        array = np.asarray(values)
        if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
            raise TypeError("masked values")
        kind = array.dtype.kind
        if kind not in _NUMBERS and (kind != "O" or any(isinstance(one, (str, bytes)) for one in array.flat)):
            raise TypeError("no numbers")
        return np.ascontiguousarray(array, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} is {shorten(values)}, expected numbers of shape {expected}") from error


def as_finite(name: str, values: npt.ArrayLike, length: int) -> FloatArray:
    """`values` as a contiguous vector of finite doubles.

    Raises:
        ValueError: as for `as_vector`; the message names the first element that is not finite.
    """
    array = as_vector(name, values, length)
    bad = np.flatnonzero(~np.isfinite(array))
    if len(bad):
        raise ValueError(f"{name}[{bad[0]}] is {array[bad[0]]}, expected a finite number")
    return array


def as_finite_number(name: str, value: Any) -> float:
    """`value` as a finite double.

    Raises:
        ValueError: it is not a finite number.
    """
    number = as_number(name, value)
    if not np.isfinite(number):
        raise ValueError(f"{name} is {number}, expected a finite number")
    return number


def as_number(name: str, value: Any) -> float:
    """`value` as a double.

    Raises:
        ValueError: it is not a number; texts and masked values are not numbers.
    """
    try:
        if isinstance(value, (str, bytes)) or np.ma.is_masked(value):
            raise TypeError("no number")
        return float(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} is {shorten(value)}, expected a number") from error


def as_flag(name: str, value: Any) -> bool:
    """`value` as a truth value; numbers are refused.

    Raises:
        ValueError: it is neither True nor False.
    """
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name} is {shorten(value)}, expected True or False")
    return bool(value)


def as_mapping(name: str, value: Any) -> Mapping[str, Any]:
    """`value` as a mapping from names; None is an empty mapping.

    Raises:
        ValueError: it is not a mapping, or has keys that are not texts.
    """
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise ValueError(f"{name} is {shorten(value)}, expected a mapping from names to values")
    for key in value:
        if not isinstance(key, str):
            raise ValueError(f"{name} has the key {shorten(key)}, expected names")
    return value


def as_count(
    name: str, value: Any, least: int = 1, expected: str = "a positive integer", below: int | None = None
) -> int:
    """`value` as an integer from `least` to below `below`; truth values are refused.

    Raises:
        ValueError: it is not such an integer.
    """
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)) or value < least:
        raise ValueError(f"{name} is {shorten(value)}, expected {expected}")
    if below is not None and value >= below:
        raise ValueError(f"{name} is {shorten(value)}, expected {expected}, below {below}")
    return int(value)


def shorten(value: Any, most: int = 60) -> str:
    """Text of a value in a message, cut off if it is long."""
    text = repr(value)
    return text if len(text) <= most else f"{text[:most]}..."


def expand_parameters(argument: str, model: Model, given: Mapping[str, Any]) -> dict[str, float]:
    """Values of parameters by flattened names; an array has one value, or one per element.

    Raises:
        ValueError: an unknown name, or a wrong number of values.
    """
    numbers: list[FloatArray] = []
    for name, value in given.items():
        size = len(model.native.elements_of(name)) if isinstance(name, str) else 0
        if not size:
            check_names(argument, [name], model.parameter_names)
        what = f"{argument}[{name!r}]"
        if np.ndim(value) == 0:
            numbers.append(np.full(size, as_number(what, value)))
            continue
        numbers.append(as_numbers(what, value, f"({size},)"))
        if numbers[-1].shape != (size,):
            raise ValueError(f"{argument}: {name!r} has shape {numbers[-1].shape}, expected ({size},)")
    determined = model.native.determined(list(given))
    return {element: float(numbers[at][place]) for element, at, place in determined}


def check_numbers(who: str, given: Mapping[str, Any], defaults: Mapping[str, Any]) -> None:
    """Refuse a text where the default is a number.

    Raises:
        ValueError: one is; the message names it with its default.
    """
    for name, value in given.items():
        default = defaults.get(name)
        if isinstance(value, str) and isinstance(default, (int, float)) and not isinstance(default, bool):
            raise ValueError(f"{who}: {name} is {value!r}, expected a number as its default, {default!r}")


def check_names(argument: str, given: Iterable[str], known: Iterable[str]) -> None:
    """Refuse names that are not known.

    Raises:
        ValueError: lists the unknown names and the right ones.
    """
    right = list(known)
    wrong = [name for name in given if name not in right]
    if wrong:
        raise ValueError(f"{argument}: unknown {', '.join(map(repr, wrong))}; {_listing(right)}")


def check_once(argument: str, given: Iterable[str]) -> None:
    """Refuse names that occur twice.

    Raises:
        ValueError: lists them.
    """
    names = list(given)
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if twice:
        raise ValueError(f"{argument} has {', '.join(map(repr, twice))} more than once")


def check_within(what: str, ends: tuple[float, float], name: str, model: Model) -> None:
    """Refuse a range of a parameter that is not within its declared bounds.

    Raises:
        ValueError: says the bounds.
    """
    place = model.parameter_names.index(name)
    low, high = (float(bounds[place]) for bounds in model.native.bounds("parameter"))
    if not low <= ends[0] <= ends[1] <= high:
        given = f"{ends[0]:g}" if ends[0] == ends[1] else f"{ends[0]:g} to {ends[1]:g}"
        raise ValueError(f"{what} is {given}, outside the bounds of {name}, {low:g} to {high:g}")


def elements(argument: str, given: Iterable[str], known: Iterable[str]) -> dict[str, str]:
    """Names of elements, with those of whole arrays, each with the name that includes it.

    Raises:
        ValueError: an unknown name, or one element twice.
    """
    right = list(known)
    found: dict[str, str] = {}
    for name in given:
        members = [one for one in right if one == name or one.startswith(f"{name}[")]
        twice = [one for one in members if one in found]
        if twice:
            raise ValueError(f"{argument} has {twice[0]!r} twice: as {found[twice[0]]!r} and as {name!r}")
        check_names(argument, members or [name], right)
        found.update(dict.fromkeys(members, name))
    return found


def _listing(names: list[str], most: int = 60) -> str:
    if not names:
        return "there are no names"
    shown = ", ".join(names[:most])
    return f"there are: {shown}" + (f", ... ({len(names)} in all)" if len(names) > most else "")


def pairs_of(argument: str, given: Mapping[str, float] | None, names: tuple[str, ...]) -> list[tuple[int, float]]:
    """Named values, all finite, as (position, value)."""
    given = as_mapping(argument, given)
    check_names(argument, given, names)
    return [(names.index(name), as_finite_number(f"{argument}[{name!r}]", value)) for name, value in given.items()]


def check_method(method: str | None) -> str | None:
    """The name of a method of integration if it is one.

    Raises:
        ValueError: there is no such method.
    """
    if method is not None and method not in METHODS:
        raise ValueError(f"method is {method!r}; there are: {', '.join(METHODS)}")
    return method


def check_limit(max_steps: int | None) -> int | None:
    """The time limit if it is one.

    Raises:
        ValueError: it is not a positive integer.
    """
    if max_steps is None:
        return None
    return as_count("max_steps", max_steps, below=COUNTS)


def refuse_past(model: Model, what: str) -> None:
    """Refuses a model that reads its past where only its state is known.

    Raises:
        ValueError: the model has dead times; the message names one.
    """
    if model.delays:
        raise ValueError(
            f"{what} goes on from a state, and `{model.delays[0]}` of {model.name} reads the past: use a model with a "
            "chain of first-order lags"
        )
