"""Trajectories against the reference files of independent implementations, actions replayed in open loop."""

import numpy as np
import pytest

import smpl

METHODS = ["ida", "rosenbrock", "explicit", "auto"]
REACTOR = ["c_A", "T", "h"]
REACTOR_RANGES = np.array([1.0, 100.0, 1.0])
BEER = ["X_A", "X_L", "X_D", "S", "EtOH", "DY", "EA"]
BEER_RANGES = np.array([15.0, 15.0, 15.0, 150.0, 150.0, 10.0, 10.0])


def columns(table, names, suffix):
    return np.stack([table[f"{name}.{suffix}"] for name in names], axis=1)


def replay(env, start, actions):
    """States, rewards and the last step's result of an episode with recorded actions."""
    env.reset(options={"state": start})
    states, rewards, last = [env.state], [], None
    for action in actions:
        last = env.step(action)
        states.append(env.state)
        rewards.append(last[1])
        if last[2] or last[3]:
            break
    return np.array(states), np.array(rewards), last


@pytest.mark.parametrize(
    ("name", "failure"),
    [
        ("reactor_1", "state_box"),
        ("reactor_2", ""),
        ("reactor_3", ""),
        ("reactor_extra_ignition", "state_box"),
        ("reactor_extra_steady", ""),
        ("reactor_extra_mpc", ""),
    ],
)
@pytest.mark.parametrize("method", METHODS)
def test_the_reactor_follows_the_reference(reference, name, failure, method):
    table = reference(f"{name}.csv")
    expected = columns(table, REACTOR, "tight")
    actions = np.stack([table["T_c"], table["q_out"]], axis=1)[1:]
    env = smpl.Env("reactor", normalize=False, scenario="legacy", method=method)
    states, rewards, last = replay(env, expected[0], actions)
    assert len(states) == len(expected)
    rows = len(states) - 1 if failure else len(states)
    error = np.abs(states - expected)[:rows] / REACTOR_RANGES
    assert error.max() < 1e-6
    assert last[4]["failure"].startswith(failure) and bool(last[4]["failure"]) == bool(failure)
    assert last[2] == bool(failure)
    # A reward divides the error of a state by its initial distance from the set-point.
    tolerance = 1e-4 * np.abs(table["setpoint.tight"][1:rows]) + 1e-7
    if name != "reactor_extra_steady":
        assert np.all(np.abs(rewards[: rows - 1] - table["setpoint.tight"][1:rows]) <= tolerance)


def test_the_reactor_runs_empty_where_the_reference_does(reference):
    table = reference("reactor_extra_drain.csv")
    actions = np.stack([table["T_c"], table["q_out"]], axis=1)[1:]
    states, _, last = replay(smpl.Env("reactor", normalize=False), columns(table, REACTOR, "tight")[0], actions)
    assert len(states) - 1 == 10
    assert last[2] and last[4]["failure"].startswith("empty")


@pytest.mark.parametrize(("scenario", "ends"), [("legacy", True), ("default", False)])
def test_the_reward_floor_ends_an_episode_in_legacy_only(reference, scenario, ends):
    table = reference("reactor_extra_floor.csv")
    env = smpl.Env("reactor", normalize=False, scenario=scenario)
    start = columns(table, REACTOR, "tight")[0]
    if not ends:
        start = env.model.steady_state([26.85, 0.1], fixed={"h": 0.659})
    _, rewards, last = replay(env, start, [[26.85, 0.2]])
    assert rewards[0] == -1000.0
    assert last[2] == ends
    assert last[4]["failure"].startswith("reward_floor" if ends else "")


@pytest.mark.parametrize(
    "name", ["beer_1", "beer_2", "beer_3", "beer_extra_const13", "beer_extra_lowsugar", "beer_extra_sampled"]
)
@pytest.mark.parametrize(("scenario", "suffix"), [("default", "tight1h"), ("legacy", "tight")])
@pytest.mark.parametrize("method", METHODS)
def test_the_beer_follows_the_reference(reference, name, scenario, suffix, method):
    table = reference(f"{name}.csv")
    expected = columns(table, BEER, suffix)
    env = smpl.Env("beer", normalize=False, scenario=scenario, method=method)
    states, rewards, last = replay(env, expected[0], table["T"][1:, np.newaxis])
    error = np.abs(states - expected[: len(states)]) / BEER_RANGES
    assert error.max() < 1e-6
    np.testing.assert_array_equal(rewards, table[f"finish.{suffix}"][1 : len(states)])
    assert last[2] and last[4]["success"]
    assert np.all(np.isnan(table[f"finish.{suffix}"][len(states) :]))
