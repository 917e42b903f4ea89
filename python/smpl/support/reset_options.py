"""Checks of `reset(options=...)` and translation for the compiled module."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from smpl import _native
from smpl.support.arguments import FloatArray, as_number, as_numbers, as_vector, check_names, expand_parameters

if TYPE_CHECKING:
    from smpl.model import Model

OPTIONS = ("state", "discrete", "parameters", "disturbances", "hold_disturbances", "start", "disturbance_seed")
_STARTS = ("sampled", "nominal", "steady", "cyclic")


def start_from_options(model: Model, options: Mapping[str, Any] | None) -> _native.Start | None:
    """Options of `reset` for the start of an episode.

    Args:
        model: the model that the names belong to.
        options: see `OPTIONS`. `state` is an array in the order of states, or a mapping from names
            of states and of algebraic variables (their initial guesses). `discrete` and
            `parameters` are mappings; an array of parameters has one value, one for each element,
            or is set element by element. `disturbances` maps names to one value per step or one
            number; with `hold_disturbances` the last value holds after the end of a record, where a
            step otherwise fails. `start` is `sampled`, `nominal`, `steady` or `cyclic`.
            `disturbance_seed` seeds what is drawn after the start (disturbances, errors of
            measurements); None for the seed of the reset.

    Raises:
        ValueError: an unknown key or name, a wrong shape, or a value that is not a finite number.
    """
    if not options:
        return None
    if not isinstance(options, Mapping):
        raise ValueError(f"options must be a mapping, got {type(options).__name__}")
    # Minari's collector leaves its own key in the options that it passes on.
    options = {key: value for key, value in options.items() if key != "minari_autoseed"}
    check_names("options", options, OPTIONS)
    mode = options.get("start", "sampled")
    if mode not in _STARTS:
        raise ValueError(f"options['start'] is {mode!r}; there are: {', '.join(_STARTS)}")
    return _native.Start(
        mode,
        _state(model, options.get("state")),
        _named("discrete", options.get("discrete"), model.discrete_names),
        _parameters(model, options.get("parameters")),
        _disturbances(model, options.get("disturbances")),
        _held(options.get("disturbances"), options.get("hold_disturbances", False)),
        _seed(options.get("disturbance_seed")),
    )


def _state(model: Model, given: Any) -> dict[str, float] | FloatArray | None:
    if given is None:
        return None
    if isinstance(given, Mapping):
        return _named("state", given, model.unknown_names)
    values = as_vector("options['state']", given, len(model.state_names))
    _check_finite("state", values)
    return values


def _seed(given: Any) -> int | None:
    if given is None:
        return None
    if isinstance(given, (bool, np.bool_)) or not isinstance(given, (int, np.integer)) or not 0 <= given < 2**64:
        raise ValueError(f"options['disturbance_seed'] is {given!r}, expected an integer from 0 to 2**64 - 1")
    return int(given)


def _named(key: str, given: Any, names: tuple[str, ...]) -> dict[str, float]:
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise ValueError(f"options[{key!r}] must be a mapping from names to values, got {type(given).__name__}")
    check_names(f"options[{key!r}]", given, names)
    values = {name: as_number(f"options[{key!r}][{name!r}]", value) for name, value in given.items()}
    _check_finite(key, list(values.values()))
    return values


def _parameters(model: Model, given: Any) -> dict[str, float]:
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise ValueError(f"options['parameters'] must be a mapping from names to values, got {type(given).__name__}")
    values = expand_parameters("options['parameters']", model, given)
    _check_finite("parameters", list(values.values()))
    return values


def _held(disturbances: Any, hold: Any) -> list[str]:
    """Names of the disturbances whose last value holds."""
    if not isinstance(hold, (bool, np.bool_)):
        raise ValueError(f"options['hold_disturbances'] is {hold!r}, expected True or False")
    return [name for name, values in (disturbances or {}).items() if hold or np.ndim(values) == 0]


def _disturbances(model: Model, given: Any) -> dict[str, FloatArray]:
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise ValueError("options['disturbances'] must be a mapping from names to sequences")
    measured = [name for name in given if name in model.native.names("measured")]
    if measured:
        raise ValueError(
            f"options['disturbances']: {measured[0]!r} follows a file; name another one or a number in a scenario, "
            f"`disturbances: {{{measured[0]}: {{from: other.csv}}}}`"
        )
    check_names("options['disturbances']", given, model.disturbance_names)
    sequences = {}
    for name, values in given.items():
        sequence = np.atleast_1d(as_numbers(f"options['disturbances'][{name!r}]", values, "(steps,)"))
        if sequence.ndim != 1 or sequence.size == 0:
            raise ValueError(f"options['disturbances'][{name!r}] has shape {sequence.shape}, expected (steps,)")
        _check_finite("disturbances", sequence)
        sequences[name] = sequence
    return sequences


def _check_finite(key: str, values: npt.ArrayLike) -> None:
    if not np.all(np.isfinite(values)):
        raise ValueError(f"options[{key!r}] has a value that is not finite")
