"""Rollouts: many trajectories at once."""

from __future__ import annotations

import numpy as np
import pytest

import smpl

NOISY = """model Noisy "a decay that is disturbed and measured badly"
time t : h
param k : 1/h = 0.5 ~ uniform(0.4, 0.6) in 0..2
action u = 0 in -1..1
state x = 1 in -10..10
disturbance w ~ normal(0, 0.3)
eq d/dt x = (u + w)*1[1/h] - k*x
observe x noise normal(0, 0.01)
reward r = -x^2
fail low when x < -2
success calm when abs(x) < 1e-3
episode { step = 0.5 [h], max_steps = 12 }
"""


def episode(env, state, actions, **options):
    """States, observations and rewards of single steps, as a rollout gives them."""
    observation, _ = env.reset(seed=options.pop("seed", 0), options={"state": state, **options})
    states, observations, rewards = [env.state], [observation], []
    end = (False, False)
    for action in actions:
        observation, reward, *end, _ = env.step(action)
        states.append(env.state)
        observations.append(observation)
        rewards.append(reward)
        if any(end):
            break
    return np.array(states), np.array(observations), np.array(rewards), tuple(end)


@pytest.mark.parametrize("name", ["reactor", "beer"])
def test_a_rollout_is_what_single_steps_give_to_the_bit(name):
    env = smpl.Env(name, normalize=False)
    model, rng = env.model, np.random.default_rng(5)
    count, horizon = 7, 9
    env.reset(seed=1)
    states = env.state * rng.uniform(0.98, 1.02, (count, len(model.state_names)))
    actions = rng.uniform(env.action_low, env.action_high, (count, horizon, len(model.action_names)))
    for threads in (1, 2):
        found = model.rollout(states, actions, threads=threads)
        for i in range(count):
            reached, _, rewards, end = episode(env, states[i], actions[i], start="nominal")
            taken = len(rewards)
            assert found.steps[i] == taken
            np.testing.assert_array_equal(found.states[i, : taken + 1], reached)
            np.testing.assert_array_equal(found.rewards[i, :taken], rewards)
            assert (found.terminated[i], found.truncated[i]) == end
            np.testing.assert_array_equal(
                found.states[i, taken:], np.broadcast_to(reached[-1], found.states[i, taken:].shape)
            )
            assert not found.rewards[i, taken:].any()


def test_states_of_a_linear_decay_are_those_of_its_closed_form():
    model = smpl.compile(source=NOISY, settings={"rtol": 1e-10})
    k, u = np.array([0.45, 0.5, 0.55]), np.array([[0.2], [-0.4], [0.9]])
    found = model.rollout([1.0], np.repeat(u[:, None, :], 6, axis=1), parameters={"k": k})
    t = 0.5 * np.arange(7)
    exact = u / k[:, None] + (1 - u / k[:, None]) * np.exp(-k[:, None] * t)
    np.testing.assert_allclose(found.states[:, :, 0], exact, rtol=1e-7)
    np.testing.assert_allclose(found.observations[:, :, 0], exact, rtol=1e-6)
    np.testing.assert_allclose(found.rewards, -(exact[:, 1:] ** 2), rtol=1e-6)


def test_with_a_seed_trajectory_i_is_the_episode_of_seed_plus_i():
    model = smpl.compile(source=NOISY)
    env = smpl.Env(model, normalize=False)
    actions = np.linspace(-0.3, 0.3, 8)[:, None]
    found = model.rollout([1.0], np.repeat(actions[None], 5, axis=0), seed=40)
    for i in range(5):
        reached, observed, rewards, _ = episode(env, [1.0], actions, seed=40 + i)
        np.testing.assert_array_equal(found.states[i], reached)
        np.testing.assert_array_equal(found.observations[i].astype(np.float32), observed)
        np.testing.assert_array_equal(found.rewards[i], rewards)
    assert len(np.unique(found.states[:, -1, 0])) == 5


