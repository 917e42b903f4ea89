"""Comparison of plants of the gallery with right-hand sides written anew in Python."""

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

import smpl

Array = npt.NDArray[np.float64]
RightSide = Callable[[Array, Array], Array]


def values(text: str, **parameters: float) -> dict[str, float]:
    """Outputs of a model without dynamics, by name."""
    head = "model Point\ntime t : s\nstate rest = 0\neq d/dt rest = 0\nepisode { step = 1 [s], max_steps = 1 }\n"
    model = smpl.compile(source=head + text)
    run = model.rollout([0.0], np.zeros((1, 0)), parameters=parameters, outputs=True)
    assert not run.failure[0], run.failure[0]
    return dict(zip(model.algebraic_names, run.outputs[0, 0], strict=True))


def rest(model: smpl.Model) -> Array:
    """States at the start of an episode with all random numbers at their means."""
    env = smpl.Env(model, normalize=False)
    env.reset(seed=0)
    return np.array(env.state)


def moves(model: smpl.Model, steps: int, share: float = 0.1, hold: int = 5, seed: int = 0) -> Array:
    """Actions around the nominal ones, `share` of their ranges wide, each held for some steps."""
    env = smpl.Env(model, normalize=False)
    low, high, nominal = env.action_low, env.action_high, model.native.defaults("action")
    drawn = np.random.default_rng(seed).uniform(-1, 1, (steps // hold + 1, len(low)))
    return np.repeat(np.clip(nominal + share * (high - low) * drawn, low, high), hold, axis=0)[:steps]


def difference(
    model: smpl.Model,
    right_side: RightSide,
    start: Array,
    actions: Array,
    step: float,
    *,
    method: str = "LSODA",
    rtol: float = 1e-11,
    disturbances: Mapping[str, float] | None = None,
    first_step: int = 0,
    **options: npt.ArrayLike,
) -> float:
    """Largest difference of a trajectory from that of SciPy, relative to the size of each state.

    `right_side(x, u)` has the states in the order and the units of the model, and its unit of time.
    `options` are those of the method.
    """
    run = model.rollout(start, actions, disturbances=disturbances, first_step=first_step)
    assert not run.failure[0], run.failure[0]
    assert run.steps[0] == len(actions)
    found, expected = run.states[0], [start]
    scale = np.maximum(np.abs(found).max(axis=0), 1e-12)
    for action in actions:
        result = solve_ivp(
            lambda _, x, u=action: right_side(x, u),
            (0.0, step),
            expected[-1],
            method,
            rtol=rtol,
            atol=0.1 * rtol * scale,
            **options,
        )
        assert result.success, result.message
        expected.append(result.y[:, -1])
    return float((np.abs(found - np.array(expected)) / scale).max())


def gains(model: smpl.Model, action: Array) -> Array:
    """Steady-state gains from actions to observations."""
    A, B, C, D = model.linearize(model.steady_state(action), action)
    return D - C @ np.linalg.solve(A, B)


def near(found: npt.ArrayLike, published: npt.ArrayLike, slack: npt.ArrayLike) -> None:
    """Assert that numbers agree with printed ones to within their last digits."""
    excess = np.abs(np.asarray(found) - np.asarray(published)) / np.asarray(slack)
    assert excess.max() <= 1, (found, published, excess)
