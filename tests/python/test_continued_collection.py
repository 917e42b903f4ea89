"""Data sets that are continued, compared with another collection, or damaged."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import smpl
from smpl.controllers import PID, Function, Loops, Noisy, Proportional, Recorded
from smpl.datasets import DatasetError, collect, load
from smpl.datasets.store import Manifest
from smpl.learning import Agent

arrow = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")


class Batched:
    """A policy of another package: a batch of observations in, actions and no state out."""

    def predict(self, observations, state=None, episode_start=None, deterministic=False):
        return np.tanh(observations[:, :2]), None


def test_parts_that_were_changed_by_hand_are_refused(tmp_path):
    collect("reactor", "pid", 4, tmp_path / "set", part=2, max_steps=5)
    first, second = (tmp_path / f"set/part-00000{i}.parquet" for i in range(2))
    kept = first.read_bytes()
    first.write_bytes(second.read_bytes())
    with pytest.raises(DatasetError, match=r"part-000000\.parquet is damaged .its episodes are not those from 0 on"):
        load(tmp_path / "set")[0]
    first.write_bytes(kept)
    table = arrow.read_table(first)
    rewards = table.column("reward").to_numpy().copy()
    rewards[2] = np.inf
    place = table.column_names.index("reward")
    pyarrow = pytest.importorskip("pyarrow")
    for changed, says in (
        (
            table.set_column(place, "reward", pyarrow.array(rewards, mask=np.isnan(rewards))),
            "rewards, row 2, is not fi",
        ),
        (table.take([0, 2, 1, *range(3, table.num_rows)]), "steps of an episode do not follow one another"),
    ):
        arrow.write_table(changed.replace_schema_metadata(table.schema.metadata), first)
        with pytest.raises(DatasetError, match=f"part-000000.parquet is damaged .*{says}"):
            load(tmp_path / "set")[0]


def test_parts_of_another_collection_and_parts_that_lost_rows_are_refused(tmp_path):
    for name, seed in (("set", 0), ("other", 50)):
        collect("reactor", "pid", 4, tmp_path / name, part=2, max_steps=5, seed=seed)
    part = tmp_path / "set/part-000001.parquet"
    kept = part.read_bytes()
    part.write_bytes((tmp_path / "other/part-000001.parquet").read_bytes())
    with pytest.raises(DatasetError, match=r"part-000001\.parquet is of another collection .*: remove it"):
        list(load(tmp_path / "set"))
    with pytest.raises(DatasetError, match=r"part-000001\.parquet is of another collection: remove it"):
        collect("reactor", "pid", 4, tmp_path / "set", max_steps=5)
    part.write_bytes(kept)
    table = arrow.read_table(part)
    rows = table.num_rows
    for count, says in ((rows - 2, "an episode has no end"), (rows // 2, "its episodes are not those")):
        arrow.write_table(table.slice(0, count).replace_schema_metadata(table.schema.metadata), part)
        with pytest.raises(DatasetError, match=f"is damaged .{says}"):
            list(load(tmp_path / "set"))


def test_arguments_that_say_what_holds_anyway_make_no_other_data_set(tmp_path):
    env = smpl.Env("reactor")
    collect("reactor", "pid", 2, tmp_path)
    anyway = {"normalize": True, "max_steps": env.max_steps, "dense_reward": True}
    for given, arguments in ((env, {}), ("reactor", anyway)):
        assert len(load(tmp_path, given, **arguments)) == len(collect(given, "pid", 2, tmp_path, **arguments)) == 2
    with pytest.raises(ValueError, match="settings: arguments of an environment, and none is given"):
        load(tmp_path, settings={"spread": 0.1})
    (tmp_path / "file").write_text("")
    with pytest.raises(DatasetError, match="file is not a folder"):
        collect("reactor", "pid", 2, tmp_path / "file")


@pytest.mark.parametrize(("key", "value"), [("part", 0), ("part", "a"), ("episodes", None), ("names", {})])
def test_a_manifest_that_cannot_be_meant_is_damaged(key, value, tmp_path):
    collect("reactor", "pid", 2, tmp_path, max_steps=5)
    content = json.loads((tmp_path / "dataset.json").read_text())
    (tmp_path / "dataset.json").write_text(json.dumps({**content, key: value}))
    for call in (load, lambda folder: collect("reactor", "pid", 2, folder, max_steps=5)):
        with pytest.raises(DatasetError, match=r"dataset\.json is damaged"):
            call(tmp_path)


def test_a_data_set_of_other_arguments_says_which(tmp_path):
    collect("reactor", "pid", 2, tmp_path, max_steps=5, reward="setpoint")
    load(tmp_path, "reactor", max_steps=5, reward="setpoint")
    with pytest.raises(DatasetError, match=r"with other arguments \(reward: setpoint there, None here\)"):
        load(tmp_path, "reactor", max_steps=5)
    with pytest.raises(
        DatasetError, match=r"other arguments \(scenario: None there, legacy here; max_steps: 5 there, 6 here\)"
    ):
        load(tmp_path, "reactor", max_steps=6, reward="setpoint", scenario="legacy")


def test_what_was_killed_goes_on_where_it_was(tmp_path):
    folder, whole = tmp_path / "killed", tmp_path / "whole"
    command = [
        sys.executable,
        "-m",
        "smpl.collect",
        "reactor",
        "--controller",
        "test_collection:Slow",
        "--episodes",
        "20",
    ]
    command += ["--part", "2", "--workers", "1", "--max-steps", "20", "--quiet", "--out"]
    paths = [str(Path(__file__).parent), *sys.path]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    process = subprocess.Popen([*command, str(folder)], env=environment)
    deadline = time.monotonic() + 120
    while len(list(folder.glob("part-*.parquet"))) < 2 and time.monotonic() < deadline:
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    parts = sorted(folder.glob("part-*.parquet"))
    assert 2 <= len(parts) < 10
    assert len(load(folder)) == 2 * len(parts)  # what is there opens
    before = {part: part.stat().st_mtime_ns for part in parts}
    for out in (folder, whole):
        subprocess.run([*command, str(out)], env=environment, check=True)
    assert {part: part.stat().st_mtime_ns for part in parts} == before
    assert [p.read_bytes() for p in sorted(folder.glob("p*"))] == [p.read_bytes() for p in sorted(whole.glob("p*"))]
    assert not list(folder.glob(".*"))


def test_more_episodes_are_added_to_those_that_are_there(tmp_path):
    collect("reactor", "pid", 3, tmp_path, part=2, max_steps=5)
    assert len(collect("reactor", "pid", 5, tmp_path, max_steps=5)) == 5
    assert [one.seed for one in load(tmp_path)] == [0, 1, 2, 3, 4]


def test_fewer_episodes_leave_those_that_are_there(tmp_path):
    collect("reactor", "pid", 7, tmp_path, part=2, max_steps=5)
    for asked in (3, 4):
        with pytest.warns(UserWarning, match=rf"is a data set of 7 episodes, which stay: {asked} were asked for"):
            assert len(collect("reactor", "pid", asked, tmp_path, max_steps=5)) == 7
    assert load(tmp_path).complete
    # What earlier versions wrote: `dataset.json` of fewer episodes than there are.
    Manifest.write(replace(load(tmp_path).manifest, episodes=3), tmp_path)
    with pytest.warns(UserWarning, match=r"part-000002.parquet has more than the 3 episodes of dataset.json"):
        kept = load(tmp_path)
    assert [one.seed for one in kept] == [0, 1] and len(kept.damaged) == 3
    assert len(collect("reactor", "pid", 7, tmp_path, max_steps=5)) == 7


def test_a_part_that_is_missing_before_others_is_named(tmp_path):
    collect("reactor", "pid", 6, tmp_path, part=2, max_steps=5)
    (tmp_path / "part-000001.parquet").unlink()
    with pytest.warns(UserWarning, match=r"part-000001.parquet is missing, though part-000002.parquet is there"):
        kept = load(tmp_path)
    assert [one.seed for one in kept] == [0, 1, 4, 5] and list(kept.damaged) == ["part-000001.parquet"]
    assert not kept.complete
    (tmp_path / "part-000002.parquet").unlink()
    cut = load(tmp_path)  # as one that was cut off, or still runs
    assert [one.seed for one in cut] == [0, 1] and not cut.complete and not cut.damaged
    with pytest.warns(UserWarning, match="6 episodes, which stay: 3 were"):
        assert [one.seed for one in collect("reactor", "pid", 3, tmp_path, max_steps=5)] == [0, 1, 2, 3]
    assert len(collect("reactor", "pid", 6, tmp_path, max_steps=5)) == 6


def test_another_data_set_in_the_folder_is_refused(tmp_path):
    collect("reactor", "pid", 2, tmp_path, max_steps=5)
    for arguments in ({"seed": 1}, {"scenario": "legacy"}, {"noise": 0.1}, {"starts": "grid:0.1:2"}):
        with pytest.raises(
            DatasetError, match=f"another data set .*{next(iter(arguments)).replace('scenario', 'checksum')}"
        ):
            collect("reactor", "pid", 2, tmp_path, **{"max_steps": 5, **arguments})
    with pytest.raises(DatasetError, match=r"gain_concentration: 100.0 there, 50.0 here"):
        collect("reactor", Proportional(50.0), 2, tmp_path, max_steps=5)
    collect("reactor", "pid", 2, tmp_path / "thinned", max_steps=5, states=["T", "h"])
    with pytest.raises(DatasetError, match=r"states: \['T', 'h'\] there, \['c_A', 'T'\] here"):
        collect("reactor", "pid", 4, tmp_path / "thinned", max_steps=5, states=["c_A", "T"])


class Held(Recorded):
    """An action that is held in a mapping."""

    def __init__(self, coolant):
        self.actions = {"T_c": coolant, "q_out": 0.1}

    def action(self, env):
        return [self.actions[name] for name in env.action_names]


class Unknown:
    """A controller whose constructor arguments are not recorded."""

    def __init__(self, coolant):
        self.coolant = coolant

    def reset(self, env):
        pass

    def action(self, env):
        return [self.coolant, 0.1]


def test_a_controller_that_holds_others_goes_on_and_a_changed_one_is_refused(tmp_path):
    def loops(gain):
        return Loops(PID("T", "T_c", gain=-gain), others={"q_out": 0.1})

    collect("reactor", loops(1.0), 2, tmp_path / "loops", max_steps=5)
    assert len(collect("reactor", loops(1.0), 3, tmp_path / "loops", max_steps=5)) == 3
    with pytest.raises(DatasetError, match=r"settings: loops\[0\]\.gain: -1\.0 there, -2\.0 here"):
        collect("reactor", loops(2.0), 4, tmp_path / "loops", max_steps=5)
    given = {"max_steps": 5, "workers": 1}
    collect("reactor", Held(26.0), 2, tmp_path / "held", **given)
    assert len(collect("reactor", Held(coolant=26.0), 3, tmp_path / "held", **given)) == 3
    with pytest.raises(DatasetError, match=r"settings: coolant: 26\.0 there, 27\.0 here"):
        collect("reactor", Held(27.0), 4, tmp_path / "held", **given)
    assert len(load(tmp_path / "held")) == 3


@pytest.mark.parametrize(
    ("controller", "says"),
    [
        (lambda observation: [0.1, 0.2], r"the controller is the anonymous function <lambda>: define it at the top"),
        (Function(lambda state: [26.0, 0.1]), r"function is the anonymous function <lambda>"),
        (
            Noisy(Unknown(26.0), {"T_c": 0.1}),
            r"arguments of controller \(test_continued_collection.Unknown\) are unknown: derive",
        ),
        (
            Unknown(26.0),
            r"the constructor arguments of Unknown .* are unknown: derive the class from smpl.controllers.R",
        ),
    ],
)
def test_a_controller_that_cannot_be_compared_is_collected_once_and_not_continued(controller, says, tmp_path):
    given = {"max_steps": 5, "workers": 1}
    assert len(collect("reactor", controller, 2, tmp_path / "set", **given)) == 2
    with pytest.raises(DatasetError, match=rf"set has episodes already, and whether .* is unknown: \w+: .*{says}"):
        collect("reactor", controller, 3, tmp_path / "set", **given)
    assert len(load(tmp_path / "set")) == 2
    # The way out that the message names.
    for version, count in (("1", 2), ("1", 3)):
        agent = Agent("mine", controller, version=version)
        assert len(collect("reactor", agent, count, tmp_path / "versioned", **given)) == count
    with pytest.raises(DatasetError, match=r"settings: version: 1 there, 2 here"):
        collect("reactor", Agent("mine", controller, version=2), 4, tmp_path / "versioned", **given)


def test_another_policy_under_the_same_file_name_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("smpl.learning.agents.load_policy", lambda spec: Batched())
    file = tmp_path / "policy.pt"
    file.write_bytes(b"one")
    collect("reactor", str(file), 2, tmp_path / "set", max_steps=5)
    assert len(collect("reactor", str(file), 3, tmp_path / "set", max_steps=5)) == 3
    file.write_bytes(b"two")
    with pytest.raises(DatasetError, match=r"another data set .*settings"):
        collect("reactor", str(file), 3, tmp_path / "set", max_steps=5)


def test_a_data_set_of_another_version_of_the_model_is_refused(tmp_path):
    text = (
        'model Tank "t"\ntime t : h\nparam k : 1/h = 0.5\naction q : m/h = 0 in 0..1 "flow"\n'
        'state h : m = 1 in 0..5 "level"\neq d/dt h = q - k*h\nobserve h\nreward r default = h / 1 [m]\n'
        "episode { step = 0.5 [h], max_steps = 3, error_reward = 0 }\n"
    )
    model = tmp_path / "tank.eq"
    model.write_text(text)
    collect(model, "nominal", 2, tmp_path / "set")
    load(tmp_path / "set", model)
    model.write_text(text.replace("= 0.5\n", "= 0.6\n"))
    with pytest.raises(DatasetError, match="another version of Tank"):
        load(tmp_path / "set", model)
    with pytest.raises(DatasetError, match="checksum"):
        collect(model, "nominal", 2, tmp_path / "set")
    with pytest.raises(DatasetError, match="other observations: h; now c_A"):
        load(tmp_path / "set", "reactor")


def test_a_damaged_part_is_named_and_can_be_left_out(tmp_path):
    collect("reactor", "pid", 6, tmp_path, part=2, max_steps=30)
    part = tmp_path / "part-000001.parquet"
    data = bytearray(part.read_bytes())
    data[len(data) // 3] ^= 0xFF
    part.write_bytes(data)
    with pytest.raises(DatasetError, match=r"part-000001\.parquet is damaged"):
        list(load(tmp_path))
    kept = load(tmp_path, skip_damaged=True)
    assert [one.seed for one in kept] == [0, 1, 4, 5] and list(kept.damaged) == [part.name]
    part.write_bytes(data[:100])
    with pytest.raises(DatasetError, match=r"part-000001\.parquet is damaged.*skip_damaged"):
        load(tmp_path)
    part.unlink()
    collect("reactor", "pid", 6, tmp_path, max_steps=30)
    assert [one.seed for one in load(tmp_path)] == list(range(6))


def test_a_full_disk_leaves_a_data_set_that_opens(tmp_path, monkeypatch):
    real, calls = os.fsync, []

    def full(descriptor):
        calls.append(descriptor)
        if len(calls) > 4:  # the manifest and the first part, each with its folder
            raise OSError(errno.ENOSPC, "No space left on device")
        real(descriptor)

    monkeypatch.setattr("smpl.datasets.store.os.fsync", full)
    with pytest.raises(DatasetError, match=r"the disk is full.* has 1 of 3 parts"):
        collect("reactor", "pid", 6, tmp_path, part=2, max_steps=5)
    assert len(load(tmp_path)) == 2 and not list(tmp_path.glob(".*"))
    monkeypatch.undo()
    assert len(collect("reactor", "pid", 6, tmp_path, max_steps=5)) == 6
