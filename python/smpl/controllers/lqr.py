"""Linear-quadratic control of any model, from its exact linearisation.

K. J. Astrom and B. Wittenmark, Computer-Controlled Systems (1997), chapter 11; sampling of system
and cost by matrix
exponentials: C. Van Loan, IEEE Transactions on Automatic Control 23 (1978) 395-404.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from smpl.controllers.base import TakesWrapped
from smpl.controllers.names import operating_point, weights
from smpl.envs import Env
from smpl.model import Model
from smpl.support.arguments import FloatArray, check_once
from smpl.support.names import listing
from smpl.support.optional import load

if TYPE_CHECKING:
    from smpl.controllers.estimation import Estimator

_MOST_STATES = 400


def sampled(A: FloatArray, B: FloatArray, interval: float) -> tuple[FloatArray, FloatArray]:
    """A and B of the system sampled with constant actions between the instants, exact."""
    linalg = _linalg()
    n, m = B.shape
    both = linalg.expm(np.block([[A, B], [np.zeros((m, n + m))]]) * interval)
    return both[:n, :n], both[:n, n:]


def sampled_cost(
    A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, N: FloatArray, interval: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weights Q, R and N of the sampled system: the sum is the integral of x'Qx + u'Ru + 2 x'Nu."""
    linalg = _linalg()
    n, m = B.shape
    whole = np.block([[A, B], [np.zeros((m, n + m))]])
    weight = np.block([[Q, N], [N.T, R]])
    zero = np.zeros((n + m, n + m))
    found = linalg.expm(np.block([[-whole.T, weight], [zero, whole]]) * interval)
    integral = found[n + m :, n + m :].T @ found[: n + m, n + m :]
    integral = (integral + integral.T) / 2
    return integral[:n, :n], integral[n:, n:], integral[:n, n:]


