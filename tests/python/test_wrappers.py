"""Wrappers and the bridge to Stable-Baselines3."""

import gymnasium
import numpy as np
import pytest

import smpl
from smpl.controllers import Constant, Proportional
from smpl.evaluation import run_episode
from smpl.wrappers import AroundNominal, SafetyGymnasium


def test_safety_gymnasium_gives_the_cost_as_a_result_of_its_own():
    env = SafetyGymnasium(smpl.Env("reactor", normalize=False))
    env.reset(seed=0)
    _, _, cost, terminated, truncated, info = env.step([36.0, 0.1])
    assert cost == info["cost"] > 0.0
    assert terminated and not truncated
    assert env.action_names == ("T_c", "q_out")


@pytest.mark.parametrize(
    ("scaled", "physical"), [([0, 0], [26.85, 0.1]), ([1, -1], [35.0, 0.05]), ([-0.5, 0.5], [20.925, 0.15])]
)
def test_zero_is_the_nominal_action_and_the_ends_are_the_bounds(scaled, physical):
    env = AroundNominal(gymnasium.make("smpl/Reactor-v0"))
    env.reset(seed=0)
    env.step(np.array(scaled, dtype=np.float64))
    np.testing.assert_allclose(env.unwrapped._native.values("action"), physical, rtol=1e-12)


class Backwards(gymnasium.ActionWrapper):
    """A wrapper without an inverse."""

    def action(self, action):
        return -action


class BackwardsAndBack(Backwards):
    def reverse_action(self, action):
        return -action


class Halved(gymnasium.Wrapper):
    """Changes actions without saying so."""

    def step(self, action):
        return self.env.step(np.asarray(action) / 2)


WRAPPED = {
    "AroundNominal": AroundNominal,
    "RescaleAction": lambda env: gymnasium.wrappers.RescaleAction(env, -3.0, np.array([5.0, 0.5], np.float32)),
    "ClipAction": gymnasium.wrappers.ClipAction,
    "two": lambda env: gymnasium.wrappers.RescaleAction(AroundNominal(env), 0.0, 2.0),
    "reverse_action": BackwardsAndBack,
    "TimeLimit": lambda env: gymnasium.wrappers.TimeLimit(env, 30),
}


@pytest.mark.parametrize("normalize", [True, False])
@pytest.mark.parametrize("wrap", WRAPPED)
def test_a_controller_acts_through_wrappers_as_without_them(wrap, normalize):
    plain = run_episode(smpl.Env("reactor", normalize=normalize, max_steps=30), Proportional(), 5)
    env = WRAPPED[wrap](smpl.Env("reactor", normalize=normalize, max_steps=30))
    through = run_episode(env, Proportional(), 5)
    assert through.steps == plain.steps
    np.testing.assert_allclose(through.states, plain.states, rtol=1e-5)
    for action in through.actions:
        assert env.action_space.contains(action) or wrap == "reverse_action"


def test_an_action_outside_the_box_is_clipped_where_the_wrapper_says_so():
    env = gymnasium.wrappers.ClipAction(smpl.Env("reactor", max_steps=2))
    assert run_episode(env, Constant([99.0, 0.1]), 0).failure == ""


@pytest.mark.parametrize("wrap", [Backwards, lambda env: gymnasium.wrappers.StickyAction(env, 0.5)])
def test_a_wrapper_that_nobody_can_undo_is_refused(wrap):
    with pytest.raises(TypeError, match=r"changes actions.*reverse_action"):
        run_episode(wrap(smpl.Env("reactor")), Proportional(), 0)


def test_a_wrapper_that_changes_actions_without_saying_so_is_noticed():
    with pytest.raises(TypeError, match="changed the action"):
        run_episode(Halved(smpl.Env("reactor")), Proportional(), 0)


def test_stable_baselines3_steps_the_native_batch():
    pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")
    from smpl.sb3 import SB3VecEnv

    env = SB3VecEnv("reactor", 3, max_steps=2)
    env.seed(5)
    observations = env.reset()
    np.testing.assert_array_equal(observations[1], smpl.Env("reactor").reset(seed=6)[0])
    env.step(np.zeros((3, 2), dtype=np.float32))
    _, rewards, done, infos = env.step(np.zeros((3, 2), dtype=np.float32))
    assert rewards.dtype == np.float32 and done.all()
    assert infos[0]["TimeLimit.truncated"] and infos[0]["terminal_observation"].shape == (3,)
    assert infos[0]["time"] == pytest.approx(0.2)
    assert infos[0]["rewards"].keys() == {"setpoint", "setpoint_change"} and isinstance(infos[0]["failure"], str)
    assert env.get_attr("render_mode") == [None] * 3


def test_stable_baselines3_takes_an_id_or_a_vector_environment():
    pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")
    from smpl.sb3 import SB3VecEnv

    vector = smpl.VectorEnv("reactor", 2, autoreset_mode="same_step", max_steps=4)
    observations = []
    for env in (SB3VecEnv("reactor", 2), SB3VecEnv("smpl/Reactor-v0", 2, max_steps=4), SB3VecEnv(vector)):
        env.seed(5)
        observations.append(env.reset())
        assert env.num_envs == 2
    np.testing.assert_array_equal(observations[0], observations[1])
    np.testing.assert_array_equal(observations[0], observations[2])
    for wrong in (
        lambda: SB3VecEnv("CartPole-v1", 2),
        lambda: SB3VecEnv(vector, 3),
        lambda: SB3VecEnv(smpl.VectorEnv("reactor", 2)),
        lambda: SB3VecEnv(gymnasium.make_vec("CartPole-v1")),
    ):
        with pytest.raises(ValueError, match=r"smpl|num_envs|autoreset_mode"):
            wrong()
