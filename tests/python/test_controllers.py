"""Baseline controllers and evaluation."""

import numpy as np
import pytest

import smpl
from smpl.controllers import Constant, Controller, Nominal, OpenLoop, Profile, Proportional, Uniform, isothermal
from smpl.evaluation import Episode, Statistics, evaluate, per_episode, pooled, returns, run_episode


@pytest.mark.parametrize(
    "controller", [Constant([1.0]), Nominal(), OpenLoop([[1.0]]), Profile(), Proportional(), Uniform()]
)
def test_every_baseline_is_a_controller(controller):
    assert isinstance(controller, Controller)


def test_the_proportional_controller_reproduces_the_reference_actions(reference):
    table = reference("reactor_2.csv")
    env = smpl.Env("reactor", normalize=False, scenario="legacy")
    controller = Proportional()
    for i in range(20):
        env.reset(options={"state": [table[f"{n}.orig"][i] for n in ("c_A", "T", "h")]})
        np.testing.assert_allclose(controller.action(env), [table["T_c"][i + 1], table["q_out"][i + 1]], rtol=1e-6)


def test_the_proportional_controller_clips_to_the_action_box(reactor):
    reactor.reset(options={"state": [0.2, 44.0, 1.0]})
    np.testing.assert_array_equal(Proportional().action(reactor), [15.0, 0.2])


@pytest.mark.parametrize(
    ("k", "temperature"), [(0, 11), (24, 14), (25, 14), (120, 14), (144, 15.92), (145, 16), (184, 9), (300, 9)]
)
def test_the_beer_profile_is_the_published_one(k, temperature):
    from smpl.controllers.beer import profile_temperature

    assert profile_temperature(k) == pytest.approx(temperature)


@pytest.mark.parametrize(
    ("scenario", "controller", "steps", "total"),
    [
        ("default", Profile(), 145, 56),
        ("legacy", Profile(), 146, 55),
        ("default", isothermal(13.0), 187, 14),
        ("legacy", isothermal(13.0), 189, 12),
    ],
)
def test_the_beer_baselines_finish_in_the_published_step(scenario, controller, steps, total):
    episode = run_episode(smpl.Env("beer", scenario=scenario), controller, 0, {"start": "nominal"})
    assert (episode.steps, episode.total, episode.success) == (steps, total, True)


@pytest.mark.parametrize("temperature", [9.0, 12.0])
def test_a_cold_beer_never_finishes_and_has_the_published_pooled_statistics(temperature):
    episodes = evaluate(smpl.Env("beer", scenario="legacy"), isothermal(temperature), 3)
    found = pooled(episodes)
    assert (found.mean, found.deviation) == (pytest.approx(-1.99005, abs=1e-5), pytest.approx(14.0014, abs=1e-4))
    # In `legacy` the clock leaves its box in step 201, so that the last step is a failure.
    assert all(episode.steps == 201 and episode.failure.startswith("state_box") for episode in episodes)


def test_the_proportional_controller_loses_about_a_tenth_of_the_starts():
    episodes = evaluate(smpl.Env("reactor", scenario="legacy", reward="setpoint_change"), Proportional(), 300)
    failed = np.mean([bool(episode.failure) for episode in episodes])
    assert 0.04 < failed < 0.17
    found = pooled(episodes)
    # 1000 sqrt(failed episodes / steps), section 9 of the reactor's specification.
    steps = sum(episode.steps for episode in episodes)
    assert found.deviation == pytest.approx(1000 * np.sqrt(failed * 300 / steps), rel=0.1)


def episode(rewards, failure=""):
    n = len(rewards)
    flags = np.zeros(n, dtype=bool)
    return Episode(
        0, np.zeros((n + 1, 1), np.float32), np.zeros((n + 1, 1)), np.zeros((n, 1)), np.array(rewards), flags, flags,
        np.zeros(n + 1), np.arange(n + 1.0), failure, False,
    )  # fmt: skip


def test_statistics_are_pooled_over_steps_or_taken_over_episodes():
    episodes = [episode([1.0, 3.0]), episode([-1000.0], "state_box")]
    assert pooled(episodes) == Statistics(-332.0, pytest.approx(np.std([1, 3, -1000])), 3)
    assert per_episode(episodes).mean == pytest.approx((2 - 1000) / 2)
    assert per_episode([episode([1.0, -5.0], "x")], failed=-1000.0).mean == -1000.0
    assert returns(episodes).mean == pytest.approx((4 - 1000) / 2)
    assert pooled([]).count == 0


def test_predictive_control_reproduces_the_reference_actions(reference):
    pytest.importorskip("casadi", reason="CasADi is not installed")
    from smpl.controllers.nmpc import ReactorNMPC

    table = reference("reactor_extra_mpc.csv")
    env = smpl.Env("reactor", normalize=False, scenario="legacy")
    controller = ReactorNMPC()
    env.reset()
    controller.reset(env)
    for i in range(30):
        # The original's own states, which carry the errors of its integrator, are what its controller saw.
        env.reset(options={"state": [table[f"{n}.orig"][i] for n in ("c_A", "T", "h")]})
        expected = [table["T_c"][i + 1], table["q_out"][i + 1]]
        np.testing.assert_allclose(controller.action(env), expected, rtol=1e-5, atol=1e-5)
    assert controller.failures == 0


def test_the_differentiation_matrix_is_exact_for_polynomials_of_its_degree():
    from smpl.controllers.nmpc import POINTS, differentiation_matrix

    polynomial = np.polynomial.Polynomial([1.0, -2.0, 0.5, 3.0, -1.0])
    np.testing.assert_allclose(
        differentiation_matrix(POINTS) @ polynomial(POINTS), polynomial.deriv()(POINTS), atol=1e-12
    )
    np.testing.assert_allclose(POINTS[1:4], [0.1127016654, 0.5, 0.8872983346], atol=1e-10)
