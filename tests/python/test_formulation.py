"""Environments as a learner sees them: the process beneath is the same, and policies come back to it."""

import re
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import smpl
from smpl.learning import Plan, Task
from smpl.learning.agents import Agent
from smpl.learning.environments import Curriculum, Formulated, FormulatedVectorEnv
from smpl.learning.formulation import Exploration, Form, FormulatedPolicy, Formulation, formulated
from smpl.learning.running import run
from smpl.loop import Settings
from smpl.policies import Rows

BOTH = {"centre": "pid", "reach": 0.5, "history": 3, "reward_scale": 0.1, "failure_reward": -7.0}


def rows(env):
    return Rows(
        env, env.reading[None] if hasattr(env, "reading") else None, env.state[None], np.array([env.steps]), [{}]
    )


def test_actions_span_from_the_centre_to_the_limits():
    env = smpl.Env("reactor")
    env.reset(seed=0)
    form = Form(Formulation(centre="nominal", reach=0.5, limits={"T_c": (20, 30)}), env)
    for action, expected in (([0, 0], [26.85, 0.1]), ([1, -1], [28.425, 0.075]), ([-1, 1], [23.425, 0.15])):
        np.testing.assert_allclose(form.physical(rows(env), np.array([action])), [expected], rtol=1e-14)
        np.testing.assert_allclose(form.reverse(rows(env), np.array([expected])), [action], rtol=1e-12, atol=1e-12)


def test_an_array_of_actions_is_named_by_one_name():
    source = (
        "model Two\ntime t : s\nset s = {a, b}\naction F[s] : 1/s = 0.5 in 0..1\naction u : 1/s = 0 in 0..1\n"
        "state x[s] = 1 in 0..9\neq d/dt x[i] = F[i] - u*x[i] for i in s\nobserve x\nreward r default = u*1[s]\n"
        "episode { step = 1 [s], max_steps = 2 }\n"
    )
    env = smpl.Env(smpl.compile(source=source))
    env.reset(seed=0)
    narrow = Form(Formulation(centre="nominal", limits={"F": (0.25, 0.75)}, windows={"x": (0, 2)}), env)
    at = env.action_names.index
    moved = narrow.physical(rows(env), np.array([[-1.0, -1.0, -1.0]]))[0]
    assert (moved[at("F[a]")], moved[at("F[b]")], moved[at("u")]) == (0.25, 0.25, 0)
    assert Form(Formulation(centre="nominal", left=("F",)), env).action_space().shape == (1,)
    with pytest.raises(ValueError, match=r"left has 'F\[a\]' twice"):
        Form(Formulation(left=("F", "F[a]")), env)
    with pytest.warns(UserWarning, match=r"limits\['u'\] is \(0.5, 1\) without the nominal action 0"):
        Form(Formulation(centre="nominal", limits={"u": (0.5, 1)}), env)


def test_a_curriculum_outside_of_the_bounds_is_refused_before_it_begins():
    stages = {"spread": [(0.0, 0.05, 0.05), (1.0, 0.3, 1.2)]}
    with pytest.raises(ValueError, match=r"a stage of curriculum\['spread'\] is 0.3 to 1.2, outside the bounds"):
        FormulatedVectorEnv("reactor", 2, curriculum=stages, autoreset_mode="same_step")


@pytest.mark.parametrize(("model", "learned", "steps"), [("mab", 7, 2), ("mab_plant", 12, 21)])
def test_what_is_left_is_done_by_the_rules_that_the_model_declares(model, learned, steps):
    env = smpl.Env(model)
    env.reset(seed=3)
    form = Form(Formulation(centre="rules", left=("F_out", "switch")), env)
    assert form.action_space().shape == (learned,)
    for _ in range(steps):
        given = form.physical(rows(env), np.zeros((1, learned)))[0]
        np.testing.assert_array_equal(given, env.policy("nominal"))
        env.step(env.from_physical(given))


