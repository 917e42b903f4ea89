"""Exports to other packages, read back by them, and imports of the data sets of 2022."""

import csv
import os
import pickle
import sys
import warnings

import numpy as np
import pytest

import smpl
from smpl.controllers import Proportional
from smpl.datasets import DatasetError, from_legacy, from_pensim_csv, legacy_rows, to_d4rl, to_hdf5, to_minari, to_torch
from smpl.datasets.exports import memory_mapped
from smpl.evaluation import evaluate
from tank import DRAWN

SET_POINT = [0.8778252005501434, 51.34660619295078, 0.659]
HOT = [0.99, 66.0, 0.6]


@pytest.fixture(scope="module")
def episodes():
    """One episode that times out and one that fails."""
    env = smpl.Env("reactor", max_steps=20)
    return evaluate(env, Proportional(), starts=[SET_POINT, HOT])


def test_d4rl_has_one_row_a_step_and_no_row_with_both_flags(episodes):
    arrays = to_d4rl(episodes)
    steps = [episode.steps for episode in episodes]
    assert {len(values) for values in arrays.values()} == {sum(steps)}
    np.testing.assert_array_equal(np.flatnonzero(arrays["timeouts"]), [steps[0] - 1])
    np.testing.assert_array_equal(np.flatnonzero(arrays["terminals"]), [sum(steps) - 1])
    # Within an episode a row's next observation is the next row's.
    np.testing.assert_array_equal(arrays["next_observations"][: steps[0] - 1], arrays["observations"][1 : steps[0]])
    env = smpl.Env("reactor", max_steps=20)
    env.reset(seed=0, options={"state": SET_POINT})
    observation, reward, *_ = env.step(arrays["actions"][0])
    np.testing.assert_array_equal(observation, arrays["next_observations"][0])
    assert np.float32(reward) == arrays["rewards"][0]


def test_h5py_reads_what_was_written(episodes, tmp_path):
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    with h5py.File(to_hdf5(episodes, tmp_path / "set.hdf5")) as file:
        expected = to_d4rl(episodes)
        assert set(file) == set(expected)
        for key, values in expected.items():
            np.testing.assert_array_equal(file[key][()], values)
            assert file[key].dtype == values.dtype
    with pytest.raises(ValueError, match="empty"):
        to_hdf5([], tmp_path / "none.hdf5")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["set.hdf5"]


def test_what_is_mapped_into_memory_is_what_is_in_the_episodes(episodes, tmp_path):
    expected = to_d4rl(episodes)
    for key, values in memory_mapped(episodes, tmp_path).items():
        np.testing.assert_array_equal(values, expected[key].astype(np.float32))


def test_torch_takes_the_export(episodes, tmp_path):
    pytest.importorskip("torch", reason="torch is not installed")
    plain, mapped = to_torch(episodes), to_torch(episodes, tmp_path)
    assert len(plain) == len(mapped) == sum(episode.steps for episode in episodes)
    np.testing.assert_array_equal(plain[3][0].numpy(), episodes[0].observations[3])
    np.testing.assert_array_equal(mapped[3][3].numpy(), episodes[0].observations[4])


def test_a_collected_data_set_becomes_one_of_minari_with_costs_and_units(tmp_path, monkeypatch):
    pytest.importorskip("minari", reason="Minari is not installed")
    pytest.importorskip("h5py", reason="h5py is not installed")
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    dataset = smpl.datasets.collect("reactor", "pid", 3, tmp_path / "set", max_steps=20)
    texts = {"algorithm_name": "pid", "author": "a", "author_email": "a@b.c", "code_permalink": "p", "description": "d"}
    to_minari("smpl/reactor/collected-v0", dataset, "smpl/Reactor-v0", eval_env="smpl/Reactor-v0", **texts)
    import minari

    stored = minari.load_dataset("smpl/reactor/collected-v0")
    assert "degC" in stored.storage.metadata["smpl"]
    for one, expected in zip(stored.iterate_episodes(), dataset, strict=True):
        np.testing.assert_array_equal(one.observations, expected.observations)
        np.testing.assert_array_equal(one.rewards, expected.rewards)
        np.testing.assert_array_equal(one.infos["cost"], expected.costs)
        np.testing.assert_array_equal(one.infos["violations"]["state_box"], expected.details.violations["state_box"])
        np.testing.assert_array_equal(one.infos["rewards"]["setpoint"][1:], expected.rewards)


