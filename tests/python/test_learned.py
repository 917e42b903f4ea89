"""Runs of the benchmark that learn: every algorithm by name, resumed to the bit, skipped without its package."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

import smpl
from smpl.benchmark import benchmark, main, runs
from smpl_benchmarks.training import COLUMNS, curve, diverged, learn
from tank import DRAWN

NAMES = {
    "offline": (
        *("BC", "PLAS", "PLASWithPerturbation", "AWAC", "TD3", "BEAR", "BCQ", "SAC", "DDPG", "CQL"),
        *("TD3PlusBC", "IQL", "CalQL", "ReBRAC", "MOPO", "COMBO"),
    ),
    "online": (
        *("PPO", "A2C", "SAC", "TD3", "DDPG", "ARS", "TQC", "CrossQ", "RecurrentPPO", "SHAC", "DiffNMPC"),
        *("RLlib-PPO", "RLlib-IMPALA", "RLlib-APPO", "RLlib-SAC"),
        *("PG-2022", "A3C-2022", "ARS-2022", "DDPG-2022", "IMPALA-2022", "PPO-2022", "SAC-2022"),
    ),
}


class Counting:
    """A trainer whose state is a number; it may die in the middle of a segment."""

    def __init__(self, dies_in=None):
        self.value, self.dies_in, self.began = 0, dies_in, 0

    def begin(self, seed):
        self.value, self.began = seed, self.began + 1

    def load(self, folder):
        self.value = json.loads((folder / "value.json").read_text())

    def train(self, steps, seed, progress):
        self.value = (self.value * 31 + seed + steps) % 1_000_003
        if self.dies_in is not None and progress >= self.dies_in:
            raise KeyboardInterrupt

    def save(self, folder):
        (folder / "value.json").write_text(json.dumps(self.value))

    def export(self, folder):
        (folder / "policy.zip").write_text(json.dumps(self.value))
        return "PPO:policy.zip"


def test_a_run_that_was_cut_off_ends_as_one_that_was_not(tmp_path):
    def validate(policy):
        value = json.loads(Path(policy.removeprefix("PPO:")).read_text())
        return -float(value % 97), float(value % 97), 0  # the best return has the worst mean of steps

    whole, parts = tmp_path / "whole", tmp_path / "parts"
    whole.mkdir()
    parts.mkdir()
    assert learn(Counting(), whole, 103, 5, 3, validate) == "PPO:policy.zip"
    with pytest.raises(KeyboardInterrupt):
        learn(Counting(dies_in=0.5), parts, 103, 5, 3, validate)
    assert len(curve(parts)) == 3
    (parts / ".checkpoint.tmp").mkdir()  # as if it had died while it wrote
    again = Counting()
    learn(again, parts, 103, 5, 3, validate)
    assert again.began == 0
    scores = [row["return_mean"] for row in curve(whole)]
    assert scores == [row["return_mean"] for row in curve(parts)] and [row["steps"] for row in curve(parts)][-1] == 103
    assert (whole / "policy.zip").read_text() == (parts / "policy.zip").read_text()
    assert float(json.loads((whole / "policy.zip").read_text()) % 97) == max(scores)
    assert (parts / "checkpoint-5").is_dir() and not (parts / "checkpoint-4").exists()
    assert tuple(curve(whole)[0]) == COLUMNS


@pytest.mark.parametrize("where", ["train", "validate"])
def test_a_learner_that_diverges_ends_its_run_with_the_best_policy_until_then(where, tmp_path):
    scored = []

    def validate(policy):
        if where == "validate" and len(scored) == 2:
            raise ValueError("the action is not finite")
        scored.append(Path(policy.removeprefix("PPO:")).read_text())
        return 0.0, float(len(scored)), 0

    class Diverging(Counting):
        def train(self, steps, seed, progress):
            super().train(steps, seed, progress)
            if where == "train" and progress >= 0.4:
                raise ValueError("found invalid values:\ntensor([[nan, nan]])")

    with pytest.warns(UserWarning, match="diverged in segment 3 of 5: "):
        assert learn(Diverging(), tmp_path, 103, 5, 3, validate) == "PPO:policy.zip"
    assert diverged(tmp_path) == 3 and len(curve(tmp_path)) == 2
    assert (tmp_path / "policy.zip").read_text() == scored[1]
    # It is over: nothing is trained when the run is asked for again.
    assert learn(Diverging(), tmp_path, 103, 5, 3, validate) == "PPO:policy.zip" and len(scored) == 2


def test_a_learner_that_diverges_at_once_has_no_policy(tmp_path):
    def validate(policy):
        raise ValueError("the action is not finite")

    with pytest.raises(ValueError, match="not finite"):
        learn(Counting(), tmp_path, 103, 5, 3, validate)
    assert diverged(tmp_path) is None


def test_every_algorithm_of_the_paper_and_beyond_has_runs():
    pytest.importorskip("yaml")
    every = runs("all", "short", "Beer", 3)
    for suite, names in NAMES.items():
        assert {one.controller for one in every if one.suite == suite} == set(names)
    for one in every:
        assert one.suite == "control" or one.settings["steps"] > 0
    assert {one.settings["steps"] for one in every if (one.suite, one.controller) == ("online", "PPO")} == {1_200_000}


def test_the_training_reward_of_short_horizons_equals_the_reward_of_the_reactor():
    pytest.importorskip("yaml")
    (one,) = runs("online", "short", "Reactor", 1, ["SHAC"])
    hyper = one.settings["hyperparameters"]
    env = smpl.Env("reactor", scenario="legacy", extra=hyper["extra"], reward=hyper["reward"])
    for seed in range(3):
        env.reset(seed=seed)
        for k in range(30):
            _, reward, terminated, _, info = env.step(np.array([0.3 * (-1) ** k, 0.1], dtype=np.float32))
            if terminated:
                break
            assert reward == info["rewards"]["setpoint"]


def test_algorithms_of_2022_have_the_steps_of_their_kind():
    pytest.importorskip("yaml")
    for env in ("Reactor", "MAb"):
        steps = {one.controller: one.settings["steps"] for one in runs("online", "short", env, 1)}
        assert steps["DDPG-2022"] == steps["SAC-2022"] == steps["DDPG"] == steps["SAC"]
        assert steps["A3C-2022"] == steps["IMPALA-2022"] == steps["RLlib-PPO"]


def test_slow_processes_have_smaller_budgets_and_rollouts_that_fit_them():
    pytest.importorskip("yaml")
    for env in ("Reactor", "Beer", "PenSim", "Atropine", "MAb", "MAbPlant"):
        for one in runs("online", "short", env, 1, ["PPO", "A2C", "RecurrentPPO"]):
            rollout = one.settings["hyperparameters"]["n_steps"] * one.settings["num_envs"]
            # A segment is whole rollouts: with a longer one it would run over its share of the steps.
            assert rollout <= one.settings["steps"] / one.settings["segments"], (env, one.controller)
    (plant,) = runs("offline", "short", "MAbPlant", 1, ["BC"])
    (reactor,) = runs("offline", "short", "Reactor", 1, ["BC"])
    assert (plant.settings["validation"], plant.settings["data"]["episodes"]) == (1, 20)
    assert (reactor.settings["validation"], reactor.settings["data"]["episodes"]) == (50, 200)
    (smoke,) = runs("offline", "smoke", "MAbPlant", 1, ["BC"])
    assert (smoke.settings["validation"], smoke.settings["data"]["episodes"]) == (2, 4)


@pytest.mark.parametrize(
    ("suite", "algorithm", "packages"),
    [
        ("offline", "BC", ("d3rlpy", "pyarrow")),
        ("online", "PPO", ("stable_baselines3",)),
        ("online", "RLlib-PPO", ("ray",)),
    ],
)
def test_a_model_of_ones_own_is_learned_and_tuned(suite, algorithm, packages, tmp_path):
    for package in ("yaml", *packages):
        pytest.importorskip(package)
    path = tmp_path / "tank.eq"
    path.write_text(DRAWN, encoding="utf-8")
    (row,) = benchmark(tmp_path / "runs", suite, env=str(path), algorithms=[algorithm])["rows"]
    assert row["env"] == "Tank" and "skipped" not in row and row["episodes"] == 4
    if algorithm == "PPO":
        pytest.importorskip("optuna")
        words = ["--env", str(path), "--algorithm", "PPO", "--budget", "smoke", "--trials", "1", "--steps", "64"]
        assert main(["tune", *words, "--study", str(tmp_path / "study"), "--out", str(tmp_path / "tuned.yaml")]) == 0
        (one,) = runs(suite, "smoke", str(path), 1, ["PPO"], tmp_path / "tuned.yaml")
        assert one.settings == runs(suite, "smoke", str(path), 1, ["PPO"])[0].settings  # trial 0 changes nothing


@pytest.mark.parametrize("algorithm", NAMES["offline"])
def test_each_offline_algorithm_trains_on_every_kind_of_process(algorithm, tmp_path):
    for package in ("yaml", "d3rlpy", "pyarrow"):
        pytest.importorskip(package)
    table = benchmark(tmp_path, "offline", env="Beer", algorithms=[algorithm], workers=1)
    (row,) = table["rows"]
    if algorithm in ("MOPO", "COMBO") and "SMPL_OFFLINE_2022" in row.get("skipped", ""):
        pytest.skip(row["skipped"])
    assert "skipped" not in row and row["episodes"] == 8 and np.isfinite(row["mean"])
    folder = tmp_path / "offline" / "Beer" / algorithm / "seed-0"
    assert {one.name for one in folder.iterdir()} >= {"configuration.json", "curve.csv", "scores.json"}
    assert [one.name for one in folder.glob("policy.*")]
    assert len(curve(folder)) == 2


def test_offline_algorithms_learn_inside_of_a_formulation(tmp_path):
    for package in ("yaml", "d3rlpy", "pyarrow"):
        pytest.importorskip(package)
    from smpl.datasets import load

    (row,) = benchmark(tmp_path, "offline", env="PenSim", algorithms=["BC"], workers=1)["rows"]
    assert np.isfinite(row["mean"])
    folder = tmp_path / "offline" / "PenSim" / "BC" / "seed-0"
    assert json.loads((folder / "formulation.json").read_text())["centre"] == "recipe"
    (data,) = (tmp_path / "data").iterdir()
    discharge = np.concatenate([one.details.physical[:, 0] for one in load(data)])
    feed = np.concatenate([one.details.physical[:, 1] for one in load(data)])
    assert np.ptp(discharge) == 0 and len(np.unique(feed)) > 50  # what is left to the recipe, and what is learned


@pytest.mark.parametrize("algorithm", NAMES["online"])
def test_each_online_algorithm_trains(algorithm, tmp_path):
    others = ("ray",) if algorithm.startswith("RLlib") else ("stable_baselines3", "sb3_contrib")
    derived = {"SHAC": ("torch",), "DiffNMPC": ("casadi",)}
    for package in ("yaml", *derived.get(algorithm, others)):
        pytest.importorskip(package)
    table = benchmark(tmp_path, "online", env="Reactor", algorithms=[algorithm], workers=1)
    (row,) = table["rows"]
    if "SMPL_ONLINE_2022" in row.get("skipped", ""):
        pytest.skip(row["skipped"])
    assert "skipped" not in row and row["episodes"] == 8 and np.isfinite(row["mean"])
    folder = tmp_path / "online" / "Reactor" / algorithm / "seed-0"
    assert algorithm == "DiffNMPC" or json.loads((folder / "formulation.json").read_text())["reach"]


@pytest.mark.parametrize(
    ("suite", "algorithm", "package"),
    [
        ("offline", "TD3PlusBC", "d3rlpy"),
        ("online", "PPO", "stable_baselines3"),
        ("online", "SAC", "stable_baselines3"),
        ("online", "SHAC", "torch"),
        ("online", "DiffNMPC", "casadi"),
    ],
)
def test_a_learned_run_that_was_cut_off_ends_in_the_same_bits(suite, algorithm, package, tmp_path, monkeypatch):
    pytest.importorskip("yaml")
    pytest.importorskip(package)
    arguments = {"env": "Reactor", "algorithms": [algorithm], "workers": 1}
    benchmark(tmp_path / "whole", suite, **arguments)
    import smpl_benchmarks.training as training

    follow = training._follow

    def dies(trainer, folder, state, number, *more):
        if number == 1:
            raise KeyboardInterrupt  # trained and saved, but not yet counted
        follow(trainer, folder, state, number, *more)

    monkeypatch.setattr(training, "_follow", dies)
    with pytest.raises(KeyboardInterrupt):
        benchmark(tmp_path / "parts", suite, **arguments)
    monkeypatch.undo()
    benchmark(tmp_path / "parts", suite, resume=True, **arguments)
    place = f"{suite}/Reactor/{algorithm}/seed-0"
    whole, parts = (json.loads((tmp_path / one / place / "scores.json").read_text()) for one in ("whole", "parts"))
    assert whole["returns"] == parts["returns"]
    # The time of what was trained before is not lost.
    seconds = sum(row["seconds"] for row in curve(tmp_path / "parts" / place))
    assert parts["training_seconds"] == pytest.approx(seconds) and parts["seconds"] > seconds
    curves = [[row["mean"] for row in curve(tmp_path / which / place)] for which in ("whole", "parts")]
    assert curves[0] == curves[1]


def test_a_suite_without_its_package_is_skipped_by_name(tmp_path, monkeypatch, capsys):
    pytest.importorskip("yaml")
    monkeypatch.setitem(sys.modules, "d3rlpy", None)
    monkeypatch.setitem(sys.modules, "sb3_contrib", None)
    given = ["--env", "Reactor", "--algorithm", "CQL", "--algorithm", "TQC", "--out", str(tmp_path), "--quiet"]
    assert main(["--suite", "all", *given]) == 0
    printed = capsys.readouterr().out
    assert "CQL" in printed and "pip install 'd3rlpy!=2.8.1'" in printed
    assert "TQC" in printed and "pip install sb3-contrib" in printed
    monkeypatch.setitem(sys.modules, "yaml", None)
    assert main(["--suite", "online", *given]) == 1
    assert "pip install pyyaml" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("processes: {Rector: {}}", "processes.*'Rector'"),
        ("processes: {Reactor: {formulations: {}}}", "processes.Reactor.*'formulations'"),
        ("processes: {Reactor: {formulation: {centre: pid, reach: 2}}}", "reach is 2"),
        ("processes: {Reactor: {algorithms: {online: {PPO: {n_stepz: 3}}}}}", "PPO has no hyperparameter n_stepz"),
        (
            "processes: {Reactor: {algorithms: {online: {PPO: {gamma: high}}}}}",
            "PPO: gamma is 'high', expected a number as its default, 0.99",
        ),
        ("processes: {Reactor: {curriculum: {spread: [[0.0, 0.3, 0.1]]}}}", "curriculum.*expected low <= high"),
        ("budgets: {smoke: {segments: 0}}", "segments is 0"),
        ("processes: {Reactor: {sizes: {short: {steps: 3}}}}", "processes.Reactor.sizes.short.*'steps'"),
        ("processes: {Reactor: {scaler: {action: min_max}}}", "processes.Reactor.*'scaler'"),
        ("- 1", "expected a mapping"),
        ("a: [", "configuration"),
    ],
)
def test_a_configuration_that_cannot_be_meant_is_told(text, says, tmp_path):
    pytest.importorskip("yaml")
    if "PPO: {" in text:
        pytest.importorskip("stable_baselines3")
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=says):
        benchmark(tmp_path / "out", "online", env="Reactor", algorithms=["PPO"], config=path)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("data: {noise: -1}", "data.noise is -1.0, expected a number that is not negative"),
        ("data: {noise: much}", "data.noise is 'much'"),
        ("data: {episodes: 0}", "data.episodes is 0"),
        ("scalers: {actions: min_max}", "scalers.*'actions'"),
        ("scalers: {action: standard}", r"scalers\['action'\] is 'standard'; there are: min_max"),
        ("data: {controller: pdi}", "controller is 'pdi'; Reactor has: "),
    ],
)
def test_what_a_data_set_cannot_be_is_told_before_anything_runs(text, says, tmp_path):
    pytest.importorskip("yaml")
    (tmp_path / "mine.yaml").write_text(f"processes: {{Reactor: {{{text}}}}}")
    with pytest.raises(ValueError, match=says):
        runs("offline", "smoke", "Reactor", 1, config=tmp_path / "mine.yaml")


def test_a_users_configuration_changes_what_is_run(tmp_path):
    pytest.importorskip("yaml")
    path = tmp_path / "mine.yaml"
    path.write_text("processes: {Beer: {steps: {short: {on_policy: 7}}, algorithms: {online: {PPO: {gamma: 0.5}}}}}")
    (one,) = runs("online", "short", "Beer", 1, ["PPO"], path)
    (plain,) = runs("online", "short", "Beer", 1, ["PPO"])
    assert one.settings["steps"] == 7 and one.settings["hyperparameters"]["gamma"] == 0.5
    assert plain.settings["hyperparameters"]["n_steps"] == one.settings["hyperparameters"]["n_steps"]


def test_the_policy_of_a_run_is_evaluated_with_its_formulation(tmp_path):
    for package in ("yaml", "stable_baselines3"):
        pytest.importorskip(package)
    from smpl.learning import Plan, Task
    from smpl.learning.scores import score

    benchmark(tmp_path, "online", env="Reactor", algorithms=["PPO"], workers=1)
    folder = tmp_path / "online/Reactor/PPO/seed-0"
    scores = json.loads((folder / "scores.json").read_text())
    task = Task.of("smpl/Reactor-v0", scenario="legacy", reward="setpoint_change", max_steps=20)
    found = score(Plan.of(task, f"PPO:{folder / 'policy.zip'}", 8, seed=0), 1)
    assert found.returns.tolist() == scores["returns"]
    bare = tmp_path / "bare"
    bare.mkdir()
    shutil.copy(folder / "policy.zip", bare)
    # The policy itself keeps its formulation: its file is enough.
    other = score(Plan.of(task, f"PPO:{bare / 'policy.zip'}", 8, seed=0), 1)
    assert other.returns.tolist() == scores["returns"]


def test_scalers_are_fitted_to_the_data_and_saved_with_the_policy(tmp_path):
    for package in ("d3rlpy", "pyarrow"):
        pytest.importorskip(package)
    import d3rlpy

    from smpl.datasets import collect
    from smpl.learning.formulation import Formulation
    from smpl_benchmarks.offline import D3rlpyTrainer

    data = collect("atropine", "nominal", 3, tmp_path / "data", noise=0.01, max_steps=8)
    seen = np.concatenate([episode.observations[:-1] for episode in data])
    policies = []
    for scalers in ({}, {"observation": "standard", "action": "min_max"}):
        trainer = D3rlpyTrainer("BC", data, Formulation(), {"batch_size": 8}, scalers)
        trainer.begin(0)
        trainer.train(3, 1, 0.0)
        trainer.export(tmp_path)
        policies.append(d3rlpy.load_learnable(str(tmp_path / "policy.d3")))
    plain, scaled = policies
    assert plain.config.observation_scaler is None
    np.testing.assert_allclose(scaled.config.observation_scaler.mean, seen.mean(axis=0), rtol=1e-4, atol=1e-6)
    actions = np.concatenate([episode.actions for episode in data])
    # Its actions lie within those of the data, whose noise takes a part of the box; the plain one knows no such box.
    far = np.random.default_rng(0).uniform(-1, 1, (50, seen.shape[1])).astype(np.float32)
    assert np.all(np.abs(scaled.predict(far)) <= np.maximum(1e-3, np.abs(actions).max(axis=0)) + 1e-6)
    for wrong, says in (({"actions": "min_max"}, "scalers.*'actions'"), ({"action": "standard"}, "there are: min_max")):
        with pytest.raises(ValueError, match=says):
            D3rlpyTrainer("BC", data, Formulation(), {}, wrong)


def test_batches_are_those_of_d3rlpy(tmp_path):
    for package in ("d3rlpy", "pyarrow"):
        pytest.importorskip(package)
    from dataclasses import fields

    import d3rlpy

    from smpl.datasets import collect, to_d3rlpy
    from smpl_benchmarks.offline import Batches

    # Random actions end episodes by failure, others by the limit of steps.
    data = to_d3rlpy(collect("reactor", "random", 20, tmp_path / "data", max_steps=12))
    assert 0 < sum(episode.terminated for episode in data.episodes) < 20
    batches = Batches(data)
    d3rlpy.seed(5)
    theirs = [data.sample_transition_batch(size) for size in (1, 256, 100)]
    d3rlpy.seed(5)
    for their, size in zip(theirs, (1, 256, 100), strict=True):
        ours = batches(size)
        for column in (field.name for field in fields(their) if field.name != "transitions"):
            np.testing.assert_array_equal(getattr(ours, column), getattr(their, column))
            assert getattr(ours, column).dtype == getattr(their, column).dtype
        for one, other in zip(ours.transitions, their.transitions, strict=True):
            np.testing.assert_array_equal(one.rewards_to_go, other.rewards_to_go)
