"""`normalize="nominal"`: 0 of an action is its nominal value, -1 and 1 are its bounds.

Expected numbers follow from the reactor's declaration: T_c = 26.85 in 15..35, q_out = 0.1 in 0.05..0.2.
"""

import copy
import json
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import smpl
import smpl.collect
import smpl.evaluate
from smpl.controllers import LQR
from smpl.datasets import collect, load
from smpl.deploy import export_command
from smpl.evaluation import evaluate, run_episode
from smpl.wrappers import AroundNominal, outer_action

SCALED = [[0, 0], [1, -1], [-1, 1], [0.5, -0.5], [-0.25, 0.75], [2, 0]]
PHYSICAL = [[26.85, 0.1], [35.0, 0.05], [15.0, 0.2], [30.925, 0.075], [23.8875, 0.175], [43.15, 0.1]]


def nominal(**more):
    return smpl.Env("reactor", normalize="nominal", **more)


def test_actions_are_shares_of_the_way_from_the_nominal_action_to_a_bound():
    env = nominal()
    for scaled, physical in zip(SCALED, PHYSICAL, strict=True):
        env.reset(seed=0)
        env.step(np.array(scaled, dtype=np.float64))
        np.testing.assert_allclose(env.action, physical, rtol=1e-15)
        np.testing.assert_allclose(env.to_physical(scaled), physical, rtol=1e-15)
        np.testing.assert_allclose(env.from_physical(physical), scaled, atol=1e-14)
    # Exactly, not to rounding alone.
    assert [env.to_physical(one).tolist() for one in SCALED[:3]] == PHYSICAL[:3]


def test_observations_and_spaces_are_those_of_normalised_environments():
    env, plain = nominal(), smpl.Env("reactor")
    assert (env.action_space, env.observation_space) == (plain.action_space, plain.observation_space)
    assert (env.reset(seed=3)[0] == plain.reset(seed=3)[0]).all()
    physical = np.array([28.0, 0.11])
    found = env.step(env.from_physical(physical))[0], plain.step(plain.from_physical(physical))[0]
    np.testing.assert_allclose(*found, rtol=1e-6)
    np.testing.assert_allclose(env.reading, plain.reading, rtol=1e-6)


def test_batches_step_as_single_environments_bit_for_bit():
    batch = smpl.make_vec("reactor", 3, normalize="nominal", autoreset_mode="disabled")
    singles = [nominal() for _ in range(3)]
    observations, _ = batch.reset(seed=7)
    actions = np.random.default_rng(0).uniform(-1, 1, (5, 3, 2))
    for place, env in enumerate(singles):
        assert (env.reset(seed=7 + place)[0] == observations[place]).all()
    for step in actions:
        observations, rewards, *_ = batch.step(step)
        for place, env in enumerate(singles):
            observation, reward, *_ = env.step(step[place])
            assert (observation == observations[place]).all() and reward == rewards[place]


def test_gymnasium_makes_and_checks_it():
    env = gymnasium.make("smpl/Reactor-v0", normalize="nominal")
    check_env(env.unwrapped, skip_render_check=True)
    vector = gymnasium.make_vec("smpl/Reactor-v0", 2, vectorization_mode="vector_entry_point", normalize="nominal")
    assert vector.unwrapped.normalize == "nominal"
    with pytest.raises(ValueError, match="normalize is 'nominl', expected True, False or 'nominal'"):
        smpl.Env("reactor", normalize="nominl")
    with pytest.raises(ValueError, match="normalize is 2, expected True or False"):
        smpl.VectorEnv("reactor", 2, normalize=2)


def test_it_is_shown_copied_and_pickled():
    env = nominal()
    assert repr(env).endswith(", normalize='nominal'>")
    env.reset(seed=1)
    env.step([0.3, 0.3])
    for other in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        assert other.normalize == "nominal"
        assert (other.to_physical([0, 0]) == [26.85, 0.1]).all()
        assert (other.step([-0.2, 0.1])[0] == copy.deepcopy(env).step([-0.2, 0.1])[0]).all()


WRAPPED = {
    "none": lambda env: env,
    "RescaleAction": lambda env: gymnasium.wrappers.RescaleAction(env, -3.0, np.array([5.0, 0.5], np.float32)),
    "ClipAction": gymnasium.wrappers.ClipAction,
    "AroundNominal": AroundNominal,
}


@pytest.mark.parametrize("name", WRAPPED)
def test_controllers_act_through_wrappers(name):
    plain = smpl.Env("reactor", normalize=False, max_steps=20)
    expected = run_episode(plain, LQR(plain), seed=2)
    env = WRAPPED[name](nominal(max_steps=20))
    found = run_episode(env, LQR(plain), seed=2)
    np.testing.assert_allclose(found.details.physical, expected.details.physical, rtol=1e-6)
    np.testing.assert_allclose(found.states, expected.states, rtol=1e-6)
    env.reset(seed=0)
    env.step(outer_action(env, env.unwrapped.from_physical([28.0, 0.11])))
    np.testing.assert_allclose(env.unwrapped.action, [28.0, 0.11], rtol=1e-6)


