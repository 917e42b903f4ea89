"""Baselines of the beer fermentation."""

from __future__ import annotations

import numpy as np

from smpl.controllers.base import Constant, TakesWrapped, require
from smpl.envs import Env
from smpl.policies import Rows
from smpl.support.arguments import FloatArray


class Profile(TakesWrapped, needs_reset=False):
    """Industrial temperature profile for 130 g/L of sugar: warm up, hold, warm up again, cool."""

    def reset(self, env: Env) -> None:
        """Nothing to forget: the profile is a function of the step.

        Raises:
            ValueError: the environment is not a beer fermentation.
        """
        require(env, "the temperature profile", actions=("T",), states=("S",))

    def action(self, env: Env) -> FloatArray:
        """Temperature of the coming hour."""
        return np.array([profile_temperature(env.steps)])

    def actions(self, rows: Rows) -> FloatArray:
        """Temperatures of the coming hours of a batch."""
        return np.array([[profile_temperature(int(step))] for step in rows.steps])


def profile_temperature(k: int) -> float:
    """Temperature in degC after k completed steps."""
    if k < 25:
        return 11 + k / 8
    if k < 120:
        return 14.0
    if k < 145:
        return 14 + 2 * (k - 120) / 25
    if k < 170:
        return 16.0
    if k < 184:
        return 16 - 8 * (k - 170) / 15
    return 9.0


def isothermal(temperature: float = 13.0) -> Constant:
    """The same temperature in degC all along."""
    return Constant([temperature], actions=("T",))
