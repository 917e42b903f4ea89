"""Models that are algebra only, as environments and in the calls of a model; expected values in closed form."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import smpl

FLASH = """
model Flash
time t : s
set s = { a, b }
param z[s] = 0.5 in 0..1
table K[s] = { a: 2.5, b: 0.3 }
action f = 1 in 0.5..1.5
var V = 0.5 in 0..1
eq sum(z[i]*(f*K[i] - 1)/(1 + V*(f*K[i] - 1)) for i in s) = 0
observe V
reward r default = V
episode { step = 1 [s], max_steps = 5 }
"""


def fraction(f: float) -> float:
    """Vapour fraction by Rachford and Rice, for equal amounts of two components."""
    a, b = 2.5 * f - 1, 0.3 * f - 1
    return -(0.5 * a + 0.5 * b) / (a * b)


@pytest.mark.parametrize("method", ["ida", "rosenbrock", "auto"])
def test_a_step_solves_the_algebra_for_the_action(method: str) -> None:
    env = smpl.Env(smpl.compile(source=FLASH), normalize=False, method=method)
    env.reset(seed=1)
    assert env.unwrapped.state_names == () or list(env.unwrapped.state_names) == []
    for f in (0.8, 1.3, 1.0):
        observation, reward, terminated, truncated, _ = env.step(np.array([f]))
        assert reward == pytest.approx(fraction(f), abs=1e-10)
        assert observation[0] == pytest.approx(fraction(f), abs=1e-6)
        assert not terminated and not truncated


def test_the_environment_passes_the_checker() -> None:
    env: gymnasium.Env = smpl.Env(smpl.compile(source=FLASH))
    check_env(env, skip_render_check=True)


def test_rollouts_and_steady_states_have_no_states() -> None:
    model = smpl.compile(source=FLASH)
    actions = np.array([[[0.8], [1.2]], [[1.0], [1.4]]])
    rollout = model.rollout(np.zeros((2, 0)), actions)
    assert rollout.states.shape == (2, 3, 0)
    np.testing.assert_allclose(
        rollout.rewards, [[fraction(0.8), fraction(1.2)], [fraction(1.0), fraction(1.4)]], atol=1e-10
    )
    steady = model.steady_state([1.2])
    np.testing.assert_allclose(np.atleast_1d(np.asarray(steady, dtype=float)).ravel()[-1:], [fraction(1.2)], atol=1e-10)


def test_the_linearisation_is_the_gain_of_the_algebra() -> None:
    model = smpl.compile(source=FLASH)
    unknowns = model.steady_state([1.0])
    a, b, c, d = model.linearize(unknowns, [1.0])
    assert a.shape == (0, 0) and b.shape == (0, 1) and c.shape == (1, 0)
    step = 1e-6
    slope = (fraction(1 + step) - fraction(1 - step)) / (2 * step)
    np.testing.assert_allclose(d, [[slope]], rtol=1e-7)
