"""What takes the steps, chosen in Python, in a model, in a scenario."""

import gymnasium
import numpy as np
import pytest
from scipy import integrate, optimize

import smpl
import titration

METHODS = ("ida", "rosenbrock", "explicit", "auto")

COOLING = """
model Cooling
time t : min
action u : K = 300 in 280..320
state T : K = 350 in 200..400
eq d/dt T = (u - T) / 5 [min]
observe T
reward r default = 0
episode { step = 1 [min], max_steps = 100 }
"""

ALGEBRAIC = """
model Algebraic
time t : s
action u = 1 in 0..2
state x = 1 in -10..10
var z = 1
eq d/dt x = (u - z) / 1 [s]
eq z^3 + z = x
observe x
episode { step = 1 [s], max_steps = 10 }
"""


@pytest.mark.parametrize("method", METHODS)
def test_a_method_follows_the_closed_solution(method):
    env = smpl.Env(smpl.compile(source=COOLING), normalize=False, method=method)
    env.reset(seed=0)
    expected = 350.0
    for action in (280.0, 320.0, 300.0):
        env.step(np.array([action]))
        expected = action + (expected - action) * np.exp(-1 / 5)
        assert env.state[0] == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("method", METHODS)
def test_gymnasium_makes_single_and_vector_environments_with_a_method(method):
    single = gymnasium.make("smpl/Reactor-v0", method=method)
    vector = gymnasium.make_vec(
        "smpl/Reactor-v0", num_envs=3, vectorization_mode="vector_entry_point", method=method, num_threads=2
    )
    other = smpl.VectorEnv("reactor", 3, method=method, num_threads=1)
    expected, _ = single.reset(seed=5)
    observations, _ = vector.reset(seed=5)
    np.testing.assert_array_equal(observations, other.reset(seed=5)[0])
    np.testing.assert_array_equal(observations[0], expected)
    generator = np.random.default_rng(1)
    for _ in range(10):
        actions = generator.uniform(-0.2, 0.2, (3, 2))
        expected = single.step(actions[0])
        result = vector.step(actions)
        np.testing.assert_array_equal(result[0], other.step(actions)[0])
        np.testing.assert_array_equal(result[0][0], expected[0])
        assert result[1][0] == expected[1]


@pytest.mark.parametrize("method", METHODS)
def test_a_snapshot_goes_on_with_the_same_bits(method):
    env = smpl.Env("reactor", method=method)
    env.reset(seed=2)
    generator = np.random.default_rng(0)
    for _ in range(5):
        env.step(generator.uniform(-0.2, 0.2, 2))
    snapshot = env.unwrapped.snapshot()
    actions = generator.uniform(-0.2, 0.2, (6, 2))
    first = [env.step(action)[0] for action in actions]
    state = env.unwrapped.state
    other = smpl.Env("reactor", method=method)
    other.reset(seed=9)
    other.step(actions[0])
    for target in (env, other):
        target.unwrapped.restore(snapshot)
        np.testing.assert_array_equal([target.step(action)[0] for action in actions], first)
        np.testing.assert_array_equal(target.unwrapped.state, state)


def test_another_name_is_a_value_error_that_lists_the_names():
    with pytest.raises(ValueError, match="method is 'bdf'; there are: ida, rosenbrock, explicit, auto"):
        smpl.Env("reactor", method="bdf")
    with pytest.raises(ValueError, match="method is 'RK45'"):
        smpl.VectorEnv("reactor", 2, method="RK45")


def test_the_explicit_method_refuses_an_algebraic_variable_by_its_name():
    model = smpl.compile(source=ALGEBRAIC)
    with pytest.raises(ValueError, match="`z` is an algebraic variable"):
        smpl.Env(model, method="explicit")
    assert smpl.Env(model, method="rosenbrock").reset(seed=0)