def test_without_a_seed_nothing_is_random():
    model = smpl.compile(source=NOISY)
    found = model.rollout([1.0], np.zeros((3, 8, 1)))
    assert (found.states == found.states[0]).all()
    np.testing.assert_array_equal(found.states, found.observations)


def test_disturbances_are_replayed_for_all_or_for_each():
    model = smpl.compile(source=NOISY, settings={"rtol": 1e-10})
    w = np.array([[0.1] * 4, [-0.2] * 4])
    found = model.rollout([1.0], np.zeros((2, 4, 1)), disturbances={"w": w})
    exact = w[:, :1] / 0.5 + (1 - w[:, :1] / 0.5) * np.exp(-0.25 * np.arange(5))
    np.testing.assert_allclose(found.states[:, :, 0], exact, rtol=1e-7)
    one = model.rollout([1.0], np.zeros((2, 4, 1)), disturbances={"w": -0.2})
    np.testing.assert_array_equal(one.states[0], found.states[1])


def test_a_trajectory_ends_by_failure_success_or_the_limit_and_rests_there():
    model = smpl.compile(source=NOISY)
    states = np.array([[-1.9], [5e-4], [1.0]])
    actions = np.repeat(np.array([-1.0, 0.0, 0.5])[:, None, None], 20, axis=1)
    found = model.rollout(states, actions, parameters={"k": [0.4, 0.5, 0.5]})
    assert found.failure[0].startswith("low") and found.failure[1:] == ["", ""]
    assert found.terminated.tolist() == [True, True, False]
    assert found.truncated.tolist() == [False, False, True]
    assert found.steps.tolist() == [1, 1, 12]
    assert (found.states[:, 12:] == found.states[:, 12:13]).all()
    assert found.cost[0, 0] > 0 and not found.cost[0, 1:].any()
    assert found.constraint_names == ("action_box", "low") and found.violations.shape == (3, 20, 2)


def test_the_clock_begins_at_the_first_step():
    source = """model Clock
time t : h
state x = 0 in 0..1e3
eq d/dt x = t*1[1/h^2]
observe x in 0..1e3
reward r = n
episode { step = 1 [h], max_steps = 10 }
"""
    model = smpl.compile(source=source, settings={"rtol": 1e-9})
    found = model.rollout([0.0], np.zeros((6, 0)), first_step=4)
    t = 4 + np.arange(7)
    np.testing.assert_allclose(found.states[0, :, 0], (t**2 - 16) / 2, rtol=1e-8)
    assert found.truncated[0] and found.steps[0] == 6
    with pytest.raises(ValueError, match="first step is 10, and the time limit 10"):
        model.rollout([0.0], np.zeros((6, 0)), first_step=10)


def test_an_environment_rolls_out_from_where_it_is_and_stays_there():
    env = smpl.Env("pensim", normalize=False)
    env.reset(seed=3)
    for _ in range(5):
        env.step(env.policy("recipe") if "recipe" in env.model.policies else env.model.native.defaults("action"))
    before = env.state
    actions = np.repeat(env.model.native.defaults("action")[None, None], 4, axis=1)
    expected = env.rollout(actions)
    assert (env.state == before).all() and env.time == pytest.approx(5 * env.model.step)
    again = env.rollout(actions, threads=1)
    np.testing.assert_array_equal(expected.states, again.states)
    np.testing.assert_array_equal(expected.states[0, 0], before)


def test_outputs_belong_to_their_states():
    source = """model Two
time t : h
action u = 0 in -1..1
state x = 1 in -10..10
var z in -10..10
eq z + 0.1*z^3 = x + u
eq d/dt x = -z*1[1/h]
observe x
reward r = z
episode { step = 1 [h], max_steps = 10 }
"""
    found = smpl.compile(source=source, settings={"rtol": 1e-9}).rollout([1.0], [[0.5], [-0.5]], outputs=True)
    z, x = found.outputs[0, 1:, 0], found.states[0, 1:, 0]
    np.testing.assert_allclose(z + 0.1 * z**3, x + np.array([0.5, -0.5]), rtol=1e-6)
    np.testing.assert_allclose(found.rewards[0], z, rtol=1e-6)