def test_a_recipe_is_followed_step_by_step_in_a_batch():
    batch = FormulatedVectorEnv("pensim", 2, formulation={"centre": "recipe", "reach": 0.1}, max_steps=70)
    env = smpl.Env("pensim", max_steps=70)
    batch.reset(seed=4)
    env.reset(seed=4)
    for _ in range(70):  # the feeds change at 3, 4, 8 and 12 h
        expected = env.step(env.from_physical(env.policy("nominal")).astype(np.float32))
        observations, rewards, *_ = batch.step(np.zeros((2, 6), dtype=np.float32))
        np.testing.assert_array_equal(observations[0], expected[0])
        assert rewards[0] == expected[1]


@pytest.mark.parametrize("normalize", [True, False])
def test_a_window_is_what_the_learner_sees_as_minus_one_and_one(normalize):
    formulation = {"windows": {"T": (45.0, 58.0), "c_A": (0.8, 0.95)}, "history": 2}
    env = Formulated(smpl.Env("reactor", normalize=normalize), formulation)
    plain = smpl.Env("reactor", normalize=False)
    batch = FormulatedVectorEnv("reactor", 1, formulation=formulation, normalize=normalize)
    names, seen = plain.observation_names, []
    assert env.observation_space.low[names.index("T")] == -1 and env.observation_space.high[names.index("T")] == 1
    for seed in range(20):
        observation, physical = env.reset(seed=seed)[0], plain.reset(seed=seed)[0]
        np.testing.assert_array_equal(batch.reset(seed=[seed])[0][0], observation)
        for name, (low, high) in formulation["windows"].items():
            expected = np.interp(physical[names.index(name)], [low, high], [-1, 1])
            seen.append(observation[names.index(name)])
            assert seen[-1] == pytest.approx(expected, abs=2e-4)  # single precision, one part in 1e7 of the bounds
        assert observation in env.observation_space
    assert min(seen) == -1 and max(seen) == 1 and np.ptp(np.abs(seen)) > 0.3


def test_zero_is_what_the_inner_controller_does():
    plain, env = smpl.Env("reactor"), Formulated(gymnasium.make("smpl/Reactor-v0"), {"centre": "pid"})
    controller = smpl.controllers.Proportional()
    plain.reset(seed=5)
    env.reset(seed=5)
    controller.reset(plain)
    for _ in range(30):
        expected = plain.step(plain.from_physical(controller.action(plain)).astype(np.float32))
        given = env.step(np.zeros(2, dtype=np.float32))
        np.testing.assert_array_equal(given[0], expected[0])
        assert given[1] == expected[1]


@pytest.mark.parametrize("mode", ["same_step", "next_step"])
def test_a_batch_gives_the_bits_of_single_environments(mode):
    batch = FormulatedVectorEnv("reactor", 3, formulation=BOTH, autoreset_mode=mode, scenario="legacy", max_steps=12)
    singles = [Formulated(smpl.Env("reactor", scenario="legacy", max_steps=12), BOTH) for _ in range(3)]
    observations, _ = batch.reset(seed=11)
    for i, env in enumerate(singles):
        np.testing.assert_array_equal(env.reset(seed=11 + i)[0], observations[i])
    generator, begun = np.random.default_rng(0), np.zeros(3, dtype=bool)
    for _ in range(40):
        actions = generator.uniform(-1, 1, (3, 2)).astype(np.float32)
        observations, rewards, terminated, truncated, infos = batch.step(actions)
        for i, env in enumerate(singles):
            if begun[i]:  # next-step autoreset: this step was the reset
                np.testing.assert_array_equal(env.reset()[0], observations[i])
                begun[i] = False
                continue
            single = env.step(actions[i])
            ended = single[2] or single[3]
            seen = infos["final_obs"][i] if ended and mode == "same_step" else observations[i]
            np.testing.assert_array_equal(single[0], seen)
            assert (single[1], single[2], single[3]) == (rewards[i], terminated[i], truncated[i])
            if ended and mode == "same_step":
                np.testing.assert_array_equal(env.reset()[0], observations[i])
            begun[i] = ended and mode == "next_step"


