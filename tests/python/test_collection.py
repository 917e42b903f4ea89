"""Collection of data sets: episodes, workers, starts, policies, refusals."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import smpl
from smpl.analysis.records import read_table
from smpl.controllers import Proportional
from smpl.datasets import DatasetError, collect, initial_grid, load
from smpl.evaluation import evaluate, run_episode
from smpl.learning import Plan, RunError, Settings, Starts, Task, run

arrow = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
FIELDS = ("observations", "states", "actions", "rewards", "terminations", "truncations", "costs", "times")


def assert_equal(one, other):
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert (one.seed, one.failure, one.success) == (other.seed, other.failure, other.success)


@pytest.mark.parametrize(
    ("env", "controllers", "options"),
    [
        ("reactor", "pid", {}),
        ("reactor", ["pid", "random"], {"noise": 0.1, "epsilon": 0.2, "weights": [3, 1]}),
        ("beer", "profile", {"max_steps": 30}),
        ("reactor", "constant:26,0.1", {"randomize": {"V_0": (0.001, 0.002)}}),
        ("reactor", ["nominal", "pid"], {"noise": 0.1}),
        ("atropine", ["mpc", "nominal"], {"max_steps": 6}),
        ("mab", "nominal", {"max_steps": 2}),
    ],
)
def test_a_native_batch_gives_the_same_bits_as_one_episode_after_the_other(env, controllers, options):
    task = Task.of(env, max_steps=options.pop("max_steps", None))
    plan = Plan.of(task, controllers, 70, seed=3, **options)
    batch = {job.index: one for job, one in run(plan, plan.jobs(0, 70), Settings())}
    single = {job.index: one for job, one in run(plan, plan.jobs(0, 70), Settings(batch=False))}
    assert sorted(batch) == sorted(single) == list(range(70))
    for index, one in single.items():
        assert_equal(batch[index], one)
        assert repr(batch[index].details) == repr(one.details)


def test_a_data_set_holds_what_the_environment_gave(tmp_path):
    dataset = collect("smpl/Reactor-v0", "pid", 12, tmp_path, seed=10, states=True, part=5, scenario="legacy")
    assert len(dataset) == 12 and dataset.complete and len(list(tmp_path.glob("part-*.parquet"))) == 3
    env = smpl.Env("reactor", scenario="legacy")
    for one, expected in zip(load(tmp_path), evaluate(env, Proportional(), 12, seed=10), strict=True):
        assert_equal(one, expected)
    assert any(one.failure for one in dataset)
    assert dataset[-1].seed == 21 and [one.seed for one in dataset[4:6]] == [14, 15]


def test_a_row_holds_an_observation_the_action_chosen_from_it_and_what_that_brought(tmp_path):
    collect("beer", "random", 2, tmp_path, states=["S"], max_steps=20, seed=4)
    table = arrow.read_table(tmp_path / "part-000000.parquet").to_pydict()
    env = smpl.Env("beer", max_steps=20)
    observation, info = env.reset(seed=4)
    for row in range(21):
        assert (table["episode"][row], table["step"][row]) == (0, row)
        assert table["time"][row] == info["time"] and table["cost"][row] == info["cost"]
        for i, name in enumerate(env.observation_names):
            assert table[f"observation.{name}"][row] == observation[i]
        for i, name in enumerate(env.discrete_names):
            assert table[f"discrete.{name}"][row] == env.discrete[i]
        assert table["state.S"][row] == env.state[env.state_names.index("S")]
        action = table["action.T"][row]
        if row == 20:
            assert action is None and table["reward"][row] is None and table["truncated"][row] is None
            break
        assert table["physical.T"][row] == env.to_physical([action])[0]
        observation, reward, terminated, truncated, info = env.step([action])
        assert table["reward"][row] == reward == table["rewards.finish"][row]
        assert (table["terminated"][row], table["truncated"][row]) == (terminated, truncated)
    assert "state.X_A" not in table and table["controller"][0] == "random" and table["seed"][0] == 4
    about = json.loads((tmp_path / "dataset.json").read_text())
    assert about["about"]["action_units"] == list(env.action_units) and len(about["identity"]["checksum"]) == 64


def test_disturbances_stand_in_the_row_of_the_step_that_they_acted_in(tmp_path):
    (one,) = collect("pensim", "nominal", 1, tmp_path, max_steps=5)
    env = smpl.Env("pensim", max_steps=5)
    env.reset(seed=0)
    recorded = dict(one.details.disturbances.items())
    other = smpl.Env("pensim", max_steps=5)
    _replayed, _ = other.reset(seed=1, options={"disturbances": recorded, "state": env.state, "parameters": {}})
    for k, action in enumerate(one.actions):
        env.step(action)
        assert recorded["z"][k] == env._native.values("disturbance")[0]
        other.step(action)
    assert len(set(recorded["z"])) == 5


def test_every_environment_is_collected_and_comes_back_as_it_was(identifier, tmp_path):
    dataset = collect(identifier, "nominal", 2, tmp_path, states=True, max_steps=3)
    plan = Plan.of(Task.of(identifier, max_steps=3), "nominal", 2)
    parameters = tuple(dataset.manifest.names["parameters"])
    for one, (_, expected) in zip(dataset, run(plan, plan.jobs(0, 2), Settings(parameters=parameters)), strict=True):
        assert_equal(one, expected)
        for name in ("rewards", "violations", "discrete", "disturbances"):
            stored, made = getattr(one.details, name), getattr(expected.details, name)
            assert list(stored) == list(made)
            for key, values in made.items():
                np.testing.assert_array_equal(stored[key], values)
        np.testing.assert_array_equal(one.details.physical, expected.details.physical)
        assert one.details.phases == expected.details.phases
        assert one.details.parameters.items() <= expected.details.parameters.items()
    dataset.check(identifier, max_steps=3)


def test_workers_do_not_change_a_single_byte(tmp_path):
    folders = [tmp_path / "one", tmp_path / "two"]
    for folder, workers in zip(folders, (1, 2), strict=True):
        collect("beer", ["nominal", "random"], 6, folder, workers=workers, max_steps=15, part=2, noise=0.1)
    for name in ("part-000000.parquet", "part-000001.parquet", "part-000002.parquet"):
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes()


class Slow:
    """Nominal actions that take their time."""

    def reset(self, env):
        self.action_given = env.model.native.defaults("action")

    def action(self, env):
        time.sleep(0.004)
        return self.action_given


def test_a_parameter_is_drawn_or_set_not_both(tmp_path):
    with pytest.raises(ValueError, match=r"randomize\['V_0'\]: the settings of the environment fix it at 0.0015"):
        collect("reactor", "pid", 2, tmp_path, randomize={"V_0": (0.001, 0.002)}, settings={"V_0": 0.0015})


def test_an_action_that_has_one_value_keeps_it_under_noise(tmp_path):
    source = (
        "model Fixed\ntime t : s\naction a : 1/s = 3 in 3..3\naction b : 1/s = 0 in -1..1\nstate x = 1\n"
        "eq d/dt x = a - b*x\nobserve x\nreward r default = x\nepisode { step = 1 [s], max_steps = 4 }\n"
    )
    (tmp_path / "fixed.eq").write_text(source)
    (one,) = collect(tmp_path / "fixed.eq", "nominal", 1, tmp_path / "set", noise=0.3, normalize=False)
    np.testing.assert_array_equal(one.details.physical[:, 0], 3.0)
    assert np.ptp(one.details.physical[:, 1]) > 0.1


def test_workers_end_with_the_process_that_was_killed(tmp_path):
    command = [sys.executable, "-m", "smpl.collect", "reactor", "--controller", "test_collection:Slow"]
    command += ["--episodes", "40", "--part", "2", "--workers", "2", "--quiet", "--out", str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    process = subprocess.Popen([*command], env=environment)
    deadline = time.monotonic() + 120

    def working():
        """Processes whose command names the folder's parent process."""
        found = subprocess.run(["pgrep", "-P", str(process.pid)], capture_output=True, text=True, check=False).stdout
        return [int(one) for one in found.split()]

    while not list(tmp_path.glob("part-*.parquet")) and time.monotonic() < deadline:
        time.sleep(0.02)
    workers = working()
    assert len(workers) >= 2
    process.send_signal(signal.SIGKILL)
    process.wait()
    while any(Path(f"/proc/{one}").exists() for one in workers) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not [one for one in workers if Path(f"/proc/{one}").exists()]