def test_the_wrapper_and_the_argument_are_the_same():
    wrapped, env = AroundNominal(smpl.Env("reactor")), nominal()
    wrapped.reset(seed=0)
    env.reset(seed=0)
    for action in np.random.default_rng(1).uniform(-1, 1, (10, 2)):
        wrapped.step(action)
        env.step(action)
        np.testing.assert_allclose(wrapped.unwrapped.action, env.action, rtol=1e-14)


def test_a_policy_that_returns_zero_is_the_nominal_one():
    found = evaluate(nominal(max_steps=10), lambda observation: np.zeros(2), episodes=2, seed=0)
    assert {tuple(row) for episode in found for row in episode.details.physical} == {(26.85, 0.1)}


def test_one_sided_actions():
    text = """model M
time t : s
state x = 0 in -9..9
action low = 0 in 0..2
action high = 2 in 0..2
eq d/dt x = (low + high - x)/1[s]
observe x in -9..9
reward r default = x
episode { step = 1 [s], max_steps = 3 }
"""
    env = smpl.Env(smpl.compile(source=text), normalize="nominal")
    env.reset(seed=0)
    env.step([-1.0, 1.0])
    assert env.action.tolist() == [0, 2]
    assert env.to_physical([0.5, -0.5]).tolist() == [1, 1]
    assert env.from_physical([1, 1]).tolist() == [0.5, -0.5]
    assert env.from_physical([0, 2]).tolist() == [0, 0]


def test_data_sets_keep_it(tmp_path):
    data = collect("reactor", "nominal", 2, tmp_path / "data", normalize="nominal", max_steps=5)
    assert data.manifest.about["normalize"] == "nominal"
    for episode in data:
        assert (episode.actions == 0).all()
        assert (episode.details.physical == [26.85, 0.1]).all()


def test_commands_take_the_scale_of_a_policy(tmp_path):
    arguments = ["reactor", "--episodes", "2", "--max-steps", "5", "--normalize", "nominal", "--quiet"]
    assert smpl.collect.main([*arguments, "--controller", "nominal", "--out", str(tmp_path / "data")]) == 0
    assert load(tmp_path / "data").manifest.about["normalize"] == "nominal"
    assert smpl.evaluate.main([*arguments, "--out", str(tmp_path / "scores")]) == 0
    result = json.loads((tmp_path / "scores" / "result.json").read_text())
    assert '"normalize": "nominal"' in json.dumps(result)
    policy = ["nominal", "--env", "reactor", "--to", "c"]
    assert export_command.main([*policy, "-o", str(tmp_path / "p.c"), "--normalize", "nominal"]) == 0


def test_models_have_the_bounds_parameters_and_interval_of_their_environments():
    model, env = smpl.compile("reactor"), nominal()
    assert model.sampling_interval == 0.1
    assert (model.parameters["U"], len(model.parameters)) == (54.94, len(model.parameter_names))
    assert model.action_nominal.tolist() == [26.85, 0.1]
    for name in ("action_low", "action_high", "observation_low", "observation_high"):
        assert (getattr(model, name) == getattr(env, name)).all()


def test_environments_take_the_model_of_another_and_list_their_arguments():
    env = smpl.Env("reactor", observation="full", reward="setpoint_change")
    batch = smpl.VectorEnv(gymnasium.wrappers.ClipAction(env), 4)
    assert batch.model is env.model and smpl.Env(env).model is env.model
    with pytest.raises(
        TypeError, match=r"Env has no argument 'rewards'; did you mean 'reward'\?; there are: model, normalize, "
    ):
        gymnasium.make("smpl/Reactor-v0", rewards="setpoint")
    with pytest.raises(
        TypeError, match=r"VectorEnv has no argument 'rewards'; did you mean 'reward'\?; there are: model, num_envs, "
    ):
        smpl.make_vec("reactor", 2, rewards="setpoint")
    with pytest.raises(
        TypeError, match=r"compile has no argument 'rewards'; did you mean 'reward'\?; there are: path, source, "
    ):
        smpl.compile("reactor", rewards="setpoint")


def test_a_wrong_reward_names_the_argument_and_a_batch_plant_asks_for_a_point():
    with pytest.raises(smpl.ScenarioError, match=r"^argument `reward`: unknown reward `profit`; the model has"):
        smpl.Env("reactor", reward="profit")
    with pytest.raises(smpl.SimulationError, match=r"^Beer has no steady state to linearise at: give at=\(y, u\)"):
        LQR(smpl.Env("beer"))
