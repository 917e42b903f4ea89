"""Episodes of the single environment, on the reactor unless another model is needed."""

import gymnasium
import numpy as np
import pytest

import smpl

START = {"c_A": 0.7, "T": 44.0, "h": 0.8}
NOMINAL = np.array([26.85, 0.1])


def trajectory(env, seed, steps=20):
    generator = np.random.default_rng(7)
    observations = [env.reset(seed=seed)[0]]
    rewards = []
    for _ in range(steps):
        observation, reward, terminated, truncated, _ = env.step(generator.uniform(-0.2, 0.2, 2))
        observations.append(observation)
        rewards.append(reward)
        if terminated or truncated:
            break
    return np.array(observations), np.array(rewards)


@pytest.mark.parametrize(
    ("equation", "root"), [("exp(v) = x", 0.0), ("v^3 + v = x - 0.9", np.roots([1, 0, 1, -0.1])[-1].real)]
)
def test_a_start_is_found_where_the_unknown_gets_small(equation, root):
    text = (
        f"state x = 1\nvar v = 1\nlet w : 1 = v\neq {equation}\neq d/dt x = -v / 1 [s]\naction u = 0 in 0..1\nobserve x"
    )
    env = smpl.Env(smpl.compile(source=text), normalize=False)
    env.reset(seed=0)
    assert env.algebraic == pytest.approx([root, root], abs=1e-9)


def test_a_parameter_that_gives_a_size_keeps_its_value():
    text = "param n = 3\nparam k = 1\nstate x[i in 1..n] = 1\neq d/dt x[i] = -k*x[i] / 1 [s] for i in 1..n\nobserve x"
    env = smpl.Env(smpl.compile(source=text), normalize=False)
    env.reset(seed=0, options={"parameters": {"k": 2.0, "n": 3.0}})
    with pytest.raises(ValueError, match="`n` shapes the model"):
        env.reset(seed=0, options={"parameters": {"n": 4.0}})
    with pytest.raises(ValueError, match="`n` shapes the model"):
        env.model.rhs(0.0, [1.0, 1.0, 1.0], [], p={"n": 4.0})
    assert smpl.compile(source=text, settings={"n": 4}).unknown_names == ("x[1]", "x[2]", "x[3]", "x[4]")


def test_the_same_seed_gives_the_same_episode_bit_for_bit():
    first, second = smpl.Env("reactor"), smpl.Env("reactor")
    for a, b in zip(trajectory(first, 3), trajectory(second, 3), strict=True):
        np.testing.assert_array_equal(a, b)


def test_episodes_after_a_seed_are_reproduced_in_order(reactor):
    reactor.reset(seed=5)
    states = [reactor.state]
    for _ in range(3):
        reactor.reset()
        states.append(reactor.state)
    reactor.reset(seed=5)
    again = [reactor.state]
    for _ in range(3):
        reactor.reset()
        again.append(reactor.state)
    np.testing.assert_array_equal(states, again)
    assert len({tuple(state) for state in states}) == 4


def test_environments_without_a_seed_differ():
    first, second = smpl.Env("reactor"), smpl.Env("reactor")
    first.reset()
    second.reset()
    assert not np.array_equal(first.state, second.state)


def test_initial_states_stay_in_the_declared_distribution(reactor):
    set_point = reactor.model.steady_state(NOMINAL, fixed={"h": 0.659})
    states = []
    for seed in range(200):
        reactor.reset(seed=seed)
        states.append(reactor.state)
    states = np.array(states)
    assert np.all(states >= 0.7 * set_point - 1e-12)
    assert np.all(states <= np.minimum(1.3 * set_point, [1.0, 100.0, 1.0]) + 1e-12)
    # Probability of clipping: (1.1412 - 1) / (1.1412 - 0.6145) = 26.8 %.
    assert np.mean(states[:, 0] == 1.0) == pytest.approx(0.268, abs=0.1)