def test_two_columns_of_one_name_are_refused(tmp_path):
    manifest = collect("reactor", "pid", 1, tmp_path, max_steps=3).manifest
    for key in ("observations", "states"):
        with pytest.raises(DatasetError, match=f"{key} has 'T' twice: a column {key[:-1]}.T"):
            replace(manifest, names={**manifest.names, key: ["T", "h", "T"]})


def test_nan_never_enters(tmp_path):
    with pytest.raises(RunError, match=r"episode 0 \(seed 0, controller .*not finite"):
        collect("reactor", lambda observation: [np.nan, 0.0], 2, tmp_path, workers=1)
    assert len(load(tmp_path)) == 0


def test_starts_are_those_that_were_asked_for(tmp_path):
    env = smpl.Env("reactor")
    steady = env.steady_state if env.reset(seed=0) else None
    low, high = env.model.native.bounds("state")
    grid = Starts.of("grid:0.3:3", env, 27)
    np.testing.assert_array_equal(grid.states, initial_grid(steady, 0.3, 3, low, high))
    assert Starts.of("unclipped_grid:0.3:3", env, 27).states[:, 0].max() == pytest.approx(1.3 * steady[0], rel=1e-14)
    table = tmp_path / "starts.csv"
    table.write_text("h,T\n0.5,40\n0.6,50\n")
    dataset = collect("reactor", "pid", 3, tmp_path / "set", starts=table, states=True, max_steps=2)
    assert [one.states[0, 2] for one in dataset] == [0.5, 0.6, 0.5]
    assert [one.states[0, 1] for one in dataset] == [40, 50, 40]
    # The others are sampled, as without a table.
    assert dataset[1].states[0, 0] == run_episode(env, Proportional(), 1).states[0, 0]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("c_A,T\n0.8,50\n0.7,\n", "line 3: T is '', expected a number"),
        ("c_A,T\n0.8,50,hot\n", "line 2 has 3 cells, expected 2: c_A, T"),
        ("c_A,T\n0.8,50\n0.7\n", "line 3 has 1 cells, expected 2: c_A, T"),
        ("", "it has no rows: expected names of states in the first line"),
        ("c_A,T\n", "it has no rows"),
        ("T,c_A,T\n50,0.8,60\n", "two columns are called 'T'"),
    ],
)
def test_a_line_of_a_table_of_starts_that_cannot_be_meant_is_named(text, says, tmp_path):
    (tmp_path / "starts.csv").write_text(text)
    with pytest.raises(ValueError, match=says):
        collect("reactor", "pid", 1, tmp_path / "set", starts=tmp_path / "starts.csv")


