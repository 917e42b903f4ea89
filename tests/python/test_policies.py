"""Anything that chooses actions runs in `evaluate`, and in the commands with equal numbers."""

import sys
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import RescaleAction, TransformObservation

import smpl
from smpl.controllers import PID, Constant, Function, Loops, Noisy, Proportional, Uniform
from smpl.datasets import collect
from smpl.evaluate import compare_controllers
from smpl.evaluation import evaluate, run_episode
from smpl.policies import KINDS, as_policy

K = np.array([[100.0, 0.0, 0.0], [0.0, 0.0, 0.5]])


def physical(env, observation):
    """The published proportional law, written for the box of an environment."""
    state = env.observation_low + (np.asarray(observation, float) + 1) / 2 * (
        env.observation_high - env.observation_low
    )
    chosen = [26.85, 0.1] + K @ (state - [0.8778252, 51.34660837, 0.659])
    return env.from_physical(np.clip(chosen, env.action_low, env.action_high))


class StableBaselines:
    """The interface of Stable-Baselines3's policies, recurrent ones included."""

    def __init__(self, env):
        self.env, self.starts, self.memories = env, [], []

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        assert deterministic
        self.starts.append(bool(episode_start[0]))
        self.memories.append(state)
        return physical(self.env, observation), len(self.starts)


class Rows:
    """The interface of d3rlpy: a row for each observation."""

    def __init__(self, env):
        self.env = env

    def predict(self, x):
        assert x.ndim == 2
        return np.stack([physical(self.env, row) for row in x])


class RLlib:
    def __init__(self, env):
        self.env = env

    def compute_single_action(self, observation, explore=True):
        assert not explore
        return physical(self.env, observation), [], {}


@pytest.mark.parametrize("kind", [StableBaselines, Rows, RLlib, lambda env: lambda seen: physical(env, seen)])
def test_a_policy_of_any_library_does_what_the_same_law_does_as_a_controller(kind):
    env = smpl.Env("reactor", max_steps=20)
    for found, expected in zip(evaluate(env, kind(env), 3), evaluate(env, Proportional(), 3), strict=True):
        # What is observed has single precision, the controller sees the state.
        np.testing.assert_allclose(found.actions, expected.actions, atol=2e-4)
        assert found.failure == expected.failure


def test_a_recurrent_policy_keeps_its_memory_within_an_episode_and_not_beyond():
    env = smpl.Env("reactor", max_steps=3)
    policy = StableBaselines(env)
    assert [episode.steps for episode in evaluate(env, policy, 2, seed=0)] == [3, 3]
    assert policy.starts == [True, False, False] * 2
    assert policy.memories == [None, 1, 2, None, 4, 5]


def test_wrappers_of_actions_and_observations_are_honoured():
    env = smpl.Env("reactor", max_steps=4)
    seen = []

    def policy(observation):
        seen.append(observation)
        return [0.5, 0.25]

    wrapped = RescaleAction(
        TransformObservation(env, lambda o: 10 * o, gymnasium.spaces.Box(-10, 10, (3,), np.float32)), 0.0, 1.0
    )
    episode = run_episode(wrapped, policy, 0)
    np.testing.assert_array_equal(episode.observations[:-1], seen)
    assert np.abs(episode.observations).max() > 1.5
    # Half and a quarter of the way through the boxes 15..35 and 0.05..0.2.
    np.testing.assert_allclose(env.action, [25.0, 0.0875], rtol=1e-6)


def test_a_function_may_see_the_state_or_a_level_in_physical_units():
    shown = []
    env = smpl.Env("reactor", observation="online", max_steps=3)
    run_episode(env, Function(lambda seen: shown.append(seen) or [26.85, 0.1], sees="online"), 4)
    run_episode(env, Function(lambda seen: shown.append(seen) or [26.85, 0.1], sees="state"), 4)
    readings, states = np.array(shown[:3]), np.array(shown[3:])
    assert readings.shape == (3, 2) and states.shape == (3, 3)
    # T and h with the declared noise of 0.1 and 0.002.
    error = np.abs(readings - states[:, 1:])
    assert (error < [0.5, 0.01]).all() and (error > 0).any()


def test_a_controller_that_sees_another_level_is_refused_with_the_way_out():
    law = Function(lambda seen: [26.85, 0.1], sees="laboratory")
    with pytest.raises(ValueError, match="sees the level 'laboratory', the environment shows 'default': give it obs"):
        evaluate(smpl.Env("reactor"), law, 1)
    with pytest.raises(ValueError, match="which Reactor does not have; there are: observation, state, default, online"):
        evaluate(smpl.Env("reactor"), Function(lambda seen: [26.85, 0.1], sees="lab"), 1)
    with pytest.raises(ValueError, match="give the function itself"):
        Function(lambda seen: [26.85, 0.1], sees="observation")


def test_noise_belongs_to_the_episode():
    env = smpl.Env("reactor", max_steps=4)
    drawn = Function(lambda state, generator: [26.85, generator.uniform(0.05, 0.2)], random=True)
    noisy = Noisy(Constant([26.85, 0.1]), {"q_out": 0.01})
    for controller in (drawn, noisy):
        first, second = evaluate(env, controller, 2, seed=7), evaluate(env, controller, 2, seed=7)
        for a, b in zip(first, second, strict=True):
            np.testing.assert_array_equal(a.actions, b.actions)
        assert not np.array_equal(first[0].actions, first[1].actions)
        # Alone, or after another episode: the same.
        np.testing.assert_array_equal(run_episode(env, controller, 8).actions, first[1].actions)
    assert np.ptp(first[0].actions[:, 0]) == 0
    with pytest.raises(ValueError, match="deviation: unknown 'F'; there are: T_c, q_out"):
        run_episode(env, Noisy(Constant([26.85, 0.1]), {"F": 1.0}), 0)