def test_a_given_state_is_simulated_as_it_is(reactor):
    reactor.reset(seed=0)
    sampled = reactor.state
    reactor.reset(seed=0, options={"state": {"T": 44.0}})
    np.testing.assert_array_equal(reactor.state, [sampled[0], 44.0, sampled[2]])
    reactor.reset(options={"state": [1.5, 44.0, 0.8]})
    np.testing.assert_array_equal(reactor.state, [1.5, 44.0, 0.8])
    reactor.reset(seed=0)
    np.testing.assert_array_equal(reactor.state, sampled)


def test_given_parameters_hold_for_one_episode(reactor):
    reactor.reset(seed=0, options={"parameters": {"U": 60.0}})
    assert reactor.parameters["U"] == 60.0
    reactor.reset(seed=0)
    assert reactor.parameters["U"] == 54.94


@pytest.mark.parametrize(
    ("options", "right"),
    [
        ({"states": {}}, "state"),
        ({"state": {"c_B": 1.0}}, "c_A, T, h"),
        ({"parameters": {"V_1": 1.0}}, "V_0"),
        ({"discrete": {"n": 1.0}}, "there are no names"),
        ({"disturbances": {"w": [1.0]}}, "there are no names"),
        ({"start": "cold"}, "sampled, nominal, steady"),
    ],
)
def test_an_unknown_option_is_refused_with_the_right_ones(reactor, options, right):
    with pytest.raises(ValueError, match=right):
        reactor.reset(options=options)


@pytest.mark.parametrize("state", [[1.0, 2.0], [[1.0, 2.0, 3.0]], [1.0, np.nan, 3.0]])
def test_a_state_of_the_wrong_shape_or_not_finite_is_refused(reactor, state):
    with pytest.raises(ValueError, match="state"):
        reactor.reset(options={"state": state})


def test_a_wrong_action_shape_names_both_shapes(reactor):
    reactor.reset(seed=0)
    with pytest.raises(ValueError, match=r"action has shape \(3,\), expected \(2,\)"):
        reactor.step([1.0, 2.0, 3.0])


def test_a_nan_action_raises_and_steps_nothing(reactor):
    reactor.reset(seed=0)
    before = reactor.state
    with pytest.raises(ValueError, match="NaN"):
        reactor.step([np.nan, 0.1])
    np.testing.assert_array_equal(reactor.state, before)
    assert reactor.steps == 0


def test_an_infinite_action_is_a_failure_and_is_not_integrated(reactor):
    reactor.reset(seed=0)
    before = reactor.state
    _, reward, terminated, truncated, info = reactor.step([np.inf, 0.1])
    assert (terminated, truncated, reward) == (True, False, -1000.0)
    assert info["failure"].startswith("action_box")
    np.testing.assert_array_equal(reactor.state, before)


def test_an_action_outside_its_box_is_integrated_and_is_a_failure(reactor):
    reactor.reset(seed=0, options={"state": START})
    _, reward, terminated, _, info = reactor.step([36.0, 0.1])
    assert terminated and reward == -1000.0
    assert info["failure"].startswith("action_box")
    assert info["constraints"]["action_box"] == pytest.approx(1.0 / 20.0)
    assert not np.array_equal(reactor.state, list(START.values()))


def test_a_bound_in_single_precision_is_inside_the_box(reactor):
    reactor.reset(seed=0, options={"state": START})
    _, _, terminated, _, info = reactor.step(np.array([15.0, 0.2], dtype=np.float32))
    assert not terminated and info["cost"] == 0.0


def test_actions_are_taken_in_double_precision():
    states = []
    for dtype in (np.float32, np.float64):
        env = smpl.Env("reactor")
        env.reset(seed=0, options={"state": START})
        env.step(np.array([0.25, -0.5], dtype=dtype))
        states.append(env.state)
    np.testing.assert_array_equal(*states)


@pytest.mark.parametrize("kind", ["strided", "other byte order", "list", "16 bits"])
def test_an_action_in_any_layout_steps_as_its_numbers_do(kind):
    action = {
        "strided": np.array([0.25, 7.0, -0.5, 7.0], np.float32)[::2],
        "other byte order": np.array([0.25, -0.5]).astype(">f4"),
        "list": [0.25, -0.5],
        "16 bits": np.array([0.25, -0.5], np.float16),
    }[kind]
    states = []
    for given in (action, np.array([0.25, -0.5])):
        env = smpl.Env("reactor")
        env.reset(seed=0, options={"state": START})
        env.step(given)
        states.append(env.state)
    np.testing.assert_array_equal(*states)