def test_a_table_of_starts_may_begin_with_a_byte_order_mark(tmp_path):
    (tmp_path / "starts.csv").write_text("\ufeffT,h\n50,0.6\n", encoding="utf-8")
    starts = Starts.of(tmp_path / "starts.csv", smpl.Env("reactor"), 1)
    assert starts.option(0) == {"T": 50.0, "h": 0.6}
    assert set(read_table(tmp_path / "starts.csv")) == {"T", "h"}  # and so may a recorded run


@pytest.mark.parametrize("name", ["PPO:p.zip", "p.d3", "p.pt"])
def test_a_policy_file_that_cannot_be_read_is_named(name, tmp_path, monkeypatch):
    from types import SimpleNamespace

    def broken(*_, **__):
        raise AttributeError("no attribute 'actor'\nmore")

    module = SimpleNamespace(PPO=SimpleNamespace(load=broken), load_learnable=broken, jit=SimpleNamespace(load=broken))
    for package in ("stable_baselines3", "d3rlpy", "torch"):
        monkeypatch.setitem(sys.modules, package, module)
    algorithm, _, file = name.rpartition(":")
    (tmp_path / file).write_bytes(b"nothing")
    spec = f"{algorithm}:{tmp_path / file}" if algorithm else str(tmp_path / file)
    with pytest.raises(ValueError, match=rf"policy file '.*{file}' cannot be read as one of .*: no attribute 'actor'$"):
        Plan.of(Task.of("reactor"), spec, 1)
    if file == "p.pt":
        monkeypatch.setattr("smpl.learning.agents.load_policy", lambda spec: Batched())
        for text in ("{", '{"reach": 9}', "3"):
            (tmp_path / "formulation.json").write_text(text)
            with pytest.raises(ValueError, match=r"formulation.json is not a formulation: "):
                Plan.of(Task.of("reactor"), spec, 1)


def test_starts_outside_of_their_bounds_are_told(tmp_path):
    table = tmp_path / "starts.csv"
    table.write_text("h,T\n0.5,40\n0.6,250\n0.7,-10\n")
    with pytest.warns(UserWarning, match=r"table starts.csv: T is .* in 2 of 3 starts, first 250") as told:
        Starts.of(table, smpl.Env("reactor"), 3)
    assert len(told) == 1