def test_a_data_set_of_a_model_of_ones_own_becomes_one_of_minari(tmp_path, monkeypatch):
    minari = pytest.importorskip("minari", reason="Minari is not installed")
    pytest.importorskip("h5py", reason="h5py is not installed")
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    path = tmp_path / "tank.eq"
    path.write_text(DRAWN, encoding="utf-8")
    dataset = smpl.datasets.collect(path, "random", 2, tmp_path / "set")
    to_minari("tank/random-v0", dataset, path)
    env = minari.load_dataset("tank/random-v0").recover_environment()
    first, _ = env.reset(seed=dataset[1].seed)
    np.testing.assert_array_equal(first, dataset[1].observations[0])
    observation, reward, *_ = env.step(dataset[1].actions[0].astype(np.float32))
    np.testing.assert_array_equal(observation, dataset[1].observations[1])
    assert reward == dataset[1].rewards[0]

    for other, says in (
        ("smpl/Reactor-v0", r"observations of shape \(1,\), the environment \(3,\)"),
        ("nowhere.eq", "nowhere.eq"),
        (smpl.Env(path, normalize=False), "recorded with normalize=True, the environment has False"),
    ):
        with pytest.raises((ValueError, OSError), match=says):
            to_minari("tank/other-v0", dataset, other)
    with pytest.raises(ValueError, match="episodes is empty"):
        to_minari("tank/other-v0", [], path)


def test_minari_is_not_given_an_environment_of_another_reward_or_scenario_without_a_word(tmp_path, monkeypatch):
    pytest.importorskip("minari", reason="Minari is not installed")
    pytest.importorskip("h5py", reason="h5py is not installed")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    recorded = smpl.Env("reactor", reward="setpoint_change")
    episodes = evaluate(recorded, Proportional(), episodes=2)
    with warnings.catch_warnings(record=True) as wording:
        warnings.simplefilter("always")
        to_minari("reactor/same-v0", episodes, recorded)
    assert not any("repeat" in str(one.message) for one in wording)  # Minari has some itself
    other = {"reward": "setpoint"}, {"reward": "setpoint_change", "settings": {"k_0": 7e10}}
    for number, arguments in enumerate(other):
        with pytest.warns(UserWarning, match="does not repeat the episodes"):
            to_minari(f"reactor/other-v{number}", episodes, smpl.Env("reactor", **arguments))


def test_a_missing_package_names_its_pip_install(episodes, tmp_path, monkeypatch):
    missing = ("h5py", "torch", "minari", "d3rlpy", "pyarrow")
    # What was imported before goes too: a module that is there is found without its package.
    loaded = [name for name in sys.modules if name.partition(".")[0] in missing]
    for module in (*missing, *loaded, "pyarrow.parquet"):
        monkeypatch.setitem(sys.modules, module, None)
    for call, says in (
        (lambda: to_hdf5(episodes, tmp_path / "a"), "pip install h5py"),
        (lambda: to_torch(episodes), "pip install torch"),
        (lambda: to_minari("a/b-v0", episodes, "smpl/Reactor-v0"), r"needs Minari: pip install minari h5py$"),
        (lambda: smpl.datasets.to_d3rlpy(episodes), r"pip install 'd3rlpy!=2.8.1'$"),
        (lambda: smpl.datasets.collect("reactor", "pid", 1, tmp_path / "b"), r"pip install pyarrow$"),
    ):
        with pytest.raises(ImportError, match=says):
            call()


def legacy_dictionary():
    """Two episodes as section 9 of the specification lays them out: a time-out after two steps, a failure after one."""
    return {
        "observations": np.array([[0.0], [1.0], [2.0], [10.0], [11.0]]),
        "actions": np.array([[0.1], [0.2], [9.9], [0.3], [9.9]]),
        "rewards": np.array([0.0, -1.0, -2.0, 0.0, -1000.0]),
        "terminals": np.array([False, False, True, False, True]),
        "timeouts": np.array([False, False, True, False, False]),
    }


