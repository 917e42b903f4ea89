"""Baseline controllers and evaluation."""

import csv
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import smpl
from smpl.commands.main import main
from smpl.controllers import (
    Constant,
    Controller,
    Nominal,
    OpenLoop,
    Policy,
    Profile,
    Proportional,
    Uniform,
    isothermal,
)
from smpl.controllers.reactor import ReactorNMPC
from smpl.evaluation import Episode, Statistics, evaluate, per_episode, pooled, returns, run_episode

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    "controller", [Constant([1.0]), Nominal(), OpenLoop([[1.0]]), Policy("mpc"), Profile(), Proportional(), Uniform()]
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
    pytest.importorskip("casadi", reason="CasADi is not installed")
    from smpl.controllers.collocation import differentiation_matrix, nodes, quadrature_weights

    points = np.append(0.0, nodes("gauss", 3))
    polynomial = np.polynomial.Polynomial([1.0, -2.0, 0.5, 3.0, -1.0])
    np.testing.assert_allclose(
        differentiation_matrix(points) @ polynomial(points), polynomial.deriv()(points), atol=1e-12
    )
    np.testing.assert_allclose(points[1:4], [0.1127016654, 0.5, 0.8872983346], atol=1e-10)
    # Radau's nodes integrate polynomials up to degree 4 exactly.
    radau = nodes("radau", 3)
    assert quadrature_weights(radau) @ polynomial(radau) == pytest.approx(polynomial.integ()(1.0), abs=1e-12)


@pytest.mark.parametrize(
    ("model", "controller", "says"),
    [
        ("reactor", Constant([26.85]), r"action has shape \(1,\), expected \(2,\)"),
        ("reactor", OpenLoop([[26.85, 0.1], [26.85]]), r"action 1 has shape \(1,\), expected \(2,\)"),
        ("reactor", Profile(), "for the actions T; Reactor has T_c, q_out"),
        ("reactor", isothermal(), "for the actions T; Reactor has T_c, q_out"),
        ("beer", Proportional(), "for the actions T_c, q_out; Beer has T"),
        ("beer", ReactorNMPC(), "for the actions T_c, q_out; Beer has T"),
        ("reactor", Policy("mpc"), "policy: unknown 'mpc'; there are: nominal"),
        ("beer", Policy("profil"), "policy: unknown 'profil'; there are: nominal, profile"),
    ],
)
def test_a_controller_of_another_process_is_refused(model, controller, says):
    with pytest.raises(ValueError, match=says):
        run_episode(smpl.Env(model), controller, 0)


class Short:
    """Forgets an action."""

    def reset(self, env):
        pass

    def action(self, env):
        return [26.85]


@pytest.mark.parametrize(
    "make",
    [
        lambda env: smpl.controllers.baseline("reactor", "pid"),
        lambda env: Nominal(),
        lambda env: smpl.controllers.LQR(env, integral=("T", "h")),
        lambda env: smpl.controllers.LQG(smpl.controllers.LQR(env), smpl.controllers.ExtendedKalmanFilter(env)),
        lambda env: smpl.controllers.SamplingMPC(env, horizon=3, samples=8, seed=0),
    ],
)
def test_wrappers_are_no_matter_to_a_controller(make):
    wrapped = gymnasium.wrappers.RecordEpisodeStatistics(gymnasium.make("smpl/Reactor-v0"))
    chosen = []
    for env in (wrapped, wrapped.unwrapped):
        wrapped.reset(seed=3)
        controller = make(env)
        controller.reset(env)
        chosen.append(controller.action(env))
    np.testing.assert_array_equal(*chosen)


@pytest.mark.parametrize("given", [object(), Proportional, None, "pid"])
def test_what_is_no_controller_is_refused(given):
    with pytest.raises(TypeError, match="expected an object with reset"):
        evaluate(smpl.Env("reactor"), given)


def test_an_action_of_a_wrong_shape_is_refused():
    with pytest.raises(ValueError, match=r"the controller's action has shape \(1,\), expected \(2,\)"):
        run_episode(smpl.Env("reactor"), Short(), 0)


def test_random_actions_belong_to_the_episode():
    env, controller = smpl.Env("reactor", max_steps=5), Uniform()
    first, second = (evaluate(env, controller, 3, seed=4) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.actions, b.actions)
        np.testing.assert_array_equal(a.observations, b.observations)
    assert not np.array_equal(first[0].actions, first[1].actions)
    assert not np.array_equal(first[0].actions, run_episode(env, Uniform(1), 4).actions)
    # Episodes that follow one another without a seed differ.
    assert not np.array_equal(run_episode(env, controller).actions, run_episode(env, controller).actions)


@pytest.mark.parametrize(
    ("model", "controller", "name"), [("pensim", Nominal(), "nominal"), ("mab", Nominal(), "nominal"),
                                      ("beer", Policy("profile"), "profile"), ("atropine", Policy("mpc"), "mpc"),
                                      ("reactor", Nominal(), "nominal")]
)  # fmt: skip
def test_policies_are_those_of_the_command(model, controller, name, tmp_path, capfd):
    """The command writes what it applied."""
    out = tmp_path / "run.csv"
    source = ROOT / "models" / f"{model}.eq"
    command = ["simulate", str(source), "--policy", name, "--steps", "12", "--seed", "3", "--out", str(out)]
    assert main(command) == 0
    env = smpl.Env(model, normalize=False, max_steps=12)
    episode = run_episode(env, controller, 3)
    with out.open(newline="") as file:
        table = list(csv.DictReader(file))
    # Row k of the table is the state after k steps and the action that led to it.
    expected = np.array([[float(row[name]) for name in env.action_names] for row in table[1 : episode.steps + 1]])
    np.testing.assert_allclose(episode.actions, expected, rtol=1e-6, atol=1e-6)


def test_the_profile_of_the_package_is_the_policy_of_the_model():
    env = smpl.Env("beer")
    env.reset(seed=0)
    for _ in range(100):
        np.testing.assert_allclose(env.policy("profile"), Profile().action(env))
        env.step(np.zeros(1))


def test_the_proportional_controller_earns_what_its_path_is_worth():
    """The limited distance telescopes: the rewards of an episode are its end less its start, whatever lies between."""
    for seed in (107, 0, 1):
        env = smpl.Env("reactor", reward="setpoint_change")
        env.reset(seed=seed)
        distances, total, over = [], 0.0, False
        while not over:
            _, reward, terminated, truncated, info = env.step(env.from_physical(Proportional().action(env)))
            over = terminated or truncated
            if not terminated:
                total += reward
                distances.append(info["rewards"]["setpoint"])
        # A start is at a distance of -1, or of less where a coordinate starts within 1e-4 of the set-point.
        assert total == pytest.approx(distances[-1] + 1, abs=1e-9)
        assert total <= 1


def test_a_start_beside_the_set_point_does_not_pay():
    """Cooled for ten steps and left alone for ten: this returned 2e10."""
    returns = {}
    for variants in ((), ("limited_change",)):
        env = smpl.Env("reactor", normalize=False, reward="setpoint_change", variants=variants)
        env.reset(options={"state": np.asarray(env.steady_state) * (1 + 1e-6)})
        total = 0.0
        for step in range(40):
            action = [15.0, 0.1] if step < 10 else [26.85, 0.1]
            _, reward, terminated, truncated, _ = env.step(action)
            total += reward
            if terminated or truncated:
                break
        returns[variants] = total
    assert returns[()] <= 1 and returns[("limited_change",)] > 1e6
