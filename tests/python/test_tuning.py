"""Searching hyperparameters: what is proposed, what is stopped, what is written."""

import json
import sys
import time
from dataclasses import replace

import pytest

from smpl.benchmark import main, runs
from smpl_benchmarks import configuration
from smpl_benchmarks.tuning import Search, Trial, best, tune, write
from tank import TANK

yaml = pytest.importorskip("yaml")
SPACE = {"x": {"low": 0.0, "high": 1.0}, "n": {"low": 1, "high": 9}, "net": [[64, 64], [32], None]}
SEARCH = Search("online", "Beer", "PPO", "short", 3, 1, 8, {"steps": 5}, SPACE, "abc")


def bowl(changed, report):
    """Highest, 0, where x is 0.25 and n is 4."""
    return -((changed.get("x", 1.0) - 0.25) ** 2) - (changed.get("n", 9) - 4) ** 2 / 100


def test_a_study_that_was_cut_off_ends_as_one_that_was_not(tmp_path):
    pytest.importorskip("optuna")
    whole = tune(SEARCH, tmp_path / "whole.sqlite3", 14, objective=bowl)

    calls = []

    def dies(changed, report):
        calls.append(changed)
        if len(calls) in (1, 6, 11):
            raise KeyboardInterrupt  # in the middle of a trial, which is left as running
        return bowl(changed, report)

    for _ in range(3):
        with pytest.raises(KeyboardInterrupt):
            tune(SEARCH, tmp_path / "parts.sqlite3", 14, objective=dies)
    assert tune(SEARCH, tmp_path / "parts.sqlite3", 14, objective=dies) == whole
    assert [one.number for one in whole] == list(range(14)) and len(calls) == 14 + 3
    assert whole[0].hyperparameters == {} and whole[0].score == bowl({}, None)
    for one in whole[1:]:
        assert 0 <= one.hyperparameters["x"] <= 1 and one.hyperparameters["n"] in range(1, 10)
        assert one.hyperparameters["net"] in SPACE["net"]
        assert one.score == bowl(one.hyperparameters, None)
    # More trials go on from there; as many as there are run nothing.
    assert tune(SEARCH, tmp_path / "whole.sqlite3", 16, objective=bowl)[:14] == whole
    assert len(tune(SEARCH, tmp_path / "whole.sqlite3", 3, objective=None.__class__)) == 16


def test_the_search_finds_what_is_better(tmp_path):
    pytest.importorskip("optuna")
    trials = tune(SEARCH, tmp_path / "study.sqlite3", 40, objective=bowl)
    found = best(trials)
    assert found.score > -0.01 and found.score > trials[0].score
    other = tune(replace(SEARCH, seed=4), tmp_path / "other.sqlite3", 3, objective=bowl)
    assert other[1].hyperparameters != trials[1].hyperparameters


def test_a_trial_behind_the_others_is_stopped_and_one_that_fails_is_told(tmp_path):
    pytest.importorskip("optuna")
    steps = []

    def objective(changed, report):
        if len(steps) == 6:
            steps.append(0)
            raise ValueError("no such batch\nmore")
        steps.append(0)
        for step in range(1, 5):
            steps[-1] = step
            report(step, -100.0 if len(steps) == 6 else 1.0)
        return 1.0

    trials = tune(SEARCH, tmp_path / "study.sqlite3", 8, objective=objective)
    assert [one.ended for one in trials[5:7]] == ["stopped early", "failed: no such batch"]
    assert [one.score for one in trials] == [1.0] * 5 + [None, None, 1.0]
    assert steps == [4, 4, 4, 4, 4, 2, 0, 4]
    assert best(trials).number == 0


def test_a_file_of_another_study_is_refused(tmp_path):
    pytest.importorskip("optuna")
    path = tmp_path / "study.sqlite3"
    tune(SEARCH, path, 1, objective=bowl)
    with pytest.raises(ValueError, match=r"another study \(it differs in: algorithm, seed\)"):
        tune(replace(SEARCH, seed=9, algorithm="A2C"), path, 1, objective=bowl)
    (tmp_path / "text").write_text("this is not a database, but a text of more than a hundred characters " * 9)
    with pytest.raises(ValueError, match="text is not a study"):
        tune(SEARCH, tmp_path / "text", 1, objective=bowl)