@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_invalid_arrays_of_either_precision_are_refused(reactor, precision):
    reactor.reset(seed=0)
    with pytest.raises(ValueError, match=r"action has shape \(3,\), expected \(2,\)"):
        reactor.step(np.ones(3, precision))
    with pytest.raises(ValueError, match=r"action has shape \(1, 2\), expected \(2,\)"):
        reactor.step(np.ones((1, 2), precision))
    with pytest.raises(ValueError, match="NaN"):
        reactor.step(np.array([np.nan, 0.1], precision))
    assert reactor.steps == 0


def test_normalised_and_physical_actions_agree(reactor):
    normalised = smpl.Env("reactor")
    for env in (reactor, normalised):
        env.reset(seed=0, options={"state": START})
    action = np.array([20.0, 0.125])
    reactor.step(action)
    normalised.step(normalised.from_physical(action))
    np.testing.assert_allclose(reactor.state, normalised.state, rtol=1e-12)
    np.testing.assert_allclose(normalised.to_physical(normalised.from_physical(action)), action, rtol=1e-14)


# `u` and `fixed` are bounded by one number, `free` by none: x = 3 * 0.5 after a step, whatever the agent says.
FIXED = """model Fixed
time t : s
state x = 0 in 0..100
action u = 3 in 3..3, v = 1 in 0..4
eq d/dt x = u * v / 1 [s]
observe x, u, free = x in -inf..inf
reward r default = u
episode { step = 0.5 [s], max_steps = 3 }
"""


@pytest.mark.parametrize("kind", ["single", "vector"])
def test_bounds_of_one_number_are_that_number(tmp_path, kind):
    (tmp_path / "fixed.eq").write_text(FIXED)
    for wording in (-1.0, 0.0, 0.3, 1.0):
        action = np.array([wording, -0.5], np.float32)
        if kind == "single":
            env = smpl.Env(tmp_path / "fixed.eq")
            env.reset(seed=0)
            observation, reward, *_ = env.step(action)
            np.testing.assert_array_equal(env.action, [3.0, 1.0])
            np.testing.assert_allclose(env.reading, [1.5, 3.0, 1.5], rtol=1e-6)
        else:
            env = smpl.VectorEnv(tmp_path / "fixed.eq", 2)
            env.reset(seed=0)
            observations, rewards, *_ = env.step(np.stack([action, action]))
            observation, reward = observations[1], rewards[1]
        # (2 * 1.5 - 100) / 100; the middle of what has no width; as it is.
        np.testing.assert_allclose(observation, [-0.97, 0.0, 1.5], rtol=1e-6)
        assert reward == 3.0 and (env.single_observation_space if kind == "vector" else env.observation_space).contains(
            observation
        )
        np.testing.assert_array_equal(env.to_physical(action), [3.0, 1.0])
        np.testing.assert_array_equal(env.from_physical([3.0, 1.0]), [0.0, -0.5])


def test_the_time_limit_truncates_after_exactly_max_steps(reactor):
    env = smpl.Env("reactor", normalize=False, max_steps=5)
    env.reset(options={"state": env.model.steady_state(NOMINAL, fixed={"h": 0.659})})
    flags = [env.step(NOMINAL)[2:4] for _ in range(5)]
    assert flags == [(False, False)] * 4 + [(False, True)]
    assert reactor.max_steps == 100
    assert smpl.Env("reactor", scenario="legacy").max_steps == 101


def test_a_failure_in_the_last_step_is_a_failure_and_no_truncation():
    env = smpl.Env("reactor", normalize=False, max_steps=1)
    env.reset(seed=0, options={"state": START})
    _, _, terminated, truncated, _ = env.step([36.0, 0.1])
    assert (terminated, truncated) == (True, False)