def test_history_and_rewards():
    env = Formulated(smpl.Env("reactor"), {"history": 2, "reward_scale": 0.5, "reward_range": (-0.1, 0.1)})
    plain = smpl.Env("reactor")
    first, second = env.reset(seed=1)[0], plain.reset(seed=1)[0]
    np.testing.assert_array_equal(first, np.concatenate([second, second]))
    given, expected = env.step(np.zeros(2)), plain.step(np.zeros(2, dtype=np.float32))
    np.testing.assert_array_equal(given[0], np.concatenate([second, expected[0]]))
    assert given[1] == max(-0.1, 0.5 * expected[1])
    hot = Formulated(smpl.Env("reactor"), {"failure_reward": -7.0})
    hot.reset(seed=1, options={"state": {"T": 99.9, "c_A": 1.0}})
    assert hot.step(np.ones(2))[1:3] == (-7.0, True)


def test_it_is_an_environment_of_gymnasium():
    check_env(Formulated(smpl.Env("reactor"), BOTH), skip_render_check=True)


def test_a_policy_of_a_formulation_runs_as_any_other():
    class Policy:
        def predict(self, observations):
            assert observations.shape[1] == 9  # three observations
            return np.tanh(observations[:, [0, 7]])

    task, env = Task.of("reactor", max_steps=25), Formulated(smpl.Env("reactor", max_steps=25), BOTH)
    agent = Agent("policy", FormulatedPolicy(Policy(), Formulation.of(BOTH)))
    plan = Plan.of(task, agent, 5, seed=2)
    for batch in (True, False):
        for job, episode in run(plan, plan.jobs(0, 5), Settings(batch=batch)):
            observation, _ = env.reset(seed=job.seed)
            for k in range(episode.steps):
                np.testing.assert_array_equal(observation[-3:], episode.observations[k])
                observation, *_ = env.step(np.tanh(observation[[0, 7]]))


def test_a_curriculum_moves_the_parameters_of_episodes():
    stages = {"spread": [(0.0, 0.01, 0.01), (0.5, 0.3, 0.3)]}
    assert Curriculum(stages).ranges(0.25) == {"spread": (pytest.approx(0.155), pytest.approx(0.155))}
    env = FormulatedVectorEnv("reactor", 8, curriculum=stages, autoreset_mode="same_step", max_steps=3)
    steady = np.array([0.8778252, 51.34660837, 0.659])
    env.reset(seed=4)
    assert np.all(np.abs(env.state / steady - 1) <= 0.01 + 1e-9)
    env.progress = 1.0
    for _ in range(3):
        observations, _, _, truncated, infos = env.step(np.zeros((8, 2)))
    assert truncated.all()
    assert np.abs(env.state / steady - 1).max() > 0.02
    assert not np.array_equal(infos["final_obs"][0], observations[0])
    again = FormulatedVectorEnv("reactor", 8, curriculum=stages, autoreset_mode="same_step", max_steps=3)
    env.progress = 0.0
    np.testing.assert_array_equal(env.reset(seed=4)[0], again.reset(seed=4)[0])


@pytest.mark.parametrize(
    ("formulation", "says"),
    [
        ({"center": "pid"}, "formulation.*'center'"),
        ({"centre": "pdi"}, "centre is 'pdi'; there are: box, nominal, rules"),
        ({"centre": "rules"}, "centre is 'rules', which Reactor does not have"),
        ({"reach": 0}, "reach is 0"),
        ({"history": 0}, "history is 0"),
        ({"reward_scale": -1}, "reward_scale is -1"),
        ({"reward_range": (1, 0)}, "reward_range is"),
        ({"failure_reward": float("nan")}, "failure_reward is nan, expected a finite number"),
        ({"left": ["T_c", "q_out"]}, "nothing is left to learn"),
        ({"left": ["T_d"]}, "left.*'T_d'"),
        ({"windows": {"T_x": (0, 1)}}, "windows.*'T_x'"),
        ({"windows": {"T": (1, 0)}}, r"windows\['T'\] is \(1, 0\)"),
        (
            {"centre": "constant:1"},
            r"centre is 'constant:1', which does not fit Reactor: action has shape \(1,\), expected",
        ),
        ({"centre": "constant:1,2,3"}, r"which does not fit Reactor: action has shape \(3,\), expected \(2,\)"),
        ({"centre": "constant:nan,0.1"}, "centre is 'constant:nan,0.1', expected finite actions"),
        ({"centre": "random"}, "centre is 'random', another action each time; there are: box, nominal"),
        ({"left": "T_c"}, "left is 'T_c', expected names of actions"),
        ({"left": None}, "left is None, expected names of actions"),
        ({"limits": {"T_c": (20, 25, 30)}}, r"limits\['T_c'\] is \(20, 25, 30\), expected \(low, high\)"),
        ({"windows": {"T": (0, float("inf"))}}, r"windows\['T'\] is \(0, inf\), expected \(low, high\), both finite"),
        ({"reward_range": (1,)}, r"reward_range is \(1,\), expected \(low, high\)"),
        ({"limits": {"T_c": (10, 20)}}, r"limits\['T_c'\] is \(10.0, 20.0\), expected a part of 15.0..35.0"),
    ],
)
def test_a_formulation_that_cannot_be_meant_is_told(formulation, says):
    with pytest.raises(ValueError, match=says):
        Formulated(smpl.Env("reactor"), formulation)


