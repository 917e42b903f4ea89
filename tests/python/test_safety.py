"""A safety filter keeps limits with the least change of the action."""

import numpy as np
import pytest

import smpl
from smpl.controllers import LQR, Constant, SafetyFilter
from smpl.learning.agents import Agent
from smpl.learning.plan import Plan, Task
from smpl.learning.reports import table
from smpl.learning.scores import score

LEVEL = """model Level "a tank that integrates its inflow"
time t : h
action u : m/h = 0 in -1..1
action other = 0 in -1..1
state h : m = 0.5 in -5..5
eq d/dt h = u
observe h
reward high default = h / 1 [m]
{limit}
episode {{ step = 1 [h], max_steps = 30 }}
"""
FAIL = 'fail high when h > 1 [m] "the tank overflows"'
CONSTRAINT = "constraint high when h > 1 [m]"


def run(env, controller, seed=0):
    return smpl.evaluation.run_episode(env, controller, seed=seed)


@pytest.fixture(params=[FAIL, CONSTRAINT])
def env(request):
    return smpl.Env(smpl.compile(source=LEVEL.format(limit=request.param)), normalize=False)


def test_safe_actions_are_not_changed_and_others_are_changed_to_the_limit(env):
    controller = SafetyFilter(Constant([0.3, 0.7]), env, horizon=5)
    episode = run(env, controller)
    assert episode.steps == 30 and not episode.failure and episode.costs.max() == 0
    # 0.5, 0.8, then the limit of 1: the exact least change of the second action is to 0.2, of the later ones to 0.
    assert episode.actions[0].tolist() == pytest.approx([0.3, 0.7])
    assert episode.actions[1].tolist() == pytest.approx([0.2, 0.7], abs=2e-3)
    assert np.abs(episode.actions[3:, 0]).max() < 1e-3
    assert episode.states[:, 0].max() <= 1.0
    assert episode.actions[:, 1] == pytest.approx(np.full(30, 0.7))


def test_interventions_and_their_size_are_counted(env):
    controller = SafetyFilter(Constant([0.3, 0.0]), env, horizon=3)
    run(env, controller)
    found = controller.statistics()
    assert found["intervention_rate"] == pytest.approx(29 / 30)
    # The range is 2: changes of 0.1 once and of 0.3 in 28 steps.
    assert found["mean_change"] == pytest.approx((0.05 + 28 * 0.15) / 30, abs=2e-3)
    assert found["unresolved_rate"] == 0


@pytest.mark.parametrize("workers", [1, 2])
def test_an_evaluation_reports_the_interventions_of_the_filter(workers):
    task = Task.of(smpl.compile(source=LEVEL.format(limit=CONSTRAINT)))
    agents = {"plain": Constant([0.3, 0.0]), "filtered": SafetyFilter(Constant([0.3, 0.0]), horizon=3)}
    scores = [score(Plan.of(task, Agent(name, one), 10), workers, kept=0) for name, one in agents.items()]
    assert "safety_filter" not in scores[0].report()
    found = scores[1].report()["safety_filter"]
    # As above, in each of ten episodes.
    assert found["intervention_rate"] == pytest.approx(29 / 30) and found["unresolved_rate"] == 0
    assert found["mean_change"] == pytest.approx((0.05 + 28 * 0.15) / 30, abs=2e-3)
    head, plain, filtered = table({"controllers": {one.name: one.report() for one in scores}})
    place = head.index("filter acts")
    assert (plain[place], filtered[place]) == ("", "97 %")


def test_a_policy_without_danger_is_left_alone(env):
    controller = SafetyFilter(lambda observation: np.array([-0.1, 0.2]), env, horizon=5)
    episode = run(env, controller)
    assert controller.interventions == 0
    assert episode.actions == pytest.approx(np.tile([-0.1, 0.2], (30, 1)))


def test_without_a_safe_plan_the_best_one_counts():
    text = LEVEL.format(limit=CONSTRAINT).replace("= 0.5 in -5..5", "= 3 in -5..5")
    env = smpl.Env(smpl.compile(source=text), normalize=False)
    controller = SafetyFilter(Constant([0.3, 0.0]), env, horizon=2)
    episode = run(env, controller)
    assert controller.unresolved >= 1
    assert episode.actions[0, 0] == pytest.approx(-1.0)
    assert episode.costs[-1] == 0


def test_a_policy_that_empties_the_reactor_is_kept_from_it():
    env, start = smpl.Env("reactor", max_steps=15), {"start": "steady"}
    draining = Constant([26.85, 0.2])
    assert "empty" in smpl.evaluation.run_episode(env, draining, options=start).failure
    controller = SafetyFilter(draining, env, horizon=8, backup=[26.85, 0.1], samples=8)
    assert not smpl.evaluation.run_episode(env, controller, options=start).failure
    assert 0 < controller.statistics()["intervention_rate"] < 1


def test_a_good_controller_of_the_reactor_is_left_alone_near_its_steady_state():
    env = smpl.Env("reactor")
    regulator = LQR(env.model)
    controller = SafetyFilter(regulator, env, horizon=5)
    env.reset(seed=0, options={"start": "steady"})
    controller.reset(env)
    assert controller.action(env) == pytest.approx(regulator.action(env), rel=1e-12)
    assert controller.interventions == 0


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"horizon": 0}, "horizon is 0"),
        ({"backup": [1.0]}, r"backup has shape \(1,\), expected \(2,\)"),
        ({"margin": -0.1}, "margin is -0.1"),
        ({"samples": -1}, "samples is -1"),
    ],
)
def test_invalid_arguments_are_named(env, arguments, says):
    with pytest.raises(ValueError, match=says):
        SafetyFilter(Constant([0.0, 0.0]), env, **arguments)
