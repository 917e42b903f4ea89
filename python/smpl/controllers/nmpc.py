"""Nonlinear model predictive control of the reactor by direct collocation (extra `mpc`: CasADi with IPOPT).

Horizon of 20 intervals of 0.1 min. On each interval the states are the polynomial through its start, the three
Gauss-Legendre points and its end; the differential equation is imposed at the inner points and at the end. The cost is
the sum over interval starts of (x - s)' Q (x - s) + (u - u_s)' R (u - u_s) and a terminal term, in unscaled units.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.controllers.base import require
from smpl.controllers.reactor import ACTIONS, SET_POINT, STATES, STEADY_ACTION
from smpl.envs import Env
from smpl.model import FloatArray

# Start, the Gauss-Legendre points of (0, 1), end.
POINTS = np.array([0.0, 0.5 - np.sqrt(0.15), 0.5, 0.5 + np.sqrt(0.15), 1.0])


def differentiation_matrix(points: FloatArray) -> FloatArray:
    """D[i, j]: derivative at point i of the Lagrange polynomial that is 1 at point j."""
    size = len(points)
    matrix = np.empty((size, size))
    for j in range(size):
        others = np.delete(points, j)
        polynomial = np.poly1d(others, r=True) / np.prod(points[j] - others)
        matrix[:, j] = polynomial.deriv()(points)
    return matrix


class ReactorNMPC:
    """Nonlinear model predictive controller of the reactor with full state feedback.

    Args:
        horizon: number of intervals of prediction and control.
        state_weight, terminal_weight, action_weight: diagonals of Q, P and R.
        set_point, steady_action: s and u_s.
        keep_warm_start: carry the last solution into the next episode, as the original did.

    Raises:
        ImportError: CasADi is missing.
    """

    def __init__(
        self,
        horizon: int = 20,
        state_weight: float = 0.1,
        terminal_weight: float = 0.1,
        action_weight: float = 0.0,
        set_point: npt.ArrayLike = SET_POINT,
        steady_action: npt.ArrayLike = STEADY_ACTION,
        keep_warm_start: bool = False,
    ) -> None:
        self._horizon = horizon
        self._weights = (state_weight, terminal_weight, action_weight)
        self._set_point = np.asarray(set_point, dtype=np.float64)
        self._steady_action = np.asarray(steady_action, dtype=np.float64)
        self._keep = keep_warm_start
        self._solver: Any = None
        self._guess: FloatArray | None = None
        self.failures = 0

    def reset(self, env: Env) -> None:
        """Build the problem at the first call; forget the last solution.

        Raises:
            ValueError: the environment is no reactor.
        """
        require(env, "this predictive controller", ACTIONS, STATES)
        if self._solver is None:
            self._build(env)
        if not self._keep:
            self._guess = None

    def action(self, env: Env) -> FloatArray:
        """First action of the optimal sequence, clipped to the box."""
        guess = self._first_guess() if self._guess is None else self._guess
        solution = self._solver(x0=guess, p=env.state, lbx=self._lower, ubx=self._upper, lbg=0.0, ubg=0.0)
        values = np.asarray(solution["x"]).ravel()
        if self._solver.stats()["success"]:
            self._guess = self._shifted(values)
        else:
            self.failures += 1
            self._guess = None
        return np.clip(self._split(values)[2][0], env.action_low, env.action_high)

    # Layout of the decision variables: starts and end (H + 1, 3), inner points (H, 3, 3), actions (H, 2).

    def _split(self, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        h = self._horizon
        a, b = 3 * (h + 1), 3 * (h + 1) + 9 * h
        return values[:a].reshape(h + 1, 3), values[a:b].reshape(h, 3, 3), values[b:].reshape(h, 2)

    def _first_guess(self) -> FloatArray:
        return np.concatenate(
            [np.tile(self._set_point, 4 * self._horizon + 1), np.tile(self._steady_action, self._horizon)]
        )

    def _shifted(self, values: FloatArray) -> FloatArray:
        return np.concatenate([np.concatenate([part[1:], part[-1:]]).ravel() for part in self._split(values)])

    def _build(self, env: Env) -> None:
        """Set the problem up for the parameters of the environment."""
        try:
            import casadi
        except ImportError as error:
            raise ImportError("predictive control needs CasADi: pip install 'smpl[mpc]'") from error
        h, matrix, step = self._horizon, differentiation_matrix(POINTS), env.model.step
        unknowns = casadi.SX.sym("w", 12 * h + 3 + 2 * h)
        start = casadi.SX.sym("x0", 3)
        nodes = [unknowns[3 * k : 3 * k + 3] for k in range(h + 1)]
        a, b = 3 * (h + 1), 3 * (h + 1) + 9 * h
        actions = [unknowns[b + 2 * k : b + 2 * k + 2] for k in range(h)]
        constraints = [nodes[0] - start]
        cost = self._weights[1] * casadi.sumsqr(nodes[h] - self._set_point)
        for k in range(h):
            inner = [unknowns[a + 9 * k + 3 * i : a + 9 * k + 3 * i + 3] for i in range(3)]
            points = [nodes[k], *inner, nodes[k + 1]]
            for i in range(1, 5):
                slope = sum(matrix[i, j] * points[j] for j in range(5))
                constraints.append(slope - step * reactor_rates(casadi, points[i], actions[k], env.parameters))
            cost += self._weights[0] * casadi.sumsqr(nodes[k] - self._set_point)
            cost += self._weights[2] * casadi.sumsqr(actions[k] - self._steady_action)
        problem = {"x": unknowns, "p": start, "f": cost, "g": casadi.vertcat(*constraints)}
        quiet: Any = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes"}
        self._solver = casadi.nlpsol("reactor_nmpc", "ipopt", problem, quiet)
        free = np.full(12 * h + 3, np.inf)
        self._lower = np.concatenate([-free, np.tile(env.action_low, h)])
        self._upper = np.concatenate([free, np.tile(env.action_high, h)])


def reactor_rates(casadi: Any, x: Any, u: Any, p: dict[str, float]) -> Any:
    """Right-hand side of the reactor in CasADi, per min; x = (c_A, T, h), u = (T_c, q_out), p parameters by name."""
    area = np.pi * p["r"] ** 2
    dilution = p["q_in"] / (area * x[2] + p["V_0"])
    rate = p["k_0"] * casadi.exp(-p["E_R"] / (x[1] + 273.15)) * x[0]
    heat = p["rho"] * p["c_p"]
    return casadi.vertcat(
        dilution * (p["c_Af"] - x[0]) - rate,
        dilution * (p["T_f"] - x[1]) - p["dH"] / heat * rate + 2 * p["U"] / (p["r"] * heat) * (u[0] - x[1]),
        (p["q_in"] - u[1]) / area,
    )
