"""Wrappers and the bridge to Stable-Baselines3."""

import gymnasium
import numpy as np
import pytest

import smpl
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
    assert env.get_attr("render_mode") == [None] * 3