def test_a_sparse_reward_is_the_sum_at_the_end():
    sums = []
    for dense in (True, False):
        env = smpl.Env("reactor", dense_reward=dense, max_steps=10)
        env.reset(seed=0, options={"state": START})
        rewards = [env.step(np.zeros(2))[1] for _ in range(10)]
        if not dense:
            assert rewards[:-1] == [0.0] * 9
        sums.append(sum(rewards))
    assert sums[0] == pytest.approx(sums[1], rel=1e-14)


def test_the_chosen_reward_is_the_one_returned():
    env = smpl.Env("reactor", reward="setpoint_change")
    env.reset(seed=0, options={"state": START})
    _, reward, _, _, info = env.step(np.zeros(2))
    assert reward == info["rewards"]["setpoint_change"] != info["rewards"]["setpoint"]


def test_the_reward_follows_the_published_formula(reactor):
    reactor.reset(options={"state": START})
    initial = reactor.state
    reward = reactor.step(NOMINAL)[1]
    set_point = np.array([0.8778252005501434, 51.34660619295078, 0.659])
    distances = (reactor.state - set_point) ** 2 / np.maximum((initial - set_point) ** 2, 1e-8)
    assert reward == pytest.approx(-distances.mean(), rel=1e-9)


def test_stepping_after_the_end_wants_a_reset(reactor):
    reactor.reset(seed=0)
    reactor.step([np.inf, 0.1])
    with pytest.raises(smpl.SimulationError, match="reset"):
        reactor.step(NOMINAL)


def test_a_restored_snapshot_goes_on_bit_for_bit():
    env = smpl.Env("reactor")
    env.reset(seed=2)
    env.step(np.zeros(2))
    snapshot = env.snapshot()
    first = [env.step(np.full(2, 0.1)) for _ in range(5)]
    env.restore(snapshot)
    assert env.steps == 1
    second = [env.step(np.full(2, 0.1)) for _ in range(5)]
    other = smpl.Env(env.model)
    other.restore(snapshot)
    third = [other.step(np.full(2, 0.1)) for _ in range(5)]
    for a, b, c in zip(first, second, third, strict=True):
        np.testing.assert_array_equal(a[0], b[0])
        np.testing.assert_array_equal(a[0], c[0])
        assert a[1] == b[1] == c[1]


def test_a_snapshot_of_another_model_is_refused(reactor):
    reactor.reset(seed=0)
    with pytest.raises(ValueError, match="snapshot"):
        smpl.Env("beer").restore(reactor.snapshot())


def test_names_units_and_bounds_are_those_of_the_specification(reactor):
    assert reactor.state_names == ("c_A", "T", "h")
    assert reactor.state_units == ("kmol/m^3", "degC", "m")
    assert reactor.action_names == ("T_c", "q_out")
    assert reactor.action_units == ("degC", "m^3/min")
    assert set(reactor.algebraic_names) >= {"V", "k", "rate"}
    assert reactor.reward_names == ("setpoint", "setpoint_change")
    np.testing.assert_array_equal(reactor.action_low, [15.0, 0.05])
    np.testing.assert_array_equal(reactor.observation_high, [1.0, 100.0, 1.0])
    np.testing.assert_allclose(reactor.steady_action, NOMINAL)
    reactor.reset(seed=0)
    np.testing.assert_allclose(reactor.steady_state, [0.8778252005501434, 51.34660619295078, 0.659], rtol=1e-12)


def test_state_is_a_copy(reactor):
    reactor.reset(seed=0)
    reactor.state[:] = 0
    assert reactor.state.all()


def test_a_compiled_model_makes_the_same_environment(reactor_model):
    by_name, by_model = smpl.Env("reactor"), smpl.Env(reactor_model)
    np.testing.assert_array_equal(by_name.reset(seed=1)[0], by_model.reset(seed=1)[0])
    with pytest.raises(ValueError, match="compile"):
        smpl.Env(reactor_model, scenario="legacy")