def test_what_was_found_is_a_configuration_that_the_benchmark_reads(tmp_path):
    path = tmp_path / "tuned.yaml"
    found = [Trial(0, {}, -3.0, "complete"), Trial(1, {"gamma": 0.5, "net": [3]}, -1.0, "complete")]
    found.append(Trial(2, {"gamma": 0.7}, None, "stopped early"))
    write(replace(SEARCH, env="Reactor", suite="offline", algorithm="BC"), found, "python one", path)
    write(SEARCH, found, "python two --seed 3", path)
    content = yaml.safe_load(path.read_text())
    about = content["tuned"]["Beer"]["online"]["PPO"]
    assert (about["command"], about["trials"], about["stopped_early"]) == ("python two --seed 3", 3, 1)
    assert (about["score"], about["score_before"]) == (-1.0, -3.0)
    assert content["tuned"]["Reactor"]["offline"]["BC"]["command"] == "python one"
    (run,) = runs("online", "short", "Beer", 1, ["PPO"], path)
    (plain,) = runs("online", "short", "Beer", 1, ["PPO"])
    assert run.settings["hyperparameters"] == {**plain.settings["hyperparameters"], "gamma": 0.5, "net": [3]}
    # The best is what was there before: nothing of an earlier study stays.
    write(SEARCH, found[:1], "python three", path)
    (run,) = runs("online", "short", "Beer", 1, ["PPO"], path)
    assert "net" not in run.settings["hyperparameters"]
    (run,) = runs("offline", "short", "Reactor", 1, ["BC"], path)
    assert run.settings["hyperparameters"]["net"] == [3]


def test_what_is_written_has_all_that_a_process_was_tuned_with(tmp_path, monkeypatch):
    (tmp_path / "models").mkdir()
    (tmp_path / "models/tank.eq").write_text(TANK, encoding="utf-8")
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path)
    wording = "formulation: {centre: nominal, reach: 0.5}, segments: {short: 3}, arguments: {reward: height}"
    (tmp_path / "own.yaml").write_text(
        f"processes: {{Own: {{model: models/tank.eq, {wording}, algorithms: {{online: {{PPO: {{gamma: 0.9}}}}}}}}}}\n"
        "algorithms: {online: {PPO: {n_steps: 64}}, offline: {AWAC: {gamma: 0.8}}}\n"
        "budgets: {short: {validation: 7}}\n"
    )
    (tmp_path / "by_path.yaml").write_text(f"processes: {{Tank: {{{wording.partition(', arg')[0]}}}}}\n")
    found = [Trial(0, {}, -3.0, "complete"), Trial(1, {"gamma": 0.5, "batch_size": 64}, -1.0, "complete")]
    absolute = str(tmp_path / "models/tank.eq")
    for env, config, suite, algorithm in (
        ("Own", "own.yaml", "online", "PPO"),
        ("models/tank.eq", "by_path.yaml", "online", "PPO"),
        (absolute, None, "offline", "AWAC"),
    ):
        search = Search.of(env, algorithm, suite=suite, config=config)
        path = tmp_path / f"out/{algorithm}-{search.env}.yaml"
        write(search, found, "python", path)
        model = yaml.safe_load(path.read_text())["processes"][search.env]["model"]
        assert model == (absolute if env == absolute else "../models/tank.eq")
        (before,) = runs(suite, "short", env, 1, [algorithm], config)
        for again in (env, search.env):
            (run,) = runs(suite, "short", again, 1, [algorithm], path)
            hyper = {**before.settings["hyperparameters"], **found[1].hyperparameters}
            assert run == replace(before, settings={**before.settings, "hyperparameters": hyper})
    # If the best trial changes nothing, the configuration is kept.
    write(Search.of("Own", "PPO", config="own.yaml"), found[:1], "python", tmp_path / "out/PPO-Own.yaml")
    (run,) = runs("online", "short", "Own", 1, ["PPO"], tmp_path / "out/PPO-Own.yaml")
    (before,) = runs("online", "short", "Own", 1, ["PPO"], "own.yaml")
    assert run == before and run.settings["hyperparameters"]["gamma"] == 0.9


