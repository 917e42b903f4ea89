"""Policies and the formulation that they were trained in: saved together, evaluated together, refused apart."""

import json
import pickle
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import smpl
import smpl.learning.policy_files
from smpl.evaluation import run_episode
from smpl.learning import agent, save_policy
from smpl.learning.environments import Formulated, FormulatedVectorEnv
from smpl.learning.formulation import FormulatedPolicy, LearnedBox
from smpl.policies import Rows

PID = {"centre": "pid", "reach": 0.5}


class Centred:
    """A policy of zeros that keeps its spaces, as those of Stable-Baselines3 do, which need not be installed."""

    def __init__(self, env):
        self.observation_space = getattr(env, "single_observation_space", env.observation_space)
        self.action_space = getattr(env, "single_action_space", env.action_space)

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        assert observation.shape[-len(self.observation_space.shape) :] == self.observation_space.shape
        return np.zeros((*observation.shape[:-1], *self.action_space.shape), dtype=np.float32), None

    def save(self, path):
        Path(path).write_bytes(pickle.dumps(self))


@pytest.fixture(autouse=True)
def _files(monkeypatch):
    def load(algorithm, file):
        assert algorithm == "PPO"
        return pickle.loads(Path(file).read_bytes())

    monkeypatch.setitem(smpl.learning.policy_files.FILES, ".zip", load)


def untrained(env):
    return Centred(env)


def formulated(given, **arguments):
    return Formulated(gymnasium.make("smpl:smpl/Reactor-v0", **arguments), given)


def score(file, out, *controllers):
    from smpl.evaluate import main

    names = [word for one in controllers for word in ("--controller", one)]
    return main(["reactor", "--policy", f"PPO:{file}", *names, "--episodes", "2", "--out", str(out)])


def test_a_policy_is_evaluated_in_the_formulation_that_it_was_saved_with(tmp_path):
    env = formulated(PID)
    file = save_policy(untrained(env), tmp_path / "ppo.zip", env)
    written = json.loads((tmp_path / "ppo.formulation.json").read_text())
    assert written["centre"] == "pid"
    assert written["environment"] == {"observations": ["c_A", "T", "h"], "actions": ["T_c", "q_out"]}
    found = agent(f"PPO:{file}", env.unwrapped.model)
    assert isinstance(found.chooser, FormulatedPolicy)
    # A policy of zeros does what its centre, the proportional controller, does.
    base = smpl.Env(env.unwrapped.model)
    observation, _ = base.reset(seed=1)
    pid = agent("pid", base.model)
    rows = Rows(base, observation[None], base.state[None], np.array([0]), [{"seed": 1}])
    np.testing.assert_allclose(found.act(rows), pid.act(rows), atol=1e-6)


def test_a_policy_of_stable_baselines_carries_its_formulation_alone(tmp_path):
    env = formulated(PID)
    assert isinstance(env.action_space, LearnedBox)
    untrained(env).save(tmp_path / "bare.zip")
    found = agent(f"PPO:{tmp_path / 'bare.zip'}", env.unwrapped.model)
    assert isinstance(found.chooser, FormulatedPolicy)
    batch = FormulatedVectorEnv("reactor", 2, formulation=PID, autoreset_mode="same_step")
    untrained(batch).save(tmp_path / "batch.zip")
    assert isinstance(agent(f"PPO:{tmp_path / 'batch.zip'}", batch.model).chooser, FormulatedPolicy)


def test_the_command_runs_it_there(tmp_path):
    env = formulated({**PID, "history": 2})
    save_policy(untrained(env), tmp_path / "ppo.zip", env)
    assert score(tmp_path / "ppo.zip", tmp_path / "a", "pid") == 0
    found = json.loads((tmp_path / "a" / "report.json").read_text())["controllers"]
    assert found["ppo"]["mean"] == pytest.approx(found["pid"]["mean"], rel=1e-4)


def test_two_formulations_of_one_policy_are_refused(tmp_path):
    env = formulated(PID)
    untrained(env).save(tmp_path / "ppo.zip")
    (tmp_path / "formulation.json").write_text('{"centre": "nominal"}')
    with pytest.raises(ValueError, match=r"was trained in another formulation than the one that is next to it"):
        agent(f"PPO:{tmp_path / 'ppo.zip'}", env.unwrapped.model)