def test_the_full_observation_adds_the_states():
    env = smpl.Env("beer", observation="full")
    names = env.observation_names
    assert set(env.state_names) <= set(names) and len(set(names)) == len(names)
    env.reset(seed=0)
    env.step([0.5])
    readings = dict(zip(names, env.reading, strict=True))
    # What the default level shows already has another name when it is added.
    assert [readings[f"state.{name}"] for name in env.state_names] == pytest.approx(list(env.state), abs=1e-4)


@pytest.mark.parametrize(
    "arguments",
    [{"render_mode": "human"}, {"max_steps": 0}, {"max_steps": 1.5}, {"max_steps": True}, {"max_steps": "3"}],
)
def test_a_wrong_argument_is_refused(arguments):
    with pytest.raises(ValueError, match=next(iter(arguments))):
        smpl.Env("reactor", **arguments)


def test_the_beer_batch_clock_is_observed():
    env = gymnasium.make("smpl/Beer-v0", normalize=False).unwrapped
    env.reset(seed=0)
    observation, *_ = env.step([13.0])
    assert observation[env.observation_names.index("elapsed")] == 1.0
    assert env.time == 1.0


@pytest.mark.parametrize("seed", [-1, 1.5, "3", True, np.int64(-2)])
def test_a_seed_that_is_none_is_refused_as_by_gymnasium(reactor, seed):
    for kind in (gymnasium.error.Error, ValueError):
        with pytest.raises(kind, match=r"seed is .*expected an integer"):
            reactor.reset(seed=seed)
    vector = smpl.VectorEnv("reactor", 2)
    for given in (seed, [0, seed], [seed, None]):
        with pytest.raises(gymnasium.error.Error, match=r"seed is .*expected an integer"):
            vector.reset(seed=given)


def test_seeds_of_any_length_are_told_apart(reactor):
    seeds = [0, 1, 2**64 - 1, 2**64, 2**64 + 1, 2**70, 2**200]
    starts = [reactor.reset(seed=seed)[0] for seed in seeds]
    assert len({start.tobytes() for start in starts}) == len(seeds)
    vector = smpl.VectorEnv("reactor", 3, normalize=False)
    np.testing.assert_array_equal(vector.reset(seed=2**64 - 1)[0], starts[2:5])
    np.testing.assert_array_equal(vector.reset(seed=[2**70, 1, None])[0][:2], [starts[5], starts[1]])


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"state": "abc"}, r"options\['state'\] is 'abc', expected numbers of shape \(3,\)"),
        ({"state": {"h": "x"}}, r"options\['state'\]\['h'\] is 'x', expected a number"),
        ({"state": {"h": [0.5]}}, r"options\['state'\]\['h'\] is \[0\.5\], expected a number"),
        ({"parameters": {"U": None}}, r"options\['parameters'\]\['U'\] is None, expected a number"),
        ({"parameters": {"r": 100}}, r"`r` = 100 is outside its bounds 0\.05\.\.5"),
        ({"state": [[1.0]]}, r"shape \(1, 1\), expected \(3,\)"),
    ],
)
def test_an_option_that_is_no_number_or_out_of_range_is_refused(reactor, options, says):
    with pytest.raises(ValueError, match=says):
        reactor.reset(seed=0, options=options)


@pytest.mark.parametrize("action", ["a", None, [1.0], [[1.0, 2.0]], {"T_c": 1}, ["a", 0.1]])
def test_an_action_that_is_none_is_refused(reactor, action):
    reactor.reset(seed=0)
    with pytest.raises(ValueError, match=r"action (is|has shape) .*expected"):
        reactor.step(action)
    assert reactor.steps == 0
    vector = smpl.VectorEnv("reactor", 1)
    vector.reset(seed=0)
    with pytest.raises(ValueError, match=r"actions (is|has shape) .*expected"):
        vector.step([action, action])


@pytest.mark.parametrize(
    "arguments", [{"num_envs": "3"}, {"num_envs": 0}, {"num_envs": 2.0}, {"num_envs": True}, {"num_threads": "2"}]
)
def test_a_wrong_number_of_environments_is_refused(arguments):
    with pytest.raises(ValueError, match=f"{next(iter(arguments))} is .*expected a positive integer"):
        smpl.VectorEnv("reactor", **arguments)


