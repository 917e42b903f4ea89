"""The interface contract where it is easy to miss: what a stranger tries that a friend would not."""

import pickle

import numpy as np
import pytest

import smpl

# x rises with slope 1, and falls to 0 when it has come to 0.5, in the middle of each step.
SAWTOOTH = """model Sawtooth "resets in the middle of a step"
time t : min
state x : 1 = 0 in -10..10
action u : 1 = 0 in 0..1
eq d/dt x = 1 [1/min]
event hit when x >= 0.5
at hit { reset x = 0 }
reward time default = integral(1) / 1 [min]
episode { step = 1 [min], max_steps = 3 }
"""

# dx/dt = r + z + u - x: at rest x = r + z + u.
SUM = """model Sum "a discrete variable and a disturbance act on the state"
time t : min
state x : 1 = 1 in -10..10
discrete r : 1 = 2
disturbance z : 1 = 3
action u : 1 = 0 in 0..1
eq d/dt x = (r + z + u - x) / 1 [min]
reward level default = x
"""


def test_an_integral_over_the_step_goes_on_across_an_event():
    env = smpl.Env(smpl.compile(source=SAWTOOTH))
    env.reset(seed=1)
    assert [env.step([0])[1] for _ in range(2)] == pytest.approx([1.0, 1.0], abs=1e-9)


def test_solver_statistics_count_the_last_step():
    env = smpl.Env("reactor")
    env.reset(seed=1)
    assert env.solver_statistics["steps"] == 0
    env.step([0, 0])
    first = env.solver_statistics
    assert first["steps"] > 0 and first["residuals"] >= first["steps"]
    env.step([0, 0])
    assert env.solver_statistics["steps"] > first["steps"]


def test_a_steady_state_keeps_the_discrete_variables_and_disturbances_that_are_given():
    model = smpl.compile(source=SUM)
    assert model.steady_state([0]) == pytest.approx([5.0])
    assert model.steady_state([0.5], {"r": 5}) == pytest.approx([8.5])
    assert model.steady_state([0], {"z": -1, "r": 0}) == pytest.approx([-1.0])
    assert model.steady_state([0]) == pytest.approx([5.0])


@pytest.mark.parametrize(
    "passed_on", [lambda snapshot: snapshot, lambda snapshot: pickle.loads(pickle.dumps(snapshot))]
)
@pytest.mark.parametrize(
    "changes",
    [{"observation": "full"}, {"scenario": "legacy"}, {"variants": ("reward_floor",)}, {"settings": {"k_0": 7.1e10}}],
)
def test_a_snapshot_of_another_compilation_is_refused(changes, passed_on):
    other, env = smpl.Env("reactor", **changes), smpl.Env("reactor")
    other.reset(seed=1)
    env.reset(seed=2)
    before = env.state
    with pytest.raises(ValueError, match="snapshot is of Reactor"):
        env.restore(passed_on(other.snapshot()))
    np.testing.assert_array_equal(env.state, before)
    env.step([0, 0])


def test_the_breach_of_a_limit_by_an_event_costs_something():
    env = smpl.Env("reactor", normalize=False)
    env.reset(seed=1, options={"state": {"c_A": 0.5, "T": 30, "h": 0.05}})
    _, _, terminated, _, info = env.step([15, 0.2])
    assert terminated and info["failure"].startswith("empty")
    assert info["constraints"]["empty"] > 1e-7
    assert info["cost"] >= info["constraints"]["empty"]


@pytest.mark.parametrize(("dense", "expected"), [(True, -100.0), (False, -100.0)])
def test_a_failed_penicillin_batch_pays_the_error_reward_and_nothing_else(dense, expected):
    env = smpl.Env("pensim", dense_reward=dense, normalize=False)
    env.reset(seed=1)
    action = np.array([0, 8, 22, 30, 0.6, 0.0])
    for _ in range(3):
        env.step(action)
    _, reward, terminated, _, _ = env.step(action + np.array([0, 1000, 0, 0, 0, 0]))
    assert terminated and reward == expected