FEEDBACK = """
model Feedback "A level that is held"
time t : s
action u = 0 in -5..5
state x = 1 in -100..100
discrete sp = 0.5
eq d/dt x = (u - x)*1 [1/s]
at end { next sp = sp + 0.25 }
observe x
policy nominal { u = 2*x }
policy held { u = 3*(sp - x) }
policy ramp { u = 0.5*n }
reward r default = x
episode { step = 0.5 [s], max_steps = 6 }
"""


def test_a_policy_that_reads_the_state_is_no_recipe_though_all_episodes_are_equal():
    with pytest.raises(ValueError, match="the policy 'nominal' of Feedback depends on more than the step"):
        Formulated(smpl.Env(smpl.compile(source=FEEDBACK)), {"centre": "recipe"})


def test_the_centre_may_be_any_policy_of_the_model():
    model = smpl.compile(source=FEEDBACK)
    actions = np.random.default_rng(1).uniform(-1, 1, (6, 4, 1))
    for centre, chosen in (("held", lambda x, k: 3 * (0.5 + 0.25 * k - x)), ("ramp", lambda x, k: 0.5 * k)):
        form = {"centre": centre, "reach": 0.5}
        batch = FormulatedVectorEnv(model, 4, formulation=form, autoreset_mode="disabled")
        single = Formulated(smpl.Env(model), form)
        batch.reset(seed=0)
        single.reset(seed=0)
        for k, given in enumerate(actions):
            # dx/dt = u - x over half a second, u held: closed form.
            x, a = batch.state[:, 0], 0.5 * given[:, 0]
            middle = np.clip(chosen(x, k), -5, 5)
            u = middle + a * np.where(a < 0, middle + 5, 5 - middle)
            batch.step(given)
            single.step(given[0])
            np.testing.assert_allclose(batch.state[:, 0], u + (x - u) * np.exp(-0.5), rtol=1e-4)
            assert single.unwrapped.state[0] == batch.state[0, 0]
        assert len(set(batch.state[:, 0])) == 4


def test_what_a_policy_would_have_chosen_is_not_known_of_recorded_episodes(tmp_path):
    from smpl.datasets import collect

    pytest.importorskip("pyarrow")
    (tmp_path / "feedback.eq").write_text(FEEDBACK)
    (one,) = collect(tmp_path / "feedback.eq", "held", 1, tmp_path / "set", states=True)
    with pytest.raises(ValueError, match="'held' is a policy of Feedback: what it would have chosen is not known"):
        formulated(one, Form(Formulation(centre="held"), smpl.Env(tmp_path / "feedback.eq")))


def test_a_window_on_an_observation_without_bounds_is_in_physical_units():
    text = FEEDBACK.replace("state x = 1 in -100..100", "state x = 1 in -4..4\nstate y = 1")
    text = text.replace("observe x", "observe x, y")
    text = text.replace("eq d/dt x = (u - x)*1 [1/s]", "eq d/dt x = (u - x)*1 [1/s]\neq d/dt y = x*1 [1/s]")
    for normalize in (True, False):
        env = smpl.Env(smpl.compile(source=text), normalize=normalize)
        env = Formulated(env, {"windows": {"x": (0, 2), "y": (0, 2)}})
        env.reset(seed=0)
        for _ in range(3):
            seen = env.step([0.1])[0]
            # A window from 0 to 2: the middle is 1, the half width 1.
            np.testing.assert_allclose(seen, np.clip(env.unwrapped.reading - 1, -1, 1), rtol=1e-6, atol=1e-6)
            assert np.isfinite(seen).all()


