"""Names and units of a model, as attributes of everything that has one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from smpl import _native
from smpl.support.hints import refuse_attribute

Names = tuple[str, ...]
_WITH_UNITS = ("state", "algebraic", "discrete", "action", "observation", "disturbance", "parameter", "reward")


class Named:
    """Carries names in the order of the values, and for each list of names the units.

    Every `KIND_units` is also there as `KIND_names_units`.
    """

    _named: _native.Model | Named
    state_names: Names
    algebraic_names: Names
    discrete_names: Names
    action_names: Names
    observation_names: Names
    disturbance_names: Names
    parameter_names: Names
    reward_names: Names
    state_units: Names
    algebraic_units: Names
    discrete_units: Names
    action_units: Names
    observation_units: Names
    disturbance_units: Names
    parameter_units: Names
    reward_units: Names

    def _take_names(self, native: _native.Model) -> None:
        """Takes the names and units of a compiled model, fetched at their first use."""
        self._named = native

    def _share_names(self, other: Named) -> None:
        """Have the names and units of another object."""
        self._named = other

    if not TYPE_CHECKING:  # misspelled names stay errors of the type check

        def __getattr__(self, name: str) -> Names:
            role, _, kind = name.partition("_")
            named = self.__dict__.get("_named")
            if named is None or role not in _WITH_UNITS or kind not in ("names", "units", "names_units"):
                refuse_attribute(self, name)
            if isinstance(named, Named):
                values = getattr(named, name)
            else:
                values = tuple(named.names(role) if kind == "names" else named.units(role))
            setattr(self, name, values)
            return values


def listing(names: Iterable[str], units: Iterable[str], most: int = 40) -> str:
    """Names with their units."""
    shown = [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]
    return ", ".join(shown[:most]) + (f", ... ({len(shown)} in all)" if len(shown) > most else "")