def test_a_model_chooses_its_method_and_a_scenario_another(tmp_path):
    (tmp_path / "cooling.eq").write_text(COOLING + "solver { method = explicit }\n")
    (tmp_path / "cooling.stiff.yaml").write_text("solver: {method: rosenbrock}\n")
    (tmp_path / "cooling.wrong.yaml").write_text("solver: {method: euler}\n")

    def work(**arguments):
        env = smpl.Env(tmp_path / "cooling.eq", **arguments)
        env.reset(seed=0)
        env.step(np.zeros(1))
        return env.unwrapped.solver_statistics

    assert work()["jacobians"] == 0
    assert 0 < work(scenario="stiff")["jacobians"] == work(scenario="stiff")["factorisations"]
    assert work(scenario="stiff", method="explicit")["jacobians"] == 0
    with pytest.raises(ValueError, match="ida, rosenbrock, explicit or auto"):
        work(scenario="wrong")


@pytest.mark.parametrize("method", METHODS)
def test_rollouts_are_the_steps_of_an_environment_of_that_method(method):
    env = smpl.Env("reactor", normalize=False, method=method)
    env.reset(seed=3)
    env.step(env.action_space.sample())
    actions = np.random.default_rng(4).uniform([24.0, 0.09], [29.0, 0.11], (5, 2))
    state = env.unwrapped.state
    expected = env.unwrapped.rollout(actions)
    given = env.unwrapped.model.rollout(state, actions, method=method)
    other = smpl.Env(env.unwrapped.model, normalize=False, method=method)
    other.reset(seed=0, options={"state": state})
    for step, action in enumerate(actions):
        env.step(action)
        other.step(action)
        np.testing.assert_array_equal(expected.states[0, step + 1], env.unwrapped.state)
        np.testing.assert_array_equal(given.states[0, step + 1], other.unwrapped.state)
    with pytest.raises(ValueError, match="there are: ida"):
        env.unwrapped.model.rollout(state, actions, method="euler")


JUMP = """
model Jump "an algebraic variable that jumps where a state passes a limit"
time t : s
state x : 1 = 0 in -10..10
var z : 1 = 0.2
action u : 1 = 1 in 0..2
eq d/dt x = (u - 0.1*z) / 1 [s]
eq z + 0.1*z^3 = if x > 0.5 then 3 else 0.2
observe x, z in -10..10
reward area = integral(z) / 1 [s]
episode { step = 2 [s], max_steps = 3 }
"""


@pytest.mark.parametrize("method", ["ida", "rosenbrock", "auto"])
@pytest.mark.parametrize("rtol", [1e-5, 1e-8])
def test_algebraic_variables_that_are_steep_or_jump_are_followed_within_steps_too(method, rtol):
    """Rates of the states say nothing of them; their integrals are known from the equations alone."""
    expected = sum(
        integrate.quad(lambda t: titration.pH(2.0 + 4.0 * t), a, b, epsabs=1e-12, limit=500)[0]
        for a, b in ((0, 2.5), (2.5, 2.6), (2.6, 4))
    )
    run = nominal_rewards(titration.TEXT, method, rtol)
    assert abs(sum(run) / expected - 1) < rtol
    if method == "ida":
        return  # it stops where one jumps, unless an event says so
    before, after = (optimize.brentq(lambda z, to=to: z + 0.1 * z**3 - to, -5, 5, xtol=1e-15) for to in (0.2, 3.0))
    jump = 0.5 / (1 - 0.1 * before)
    run = nominal_rewards(JUMP, method, rtol)
    assert abs(sum(run) / (jump * before + (6 - jump) * after) - 1) < rtol


def nominal_rewards(source, method, rtol):
    """Rewards of an episode at the nominal action."""
    env = smpl.Env(smpl.compile(source=f"{source}\nsolver {{ rtol = {rtol} }}"), method=method)
    env.reset(seed=0)
    action, rewards, ended = env.from_physical(env.model.native.defaults("action")), [], False
    while not ended:
        _, reward, terminated, truncated, info = env.step(action)
        assert not info["failure"]
        rewards.append(reward)
        ended = terminated or truncated
    return rewards
