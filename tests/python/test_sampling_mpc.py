"""Sampling-based predictive control against optima that are known."""

import itertools

import numpy as np
import pytest

import smpl
from smpl.controllers import LQR, ExtendedKalmanFilter, Loops, OpenLoop, SamplingMPC
from smpl.evaluation import evaluate, run_episode

CART = """model Cart "a double integrator"
time t : s
param drag : 1/s = 0 in 0..5
action u = 0 in -1..1
state x = 0 in -100..100
state v : 1/s = 0 in -100..100
eq d/dt x = v
eq d/dt v = u * 1 [1/s^2] - drag*v
steady { u = 0, x = 0, v = 0 }
observe x, v
level position { observe x noise normal(0, 0.001) }
reward near default = -sq(x)
reward far = sq(x)
fail wall when x < -2
episode { step = 0.5 [s], max_steps = 30, error_reward = 0 }
"""


@pytest.fixture(scope="module")
def cart():
    return smpl.compile(source=CART)


def quadratic(found, plans):
    """x^2 + u^2 summed over steps, the state before each."""
    return found.states[:, :-1, 0] ** 2 + plans[:, :, 0] ** 2


@pytest.mark.parametrize("method", ["mppi", "cem"])
def test_a_quadratic_cost_is_nearly_that_of_the_optimal_regulator(cart, method):
    env = smpl.Env(cart, normalize=False, max_steps=20)
    optimal = LQR(cart, {"x": 1.0}, {"u": 1.0})
    start = {"state": {"x": 0.8, "v": 0.0}}
    controller = SamplingMPC(horizon=10, samples=64, iterations=4, method=method, cost=quadratic)
    episode = run_episode(env, controller, 0, start)
    cost = (episode.states[:-1, 0] ** 2).sum() + (episode.actions**2).sum()
    best = np.array([0.8, 0.0]) @ optimal.riccati @ np.array([0.8, 0.0])
    assert best * 0.999 < cost < best * 1.05
    assert controller.fallbacks == 0 and controller.decisions == episode.steps


def test_integer_actions_are_whole_and_the_best_of_all_sequences_is_found(cart):
    env = smpl.Env(cart, normalize=False)
    env.reset(seed=0, options={"state": {"x": 1.3, "v": -0.2}})
    plans = np.array(list(itertools.product([-1.0, 0.0, 1.0], repeat=5)))[:, :, None]
    best = plans[int(np.argmin((env.rollout(plans).states[:, 1:, 0] ** 2).sum(axis=1)))]
    controller = SamplingMPC(horizon=5, samples=256, method="cem", integer=["u"], deviation={"u": 1.0})
    controller.reset(env)
    assert controller.action(env) == best[0]
    np.testing.assert_array_equal(controller.plan, best)


def test_the_random_numbers_belong_to_the_episode(cart):
    env, controller = smpl.Env(cart, normalize=False, max_steps=4), SamplingMPC(horizon=4, samples=16, cost="far")
    first, second = (evaluate(env, controller, 2, seed=5) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.actions, b.actions)
    assert not np.array_equal(first[0].actions, first[1].actions)


def test_the_environment_stays_where_it_is_while_a_decision_is_made(cart):
    env = smpl.Env(cart, normalize=False)
    env.reset(seed=0, options={"state": {"x": 1.0, "v": 0.0}})
    controller = SamplingMPC(horizon=4, samples=16)
    controller.reset(env)
    before = env.snapshot().to_bytes()
    controller.action(env)
    assert env.snapshot().to_bytes() == before


def test_a_named_reward_of_the_model_is_maximised(cart):
    env = smpl.Env(cart, normalize=False)
    for reward, sign in (("near", -1.0), ("far", 1.0)):
        env.reset(seed=0, options={"state": {"x": 1.0, "v": 0.0}})
        controller = SamplingMPC(horizon=5, samples=64, cost=reward)
        controller.reset(env)
        assert sign * controller.action(env)[0] > 0.5
    with pytest.raises(ValueError, match=r"cost is 'cheap', no reward of Cart; there are: near \[1\], far \[1\]"):
        SamplingMPC(cost="cheap").reset(env)