def test_spread_starts_fill_each_sixteenth_of_each_state_once():
    pytest.importorskip("scipy", reason="SciPy is not installed")
    env = smpl.Env("reactor")
    env.reset(seed=0)
    spread = Starts.of("spread:0.1", env, 16, seed=5).states
    unit = (spread / env.steady_state - 0.9) / 0.2
    # A net in base 2, as Sobol's points are: one of 16 in each sixteenth.
    for column in unit.T:
        assert sorted(np.floor(16 * column)) == list(range(16))


def test_spread_starts_fill_what_of_the_box_lies_within_the_bounds():
    """A temperature in degC or K has bounds that are nearer than 0.3 times its value."""
    pytest.importorskip("scipy", reason="SciPy is not installed")
    env = smpl.Env("reactor")
    low, high = env.model.native.bounds("state")
    states = Starts.of("spread:0.95", env, 64).states
    ends = np.clip(np.array([[0.05], [1.95]]) * env.steady_state, low, high)
    assert np.any(ends[1] == high)
    for column, least, most in zip(states.T, *ends, strict=True):
        assert sorted(np.floor(64 * (column - least) / (most - least))) == list(range(64))


def test_a_parameter_array_is_drawn_element_by_element(tmp_path):
    path = tmp_path / "two.eq"
    path.write_text(
        "model Two\ntime t : s\nset s = {a, b}\nparam k[s] : 1/s = 0.1 in 0..1\naction u = 0 in 0..1\n"
        "state x[s] = 1 in 0..9\neq d/dt x[i] = -k[i]*x[i] + u*1[1/s] for i in s\nobserve x\nreward r default = u\n"
        "episode { step = 1 [s], max_steps = 2 }\n",
        encoding="utf-8",
    )
    plan = Plan.of(Task.of(path), "nominal", 20, randomize={"k": (0.2, 0.4)})
    drawn = np.array([list(job.options["parameters"].values()) for job in plan.jobs(0, 20)])
    assert list(plan.randomize) == ["k[a]", "k[b]"] and drawn.shape == (20, 2)
    assert np.all((drawn >= 0.2) & (drawn <= 0.4)) and np.all(drawn[:, 0] != drawn[:, 1])
    with pytest.raises(ValueError, match=r"randomize has 'k\[a\]' twice"):
        Plan.of(Task.of(path), "nominal", 1, randomize={"k": (0.2, 0.4), "k[a]": (0.1, 0.2)})


def test_noise_mixtures_and_random_steps_have_the_shares_that_were_asked_for():
    task = Task.of("reactor", max_steps=50, settings={"error_reward": 0})
    plan = Plan.of(task, ["constant:25,0.125", "nominal"], 400, weights=[1, 3], noise=0.05, epsilon=0.25)
    jobs = plan.jobs(0, 400)
    # Four standard deviations of a binomial share of 400.
    assert abs(np.mean([job.agent for job in jobs]) - 0.75) < 4 * np.sqrt(0.75 * 0.25 / 400)
    shifts = np.concatenate([job.shift for job in jobs])
    assert abs(shifts.std() / 0.05 - 1) < 4 / np.sqrt(2 * shifts.size)
    replaced = np.concatenate([job.replaced for job in jobs])
    assert abs(np.mean(~np.isnan(replaced[:, 0])) - 0.25) < 4 * np.sqrt(0.25 * 0.75 / len(replaced))
    ((job, one),) = run(plan, [next(job for job in jobs if job.agent == 0)], Settings())
    row = np.flatnonzero(np.isnan(job.replaced[: one.steps, 0]))[0]
    # 25 and 0.125 are the middle of the box: 0 when scaled.
    np.testing.assert_allclose(one.actions[row], job.shift[row], atol=1e-7)


class Batched:
    """A policy as of Stable-Baselines3: a batch in, actions and no state out."""

    def predict(self, observations, state=None, episode_start=None, deterministic=False):
        assert deterministic
        return np.tanh(observations[:, :2]), None


def test_policies_of_other_packages_act_on_batches_and_one_by_one():
    plan = Plan.of(Task.of("reactor", max_steps=20), Batched(), 5)
    batch = {job.index: one for job, one in run(plan, plan.jobs(0, 5), Settings())}
    for job, one in run(plan, plan.jobs(0, 5), Settings(batch=False)):
        assert_equal(batch[job.index], one)
        np.testing.assert_allclose(one.actions, np.tanh(one.observations[:-1, :2]), rtol=1e-6)


