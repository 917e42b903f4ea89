"""Conventions of environments: of Gymnasium, and of packages that rely on it."""

import json
import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import smpl
from conftest import ENVIRONMENTS


def test_the_environments_of_all_shipped_models_are_registered():
    assert {"smpl/Reactor-v0", "smpl/Beer-v0"} <= set(ENVIRONMENTS)


def test_check_env_finds_nothing_to_complain_about(identifier):
    env = gymnasium.make(identifier)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


def test_every_model_says_what_is_measured_online_and_every_level_is_observed(identifier):
    levels = gymnasium.make(identifier).unwrapped.model.levels
    assert {"default", "online", "full"} <= set(levels)
    for level in levels:
        env = gymnasium.make(identifier, observation=level)
        env.action_space.seed(0)
        observation, _ = env.reset(seed=0)
        assert env.observation_space.contains(observation), level
        observation = env.step(env.action_space.sample())[0]
        assert env.observation_space.contains(observation), level


def test_a_sample_of_the_reactor_is_taken_every_five_steps_and_known_three_later():
    env = smpl.Env("reactor", normalize=False, observation="laboratory")
    position = env.observation_names.index("c_A")
    env.reset(seed=0)
    seen = [env.step([26.85, 0.1])[0][position] for _ in range(14)]
    changes = [step + 1 for step in range(1, 14) if seen[step] != seen[step - 1]]
    assert changes == [8, 13]


@pytest.mark.parametrize("normalize", [True, False])
def test_the_passive_checks_of_make_pass_in_both_units(identifier, normalize):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(identifier, normalize=normalize)
        env.reset(seed=0)
        env.action_space.seed(0)
        for _ in range(3):
            _, _, terminated, truncated, _ = env.step(env.action_space.sample())
            if terminated or truncated:
                env.reset()
        env.close()
        env.close()


def test_registering_twice_changes_nothing_and_warns_of_nothing():
    before = dict(gymnasium.registry)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        smpl.register_envs()
    assert dict(gymnasium.registry) == before


def test_a_specification_can_be_written_as_json_and_made_again(identifier):
    specification = gymnasium.make(identifier, max_steps=7).spec
    assert specification.max_episode_steps is None
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(specification.to_json()))
    assert again.unwrapped.max_steps == 7
    json.loads(specification.to_json())


def test_the_id_with_the_module_needs_no_import():
    code = "import gymnasium; print(gymnasium.make('smpl:smpl/Reactor-v0').reset(seed=0)[0].shape)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "(3,)"


def test_observations_are_single_precision_inside_their_space(identifier):
    env = gymnasium.make(identifier, normalize=False).unwrapped
    observation, _ = env.reset(seed=1)
    assert observation.dtype == np.float32
    assert env.observation_space.contains(observation)


def test_info_has_the_same_keys_and_shapes_at_every_step(identifier):
    env = gymnasium.make(identifier, info_state=True).unwrapped
    _, first = env.reset(seed=0)
    _, _, _, _, second = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    expected = {"time", "failure", "success", "success_name", "constraints", "cost", "rewards", "state"}
    expected |= {"phase"} if env.model.phases else set()
    assert expected == set(first) == set(second)
    for key in ("constraints", "rewards"):
        assert list(first[key]) == list(second[key])
    assert first["state"].shape == second["state"].shape == (len(env.state_names),)
    assert isinstance(first["failure"], str) and isinstance(first["success"], bool)
    assert second["cost"] == pytest.approx(sum(second["constraints"].values()))


def test_stable_baselines3_checker_passes(identifier):
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="stable-baselines3 is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(gymnasium.make(identifier).unwrapped)


def test_a_file_of_ones_own_is_registered_like_any_environment(tmp_path):
    file = tmp_path / "own.eq"
    file.write_text(
        "model Own\nstate x = 1 in 0..2\naction u = 0 in 0..1\neq d/dt x = (u - x) / 1 [s]\n"
        "observe x\nreward r default = x\n"
    )
    gymnasium.register(
        "own/Own-v0",
        entry_point="smpl.envs:Env",
        vector_entry_point="smpl.vector:VectorEnv",
        kwargs={"model": str(file)},
    )
    try:
        env = gymnasium.make("own/Own-v0", normalize=False)
        env.reset(seed=0)
        observation = env.step(np.zeros(1))[0]
        assert observation[0] == pytest.approx(np.exp(-1), rel=1e-6)
        venv = gymnasium.make_vec("own/Own-v0", num_envs=3, vectorization_mode="vector_entry_point")
        assert venv.reset(seed=0)[0].shape == (3, 1)
    finally:
        gymnasium.registry.pop("own/Own-v0")
