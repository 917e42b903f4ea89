"""Baseline controllers. All give actions in physical units and see the environment beneath the observation."""

from smpl.controllers.base import Constant, Controller, Nominal, OpenLoop, Policy, Uniform
from smpl.controllers.beer import Profile, isothermal
from smpl.controllers.reactor import Proportional

__all__ = [
    "Constant",
    "Controller",
    "Nominal",
    "OpenLoop",
    "Policy",
    "Profile",
    "Proportional",
    "Uniform",
    "isothermal",
]