def test_a_function_is_a_policy_of_a_formulation():
    form = Formulation(centre="nominal", reach=0.5)
    mine = Agent("mine", FormulatedPolicy(lambda seen: 0.1 * seen[:2], form))
    plan = Plan.of(Task.of("reactor", max_steps=6), mine, 2)
    env = Formulated(smpl.Env("reactor", max_steps=6), form)
    for job, episode in run(plan, plan.jobs(0, 2), Settings()):
        seen, _ = env.reset(seed=job.seed)
        for k in range(episode.steps):
            seen, *_ = env.step(0.1 * seen[:2])
            np.testing.assert_array_equal(seen, episode.observations[k + 1])
    with pytest.raises(TypeError, match="policy is Uniform, expected an object with predict, or a function"):
        FormulatedPolicy(smpl.controllers.Uniform(), form)


def test_actions_of_a_wrong_shape_are_refused_as_by_the_environment():
    plain, env = smpl.Env("reactor"), Formulated(smpl.Env("reactor"), {"centre": "nominal"})
    for one in (plain, env):
        with pytest.raises(smpl.SimulationError, match="call reset first"):
            one.step(np.zeros(2))
        one.reset(seed=0)
        for action in (0.0, [0.1], np.zeros(3), np.zeros((2, 1)), np.zeros((2, 2)), [np.nan, 0.0]):
            with pytest.raises(ValueError, match="action"):
                one.step(action)
        assert one.unwrapped.steps == 0
    with pytest.raises(ValueError, match=r"action has shape \(1,\), expected \(2,\)"):
        env.reverse_action([0.0])
    np.testing.assert_array_equal(env.step(np.zeros(2))[0], plain.step(env.action(np.zeros(2)))[0])


def test_an_agent_whose_actions_have_another_shape_is_told():
    class Wide:
        def act(self, rows):
            return np.zeros((len(rows.steps), 1))

    plan = Plan.of(Task.of("reactor", max_steps=5), Agent("wide", Wide()), 3)
    with pytest.raises(smpl.learning.RunError, match=r"wide gave actions of shape \(3, 1\), expected \(3, 2\)"):
        list(run(plan, plan.jobs(0, 3), Settings()))


def test_progress_is_a_share():
    env = FormulatedVectorEnv("reactor", 2)
    for value in (float("nan"), -0.1, 1.5):
        with pytest.raises(ValueError, match=r"progress is .*, expected a number from 0 to 1"):
            env.progress = value
    env.progress = 1
    assert env.progress == 1.0


def test_a_policy_that_looks_at_the_state_is_no_recipe():
    env = smpl.Env("reactor", extra="policy nominal { T_c = value(T) - 25\n q_out = 0.1 }")
    with pytest.raises(ValueError, match="the policy 'nominal' of Reactor depends on more than the step"):
        Formulated(env, {"centre": "recipe"})


def test_a_schedule_of_set_points_is_part_of_the_task(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "learning.md").read_text(encoding="utf-8")
    (model,) = re.findall(r"^```\n(model Tracking.*?)^```$", text, re.S | re.M)
    path = tmp_path / "tracking.eq"
    path.write_text(model)
    env = smpl.Env(path, normalize=False)
    schedule = np.array([0.5] * 50 + [0.7] * 150)
    env.reset(seed=0, options={"disturbances": {"h_sp": schedule}})
    level = 0.5
    for k in range(200):
        flow = 0.1 + 0.1 * np.clip(5 * (schedule[k] - level), -1, 1)
        observation, reward, _, truncated, _ = env.step(np.array([flow]))
        level += 0.1 * (flow - 0.1) / 0.15
        assert observation[0] == pytest.approx(level, rel=1e-6)
        assert reward == pytest.approx(-((level - schedule[k]) ** 2), abs=1e-9)
    assert truncated and level == pytest.approx(0.7, abs=0.01)
    drawn = set()
    env.reset(seed=1)
    for _ in range(200):
        drawn.add(float(env.step(np.array([0.1]))[0][1]))
    assert len(drawn) > 3 and all(0.3 <= one <= 0.8 for one in drawn)