@pytest.mark.parametrize(
    ("name", "says"),
    [("Reactor", "did you mean 'reactor'"), ("MAbPlant", "did you mean 'mab_plant'"), ("reaktor", "'reactor'"),
     ("smpl/Reactor-v0", "gymnasium.make"), ("zzz", "there are: atropine")],
)  # fmt: skip
def test_a_model_that_is_not_there_comes_with_a_hint(name, says):
    with pytest.raises(FileNotFoundError, match=says):
        smpl.Env(name)


def test_files_of_the_working_folder_are_not_taken_for_shipped_models(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "reactor").write_text("nothing")
    (tmp_path / "beer").mkdir()
    (tmp_path / "mine").write_text((smpl.support.files.models_directory() / "reactor.eq").read_text())
    assert gymnasium.make("smpl/Reactor-v0").unwrapped.model.name == "Reactor"
    assert smpl.VectorEnv("beer", 1).model.name == "Beer"
    assert smpl.compile("mine").name == "Reactor"
    with pytest.raises(smpl.CompileError):
        smpl.compile("./reactor")


def test_a_parameter_in_an_equation_keeps_to_its_range(reactor_model):
    y, u = [0.8, 50.0, 0.6], [26.85, 0.1]
    with pytest.raises(ValueError, match="is outside its bounds"):
        reactor_model.rhs(0.0, y, u, {"r": 100})
    with pytest.raises(ValueError, match=r"p\['r'\] is 'x', expected a number"):
        reactor_model.rhs(0.0, y, u, {"r": "x"})


def test_solver_and_episode_are_set_by_name():
    coarse = smpl.Env("reactor", settings={"rtol": 1e-4, "max_order": 2, "max_internal_steps": 500, "step": 0.2})
    fine = smpl.Env("reactor", settings={"rtol": 1e-10})
    for env in (coarse, fine):
        env.reset(seed=0)
        env.step(np.zeros(2))
    assert coarse.time == 0.2 and fine.time == 0.1
    assert coarse.solver_statistics["steps"] < fine.solver_statistics["steps"]


def test_the_longest_internal_step_is_an_argument():
    single, batch = smpl.Env("reactor", max_step=0.002), smpl.VectorEnv("reactor", 1, max_step=0.002)
    single.reset(seed=0)
    batch.reset(seed=0)
    observation = single.step(np.zeros(2))[0]
    np.testing.assert_array_equal(batch.step(np.zeros((1, 2)))[0][0], observation)
    # 0.1 min of an episode's step.
    assert single.solver_statistics["steps"] >= 50 > smpl_steps("reactor")
    with pytest.raises(ValueError, match=r"settings to smpl\.compile"):
        smpl.Env(smpl.compile("reactor"), max_step=0.002)


def smpl_steps(model):
    """Internal steps of the first step without a limit."""
    env = smpl.Env(model)
    env.reset(seed=0)
    env.step(np.zeros(2))
    return env.solver_statistics["steps"]


def test_an_observation_of_each_instance_has_the_name_of_what_it_observes():
    source = """time t : s
component Tank { state h : m = 1 in 0..2
  eq d/dt h = -h / 1 [s] }
use Tank as tank[k in 1..2]()
use Tank as tall
state x : m = 1 in 0..2
eq d/dt x = -x / 1 [s]
observe tank[k].h in 0..3 for k in 1..2
observe twice = 2*tank[k].h in 0..4 for k in 1..2
observe double = 2*y in 0..4 for y in (tank[1].h, x)
observe y in 0..5 for y in (tall.h, x)
reward r = 0
episode { step = 1 [s], max_steps = 3 }"""
    env = smpl.Env(smpl.compile(source=source))
    names = ["tank[1].h", "tank[2].h", "twice[1]", "twice[2]", "double[tank[1].h]", "double[x]", "tall.h", "x"]
    assert list(env.observation_names) == names
    assert not [name for name in smpl.Env("mab_plant").observation_names if "[]" in name]