def test_rows_of_2022_have_their_shift_undone(tmp_path):
    path = tmp_path / "set.pkl"
    path.write_bytes(pickle.dumps(legacy_dictionary()))
    first, second = from_legacy(path)
    np.testing.assert_array_equal(first.observations, np.float32([[0], [1], [2]]))
    np.testing.assert_array_equal(first.actions, np.float32([[0.1], [0.2]]))
    np.testing.assert_array_equal(first.rewards, [-1, -2])
    assert first.truncations.tolist() == [False, True] and not first.terminations.any() and not first.failure
    np.testing.assert_array_equal(second.rewards, [-1000])
    assert second.terminations.tolist() == [True] and second.failure and not second.truncations.any()


def test_the_layout_of_2022_comes_back_as_it_went(episodes):
    rows = legacy_rows(episodes)
    back = from_legacy({key: getattr(rows, key) for key in legacy_dictionary()})
    for one, expected in zip(back, episodes, strict=True):
        for name in ("observations", "actions", "rewards", "terminations", "truncations"):
            np.testing.assert_array_equal(getattr(one, name), getattr(expected, name))


class Bomb:
    def __reduce__(self):
        return os.system, ("echo this must not run",)


def test_faulty_data_sets_of_2022_are_refused(tmp_path):
    path = tmp_path / "set.pkl"
    cases = [
        (pickle.dumps(Bomb()), "asks for posix.system"),
        (b"garbage", "not a data set of 2022"),
        (pickle.dumps([1, 2]), "expected a dictionary with observations.* got list"),
        (pickle.dumps({**legacy_dictionary(), "rewards": np.zeros(4)}), "differ in length"),
        (
            pickle.dumps({**legacy_dictionary(), "rewards": np.array([0, np.nan, 0, 0, 0])}),
            "rewards, row 1, is not finite",
        ),
        (pickle.dumps({**legacy_dictionary(), "terminals": np.zeros(5, bool)}), "rows 3 to 4 .* without an end"),
    ]
    for content, says in cases:
        path.write_bytes(content)
        with pytest.raises(DatasetError, match=says):
            from_legacy(path)


HEADER = [
    "Time Step",
    "pH",
    "Temperature",
    "Acid flow rate",
    "Base flow rate",
    "Cooling water",
    "Heating water",
    "Vessel Weight",
    "Dissolved oxygen concentration",
    "Discharge rate",
    "Sugar feed rate",
    "Soil bean feed rate",
    "Aeration rate",
    "Back pressure",
    "Water injection/dilution",
    "Yield Per Step",
]


def write_batch(path, rows, header=HEADER):
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(rows)


def test_files_of_penicillin_pair_the_observation_before_with_action_and_reward_of_a_row(tmp_path):
    # Cell = 100 * row + column, so that each one shows its origin.
    rows = [[100.0 * row + column for column in range(len(HEADER))] for row in range(1150)]
    write_batch(tmp_path / "random_batch_0.csv", rows)
    write_batch(tmp_path / "random_batch_1.csv", rows[:3])
    whole, short = from_pensim_csv(tmp_path)
    assert whole.steps == 1149 and whole.terminations[-1] and whole.success and not whole.truncations.any()
    assert short.steps == 2 and short.truncations.tolist() == [False, True] and not short.success
    np.testing.assert_array_equal(short.observations, [[100 * row + column for column in range(9)] for row in range(3)])
    np.testing.assert_array_equal(short.actions, [[100 * row + column for column in range(9, 15)] for row in (1, 2)])
    np.testing.assert_array_equal(short.rewards, [115, 215])
    write_batch(tmp_path / "other.csv", [["a", *row[1:]] for row in rows[:3]])
    with pytest.raises(DatasetError, match=r"other.csv, line 2: 'a' is not a number"):
        from_pensim_csv(tmp_path / "other.csv")
    write_batch(tmp_path / "other.csv", rows[:3], ["Hour", *HEADER[1:]])
    with pytest.raises(DatasetError, match="no column time step"):
        from_pensim_csv([tmp_path / "other.csv"])
