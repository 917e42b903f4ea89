"""The value of an episode and its derivatives, against closed solutions and differences of whole rollouts."""

import numpy as np
import pytest

import smpl

DECAY = """model Decay
param k : 1/s = 0.5
action u = 1 in 0..2
state x = 1
eq d/dt x = u*1[1/s] - k*x
observe x in 0..9
reward earned = x - sq(u)
reward other = x*u
episode { step = 0.5 [s], max_steps = 20 }
"""

REMEMBERS = """model Remembers
action u = 0 in -1..1
state x = 1
discrete d = 0
eq d/dt x = (u - d)*1[1/s]
at end { next d = d + x }
observe x in -9..9
reward r = x
episode { step = 1 [s], max_steps = 20 }
"""


def tight(source):
    return smpl.compile(source=source, settings={"rtol": 1e-11})


def differences(value, at, size=1e-4):
    """Central differences of fourth order, entry by entry."""
    slopes = np.empty(at.size)
    for i in range(at.size):
        h = size * max(abs(at.flat[i]), 1e-1)

        def moved(k, i=i, h=h):
            there = np.array(at, dtype=float)
            there.flat[i] += k * h
            return value(there)

        slopes[i] = (8 * (moved(1) - moved(-1)) - (moved(2) - moved(-2))) / (12 * h)
    return slopes.reshape(at.shape)


def test_a_linear_model_has_the_sums_of_its_solution():
    model, k, h, discount = tight(DECAY), 0.5, 0.5, 0.9
    u = np.array([[0.3], [1.2], [0.7], [1.9]])
    found = model.gradient([0.8], u, discount=discount, final=[2.0], parameters="k")
    e = np.exp(-k * h)
    x = [0.8]
    for action in u[:, 0]:
        x.append(e * x[-1] + (1 - e) / k * action)
    weights = discount ** np.arange(4)
    value = (weights * (np.array(x[1:]) - u[:, 0] ** 2)).sum() + 2 * x[-1]
    # x after step j by the start is e^j, by the action of step i < j e^(j - 1 - i) (1 - e)/k.
    by_start = (weights * e ** np.arange(1, 5)).sum() + 2 * e**4
    by_action = [
        -2 * u[i, 0] * weights[i]
        + (1 - e) / k * (sum(weights[j] * e ** (j - i) for j in range(i, 4)) + 2 * e ** (3 - i))
        for i in range(4)
    ]
    assert found.value == pytest.approx(value, rel=1e-9)
    np.testing.assert_allclose(found.by_state, [by_start], rtol=1e-8)
    np.testing.assert_allclose(found.by_action[:, 0], by_action, rtol=1e-7)
    np.testing.assert_allclose(found.states[:, 0], x, rtol=1e-9)
    assert found.by_parameter.shape == (1,) and found.parameters == ("k",)

    def at(rate):
        reached = model.rollout([0.8], u, parameters={"k": rate[0]})
        return float((weights * reached.rewards[0]).sum() + 2 * reached.states[0, -1, 0])

    np.testing.assert_allclose(found.by_parameter, differences(at, np.array([k])), rtol=1e-6)


def test_episodes_side_by_side_are_those_one_by_one():
    model = tight(DECAY)
    rng = np.random.default_rng(1)
    x, u = rng.uniform(0, 2, (3, 1)), rng.uniform(0, 2, (3, 5, 1))
    together = model.gradient(x, u, reward="other", parameters=("k",), threads=2)
    assert together.value.shape == (3,) and together.by_action.shape == (3, 5, 1)
    for i in range(3):
        alone = model.gradient(x[i], u[i], reward="other", parameters=("k",))
        for name in ("value", "by_state", "by_action", "by_parameter", "states", "rewards"):
            np.testing.assert_array_equal(getattr(together, name)[i], getattr(alone, name))


def test_the_reactor_against_differences_of_rollouts():
    extra = "reward squared = -sq((T - 52 [degC])/5 [K]) - sq((h - 0.65 [m])/0.05 [m])"
    model = smpl.compile("reactor", settings={"rtol": 1e-11}, reward="squared", extra=extra)
    env = smpl.Env(model, normalize=False)
    env.reset(seed=2)
    x = np.array(env.state)
    rng = np.random.default_rng(0)
    u = rng.uniform(0.4, 0.6, (6, 2)) * (env.action_high - env.action_low) + env.action_low
    found = model.gradient(x, u)

    def value(actions):
        return float(model.rollout(x, actions).rewards[0].sum())

    assert found.value == pytest.approx(value(u), rel=1e-6)
    expected = differences(value, u, 1e-4)
    np.testing.assert_allclose(found.by_action, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


def test_a_model_that_remembers_is_refused_by_name():
    env = smpl.Env("reactor", normalize=False)
    env.reset(seed=2)
    # Its reward is relative to the distance at the start of the episode.
    with pytest.raises(ValueError, match=r"the reward after .* remembers more than its states"):
        env.model.gradient(env.state, np.tile((env.action_low + env.action_high) / 2, (3, 1)))
    with pytest.raises(ValueError, match=r"episode 0: x after .* remembers more than its states"):
        smpl.compile(source=REMEMBERS).gradient([1.0], np.zeros((4, 1)))


def test_an_episode_that_ends_early_is_refused():
    source = DECAY.replace("episode {", "fail low when x < 0.7\nepisode {")
    with pytest.raises(smpl.SimulationError, match=r"ends after \d steps.*low"):
        smpl.compile(source=source).gradient([0.8], np.zeros((8, 1)))


def test_bad_input_is_named():
    model = smpl.compile(source=DECAY)
    with pytest.raises(ValueError, match="reward"):
        model.gradient([0.8], np.ones((2, 1)), reward="earnd")
    with pytest.raises(ValueError, match=r"discount is 1\.5"):
        model.gradient([0.8], np.ones((2, 1)), discount=1.5)
    with pytest.raises(ValueError, match="final has shape"):
        model.gradient([0.8], np.ones((2, 1)), final=[1.0, 2.0])
    with pytest.raises(ValueError, match="actions has shape"):
        model.gradient([0.8], np.ones((2, 3)))