def test_a_study_without_a_score_writes_nothing(tmp_path):
    with pytest.raises(ValueError, match="no trial has a score: failed: no such batch"):
        write(SEARCH, [Trial(0, {}, None, "failed: no such batch")], "python", tmp_path / "tuned.yaml")
    assert not (tmp_path / "tuned.yaml").exists()


def test_the_packages_own_tuned_hyperparameters_say_how_they_were_found():
    given = configuration.read()
    for env, suites in given["tuned"].items():
        for suite, algorithms in suites.items():
            for algorithm, about in algorithms.items():
                assert f"--env {env} " in about["command"] and f"--algorithm {algorithm}" in about["command"]
                assert about["score"] >= about["score_before"]
                assert given["processes"][env]["algorithms"][suite][algorithm] is not None


def test_every_space_of_the_configuration_can_be_searched():
    given = configuration.read()
    for suite, algorithms in given["spaces"].items():
        for algorithm in algorithms:
            search = Search.of("Reactor", algorithm, suite=suite, budget="smoke")
            assert search.space and search.settings["steps"] > 0 and search.episodes == 2


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--algorithm", "PPP"], "algorithm is 'PPP'; there are: A2C"),
        (["--env", "Bear", "--algorithm", "PPO"], "env is 'Bear'; there are"),
        (["--suite", "control", "--algorithm", "profile"], "suite is 'control', which has no hyperparameters"),
        (["--algorithm", "PG-2022"], "PG-2022 has no space to search; there are: PPO, A2C"),
        (["--algorithm", "PPO", "--steps", "0"], "steps is 0"),
        (["--algorithm", "PPO", "--config", "mine.yaml"], r"spaces.online.PPO.gamma is {'low': 1, 'high': 0}"),
    ],
)
def test_a_search_that_cannot_be_made_is_told_in_a_line(arguments, says, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text("spaces: {online: {PPO: {gamma: {low: 1, high: 0}}}}")
    env = [] if "--env" in arguments else ["--env", "Beer"]
    assert main(["tune", *env, *arguments]) == 1
    error = capsys.readouterr().err
    assert says in error and error.count("\n") == 1


def test_without_optuna_the_command_says_how_to_get_it(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "optuna", None)
    assert main(["tune", "--env", "Beer", "--algorithm", "PPO"]) == 1
    assert "pip install optuna" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("suite", "algorithm", "package"), [("online", "PPO", "sb3"), ("offline", "BC", "d3rlpy")])
def test_the_command_tunes(suite, algorithm, package, tmp_path, capsys):
    for name in ("optuna", "pyarrow", "stable_baselines3" if package == "sb3" else "d3rlpy"):
        pytest.importorskip(name)
    given = ["tune", "--suite", suite, "--env", "Reactor", "--algorithm", algorithm, "--budget", "smoke", "--seeds=2"]
    places = ["--study", str(tmp_path / "study.sqlite3"), "--out", str(tmp_path / "tuned.yaml"), "--workers", "1"]
    assert main([*given, "--trials", "2", *places]) == 0
    assert "trial 0:" in capsys.readouterr().out
    content = yaml.safe_load((tmp_path / "tuned.yaml").read_text())
    about = content["tuned"]["Reactor"][suite][algorithm]
    command = f"python -m smpl.benchmark {' '.join(given)} --trials 2"
    assert about["command"] == command and about["trials"] == 2 and json.dumps(about)
    first = (tmp_path / "tuned.yaml").read_text()
    assert main([*given, "--trials", "2", *places, "--quiet"]) == 0  # nothing is run again
    assert (tmp_path / "tuned.yaml").read_text() == first


def test_no_trial_begins_after_the_time_limit(tmp_path):
    pytest.importorskip("optuna")
    trials = tune(SEARCH, tmp_path / "study.sqlite3", 10**6, objective=lambda *_: time.sleep(0.3) or 1.0, seconds=1.0)
    assert 1 <= len(trials) <= 4