class Single:
    """A policy as of RLlib."""

    def compute_single_action(self, observation, explore=True):
        assert not explore
        return np.tanh(observation[:2]), [], {}


def test_policies_of_one_observation_at_a_time_act():
    plan = Plan.of(Task.of("reactor", max_steps=10), Single(), 2)
    for _, one in run(plan, plan.jobs(0, 2), Settings()):
        np.testing.assert_allclose(one.actions, np.tanh(one.observations[:-1, :2]), rtol=1e-6)


class Narrow:
    def predict(self, observations):
        return np.zeros((len(observations), 3))


class Recurrent:
    """Counts its steps in its state, as recurrent policies of sb3-contrib keep theirs: (layers, environments, size)."""

    def predict(self, observations, state=None, episode_start=None, deterministic=False):
        count = np.zeros((1, len(observations), 1)) if state is None else state[0].copy()
        if episode_start is not None:
            count[:, episode_start] = 0
        actions = np.repeat(count[0] / 100, 2, axis=1) - 0.1
        return actions, (count + 1, count + 1)


def test_the_state_of_a_recurrent_policy_begins_anew_in_each_episode():
    # Three times as many episodes as places, of different lengths.
    plan = Plan.of(Task.of("reactor", max_steps=30, scenario="legacy"), Recurrent(), 192)
    lengths = set()
    for _, one in run(plan, plan.jobs(0, 192), Settings()):
        np.testing.assert_allclose(one.actions[:, 0], np.arange(one.steps) / 100 - 0.1, atol=1e-7)
        lengths.add(one.steps)
    assert len(lengths) > 2


def test_a_model_whose_file_has_changed_since_it_was_compiled_is_refused(tmp_path):
    path = tmp_path / "beer.eq"
    path.write_text(Path(smpl.compile("beer").native.sources[0]).read_text())
    model = smpl.compile(path)
    path.write_text(path.read_text() + "\n")
    os.utime(path, ns=(1, 1))
    with pytest.raises(ValueError, match="has changed since it was compiled"):
        collect(model, "nominal", 1, tmp_path / "set")


class Raising:
    """A controller with an error in its code."""

    def __init__(self, where):
        self.where = where

    def reset(self, env):
        if self.where == "reset":
            raise KeyError("boom")

    def action(self, env):
        raise KeyError("boom")


def raising(observation):
    raise KeyError("boom")


def test_a_controller_may_have_an_action_alone(tmp_path):
    class Still:
        def action(self, env):
            return [26.85, 0.1]

    env = smpl.Env("reactor", max_steps=5)
    (kept,) = collect("reactor", Still(), 1, tmp_path, workers=1, max_steps=5)
    np.testing.assert_array_equal(kept.observations, evaluate(env, Still(), 1)[0].observations)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"controller": Narrow()}, r"episode 0 .*Narrow gave actions of shape \(1, 3\), expected \(1, 2\)"),
        ({"controller": "pdi"}, "controller is 'pdi'; Reactor has: nominal, random, lqr, pid, mpc"),
        ({"controller": "nowhere:Thing"}, "nowhere"),
        ({"controller": Proportional}, "the class Proportional"),
        ({"episodes": 0}, "episodes is 0"),
        ({"env": "smpl/Rector-v0"}, "Rector"),
        ({"env": "CartPole-v1"}, "not an environment of smpl"),
        ({"starts": "gird"}, "starts is 'gird'; there are: sampled, grid"),
        ({"starts": [{"x": 1.0}]}, "unknown name 'x'|starts.*x"),
        ({"randomize": {"UU": (1, 2)}}, "UU"),
        ({"randomize": {"U": (2, 1)}}, r"randomize\['U'\]"),
        (
            {"randomize": {"spread": (0, 2)}},
            r"randomize\['spread'\] is 0 to 2, outside the bounds of spread, 0 to 1",
        ),
        ({"noise": -1.0}, "noise is -1"),
        ({"weights": [1, 2]}, "weights is"),
        ({"states": ["q"]}, "q"),
        ({"seed": -1}, "seed is -1"),
        ({"workers": 0}, "workers is 0"),
        (
            {"controller": Raising(None), "workers": 1},
            r"episode 0 \(seed 0, controller Raising\): KeyError: 'boom' \(test_coll.*, line ",
        ),
        ({"controller": Raising("reset")}, "controller Raising: its reset fails: KeyError: 'boom'"),
        ({"controller": raising, "workers": 1}, r"episode 0 .*KeyError: 'boom'"),
    ],
)
def test_bad_input_of_a_collection_is_refused(arguments, says, tmp_path):
    given = {"env": "reactor", "controller": "pid", "episodes": 2, **arguments}
    kinds = (ValueError, TypeError, FileNotFoundError, gymnasium.error.Error, RunError)
    with pytest.raises(kinds, match=says):
        collect(given.pop("env"), given.pop("controller"), given.pop("episodes"), tmp_path / "set", **given)


