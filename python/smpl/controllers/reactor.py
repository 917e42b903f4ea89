"""Baselines of the reactor: the published proportional and predictive controllers."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.controllers.base import TakesWrapped, require
from smpl.controllers.nmpc import NMPC
from smpl.envs import Env, Interface
from smpl.policies import Rows
from smpl.support.arguments import FloatArray

# Published set-point and steady action, in the declared units (c_A, T, h) and (T_c, q_out).
SET_POINT = np.array([0.8778252, 51.34660837, 0.659])
STEADY_ACTION = np.array([26.85, 0.1])
STATES, ACTIONS = ("c_A", "T", "h"), ("T_c", "q_out")


class Proportional(TakesWrapped, needs_reset=False):
    """`pid` of the paper, which is proportional: T_c by concentration, outflow by level.

    T_c = 26.85 + 100.0 (c_A - c_A,s), q_out = 0.1 + 0.5 (h - h_s), both clipped to the action box.
    It does not look at the temperature and loses about a tenth of the random starts to thermal
    runaway.

    Args:
        gain_concentration: K m^3/kmol.
        gain_level: m^2/min.
    """

    needs = "states"

    def __init__(self, gain_concentration: float = 100.0, gain_level: float = 0.5) -> None:
        self._gains = np.array([gain_concentration, gain_level])

    def reset(self, env: Env) -> None:
        """Nothing to forget.

        Raises:
            ValueError: the environment is not a reactor.
        """
        require(env, "the proportional controller", ACTIONS, STATES)

    def action(self, env: Env) -> FloatArray:
        """The clipped proportional action."""
        return self._law(env.state, env)

    def actions(self, rows: Rows) -> FloatArray:
        """The clipped proportional actions of a batch."""
        return self._law(rows.states, rows.interface)

    def _law(self, states: FloatArray, interface: Interface) -> FloatArray:
        error = states[..., [0, 2]] - SET_POINT[[0, 2]]
        return np.clip(STEADY_ACTION + self._gains * error, interface.action_low, interface.action_high)


class ReactorNMPC(TakesWrapped):
    """`mpc` of the paper: nonlinear predictive control of the reactor with full state feedback.

    The cost is the sum over interval starts of (x - s)' Q (x - s) + (u - u_s)' R (u - u_s) and a
    terminal term. It is unscaled, so that the temperature dominates; the action box is the only
    bound. Parameters are those of the plant's episode. The problem is built at the first reset.

    Args:
        horizon: number of intervals of prediction and control.
        state_weight, terminal_weight, action_weight: diagonals of Q, P and R.
        set_point, steady_action: s and u_s.
        keep_warm_start: carry the last solution into the next episode, as the original did.
        options: further arguments of `NMPC`, such as `solver`.

    Attributes:
        controller: the `NMPC`.

    Raises:
        ImportError: CasADi is missing.
    """

    sees = "state"

    def __init__(
        self,
        horizon: int = 20,
        state_weight: float = 0.1,
        terminal_weight: float = 0.1,
        action_weight: float = 0.0,
        set_point: npt.ArrayLike = SET_POINT,
        steady_action: npt.ArrayLike = STEADY_ACTION,
        keep_warm_start: bool = False,
        **options: Any,
    ) -> None:
        self._horizon = horizon
        points = np.concatenate([np.asarray(set_point, float), np.asarray(steady_action, float)])
        self._options: dict[str, Any] = {
            "cost": dict.fromkeys(STATES, state_weight) | dict.fromkeys(ACTIONS, action_weight),
            "terminal": dict.fromkeys(STATES, terminal_weight),
            "set_point": dict(zip((*STATES, *ACTIONS), points.tolist(), strict=True)),
            "declared": False,
            "nodes": "gauss",
            "p": "episode",
            "keep_warm_start": keep_warm_start,
            **options,
        }
        self.controller: NMPC | None = None

    def reset(self, env: Env) -> None:
        """Build the problem at the first call; forget the last solution.

        Raises:
            ValueError: the environment is not a reactor.
        """
        require(env, "this predictive controller", ACTIONS, STATES)
        if self.controller is None or self.controller.model is not env.model:
            self.controller = NMPC(env, self._horizon, **self._options)
        self.controller.reset(env)

    def action(self, env: Env) -> FloatArray:
        """First action of the optimal sequence, clipped to the box."""
        if self.controller is None:
            raise ValueError("call reset(env) first")
        return self.controller.action(env)

    @property
    def failures(self) -> int:
        """Decisions without a solution, in which the last plan went on."""
        return 0 if self.controller is None else self.controller.fallbacks