def test_failures_are_avoided_and_unavoidable_ones_are_counted(cart):
    env = smpl.Env(cart, normalize=False, max_steps=15)
    controller = SamplingMPC(horizon=8, samples=48, cost=lambda found, plans: found.states[:, :-1, 0])
    # The cost pulls towards the wall at -2 with all that there is.
    episode = run_episode(env, controller, 0, {"state": {"x": 1.0, "v": 0.0}})
    assert not episode.failure and episode.states[:, 0].min() < -1.5
    assert controller.fallbacks == 0
    run_episode(env, controller, 0, {"state": {"x": -1.9, "v": -3.0}})
    assert controller.fallbacks == 1


def test_a_plan_may_be_held_and_followed_for_some_steps(cart):
    env = smpl.Env(cart, normalize=False, max_steps=12)
    controller = SamplingMPC(horizon=6, samples=16, hold=2, every=4)
    episode = run_episode(env, controller, 1, {"state": {"x": 1.0, "v": 0.0}})
    assert controller.decisions == 3
    np.testing.assert_array_equal(episode.actions[0::2], episode.actions[1::2])


def test_another_model_predicts_from_the_state_or_from_an_estimate(cart):
    plant = smpl.Env(
        smpl.compile(source=CART, settings={"drag": 0.3}, observation="position"), normalize=False, max_steps=16
    )
    kalman = ExtendedKalmanFilter(plant.model, initial={"x": 0.5}, process_noise={"v": 0.05})
    for controller in (
        SamplingMPC(cart, horizon=8, samples=48),
        SamplingMPC(horizon=8, samples=48, p={"drag": 0.1}),
        SamplingMPC(cart, horizon=8, samples=48, estimator=kalman),
    ):
        episode = run_episode(plant, controller, 0, {"state": {"x": 0.8, "v": 0.0}})
        assert abs(episode.states[-1, 0]) < 0.1
    with pytest.raises(ValueError, match="the model that predicts has the actions u, the environment T_c, q_out"):
        run_episode(smpl.Env("reactor"), SamplingMPC(cart), 0)


def test_a_guess_is_tried_and_never_made_worse(cart):
    env = smpl.Env(cart, normalize=False)
    env.reset(seed=0, options={"state": {"x": 1.0, "v": 0.0}})
    guess = np.array([-1.0, -0.5, 0.0, 0.5, 0.5])[:, None]
    cost = -env.rollout(guess).rewards.sum()
    controller = SamplingMPC(horizon=5, samples=4, iterations=1, guess=lambda env, horizon: guess[:horizon])
    controller.reset(env)
    controller.action(env)
    assert -env.rollout(controller.plan).rewards.sum() <= cost
    with pytest.raises(ValueError, match=r"guess has shape \(3, 1\), expected \(5, 1\) or \(K, 5, 1\)"):
        wrong = SamplingMPC(horizon=5, guess=lambda env, horizon: guess[:3])
        wrong.reset(env)
        wrong.action(env)


def test_loops_without_a_controller_hold_the_operating_action(cart):
    episode = run_episode(smpl.Env(cart, normalize=False, max_steps=3), Loops(others={"u": 0.5}), 0)
    np.testing.assert_array_equal(episode.actions, 0.5)


def test_plans_around_the_recipe_of_pensim_bring_more_than_the_recipe():
    from smpl.controllers.pensim import Recipe

    env = smpl.Env("pensim", normalize=False, max_steps=400)
    recipe = Recipe(smpl.compile("pensim")).actions_of_steps

    def follow(env, horizon):
        return recipe[np.minimum(env.steps + np.arange(horizon), len(recipe) - 1)]

    spread = {"discharge": 1, "Fs": 6, "Foil": 1, "Fg": 5, "pressure": 0.05, "Fw": 15}
    controller = SamplingMPC(
        horizon=100, hold=25, every=50, samples=8, iterations=1, method="cem", guess=follow, deviation=spread
    )
    plain = run_episode(env, OpenLoop(recipe), seed=3)
    better = run_episode(env, controller, seed=3)
    assert not better.failure
    assert better.total > plain.total