#: What a constraint costs where a in 0..10 stays at 4, b in -10..10 at 1, y in 0..10 at 12, x[i] in 0..20 at i/2.
COSTS = {
    "a > 2.5": 1.5 / 10,
    "a > 2.5 and b < 1.5": 0.5 / 20,
    "a > 2.5 or b < 1.5": 1.5 / 10,
    "a > 2.5 and open == 1": 1.5 / 10,
    "a > 2.5 and open == 0": 0,
    "a > 2.5 or open == 0": 1.5 / 10,
    "a > 2.5 or open == 1": 1,
    "a > 2.5 and (b > 5 or open == 1)": 1.5 / 10,
    "(a > 2.5 and open == 0) or b > 0.5": 0.5 / 20,
    "not (a < 2.5)": 1.5 / 10,
    "not (a < 2.5 or b < 0.5)": 0.5 / 20,
    "not (open == 0 or b < 0.5)": 0.5 / 20,
    "a + b > 4": 1 / 4,
    "open == 1": 1,
    "far": 1.5 / 10,
    "far or near": 1.5 / 10,
    "not near": 1.5 / 10,
    "unit[2].hot": 1 / 10,
    "any(unit[k].hot for k in 1..2)": 1 / 10,
    "tall[20]": 2 / 20,
    "any(tall[i] for i in 1..20)": 2 / 20,
    "any(x[i] > 8 for i in 1..20)": 2 / 20,
    "any(x[i] > 8 for i in 1..20 if i < 19)": 1 / 20,
    "any(x[i] > 8 for i in 1..20 if x[i] < a + 5)": 0.5 / 20,
    "any(x[i] > 8 for i in 1..20) and a > 3.9": 0.1 / 10,
    "any(v > 3 for v in (a, b, y))": 9 / 10,
    "any(open == i for i in 1..2)": 1,
    "all(x[i] > 0.1 for i in 1..20)": 0.4 / 20,
    "not all(x[i] < 8 for i in 1..20)": 2 / 20,
    "outside bounds(y)": 2 / 10,
    "outside bounds(y) and open == 1": 2 / 10,
    "not inside bounds(y)": 2 / 10,
    "a < 5 or ln(-a) > 3": 1 / 10,
    "not (a > 5 and ln(-a) > 3)": 1 / 10,
    "any(ln(x[i] - 1) > 1 for i in 1..20)": np.log(9) - 1,
}


@pytest.mark.parametrize("condition", COSTS)
def test_a_constraint_costs_by_how_much_its_comparison_holds(condition):
    source = f"""
component Unit {{
  state T = 2 in 0..10
  let hot = T > 1
  eq d/dt T = 0 [1/s]
}}
use Unit as unit[k in 1..2]
state a = 4 in 0..10
state b = 1 in -10..10
state y = 12 in 0..10
state x[i in 1..20] = 0 in 0..20
discrete open = 1
eq d/dt a = 0 [1/s]
eq d/dt b = 0 [1/s]
eq d/dt y = 0 [1/s]
eq d/dt x[i] = 0 [1/s] for i in 1..20
initial x[i] = i/2 for i in 1..20
let far = a > 2.5
let near = not (far or b > 2) or a > 10
let tall[i in 1..20] = x[i] > 8
constraint cost when {condition}
episode {{ step = 1 [s], max_steps = 2 }}
"""
    env = smpl.Env(smpl.compile(source=source))
    env.reset(seed=0)
    assert env.step([])[4]["constraints"]["cost"] == pytest.approx(COSTS[condition])


def test_conditions_of_conditions_are_looked_into_once():
    chain = "\n".join(f"let c{i} = c{i - 1} and (c{i - 1} or a > {i})" for i in range(1, 60))
    text = "state a = 4 in 0..10\neq d/dt a = 0 [1/s]\nlet c0 = a > 2.5\nconstraint cost when c59\n"
    env = smpl.Env(smpl.compile(source=text + "episode { step = 1 [s] }\n" + chain))
    env.reset(seed=0)
    assert env.step([])[4]["constraints"]["cost"] == pytest.approx(1.5 / 10)