def test_with_sparse_rewards_a_failed_reactor_pays_the_sum():
    env = smpl.Env("reactor", dense_reward=False, normalize=False)
    env.reset(seed=1)
    rewards = [env.step([26.85, 0.1])[4]["rewards"]["setpoint"] for _ in range(3)]
    _, reward, terminated, _, _ = env.step([50, 0.1])
    assert terminated and reward == pytest.approx(sum(rewards) - 1000)


def test_minaris_key_in_the_options_is_let_through():
    env = smpl.Env("reactor")
    first, _ = env.reset(seed=1, options={"minari_autoseed": True})
    second, _ = env.reset(seed=1)
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("options", [5, [1], "state"])
def test_options_that_are_no_mapping_are_a_value_error(options):
    with pytest.raises(ValueError, match="mapping"):
        smpl.Env("reactor").reset(seed=1, options=options)


@pytest.mark.parametrize("limit", [0, -1, 1.5, 2**40, "many"])
def test_a_time_limit_that_is_none_is_a_value_error(limit):
    with pytest.raises(ValueError, match="max_steps"):
        smpl.Env("reactor", max_steps=limit)


def test_seeds_of_numpy_are_seeds():
    env = smpl.Env("reactor")
    vector = smpl.VectorEnv("reactor", 2)
    np.testing.assert_array_equal(env.reset(seed=np.int64(3))[0], env.reset(seed=3)[0])
    np.testing.assert_array_equal(vector.reset(seed=np.int64(3))[0], vector.reset(seed=3)[0])


@pytest.mark.parametrize("seed", ["a", 1.5, [1]])
def test_seeds_of_a_vector_environment_that_are_none_are_refused(seed):
    with pytest.raises(ValueError, match="seed"):
        smpl.VectorEnv("reactor", 3).reset(seed=seed)


def test_files_that_are_no_models_raise_what_they_are(tmp_path):
    with pytest.raises(FileNotFoundError):
        smpl.compile(tmp_path / "none.eq")
    (tmp_path / "folder.eq").mkdir()
    with pytest.raises(IsADirectoryError):
        smpl.compile(tmp_path / "folder.eq")
    (tmp_path / "bytes.eq").write_bytes(b"model M\nparam k = 1 # \xff\n")
    with pytest.raises(smpl.CompileError, match="UTF-8") as caught:
        smpl.compile(tmp_path / "bytes.eq")
    (finding,) = caught.value.diagnostics
    assert finding.file.endswith("bytes.eq") and finding.line == 1


@pytest.mark.parametrize(
    ("text", "place", "message"),
    [
        ("# a comment\nparameters: {k_0: 1, kk: 1}\n", "s.yaml:2:22", "unknown parameter or setting `kk`"),
        ("variants: [nope]\n", "s.yaml:1:12", "unknown variant `nope`"),
        ("max_steps: 5\nreward: foo\n", "s.yaml:2:9", "unknown reward `foo`"),
        ("\nparameters:\n  k_0: abc\n", "s.yaml:3:3", "takes a number, not `abc`"),
        ("parameters: {k_0: .nan}\n", "s.yaml:1:14", "`k_0` takes a finite number"),
        ("max_steps: -1\n", "s.yaml:1:12", "a whole number that is not negative"),
        ("noise: 3\n", "s.yaml:1:", "`noise` is true, false or a mapping"),
        ("[1, 2]\n", "s.yaml:1:1", "keys with values"),
    ],
)
def test_faults_of_a_scenario_are_placed_in_its_file_and_said_once(tmp_path, text, place, message):
    scenario = tmp_path / "s.yaml"
    scenario.write_text(text)
    with pytest.raises(smpl.ScenarioError) as caught:
        smpl.compile("reactor", scenario=scenario)
    wording = str(caught.value)
    assert place in wording and wording.count(message) == 1, wording


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "x", None])
def test_a_setting_that_is_no_number_is_refused_once(value):
    with pytest.raises(smpl.ScenarioError, match="number") as caught:
        smpl.compile("reactor", settings={"k_0": value})
    assert str(caught.value).count("k_0") == 1