class LQR(TakesWrapped):
    """Linear-quadratic regulator, u = u_s - K (x - x_s) - K_i z, within the action box.

    z are the sums over steps of the errors of the outputs named by `integral`: they hold these at
    their set-points against constant disturbances and wrong parameters. An error is not summed up
    while it would drive a saturated action further out.

    Args:
        model: a model, or an environment of which the model is taken.
        state_weight: by names of states, x'Qx; without any weight 1/x_s^2 (1/range^2 where x_s is
            0).
        action_weight: by names of actions, u'Ru; without any 1/range^2.
        output_weight: by names of observations, y'Wy with y = Cx + Du: what an action does to them
            at once counts too.
        integral: names of observations, or a mapping from them to the weight of their summed
            errors, by default that of the output in Q, a hundredth of it a step.
        discrete: the regulator of the system as it is sampled (`scipy.linalg.solve_discrete_are`);
            otherwise that of continuous time, whose gain a sampled controller only approximates.
        cost: `sum` over instants, or `integral` over time, sampled exactly.
        at: (y, u) where the model is linearised and is to be held; its steady state if none.
        p: parameters and the like.
        pade: order of the approximations of dead times, 1 to 5. Their states follow those of the
            model, have no weight, and are those of the linear model with the states and actions so
            far.

    Attributes:
        gain: K, (actions, states + integrators).
        state, action_at_rest: x_s and u_s.
        system: A, B, C, D of continuous time, in as many states as are free.
        eigenvalues: of the closed loop.

    Raises:
        ValueError: a name or weight that does not fit, or what cannot be stabilised, with the
            states concerned.
        ImportError: SciPy is missing.
    """

    def __init__(
        self,
        model: Model | Env,
        state_weight: Mapping[str, float] | None = None,
        action_weight: Mapping[str, float] | None = None,
        *,
        output_weight: Mapping[str, float] | None = None,
        integral: Any = (),
        discrete: bool = True,
        cost: str = "sum",
        at: tuple[Any, Any] | None = None,
        p: Mapping[str, float] | None = None,
        pade: int = 3,
    ) -> None:
        if cost not in ("sum", "integral"):
            raise ValueError(f"cost is {cost!r}, expected 'sum' or 'integral'")
        self.model = model if isinstance(model, Model) else model.model
        self._linear = self.model.with_pade(pade)
        n = len(self._linear.state_names)
        if n > _MOST_STATES:
            raise ValueError(f"{self.model.name} has {n} states; a regulator of more than {_MOST_STATES} is not made")
        y, u = operating_point(self.model, at, p)
        if self.model.delays:
            y = self._linear._rested(self.model, y, u, p)
        self.system = self._linear.linearize(y, u, p)
        A, B = self.system[:2]
        self.state, self.action_at_rest = y[:n].copy(), u.copy()
        self._integral = self._integrators(integral)
        Q, R, N = self._weights(state_weight, action_weight, output_weight)
        F, G = sampled(A, B, self.model.step) if discrete else (A, B)
        if discrete and cost == "integral":
            Q, R, N = sampled_cost(A, B, Q, R, N, self.model.step)
        F, G, Q, N = self._augmented(F, G, Q, N, discrete)
        gain, self.riccati = _regulator(F, G, Q, R, N, discrete, self._stateful_names())
        self.eigenvalues = np.linalg.eigvals(F - G @ gain)
        free = len(self.system.state_names)
        self.gain = np.hstack([self._of_states(gain[:, :free]), gain[:, free:]])
        # The linear model predicts the states of approximations, which are the last ones.
        self._memory = np.zeros(n - len(self.model.state_names))
        by_states, by_actions = (part[free - len(self._memory) :] for part in sampled(A, B, self.model.step))
        self._goes_on = self._of_states(by_states), by_actions
        self._sum = np.zeros(len(self._integral))
        self._low, self._high = self.model.native.bounds("action")

    def _of_states(self, rows: FloatArray) -> FloatArray:
        """Rows that multiply free states, with a column for every state."""
        names = self._linear.state_names
        if self.system.state_names == names:
            return rows
        whole = np.zeros((*rows.shape[:-1], len(names)))
        whole[..., [names.index(name) for name in self.system.state_names]] = rows
        return whole

    def reset(self, env: Env) -> None:
        """Forget the summed errors.

        Raises:
            ValueError: the environment is of another model.
        """
        if env.state_names != self.model.state_names or env.action_names != self.model.action_names:
            raise ValueError(f"this regulator is for {self.model.name}, the environment is {env.model.name}")
        self._sum[:] = 0.0
        self._memory[:] = 0.0
        self._low, self._high = env.action_low, env.action_high

    def action(self, env: Env) -> FloatArray:
        """Feedback of the state beneath the observation; `LQG` feeds back an estimate."""
        return self.control(env.state)

    def control(self, state: FloatArray) -> FloatArray:
        """The action for a state, or for an estimate of it; sums up the errors."""
        n = len(self.state)
        deviation = np.append(state - self.state[: len(state)], self._memory)
        wanted = self.action_at_rest - self.gain[:, :n] @ deviation - self.gain[:, n:] @ self._sum
        action = np.clip(wanted, self._low, self._high)
        self._accumulate(deviation, action, wanted)
        by_states, by_actions = self._goes_on
        self._memory = by_states @ deviation + by_actions @ (action - self.action_at_rest)
        return action

    def _accumulate(self, deviation: FloatArray, action: FloatArray, wanted: FloatArray) -> None:
        n = len(self.state)
        for j, (row, through, _) in enumerate(self._integral):
            error = float(self._of_states(row) @ deviation + through @ (action - self.action_at_rest))
            # What the error would change in each action, where that one is at its limit.
            push = -self.gain[:, n + j] * error
            if not np.any((wanted - action) * push > 0):
                self._sum[j] += error

    def _integrators(self, given: Any) -> list[tuple[FloatArray, FloatArray, float | None]]:
        C, D = self.system[2], self.system[3]
        names, units = self.model.observation_names, self.model.observation_units
        chosen = [given] if isinstance(given, str) else list(given)
        check_once("integral", chosen)
        wanted: dict[str, float | None] = dict(given) if isinstance(given, Mapping) else dict.fromkeys(chosen)
        wrong = [name for name in wanted if name not in names]
        if wrong:
            raise ValueError(f"integral: unknown {', '.join(map(repr, wrong))}; there are: {listing(names, units)}")
        if len(wanted) > len(self.model.action_names):
            raise ValueError(
                f"integral: {len(wanted)} outputs, but {self.model.name} has {len(self.model.action_names)} actions: "
                "no more outputs can be held than there are actions"
            )
        return [(C[names.index(name)], D[names.index(name)], weight) for name, weight in wanted.items()]

    def _weights(self, state: Any, action: Any, output: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
        model = self._linear
        low, high = model.native.bounds("state")
        q = weights("state_weight", state, model.state_names, model.state_units)
        w = weights("output_weight", output, model.observation_names, model.observation_units)
        if q is None:
            q = np.zeros(len(self.state)) if w is not None else 1 / _scale(self.state, low, high) ** 2
            q[len(self.model.state_names) :] = 0.0
        r = weights("action_weight", action, model.action_names, model.action_units)
        low, high = model.native.bounds("action")
        if r is None:
            r = 1 / _scale(high - low, low, high) ** 2
        if not (r > 0).all():
            missing = [name for name, one in zip(model.action_names, r, strict=True) if not one > 0]
            raise ValueError(f"action_weight: {', '.join(missing)} weigh nothing, expected a positive weight for each")
        Q, R, N = np.diag(q), np.diag(r), np.zeros((len(self.system.state_names), len(r)))
        if self.system.state_names != model.state_names:
            Q = self.system.states.T @ Q @ self.system.states
        if w is not None:
            C, D = self.system[2:]
            Q, R, N = Q + C.T @ np.diag(w) @ C, R + D.T @ np.diag(w) @ D, C.T @ np.diag(w) @ D
        return Q, R, N

    def _augmented(
        self, F: FloatArray, G: FloatArray, Q: FloatArray, N: FloatArray, discrete: bool
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The system with the summed errors as further states."""
        count = len(self._integral)
        if not count:
            return F, G, Q, N
        n, m = G.shape
        rows = np.array([row for row, _, _ in self._integral])
        through = np.array([one for _, one, _ in self._integral])
        keep = np.eye(count) if discrete else np.zeros((count, count))
        heavy = np.diag([self._integral_weight(row, weight, Q) for row, _, weight in self._integral])
        return (
            np.block([[F, np.zeros((n, count))], [rows, keep]]),
            np.vstack([G, through]),
            np.block([[Q, np.zeros((n, count))], [np.zeros((count, n)), heavy]]),
            np.vstack([N, np.zeros((count, m))]),
        )

    def _integral_weight(self, row: FloatArray, weight: float | None, Q: FloatArray) -> float:
        if weight is not None:
            return float(weight)
        # What an error of one unit of the output costs at least in x'Qx, a hundredth of it.
        norm = float(row @ row)
        return 0.01 * float(row @ Q @ row) / norm**2 if norm > 0 else 1.0

    def _stateful_names(self) -> list[str]:
        return [*self.system.state_names, *(f"integral {i}" for i in range(len(self._integral)))]


class LQG(TakesWrapped):
    """Feedback of an estimate by linear-quadratic control or a controller with `control(state)`.

    Args:
        regulator: `LQR`.
        estimator: `ExtendedKalmanFilter` or `MovingHorizonEstimator`.
    """

    def __init__(self, regulator: LQR, estimator: Estimator) -> None:
        self.regulator, self.estimator = regulator, estimator
        self.sees = estimator.sees

    def reset(self, env: Env) -> None:
        """Begin an episode in both.

        Raises:
            ValueError: the estimator's states are others than the regulator's.
        """
        estimated = self.estimator.model.state_names
        if estimated != self.regulator.model.state_names:
            raise ValueError(
                f"the estimator has the states {', '.join(estimated[:8])}, the regulator "
                f"{', '.join(self.regulator.model.state_names[:8])}"
            )
        self.regulator.reset(env)
        self.estimator.reset(env)

    def action(self, env: Env) -> FloatArray:
        """The regulator's action for the estimate from all readings so far."""
        return self.regulator.control(self.estimator.update(env))


def _regulator(
    F: FloatArray, G: FloatArray, Q: FloatArray, R: FloatArray, N: FloatArray, discrete: bool, names: list[str]
) -> tuple[FloatArray, FloatArray]:
    linalg = _linalg()
    _check_stabilisable(F, G, discrete, names)
    try:
        solve = linalg.solve_discrete_are if discrete else linalg.solve_continuous_are
        P = solve(F, G, Q, R, s=N)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise ValueError(
            f"no regulator was found ({error}): weigh the states that integrate, of {', '.join(names[:8])}"
        ) from error
    if discrete:
        return np.linalg.solve(R + G.T @ P @ G, G.T @ P @ F + N.T), P
    return np.linalg.solve(R, G.T @ P + N.T), P


def _check_stabilisable(F: FloatArray, G: FloatArray, discrete: bool, names: list[str]) -> None:
    """Hautus' test: an eigenvalue that does not decay must be moved by an action."""
    values, left = np.linalg.eig(F.T)
    for value, vector in zip(values, left.T, strict=True):
        slow = abs(value) >= 1 - 1e-10 if discrete else value.real >= -1e-10
        effect = np.abs(vector @ G).max(initial=0.0)
        if slow and effect <= 1e-10 * max(np.abs(G).max(initial=0.0), 1e-300) * np.abs(vector).max():
            part = [names[i] for i in np.argsort(-np.abs(vector))[:3] if abs(vector[i]) > 1e-3 * np.abs(vector).max()]
            raise ValueError(
                f"no action moves the mode {value:.4g} of {', '.join(part)}, which does not decay: it cannot be"
                " stabilised"
            )


def _scale(values: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Sizes that are not zero: the values, else the ranges, else 1."""
    width = np.where(np.isfinite(high - low), high - low, 1.0)
    sizes = np.where(np.abs(values) > 0, np.abs(values), width)
    return np.where((sizes > 0) & np.isfinite(sizes), sizes, 1.0)


def _linalg() -> Any:
    return load("scipy.linalg", "linear control")