def test_curricula_that_cannot_be_meant_are_told():
    with pytest.raises(ValueError, match="must rise"):
        Curriculum({"spread": [(0.5, 0, 1), (0.5, 0, 1)]})
    with pytest.raises(ValueError, match="low <= high"):
        Curriculum({"spread": [(0.5, 1, 0)]})
    with pytest.raises(ValueError, match="SAME_STEP"):
        FormulatedVectorEnv("reactor", 2, curriculum={"spread": [(0, 0.1, 0.1)]})
    with pytest.raises(ValueError, match=r"curriculum.*'spred'"):
        FormulatedVectorEnv("reactor", 2, curriculum={"spred": [(0, 0.1, 0.1)]}, autoreset_mode="same_step")


def explored(model, formulation, tmp_path, episodes=3, **arguments):
    """Episodes of a centre with noise, and the formulation in their environment."""
    from smpl.datasets import collect

    task = Task.of(model, **arguments)
    agent = Agent("centre", Exploration(Formulation.of(formulation), 0.6))
    return collect(task.name, agent, episodes, tmp_path / "data", states=True, **arguments), Form(
        Formulation.of(formulation), task.env()
    )


@pytest.mark.parametrize(
    ("model", "formulation", "limit"),
    [
        ("reactor", {**BOTH, "windows": {"T": [40, 60]}, "limits": {"T_c": [20, 30]}}, 12),
        ("pensim", {"centre": "recipe", "reach": 0.1, "left": ["discharge", "Fw"]}, 20),
        ("mab_plant", {"centre": "rules", "left": ["F_out", "switch"], "reach": 0.02}, 3),
    ],
)
def test_recorded_episodes_are_what_a_learner_of_the_formulation_would_have_had(model, formulation, limit, tmp_path):
    pytest.importorskip("pyarrow")
    data, form = explored(model, formulation, tmp_path, max_steps=limit)
    env = Formulated(smpl.Env(model, max_steps=limit), formulation)
    for kept in data:
        seen = formulated(kept, form)
        assert np.abs(seen.actions).max() > 0.9 and np.ptp(seen.actions) > 1
        observation, _ = env.reset(seed=kept.seed)
        np.testing.assert_array_equal(seen.observations[0], observation)
        for k in range(kept.steps):
            observation, reward, *_ = env.step(seen.actions[k])
            np.testing.assert_allclose(seen.observations[k + 1], observation, rtol=0, atol=1e-4)
            assert seen.rewards[k] == pytest.approx(reward, rel=1e-4, abs=1e-4)


def test_episodes_that_are_none_of_a_formulation_are_refused(tmp_path):
    from smpl.datasets import collect

    pytest.importorskip("pyarrow")
    form = Form(Formulation(centre="nominal", limits={"T_c": (25, 28)}), smpl.Env("reactor", max_steps=5))
    for states, says in ((False, "without states"), (["T", "h"], "with 2 of 3 states")):
        bare = collect("reactor", "nominal", 1, tmp_path / f"bare{states}", states=states, max_steps=5)[0]
        with pytest.raises(ValueError, match=f"was collected {says}, and the centre 'pid' reads all: states=True"):
            formulated(bare, Form(Formulation(centre="pid"), smpl.Env("reactor", max_steps=5)))
        # A centre that looks at no state needs none.
        for centre in ("nominal", "recipe", "constant:26.85,0.1"):
            seen = formulated(bare, Form(Formulation(centre=centre), smpl.Env("reactor", max_steps=5)))
            np.testing.assert_allclose(seen.actions, 0, atol=1e-5)
    with pytest.raises(ValueError, match="the episode has 3 observations, Beer has 8"):
        formulated(bare, Form(Formulation(), smpl.Env("beer")))
    wide = collect("reactor", "random", 1, tmp_path / "wide", states=True, max_steps=5)[0]
    with pytest.raises(ValueError, match=r"has T_c = .*, which is not one of its formulation's actions"):
        formulated(wide, form)
    with pytest.raises(ValueError, match=r"has q_out = .*, which is not one of its formulation's actions"):
        formulated(wide, Form(Formulation(left=("q_out",)), smpl.Env("reactor", max_steps=5)))
