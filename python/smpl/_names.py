"""Names and units of a model, as attributes of everything that has one."""

from __future__ import annotations

from smpl import _native

Names = tuple[str, ...]
_WITH_UNITS = ("state", "algebraic", "discrete", "action", "observation", "disturbance", "parameter", "reward")


class Named:
    """Carries names in the order of the values, and for each list of names the units.

    Every `KIND_units` is also there as `KIND_names_units`.
    """

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
        """Copy names and units from the compiled model."""
        for role in _WITH_UNITS:
            setattr(self, f"{role}_names", tuple(native.names(role)))
            units = tuple(native.units(role))
            setattr(self, f"{role}_units", units)
            setattr(self, f"{role}_names_units", units)

    def _share_names(self, other: Named) -> None:
        """Refer to the names and units of another object."""
        for role in _WITH_UNITS:
            for suffix in ("names", "units", "names_units"):
                setattr(self, f"{role}_{suffix}", getattr(other, f"{role}_{suffix}"))