def test_a_policy_whose_shapes_are_those_of_another_formulation_is_refused(tmp_path, capsys):
    plain = gymnasium.make("smpl:smpl/Reactor-v0")
    wide = gymnasium.wrappers.FrameStackObservation(plain, 3)
    untrained(gymnasium.wrappers.FlattenObservation(wide)).save(tmp_path / "wide.zip")
    made = agent(f"PPO:{tmp_path / 'wide.zip'}", plain.unwrapped.model)
    env = smpl.Env(plain.unwrapped.model)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"takes observations of shape \(9,\).*save_policy\(policy, path, env\)"):
        made.check(env)
    assert score(tmp_path / "wide.zip", tmp_path / "b") == 1
    assert "takes observations of shape (9,)" in capsys.readouterr().err
    with pytest.raises(ValueError, match=r"FlattenObservation changes observations"):
        save_policy(
            untrained(gymnasium.wrappers.FlattenObservation(wide)),
            tmp_path / "x.zip",
            gymnasium.wrappers.FlattenObservation(wide),
        )


def test_a_policy_is_not_run_outside_of_its_formulation(tmp_path):
    env = formulated(PID)
    policy = untrained(env)
    assert run_episode(env, policy, 1).steps > 0
    with pytest.raises(ValueError, match=r"was trained in the formulation .*'centre': 'pid'"):
        run_episode(gymnasium.make("smpl:smpl/Reactor-v0"), policy, 1)


def test_a_policy_of_another_level_or_model_is_refused(tmp_path):
    env = formulated(PID)
    file = save_policy(untrained(env), tmp_path / "ppo.zip", env)
    with pytest.raises(ValueError, match=r"was trained on the observations c_A, T, h; .* \(level 'online'\) has T, h"):
        agent(f"PPO:{file}", smpl.compile("reactor", observation="online"))


def test_physical_and_scaled_actions_are_not_mixed(tmp_path):
    physical = gymnasium.make("smpl:smpl/Reactor-v0", normalize=False)
    file = save_policy(untrained(physical), tmp_path / "ppo.zip", physical)
    made = agent(f"PPO:{file}", physical.unwrapped.model)
    env = smpl.Env(physical.unwrapped.model)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"gives actions in physical units; .* takes them in \[-1, 1\]"):
        made.check(env)


@pytest.mark.parametrize(
    "trained, other, message",
    [
        ({"normalize": "nominal"}, {}, r"trained with normalize='nominal', .* has normalize=True: .*normalize nominal"),
        ({}, {"normalize": "nominal"}, r"trained with normalize=True, .* has normalize='nominal'"),
        ({}, {"settings": {"step": 0.2}}, r"trained with steps of 0.1 min, .* has 0.2 min"),
        ({}, {"extra": "variant w { action T_c : degC = 26.85 in 15..40 }", "variants": ["w"]},
         r"trained with action_high\['T_c'\] = 35, .* has 40"),
    ],
)  # fmt: skip
def test_another_scale_bounds_or_interval_than_in_training_are_refused(tmp_path, trained, other, message):
    env = smpl.Env("reactor", **trained)
    file = save_policy(untrained(env), tmp_path / "ppo.zip", env)
    same, another = smpl.Env("reactor", **trained), smpl.Env("reactor", **other)
    for one in (same, another):
        one.reset(seed=0)
    agent(f"PPO:{file}", same.model).check(same)
    with pytest.raises(ValueError, match=message):
        agent(f"PPO:{file}", another.model).check(another)


def test_the_scale_beneath_a_formulation_does_not_matter(tmp_path):
    env = formulated(PID)
    file = save_policy(untrained(env), tmp_path / "ppo.zip", env)
    nominal, physical = smpl.Env("reactor", normalize="nominal"), smpl.Env("reactor", normalize=False)
    for one in (nominal, physical):
        one.reset(seed=0)
    agent(f"PPO:{file}", nominal.model).check(nominal)
    with pytest.raises(ValueError, match="trained with normalize=True"):
        agent(f"PPO:{file}", physical.model).check(physical)


def test_a_formulation_next_to_an_exported_policy_is_not_for_it(tmp_path):
    """The exported file has its formulation inside."""
    env = formulated(PID)
    save_policy(untrained(env), tmp_path / "ppo.zip", env)
    assert (tmp_path / "ppo.formulation.json").is_file()
    plain = smpl.Env("reactor")
    smpl.deploy.export_policy("lqr", plain, "c", tmp_path / "ppo.c")
    found = agent(str(tmp_path / "ppo.c"), plain.model)
    plain.reset(seed=0)
    found.check(plain)
    assert type(found.chooser).__name__ == "Artefact"


def test_what_cannot_be_saved_is_refused(tmp_path):
    env = formulated(PID)
    with pytest.raises(ValueError, match="expected a file that ends in"):
        save_policy(untrained(env), tmp_path / "ppo.pkl", env)
    with pytest.raises(TypeError, match="expected an environment of smpl"):
        save_policy(untrained(env), tmp_path / "ppo.zip", gymnasium.make("Pendulum-v1"))
    with pytest.raises(TypeError, match="expected an object with save"):
        save_policy(print, tmp_path / "ppo.zip", env)
