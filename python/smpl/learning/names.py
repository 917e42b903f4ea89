"""Controllers by their names, as `--controller` takes them."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import partial
from typing import Any

from smpl import controllers
from smpl.controllers.reactor import ReactorNMPC
from smpl.model import Model


def named(spec: str, model: Model) -> Any:
    """The controller of a name: one of `names`, `constant:NUMBER,...` or `MODULE:ATTRIBUTE`.

    Raises:
        ValueError: an unknown name; the message lists the known ones.
    """
    known = _known(model)
    if spec in known:
        return known[spec]()
    if spec.startswith("constant:"):
        return controllers.Constant(_numbers(spec))
    if ":" in spec:
        return _imported(spec)
    try:
        return controllers.baseline(model.name, spec)
    except (ValueError, KeyError):
        pass
    raise ValueError(
        f"controller is {spec!r}; {model.name} has: {', '.join(names(model))}; "
        "others: constant:NUMBER,..., MODULE:ATTRIBUTE, PPO:FILE.zip, FILE.d3, FILE.pt"
    )


def names(model: Model) -> tuple[str, ...]:
    """Names of the controllers for a model."""
    try:
        more = controllers.baselines(model.name)
    except ValueError:  # a model that is not shipped has none
        more = ()
    return tuple(dict.fromkeys((*_known(model), *more)))


def _known(model: Model) -> dict[str, Callable[[], Any]]:
    """Controllers by name: of every model, baselines of this one, and declared policies."""
    known: dict[str, Callable[[], Any]] = {"nominal": controllers.Nominal, "random": controllers.Uniform}
    known["lqr"] = partial(controllers.LQR, model)
    if model.action_names == ("T_c", "q_out"):
        known |= {"pid": controllers.Proportional, "mpc": ReactorNMPC}
    if model.action_names == ("T",) and "S" in model.state_names:
        known |= {"profile": controllers.Profile, "isothermal": controllers.isothermal}
    for policy in model.policies:
        known.setdefault(policy, partial(controllers.Policy, policy))
    return known


def _imported(spec: str) -> Any:
    module, _, attribute = spec.partition(":")
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"controller {spec!r} is not there: {error}") from error
    return found() if isinstance(found, type) else found


def _numbers(spec: str) -> list[float]:
    try:
        return [float(number) for number in spec.partition(":")[2].split(",")]
    except ValueError as error:
        raise ValueError(f"controller is {spec!r}, expected constant:NUMBER,NUMBER,...") from error
