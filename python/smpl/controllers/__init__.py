"""Baseline controllers. All give actions in physical units and see the environment beneath the observation."""

from smpl.controllers.adapt import Function, Noisy, as_player
from smpl.controllers.base import Constant, Controller, Nominal, OpenLoop, Policy, Uniform
from smpl.controllers.beer import Profile, isothermal
from smpl.controllers.reactor import Proportional

__all__ = [
    "Constant",
    "Controller",
    "Function",
    "Noisy",
    "Nominal",
    "OpenLoop",
    "Policy",
    "Profile",
    "Proportional",
    "Uniform",
    "as_player",
    "isothermal",
]
