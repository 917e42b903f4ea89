"""Baselines of the reactor: the published proportional controller; predictive control is in `smpl.controllers.nmpc`."""

from __future__ import annotations

import numpy as np

from smpl.controllers.base import require
from smpl.envs import Env
from smpl.model import FloatArray

# Published set-point and steady action, in the declared units (c_A, T, h) and (T_c, q_out).
SET_POINT = np.array([0.8778252, 51.34660837, 0.659])
STEADY_ACTION = np.array([26.85, 0.1])
STATES, ACTIONS = ("c_A", "T", "h"), ("T_c", "q_out")


class Proportional:
    """`pid` of the paper, in truth proportional only: jacket temperature by concentration, outflow by level.

    T_c = 26.85 + 100.0 (c_A - c_A,s), q_out = 0.1 + 0.5 (h - h_s), both clipped to the action box. It does not look at
    the temperature and loses about a tenth of the random starts to thermal runaway.

    Args:
        gain_concentration: K m^3/kmol.
        gain_level: m^2/min.
    """

    def __init__(self, gain_concentration: float = 100.0, gain_level: float = 0.5) -> None:
        self._gains = np.array([gain_concentration, gain_level])

    def reset(self, env: Env) -> None:
        """Nothing to forget.

        Raises:
            ValueError: the environment is no reactor.
        """
        require(env, "the proportional controller", ACTIONS, STATES)

    def action(self, env: Env) -> FloatArray:
        """The clipped proportional action."""
        error = env.state[[0, 2]] - SET_POINT[[0, 2]]
        return np.clip(STEADY_ACTION + self._gains * error, env.action_low, env.action_high)
