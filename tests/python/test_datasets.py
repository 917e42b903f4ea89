"""Grids, layouts and exports of data sets."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import smpl
from smpl.controllers import Proportional, Uniform
from smpl.datasets import d3rlpy_arrays, initial_grid, legacy_rows, to_d3rlpy, to_minari, transitions
from smpl.evaluation import evaluate

SET_POINT = [0.8778252005501434, 51.34660619295078, 0.659]
HOT = [0.99, 66.0, 0.6]


@pytest.fixture(scope="module")
def episodes():
    """One episode that times out and one that fails."""
    env = smpl.Env("reactor", max_steps=20)
    return evaluate(env, Proportional(), starts=[SET_POINT, HOT])


def test_the_grid_varies_the_first_state_fastest_and_covers_the_spread():
    grid = initial_grid(SET_POINT, 0.3, 10)
    assert grid.shape == (1000, 3)
    np.testing.assert_allclose(grid[0], 0.7 * np.array(SET_POINT))
    np.testing.assert_allclose(grid[-1], 1.3 * np.array(SET_POINT))
    assert grid[1, 0] > grid[0, 0] and grid[1, 1] == grid[0, 1]
    # The specification: 26 to 30 % of an unclipped grid has c_A > 1.
    assert 0.26 <= np.mean(grid[:, 0] > 1.0) <= 0.30
    assert initial_grid(SET_POINT, 0.3, 10, [0, 0, 0], [1, 100, 1])[:, 0].max() == 1.0


def test_the_default_layout_has_one_row_a_step(episodes):
    rows = transitions(episodes)
    steps = sum(episode.steps for episode in episodes)
    assert len(rows.rewards) == len(rows.observations) == len(rows.next_observations) == steps
    np.testing.assert_array_equal(rows.next_observations[0], rows.observations[1])
    assert episodes[1].failure and rows.terminations[-1] and not rows.truncations[-1]
    assert rows.truncations[19] and not rows.terminations[19]


def test_the_legacy_layout_is_one_row_late_and_has_one_row_more(episodes):
    rows = legacy_rows(episodes)
    first = episodes[0]
    assert np.sum(rows.episodes == 0) == first.steps + 1
    assert rows.rewards[0] == 0.0 and not rows.terminals[0]
    np.testing.assert_array_equal(rows.rewards[1 : first.steps + 1], first.rewards)
    np.testing.assert_array_equal(rows.observations[: first.steps + 1], first.observations)
    assert rows.terminals[first.steps] and rows.timeouts[first.steps]


def test_no_transition_of_a_truncated_episode_is_lost_for_d3rlpy(episodes):
    arrays = d3rlpy_arrays(episodes)
    steps = [episode.steps for episode in episodes]
    assert len(arrays["rewards"]) == steps[0] + 1 + steps[1]
    np.testing.assert_array_equal(np.flatnonzero(arrays["timeouts"]), [steps[0]])
    np.testing.assert_array_equal(np.flatnonzero(arrays["terminals"]), [steps[0] + steps[1]])
    np.testing.assert_array_equal(arrays["observations"][steps[0]], episodes[0].observations[-1])
    assert not np.any(arrays["terminals"] * arrays["timeouts"])


def test_d3rlpy_takes_the_export(episodes):
    pytest.importorskip("d3rlpy", reason="d3rlpy is not installed")
    assert to_d3rlpy(episodes).transition_count == sum(episode.steps for episode in episodes)


def test_an_episode_is_replayed_bit_for_bit():
    env = smpl.Env("reactor", max_steps=20)
    for episode in [*evaluate(env, Uniform(), 2, seed=3), *evaluate(env, Proportional(), starts=[SET_POINT, HOT])]:
        other = smpl.Env("reactor", max_steps=20)
        observations = [other.reset(seed=episode.seed, options=episode.options)[0]]
        # As stored: single precision, from a data set's rows.
        actions = np.array(transitions([episode]).actions.astype(np.float32).tolist(), dtype=np.float32)
        steps = [other.step(action) for action in actions]
        observations += [step[0] for step in steps]
        np.testing.assert_array_equal(np.stack(observations), episode.observations)
        np.testing.assert_array_equal([step[1] for step in steps], episode.rewards)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((SET_POINT, 0.3, 0), "points is 0, expected a positive integer"),
        ((SET_POINT, 0.3, 2.5), r"points is 2\.5"),
        ((SET_POINT, float("nan"), 2), "spread is nan"),
        (([SET_POINT], 0.3, 2), r"centre has shape \(1, 3\)"),
        (("abc", 0.3, 2), "centre is 'abc', expected numbers"),
        ((SET_POINT, "x", 2), "spread is 'x', expected a number"),
    ],
)
def test_a_grid_of_nothing_is_refused(arguments, says):
    with pytest.raises(ValueError, match=says):
        initial_grid(*arguments)


def test_minari_takes_the_export(episodes, tmp_path, monkeypatch):
    pytest.importorskip("minari", reason="Minari is not installed")
    pytest.importorskip("h5py", reason="h5py is not installed")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    dataset = to_minari(
        "smpl/reactor/pid-v0", episodes, "smpl/Reactor-v0", algorithm_name="pid", author="a", author_email="a@b.c",
        code_permalink="p", eval_env="smpl/Reactor-v0", description="d", ref_min_score=-1e5, ref_max_score=0.0,
    )  # fmt: skip
    assert dataset.total_steps == sum(episode.steps for episode in episodes)
    np.testing.assert_array_equal(dataset[1].observations, episodes[1].observations)
    # What is stored gives the same episodes again.
    env = smpl.Env("reactor", max_steps=20)
    for stored in dataset.iterate_episodes():
        (start,) = dataset.storage.get_episode_metadata([stored.id])
        observations = [env.reset(seed=start["seed"], options=start["options"])[0]]
        steps = [env.step(action) for action in stored.actions]
        np.testing.assert_array_equal([*observations, *(step[0] for step in steps)], stored.observations)
        np.testing.assert_array_equal([step[1] for step in steps], stored.rewards)


def test_an_environment_that_shows_other_observations_is_told_with_their_name(episodes):
    from smpl.datasets.exports import _warn_unless_repeated

    env, first = smpl.Env("reactor", max_steps=20), episodes[0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _warn_unless_repeated(env, first)
    shown = first.observations.copy()
    shown[2, 1] += 0.5
    with pytest.warns(
        UserWarning, match=rf"after 2 steps the observation {env.observation_names[1]} is .*, recorded is"
    ):
        _warn_unless_repeated(env, replace(first, observations=shown))
    with pytest.warns(UserWarning, match=r"step 1 gives the reward"):
        _warn_unless_repeated(env, replace(first, rewards=first.rewards + 1))


def test_costs_stand_in_the_row_of_the_instant_and_rewards_in_that_of_their_step(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    text = """
model Filling
action q : m/s = 1 in 0..2
state h : m = 0 in 0..10
eq d/dt h = q
observe h
reward level default = h / 1 [m]
constraint full when h > 2 [m]
episode { step = 1 [s], max_steps = 4, error_reward = -1 }
"""
    smpl.datasets.collect(smpl.Env(smpl.compile(source=text)), "constant:1", 1, tmp_path / "data")
    table = parquet.read_table(tmp_path / "data" / "part-000000.parquet").to_pydict()
    np.testing.assert_allclose(table["reward"][:-1], [1, 2, 3, 4], rtol=1e-6)
    assert table["reward"][-1] is None
    # Levels 0, 1, 2, 3, 4 m; the excess over 2 m is over the range of 10 m.
    np.testing.assert_allclose(table["cost"], [0, 0, 0, 0.1, 0.2], atol=1e-6)
    assert table["violation.full"] == table["cost"]