class Mortal:
    """Nominal actions; the first process that meets episode 5 dies of it."""

    def reset(self, env):
        mark = Path(os.environ["SMPL_TEST_MARK"])
        if env.episode[0] == 5 and not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)

    def action(self, env):
        return env.model.native.defaults("action")


def test_a_worker_that_dies_is_replaced_and_nothing_is_lost_or_counted_twice(tmp_path, monkeypatch):
    monkeypatch.setenv("SMPL_TEST_MARK", str(tmp_path / "mark"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parent), *sys.path]))
    controller = __import__("test_collection").Mortal()
    dataset = collect("reactor", controller, 8, tmp_path / "set", workers=2, part=2, max_steps=5)
    assert (tmp_path / "mark").exists() and [one.seed for one in dataset] == list(range(8))


def test_a_controller_that_cannot_travel_says_what_to_do(tmp_path):
    with pytest.raises(ValueError, match=r"cannot be sent to other processes .*workers=1, or MODULE:NAME"):
        collect("reactor", lambda observation: [0.0, 0.0], 4, tmp_path, workers=2, part=2)


def test_a_class_that_other_processes_have_not_says_what_to_do(tmp_path):
    text = (
        "import sys\nfrom smpl.datasets import collect\n"
        "class Still:\n    def action(self, env): return [26.85, 0.1]\n"
        "collect('reactor', Still(), 4, sys.argv[1], workers=2, part=1, max_steps=4)"
    )
    done = subprocess.run(
        [sys.executable, "-c", text, tmp_path / "set"], capture_output=True, text=True, timeout=300, check=False
    )
    last = done.stderr.splitlines()[-1]
    assert last.startswith("ValueError: the controller cannot be made in other processes (AttributeError: Can't get")
    assert "define it in a module" in last and "workers=1" in last and "out of memory" not in done.stderr


def test_two_collections_at_once_into_one_folder_are_refused(tmp_path):
    refused = []

    class Second:
        def action(self, env):
            if not refused:
                try:
                    collect("reactor", "pid", 2, tmp_path, max_steps=5)
                except DatasetError as error:
                    refused.append(str(error))
            return [26.85, 0.1]

    assert len(collect("reactor", Second(), 2, tmp_path, max_steps=5, workers=1)) == 2
    assert refused == [f"another process is collecting into {tmp_path}: wait for it, or stop it first"]
    assert not list(tmp_path.glob(".*"))
    assert len(collect("reactor", "pid", 2, tmp_path / "free", max_steps=5)) == 2


def test_a_script_that_other_processes_would_run_again_works_in_one(tmp_path):
    """`collect` at the top of a script, without a guard: a spawned process would import the script and collect too."""
    lines = [
        "import sys",
        "from smpl.datasets import collect",
        "class Still:",
        "    def reset(self, env): pass",
        "    def action(self, env): return [26.85, 0.1]",
        "data = collect('reactor', Still(), 3, sys.argv[1], workers=2, part=1, max_steps=4)",
        "print(len(data), data[2].steps)",
    ]
    for name, text in (
        ("plain.py", lines),
        ("mentions.py", [*lines[:6], "print(type(data).__name__ and len(data), data[2].steps)"]),
        ("guarded.py", [*lines[:5], "if __name__ == '__main__':", *("    " + line for line in lines[5:])]),
    ):
        script = tmp_path / name
        script.write_text("\n".join(text))
        done = subprocess.run(
            [sys.executable, script, tmp_path / script.stem], capture_output=True, text=True, timeout=300
        )
        assert done.stdout.split() == ["3", "4"], done.stderr
        assert (f"one process does all the work: {name} has no" in done.stderr) == (name != "guarded.py")
    for number in range(3):
        one, other = (load(tmp_path / name)[number] for name in ("plain", "guarded"))
        np.testing.assert_array_equal(one.observations, other.observations)