def test_a_start_without_a_solution_is_a_failure_of_its_trajectory_alone():
    source = """model Root
time t : h
state x = 1 in -10..10
var z = 1 in 0..10
eq z^2 = x
eq d/dt x = -z*0.1[1/h]
observe x
reward r = z
episode { step = 1 [h], max_steps = 10 }
"""
    found = smpl.compile(source=source).rollout([[4.0], [-1.0]], np.zeros((2, 3, 0)))
    assert found.failure[0] == "" and found.failure[1].startswith("start: ")
    assert np.isnan(found.states[1]).all() and np.isfinite(found.states[0]).all()
    assert found.steps.tolist() == [3, 0] and found.terminated.tolist() == [False, True]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"states": [1.0, 2.0]}, r"states has shape \(2,\), expected \(N, 1\) or \(1,\)"),
        ({"states": [[1.0], [np.nan]]}, r"states\[1, 0\] is nan"),
        ({"states": "a"}, "states is 'a'"),
        ({"actions": np.zeros((3, 4))}, r"actions has shape \(3, 4\), expected \(N, H, 1\) or \(H, 1\)"),
        ({"actions": [[[0.0], [np.nan]]]}, r"actions\[0, 1, 0\] is nan"),
        ({"states": np.ones((2, 1)), "actions": np.zeros((3, 4, 1))}, "states has 2 trajectories, expected 3"),
        ({"parameters": {"kk": 1.0}}, "unknown 'kk'"),
        ({"parameters": {"k": [1.0, 2.0, 3.0]}}, r"parameters\['k'\] has shape \(3,\)"),
        ({"parameters": {"k": 7.0}}, "k"),
        ({"parameters": 3}, "parameters must be a mapping"),
        ({"disturbances": {"w": [0.0]}}, r"disturbances\['w'\] has shape \(1,\), expected \(\) or \(4,\)"),
        ({"discrete": {"d": 0}}, "unknown 'd'"),
        ({"seed": 1.5}, "seed is 1.5"),
        ({"threads": -1}, "threads is -1"),
        ({"first_step": -1}, "first_step is -1"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(arguments, message):
    model = smpl.compile(source=NOISY)
    given = {"states": [1.0], "actions": np.zeros((4, 1)), **arguments}
    with pytest.raises((ValueError, TypeError), match=message):
        model.rollout(**given)


CAUSES = """model Causes
time t : h
action u = 0 in -1..1
state x = 1 in -10..10
eq d/dt x = (if u > 3 then sqrt(-1 - x*x) else u)*1[1/h]
observe x
reward r = x
fail startup when x > 1.4
fail low event x < 0.2
episode { step = 1 [h], max_steps = 10 }
"""


@pytest.mark.parametrize(
    ("action", "kind", "name"),
    [
        (0.0, "", ""),
        (0.5, "condition", "startup"),
        (-0.9, "event", "low"),
        (1.5, "action_box", ""),
        (4.0, "solver", ""),  # also outside of the action's box: the step was undone
    ],
)
def test_the_cause_of_a_failure_is_data(action, kind, name):
    model = smpl.compile(source=CAUSES)
    found = model.rollout([1.0], [[[action]]])
    assert (found.failure_kind, found.failure_name) == ([kind], [name])
    env = smpl.Env(model, normalize=False)
    env.reset(options={"state": [1.0]})
    env.step([action])
    assert (env.unwrapped._native.failure_kind, env.unwrapped._native.failure_name) == (kind, name)


def test_a_start_without_a_solution_is_a_kind_of_failure():
    source = CAUSES.replace("action u = 0 in -1..1\n", "action u = 0 in -1..1\nvar z = 1 in 0..10\n")
    source = source.replace("eq d/dt x", "eq z^2 = x\neq d/dt x")
    found = smpl.compile(source=source).rollout([[1.0], [-1.0]], np.zeros((2, 1, 1)))
    assert found.failure_kind == ["", "start"]