def test_an_action_of_a_wrong_shape_of_a_policy_is_refused():
    with pytest.raises(ValueError, match=r"the policy's action has shape \(1,\), expected \(2,\)"):
        run_episode(smpl.Env("reactor"), lambda observation: [0.0], 0)


@pytest.mark.parametrize("normalize", [True, False])
def test_the_reading_is_what_the_environment_returned_in_physical_units(normalize):
    env = smpl.Env("reactor", normalize=normalize)
    with pytest.raises(ValueError, match="nothing was observed yet"):
        _ = env.reading
    env.reset(seed=2)
    np.testing.assert_allclose(env.reading, np.clip(env.state, env.observation_low, env.observation_high), rtol=1e-6)


class OnRows:
    """A policy of smpl: it acts on a batch."""

    def act(self, rows):
        interface = rows.interface
        error = rows.states[:, [0, 2]] - [0.8778252, 0.659]
        chosen = np.clip([26.85, 0.1] + error * [100.0, 0.5], interface.action_low, interface.action_high)
        return interface.from_physical(chosen)


POLICIES = {
    "Stable-Baselines3": lambda env: Library(env),
    "d3rlpy": Rows,
    "RLlib": RLlib,
    "function": lambda env: lambda seen: physical(env, seen),
    "rows": lambda env: OnRows(),
    "controller with a batched law": lambda env: Proportional(),
    "controller": lambda env: Loops(PID("T", "T_c", gain=0.3), others={"q_out": 0.1}),
    "random controller": lambda env: Uniform(3),
    "noisy controller": lambda env: Noisy(Proportional(), {"T_c": 0.2}),
}


class Library:
    """The interface of Stable-Baselines3: one observation, or a batch of them."""

    def __init__(self, env):
        self.env = env

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        rows = [physical(self.env, one) for one in np.atleast_2d(observation)]
        return np.array(rows if np.ndim(observation) == 2 else rows[0]), None


def equal(one, other):
    for name in ("observations", "states", "actions", "rewards", "terminations", "truncations", "costs", "times"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert (one.failure, one.success, one.seed) == (other.failure, other.success, other.seed)
    np.testing.assert_array_equal(one.details.physical, other.details.physical)
    for name in ("rewards", "violations", "discrete", "disturbances"):
        for key, values in getattr(one.details, name).items():
            np.testing.assert_array_equal(values, getattr(other.details, name)[key])


@pytest.mark.parametrize("kind", POLICIES)
def test_evaluation_collection_and_the_command_give_the_same_episodes(kind, tmp_path):
    env = smpl.Env("reactor", max_steps=20)
    expected = evaluate(env, POLICIES[kind](env), 5, seed=4)
    stored = collect("reactor", POLICIES[kind](env), 5, tmp_path, seed=4, max_steps=20, workers=1, states=True)
    for one, other in zip(stored, expected, strict=True):
        equal(one, other)
    _, (score,) = compare_controllers("reactor", [POLICIES[kind](env)], 5, seed=4, workers=1, max_steps=20)
    assert score.report()["returns"] == [one.total for one in expected]


def test_each_kind_in_the_table_is_recognised():
    env = smpl.Env("reactor")
    names = ("controller", "Stable-Baselines3", "d3rlpy", "rows", "RLlib", "function")
    for kind, name in zip(KINDS, names, strict=True):
        assert isinstance(as_policy(POLICIES[name](env)), kind.adapter), name
    with pytest.raises(TypeError, match="controller is the class Proportional, expected an object with reset"):
        as_policy(Proportional)
    with pytest.warns(DeprecationWarning, match=r"use smpl\.policies\.as_policy"):
        assert smpl.controllers.as_player is as_policy


@pytest.fixture
def torch(monkeypatch):
    """The random generator of torch, which need not be installed: NumPy's under its names."""
    generator = [np.random.default_rng(0)]

    def manual_seed(seed):
        generator[0] = np.random.default_rng(seed)

    def set_rng_state(state):
        generator[0].bit_generator.state = state

    found = SimpleNamespace(
        manual_seed=manual_seed, get_rng_state=lambda: generator[0].bit_generator.state, set_rng_state=set_rng_state,
        equal=lambda one, other: one == other, rand=lambda *shape: generator[0].uniform(size=shape),
    )  # fmt: skip
    monkeypatch.setitem(sys.modules, "torch", found)
    return found


class Sampling:
    """A policy with a row for each observation that draws its actions."""

    def __init__(self, torch):
        self.torch = torch

    def predict(self, observations):
        return self.torch.rand(len(observations), 2) - 0.5


@pytest.mark.parametrize("kind", [Sampling, lambda torch: lambda seen: torch.rand(2) - 0.5])
def test_a_policy_that_draws_scores_the_same_in_evaluation_and_in_the_command(kind, torch):
    expected = [one.total for one in evaluate(smpl.Env("reactor", max_steps=20), kind(torch), 5, seed=4)]
    assert len(set(expected)) == 5
    for workers in (1, 2):
        found = compare_controllers("reactor", [kind(torch)], 5, seed=4, workers=workers, max_steps=20)[1][0].report()
        assert found["returns"] == expected
    alone = run_episode(smpl.Env("reactor", max_steps=20), kind(torch), 6)
    assert alone.total == expected[2]
